#include "coordinator/farm/measure.h"

#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"

_Static_assert((int)REPLICATES == (int)ACCURACY_REPLICATES, "the figures are computed from all replicates");

static void take_tails(struct measurement *m, const struct film *film)
{
    for (uint32_t t = 0; t < m->tiles; t++)
        for (uint32_t g = 0; g < GROUPS; g++) {
            float *list = m->tails + ((size_t)t * GROUPS + g) * TAIL_MAX;
            struct tail tail;
            film_tail(film, t, g, &tail);
            for (uint32_t i = 0; i < TAIL_MAX; i++)
                list[i] = i < tail.count ? tail.entries[i].value : 0;
            m->samples[t * GROUPS + g] = film_group_samples(film, t, g);
        }
}

status measurement_take(struct measurement *out, const struct film *film, struct error *err)
{
    size_t values = (size_t)film_width(film) * film_height(film) * 3;

    *out = (struct measurement){.width = film_width(film), .height = film_height(film),
                                .tiles = film_tile_count(film),
                                .pixel_samples = film_samples(film)};
    out->samples = mem_alloc_array((size_t)out->tiles * GROUPS, sizeof *out->samples);
    out->tails = mem_alloc_array((size_t)out->tiles * GROUPS * TAIL_MAX, sizeof *out->tails);
    for (uint32_t r = 0; r < REPLICATES; r++) {
        out->replicates[r] = mem_alloc_array(values, sizeof *out->replicates[r]);
        if (out->replicates[r])
            film_replicates(film, r, 0, out->height, out->replicates[r]);
    }
    for (uint32_t r = 0; r < REPLICATES; r++)
        if (!out->replicates[r] || !out->samples || !out->tails) {
            measurement_release(out);
            return error_no_memory(err, "a frame's replicates");
        }
    take_tails(out, film);
    return STATUS_OK;
}

void measurement_release(struct measurement *m)
{
    for (uint32_t r = 0; r < REPLICATES; r++)
        mem_free(m->replicates[r]);
    mem_free(m->samples);
    mem_free(m->tails);
    memset(m, 0, sizeof *m);
}

/* ---- how it is shown ------------------------------------------------------------------------- */

struct shown {
    const struct tonemap_settings *tone;
    struct tonemap_context context;
    struct tonemap_state state;  /* of the mean */
};

static status show_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes,
                         struct error *err)
{
    const struct shown *shown = user;
    size_t values = (size_t)width * height * 3;
    /* Only read. */
    const struct image in = {.width = width, .height = height, .channels = 3, .pixels = (float *)rgb};
    struct image out = {0};
    status s = tonemap_apply(&out, &in, shown->tone, &shown->context, err);

    for (size_t i = 0; s == STATUS_OK && i < values; i++)
        codes[i] = out.pixels[i] * 255;
    image_release(&out);
    return s;
}

/* The tone mapping's measurements of the mean. */
static status measure_mean(const struct measurement *m, struct shown *shown, struct error *err)
{
    struct image mean = {0};
    size_t values = (size_t)m->width * m->height * 3;
    status s = image_init(&mean, m->width, m->height, 3, err);

    for (size_t i = 0; s == STATUS_OK && i < values; i++)
        for (uint32_t r = 0; r < REPLICATES; r++)
            mean.pixels[i] += m->replicates[r][i] / REPLICATES;
    if (s == STATUS_OK)
        s = tonemap_measure(&shown->state, &mean, shown->tone, &shown->context, err);
    image_release(&mean);
    return s;
}

status measurement_figures(const struct measurement *m, const struct tonemap_settings *tone,
                           const struct tonemap_context *context, uint64_t effects,
                           double brightest, struct accuracy_figures *out,
                           struct accuracy_map *map, struct error *err)
{
    struct shown *shown = mem_calloc(1, sizeof *shown);
    struct accuracy_picture picture = {.width = m->width, .height = m->height,
                                       .samples = m->samples};
    struct accuracy_tails tails = {.values = m->tails, .lists = (size_t)m->tiles * GROUPS,
                                   .length = TAIL_MAX, .samples = m->pixel_samples};
    struct accuracy_evidence evidence = {
        .samples = (double)m->pixel_samples / ((double)m->width * m->height),
        .effects = effects, .brightest = brightest, .tails = &tails};
    status s = STATUS_OK;

    memset(out, 0, sizeof *out);
    if (!shown)
        return error_no_memory(err, "a frame's figures");
    for (uint32_t r = 0; r < REPLICATES; r++)
        picture.replicates[r] = m->replicates[r];
    shown->tone = tone;
    shown->context = *context;
    s = measure_mean(m, shown, err);
    shown->context.state = &shown->state;
    if (s == STATUS_OK)
        s = accuracy_figures_of(out, &picture, &(struct accuracy_transform){show_codes, shown},
                                &evidence, map, err);
    mem_free(shown);
    return s;
}

void measure_transform_text(const struct tonemap_settings *tone, char out[MEASURE_TEXT_MAX])
{
    snprintf(out, MEASURE_TEXT_MAX, "%s, exposure %+g EV%s%s%s", tone->op->name, tone->exposure_ev,
             tone->metering != TONEMAP_METERING_OFF ? " after metering by " : "",
             tone->metering != TONEMAP_METERING_OFF ? tonemap_metering_name(tone->metering) : "",
             tone->op->display_encoded ? "" : ", sRGB");
}
