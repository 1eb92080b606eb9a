#include "client/effects_measure.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/progress.h"

void effects_measure_shrink(struct render_settings *s, int size_given, int spp_given)
{
    if (!size_given) {
        s->width = (uint32_t)fmax(1, (double)s->width * EFFECTS_PILOT_ROWS / (double)s->height + 0.5);
        s->height = EFFECTS_PILOT_ROWS;
    }
    if (!spp_given)
        s->spp = EFFECTS_PILOT_SPP;
}

/* A side's picture is the mean of its rounds. An interruption may leave one trial a round ahead of
 * another: their noise cancels less then, and the bias is as right. */
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
    mine.stop = (struct stop_rules){0}; /* pictures of equal samples are compared */
    result = trial_render(m->connection, m->scene, &mine, "pilot", NULL, &done, err);
    m->core_s += done.core_s;
    if (result == STATUS_OK)
        result = keep(&m->trials[trial], round, &done, err);
    trial_release(&done);
    return result;
}

static status meter(struct effects_measure *m, struct error *err)
{
    image_release(&m->usual);
    if (pair_mean(&m->usual, &m->trials[0].side[0], &m->trials[0].side[1], err) != STATUS_OK)
        return STATUS_ERR_NO_MEMORY;
    return shown_meter(&m->shown, &m->usual, &m->request->output.tonemap,
                       &m->request->output.tonemap_file, err);
}

status effects_measure_run(struct effects_measure *m, uint64_t set, struct error *err)
{
    struct progress progress;
    status result = STATUS_OK, metered = STATUS_OK;

    m->count = 1;
    for (int bit = 0; bit < EFFECT_COUNT; bit++)
        if (set & EFFECTS_SWITCHABLE & (uint64_t)1 << bit)
            m->trials[m->count++].without = (uint64_t)1 << bit;
    progress_init(&progress, m->quiet);
    for (unsigned round = 0; round < EFFECTS_ROUNDS && m->count > 1; round++)
        for (size_t i = 0; i < m->count && result == STATUS_OK; i++) {
            char text[128], name[64] = "the whole picture";
            if (i)
                snprintf(name, sizeof name, "without %s",
                         effect_name((enum effect_bit)__builtin_ctzll(m->trials[i].without)));
            snprintf(text, sizeof text, "round %u of %d: %s", round + 1, EFFECTS_ROUNDS, name);
            progress_draw(&progress,
                          (double)(round * m->count + i) / (double)(EFFECTS_ROUNDS * m->count), text);
            result = run_one(m, i, round, err);
        }
    progress_clear(&progress);
    if (effects_measure_rounds(m))
        metered = meter(m, result == STATUS_OK ? err : NULL);
    return result == STATUS_OK ? metered : result;
}

status effects_measure_add(struct effects_measure *m, uint64_t without, size_t *trial, struct error *err)
{
    status result = STATUS_OK;

    *trial = m->count++;
    for (size_t s = 0; s < 2; s++)
        image_release(&m->trials[*trial].side[s]);
    m->trials[*trial] = (struct effects_trial){.without = without};
    for (unsigned round = 0; round < m->trials[0].rounds && result == STATUS_OK; round++)
        result = run_one(m, *trial, round, err);
    return result;
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

status effects_measure_price(const struct effects_measure *m, size_t trial, struct effects_price *out,
                             struct error *err)
{
    const struct effects_trial *whole = &m->trials[0], *less = &m->trials[trial];
    const unsigned rounds = effects_measure_rounds(m);
    double mean = 0, square = 0, width;

    for (unsigned r = 0; r < rounds; r++)
        mean += (1 - less->core_s[r] / whole->core_s[r]) / rounds;
    for (unsigned r = 0; r < rounds; r++) {
        const double d = 1 - less->core_s[r] / whole->core_s[r] - mean;
        square += d * d;
    }
    width = student_t95(rounds - 1) * sqrt(square / (rounds - 1) / rounds);
    out->saved = (struct study_interval){mean, mean - width, mean + width};
    return pair_bias_of(&out->bias, &m->shown, &m->usual, &whole->side[0], &less->side[0],
                        &whole->side[1], &less->side[1], err);
}

void effects_measure_release(struct effects_measure *m)
{
    for (size_t i = 0; i < EFFECTS_TRIALS_MAX; i++)
        for (size_t s = 0; s < 2; s++)
            image_release(&m->trials[i].side[s]);
    image_release(&m->usual);
}
