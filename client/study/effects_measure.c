#include "client/study/effects_measure.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/terminal/progress.h"

void effects_measure_shrink(struct render_settings *s, int size_given, int spp_given)
{
    if (!size_given && !s->whole_width) { /* a region stays as it is */
        s->width = (uint32_t)fmax(1, (double)s->width * EFFECTS_PILOT_ROWS / (double)s->height + 0.5);
        s->height = EFFECTS_PILOT_ROWS;
    }
    if (!spp_given)
        s->spp = EFFECTS_PILOT_SPP;
}

/* A side's picture is the mean of its rounds. An interruption may leave one trial a round ahead of
 * another: then less noise cancels, but the bias is still correct. */
static status keep(struct effects_trial *t, unsigned round, struct trial *done, struct error *err)
{
    struct image *side = &t->side[round % 2];
    const float share = 1 / (float)(round / 2 + 1);

    t->core_s[round] = done->core_s;
    t->rounds = round + 1;
    if (!side->pixels) {
        *side = done->picture;
        memset(&done->picture, 0, sizeof done->picture);
        return STATUS_OK;
    }
    if (side->width != done->picture.width || side->height != done->picture.height)
        return error_set(err, STATUS_ERR_PROTOCOL, "a pilot's picture has another size than the last");
    for (size_t i = 0; i < (size_t)side->width * side->height * 3; i++)
        side->pixels[i] += (done->picture.pixels[i] - side->pixels[i]) * share;
    return STATUS_OK;
}

static status run_one(struct effects_measure *m, size_t trial, unsigned round, struct error *err)
{
    struct job_request mine = *m->request;
    struct trial done;
    status result;

    mine.settings.without |= m->trials[trial].without;
    mine.settings.seed += round;
    mine.settings.spp = m->trials[trial].spp;
    mine.stop = (struct stop_rules){0}; /* pictures of equal samples are compared */
    result = trial_render(m->connection, m->scene, &mine, "pilot", NULL, &done, err);
    m->core_s += done.core_s;
    THEN(result, keep(&m->trials[trial], round, &done, err));
    trial_release(&done);
    return result;
}

/* Share of the time that each round of a trial saved. */
static void saved_rounds(double *saved, const struct effects_trial *whole, const struct effects_trial *less, unsigned rounds)
{
    for (unsigned r = 0; r < rounds; r++)
        saved[r] = 1 - less->core_s[r] / whole->core_s[r];
}

static void forget(struct effects_trial *t)
{
    for (size_t s = 0; s < 2; s++)
        image_release(&t->side[s]);
    *t = (struct effects_trial){0};
}

/* The whole picture of that length; NULL: there is none. 0: the longest. */
static const struct effects_trial *whole_of(const struct effects_measure *m, uint32_t spp)
{
    const struct effects_trial *found = NULL;

    for (size_t i = 0; i < m->count; i++) {
        const struct effects_trial *t = &m->trials[i];
        if (t->without == 0 && (spp ? t->spp == spp : !found || t->spp > found->spp))
            found = t;
    }
    return found;
}

static status meter(struct effects_measure *m, struct error *err)
{
    const struct effects_trial *whole = whole_of(m, 0);
    struct image mean = {0};
    status result = pair_mean(&mean, &whole->side[0], &whole->side[1], err);

    THEN(result, shown_meter(&m->shown, &mean, &m->request->output.tonemap, &m->request->output.tonemap_file, err));
    image_release(&mean);
    return result;
}

/* The trials that lack rounds, round by round, so that variations of the machine affect all of them equally. */
static status run_rounds(struct effects_measure *m, uint32_t spp, struct error *err)
{
    struct progress progress;
    status result = STATUS_OK;

    progress_init(&progress, m->quiet);
    for (unsigned round = 0; round < EFFECTS_ROUNDS; round++)
        for (size_t i = 0; i < m->count && result == STATUS_OK; i++) {
            const uint64_t without = m->trials[i].without;
            char text[128], name[64] = "the whole picture";
            if (m->trials[i].rounds != round)
                continue;
            if (without & (without - 1))
                snprintf(name, sizeof name, "without several effects");
            else if (without)
                snprintf(name, sizeof name, "without %s", effect_name((enum effect_bit)__builtin_ctzll(without)));
            snprintf(text, sizeof text, "%u samples, round %u of %d: %s", spp, round + 1, EFFECTS_ROUNDS, name);
            progress_draw(&progress, (double)(round * m->count + i) / (double)(EFFECTS_ROUNDS * m->count), text);
            result = run_one(m, i, round, err);
        }
    progress_clear(&progress);
    return result;
}

static void add_trial(struct effects_measure *m, uint64_t without, uint32_t spp)
{
    m->trials[m->count++] = (struct effects_trial){.without = without, .spp = spp};
}

status effects_measure_run(struct effects_measure *m, uint64_t set, struct error *err)
{
    const uint32_t spp = m->request->settings.spp;
    status result, metered = STATUS_OK;

    if (!(set & EFFECTS_SWITCHABLE))
        return STATUS_OK;
    add_trial(m, 0, spp);
    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (set & EFFECTS_SWITCHABLE & (uint64_t)1 << bit)
            add_trial(m, (uint64_t)1 << bit, spp);
    result = run_rounds(m, spp, err);
    if (effects_measure_rounds(m))
        metered = meter(m, result == STATUS_OK ? err : NULL);
    return result == STATUS_OK ? metered : result;
}

