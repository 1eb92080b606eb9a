#include "common/accuracy/word.h"

#include <math.h>
#include <stdio.h>

#include "common/scene/effects.h"

/* Chosen on even seeds of the scenes of `make accuracy`, checked on the odd ones. The fitted tail index is reported but
 * not used: lights that the camera sees fill the lists, and then it says nothing. */
#define UNSEEN_MAX 1.0
#define DISAGREEMENT_MAX 1.5
#define TOP_SHARE_MAX 0.7
#define SPARSE_MAX 0.3

double word_unseen(const struct accuracy_evidence *evidence, double squared_error)
{
    double one;

    if (!(evidence->effects & EFFECT_CAUSTICS) || !(evidence->brightest > 0) || !(evidence->samples > 0))
        return 0;
    one = evidence->brightest / evidence->samples;
    return squared_error > 0 ? 3 * one * one / squared_error : INFINITY;
}

double accuracy_brightest(const struct scene *scene, double env_strength)
{
    const struct scene_environment *e = &scene->environment;
    double map = e->constant ? 1 : e->brightest > 0 ? (double)e->brightest : INFINITY, brightest = 0;

    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int c = 0; c < 3; c++)
            brightest = fmax(brightest, (double)scene->materials[i].emission[c]);
    for (int c = 0; c < 3 && e->present; c++)
        brightest = fmax(brightest, (double)e->radiance[c] * env_strength * map);
    return brightest;
}

void word_choose(struct accuracy_figures *figures, const struct accuracy_evidence *evidence)
{
    figures->reasons = 0;
    if (figures->unseen > UNSEEN_MAX)
        figures->reasons |= ACCURACY_UNSEEN;
    if (figures->disagreement > DISAGREEMENT_MAX)
        figures->reasons |= ACCURACY_DISAGREE;
    if (figures->top_share > TOP_SHARE_MAX)
        figures->reasons |= ACCURACY_TOP;
    if (figures->lone * figures->dark > SPARSE_MAX)
        figures->reasons |= ACCURACY_SPARSE;
    if (evidence && evidence->tails && figures->tail_index > tail_index_limit((double)evidence->tails->samples))
        figures->reasons |= ACCURACY_TAIL;
    figures->reliable = figures->known && !(figures->reasons & ACCURACY_DISPLAY_REASONS);
}

const char *accuracy_word(const struct accuracy_figures *figures)
{
    return figures->reliable ? "reliable" : "may be understated";
}

int accuracy_rmse_is_reliable(const struct accuracy_figures *figures)
{
    return figures->known && !(figures->reasons & ACCURACY_RMSE_REASONS);
}

const char *accuracy_rmse_word(const struct accuracy_figures *figures)
{
    return accuracy_word(&(struct accuracy_figures){.reliable = accuracy_rmse_is_reliable(figures)});
}

const char *accuracy_cause(uint64_t effects)
{
    static const struct {
        uint64_t all;
        const char *text;
    } causes[] = {
        {EFFECT_CAUSTICS | EFFECT_NESTED_DIELECTRIC | EFFECT_EMISSIVE_MESH,
         "caustics, or lamps inside glass: light that reaches a surface through glass is found by chance only"},
        {EFFECT_CAUSTICS | EFFECT_ENVIRONMENT,
         "caustics of a small sun: light that reaches a surface by several mirrors or faces of glass is found by chance "
         "only"},
        {EFFECT_CAUSTICS,
         "caustics: light that reaches a surface by several mirrors or faces of glass is found by chance only"},
        {EFFECT_MEDIUM, "light that is scattered in a volume"},
        {EFFECT_FOG, "light that is scattered in the fog"},
        {EFFECT_GLOSSY | EFFECT_ENVIRONMENT, "reflections of a small sun on glossy surfaces"},
        {EFFECT_GLOSSY | EFFECT_EMISSIVE_MESH, "reflections of small lamps on glossy surfaces"},
        {EFFECT_ENVIRONMENT, "light that comes in through small openings"},
    };

    for (size_t i = 0; i < sizeof causes / sizeof *causes; i++)
        if ((effects & causes[i].all) == causes[i].all)
            return causes[i].text;
    return "few samples that carry most of the light";
}

static const char *with_cause(const char *why, uint64_t effects, char out[ACCURACY_WORDS_SIZE])
{
    snprintf(out, ACCURACY_WORDS_SIZE, "%s; likely cause: %s", why, accuracy_cause(effects));
    return out;
}

const char *accuracy_reason_text(const struct accuracy_figures *figures, uint64_t effects,
                                 char out[ACCURACY_WORDS_SIZE])
{
    char why[96];

    out[0] = '\0';
    if (figures->reliable)
        return out;
    snprintf(why, sizeof why, "there are too few samples");
    if (figures->known)
        snprintf(why, sizeof why, "%.0f %% of the noisy pixels have not been lit yet", 100 * figures->dark);
    return with_cause(why, effects, out);
}

const char *accuracy_rmse_reason_text(const struct accuracy_figures *figures, uint64_t effects,
                                      char out[ACCURACY_WORDS_SIZE])
{
    char why[96];

    out[0] = '\0';
    if (accuracy_rmse_is_reliable(figures))
        return out;
    if (!figures->known)
        snprintf(why, sizeof why, "there are too few samples");
    else if (figures->reasons & ACCURACY_TOP)
        snprintf(why, sizeof why, "%.0f %% of the squared error is in 0.1 %% of the pixels", 100 * figures->top_share);
    else if (figures->reasons & ACCURACY_DISAGREE)
        snprintf(why, sizeof why, "the halves of the samples disagree about the error");
    else
        snprintf(why, sizeof why, "one path to the brightest light would outweigh all of the error");
    return with_cause(why, effects, out);
}