/* What an effect saves of the time hardly depends on the pilot's length, so that all rounds count. */
static void keep_saved(struct effects_trial *longer, const struct effects_trial *whole, const struct effects_trial *less)
{
    memcpy(longer->saved, less->saved, less->saved_count * sizeof *less->saved);
    saved_rounds(longer->saved + less->saved_count, whole, less, EFFECTS_ROUNDS);
    longer->saved_count = less->saved_count + EFFECTS_ROUNDS;
}

status effects_measure_again(struct effects_measure *m, uint64_t bits, uint32_t spp, struct error *err)
{
    status result;

    for (size_t i = 0; i < m->count; i++)
        if (m->trials[i].without & bits) {
            struct effects_trial longer = {.without = m->trials[i].without, .spp = spp};
            keep_saved(&longer, whole_of(m, m->trials[i].spp), &m->trials[i]);
            forget(&m->trials[i]);
            m->trials[i] = longer;
        }
    if (!whole_of(m, spp))
        add_trial(m, 0, spp);
    result = run_rounds(m, spp, err);
    return result == STATUS_OK ? meter(m, err) : result;
}

status effects_measure_together(struct effects_measure *m, uint64_t without, uint32_t spp, size_t *trial,
                                struct error *err)
{
    const uint64_t last = m->trials[m->count - 1].without;

    if (last & (last - 1))
        forget(&m->trials[--m->count]);
    *trial = m->count;
    add_trial(m, without, spp);
    return run_rounds(m, spp, err);
}

unsigned effects_measure_rounds(const struct effects_measure *m)
{
    unsigned rounds = m->count ? EFFECTS_ROUNDS : 0;

    for (size_t i = 0; i < m->count; i++)
        rounds = m->trials[i].rounds < rounds ? m->trials[i].rounds : rounds;
    return rounds / 2 * 2;
}

size_t effects_measure_find(const struct effects_measure *m, int bit)
{
    for (size_t i = 1; i < m->count; i++)
        if (m->trials[i].without == (uint64_t)1 << bit)
            return i;
    return 0;
}

static status noise_of(double *codes, const struct effects_measure *m, const struct effects_trial *t, struct error *err)
{
    struct pair_error error = {0};
    status result = pair_error_of(&error, &m->shown, &t->side[0], &t->side[1], NULL, err);

    *codes = error.codes.value;
    return result;
}

static struct study_interval saved_by(const struct effects_trial *whole, const struct effects_trial *less,
                                      unsigned rounds)
{
    double all[EFFECTS_ROUNDS * EFFECTS_LENGTHS_MAX], mean = 0, square = 0, width;
    const unsigned count = less->saved_count + rounds;

    memcpy(all, less->saved, less->saved_count * sizeof *all);
    saved_rounds(all + less->saved_count, whole, less, rounds);
    for (unsigned r = 0; r < count; r++)
        mean += all[r] / count;
    for (unsigned r = 0; r < count; r++)
        square += (all[r] - mean) * (all[r] - mean);
    width = student_t95(count - 1) * sqrt(square / (count - 1) / count);
    return (struct study_interval){mean, mean - width, mean + width};
}

status effects_measure_price(const struct effects_measure *m, size_t trial, struct effects_price *out,
                             struct error *err)
{
    const struct effects_trial *less = &m->trials[trial], *whole = whole_of(m, less->spp);
    struct image usual = {0};
    double before = 0, after = 0;
    status result = pair_mean(&usual, &whole->side[0], &whole->side[1], err);

    THEN(result, noise_of(&before, m, whole, err));
    THEN(result, noise_of(&after, m, less, err));
    THEN(result, pair_bias_of(&out->bias, &m->shown, &usual, &whole->side[0], &less->side[0], &whole->side[1],
                              &less->side[1], err));
    out->saved = saved_by(whole, less, effects_measure_rounds(m));
    out->noise = before > 0 ? after / before : after > 0 ? INFINITY : 1;
    image_release(&usual);
    return result;
}

struct study_interval effects_price_gain(const struct effects_price *price)
{
    const double more = price->noise * price->noise;

    return (struct study_interval){1 - (1 - price->saved.value) * more, 1 - (1 - price->saved.low) * more,
                                   1 - (1 - price->saved.high) * more};
}

double effects_measure_sample_s(const struct effects_measure *m)
{
    const struct effects_trial *whole = whole_of(m, 0);
    double sum = 0;

    for (unsigned r = 0; r < whole->rounds; r++)
        sum += whole->core_s[r] / whole->rounds;
    return sum / ((double)whole->side[0].width * whole->side[0].height * whole->spp);
}

double effects_measure_samples_to(const struct effects_measure *m, double codes)
{
    const struct effects_trial *whole = whole_of(m, 0);
    struct error ignored = {0};
    double error;

    /* A side is the mean of half of the rounds. Out of memory: no prediction. */
    if (noise_of(&error, m, whole, &ignored) != STATUS_OK)
        return INFINITY;
    return whole->spp * (effects_measure_rounds(m) / 2) * (error / codes) * (error / codes);
}

void effects_measure_release(struct effects_measure *m)
{
    for (size_t i = 0; i < EFFECTS_TRIALS_MAX; i++)
        forget(&m->trials[i]);
}
