/* The main curve: pairs of pictures with twice the samples each time, and the results of the last one. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/study/run.h"
#include "client/study/data/study_fields.h"
#include "client/study/data/study_words.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/film/tiles.h"

enum { CROP_SIDE = 96, CROPS = 3, REGIONS = 2, PIXEL_BINS = 12, TAIL_DECADES = 4, TAIL_STEPS = 8 };
#define MAIN_SHARE 0.4 /* of the budget */

/* The root mean square error of each tile, in codes. */
static void set_tile_errors(struct study *s, const float *pixels, uint32_t width, uint32_t height)
{
    const uint32_t columns = tiles_across(width), rows = tiles_across(height);
    double *sum = must(mem_calloc((size_t)columns * rows, sizeof *sum));
    double *count = must(mem_calloc((size_t)columns * rows, sizeof *count));

    s->tile_error.values.count = 0;
    if ((size_t)columns * rows > STUDY_NUMBERS_MAX) { /* a study holds no such map */
        mem_free(count);
        mem_free(sum);
        return;
    }
    for (size_t i = 0; i < (size_t)width * height; i++) {
        const size_t tile = i / width / TILE_SIZE * columns + i % width / TILE_SIZE;
        sum[tile] += (double)pixels[i] * (double)pixels[i];
        count[tile]++;
    }
    s->tile_error.columns = columns;
    s->tile_error.rows = rows;
    for (size_t i = 0; i < (size_t)columns * rows; i++)
        study_numbers_add(&s->tile_error.values, sqrt(sum[i] / count[i]));
    mem_free(count);
    mem_free(sum);
}

/* Pixels by error: below 1/8, 1/4, 1/2, ... codes. */
static void set_histogram(struct study *s, const float *pixels, size_t count)
{
    s->histogram.count = 0;
    for (int i = 0; i < PIXEL_BINS; i++) {
        struct study_bin *bin = study_add_bin(s);
        *bin = (struct study_bin){i ? ldexp(1, i - 4) : 0, i == PIXEL_BINS - 1 ? 256 : ldexp(1, i - 3), 0};
    }
    for (size_t i = 0; i < count; i++) {
        int bin = 0;
        while (bin < PIXEL_BINS - 1 && (double)pixels[i] >= s->histogram.items[bin].high)
            bin++;
        s->histogram.items[bin].count++;
    }
}

/* From the worst ten-thousandth of the pixels, or a single pixel, to all of them. */
static status set_tail(struct study_run *run, const struct image pair[2], struct error *err)
{
    struct study_tail *tail = &run->study->tail;
    double pixels[TAIL_DECADES * TAIL_STEPS + 1], held[TAIL_DECADES * TAIL_STEPS + 1];
    const double least = 1 / ((double)pair[0].width * pair[0].height);
    size_t count = 0;
    status result;

    for (int i = -TAIL_DECADES * TAIL_STEPS; i <= 0; i++)
        if (pow(10, (double)i / TAIL_STEPS) >= least)
            pixels[count++] = pow(10, (double)i / TAIL_STEPS);
    result = pair_tail_of(held, pixels, count, &pair[0], &pair[1], err);
    tail->pixels.count = tail->error.count = 0;
    for (size_t i = 0; i < count && result == STATUS_OK; i++) {
        study_numbers_add(&tail->pixels, pixels[i]);
        study_numbers_add(&tail->error, held[i]);
    }
    return result;
}

static int rising(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* The error that half of the tiles exceed, or the largest. */
static double error_of_region(const struct study_map *map, int worst)
{
    const size_t count = map->values.count;
    double *sorted = must(mem_memdup(map->values.items, count * sizeof *sorted)), value;

    /* any region will do */
    qsort(sorted, count, sizeof *sorted, rising);
    value = sorted[worst ? count - 1 : count / 2];
    mem_free(sorted);
    return value;
}

/* Small pictures have small regions, so that the typical and the worst one differ. */
static uint32_t crop_side(uint32_t width, uint32_t height)
{
    const uint32_t half = (width < height ? width : height) / 2;

    return half > CROP_SIDE ? CROP_SIDE : half < 2 * TILE_SIZE ? 2 * TILE_SIZE : half;
}

static double corner_of(size_t tile, uint32_t side, uint32_t crop)
{
    const double corner = (double)tile * TILE_SIZE - crop / 2 + TILE_SIZE / 2;

    return fmax(0, fmin((double)side - crop, corner));
}

/* The upper left corner of a region around the tile whose error is nearest to a given one. */
static void choose_region(const struct study_map *map, int worst, uint32_t width, uint32_t height,
                          struct study_region *out)
{
    const double wanted = error_of_region(map, worst);
    const size_t columns = (size_t)map->columns;
    const uint32_t crop = crop_side(width, height);
    size_t best = 0;

    for (size_t i = 1; i < map->values.count; i++)
        if (fabs(map->values.items[i] - wanted) < fabs(map->values.items[best] - wanted))
            best = i;
    out->x = corner_of(best % columns, width, crop);
    out->y = corner_of(best / columns, height, crop);
}

static status add_crop(struct study_run *run, struct study_region *region, size_t point, struct error *err)
{
    const struct image *in = &run->pairs[point][0];
    const uint32_t side = crop_side(in->width, in->height);
    struct study_crop *crop = study_add_crop(region);
    struct image codes = {0};
    status result = shown_codes(&run->shown, &codes, in, err);

    if (result == STATUS_OK) {
        struct study_picture *p = &crop->picture;
        crop->core_s = run->study->points.items[point].core_s;
        crop->codes = run->study->points.items[point].codes.value;
        p->width = in->width < side ? in->width : side;
        p->height = in->height < side ? in->height : side;
        p->rgb = must(mem_alloc_array((size_t)p->width * p->height, 3));
        for (size_t y = 0; y < p->height; y++)
            for (size_t x = 0; x < 3 * (size_t)p->width; x++)
                p->rgb[3 * y * p->width + x] =
                    (uint8_t)lroundf(codes.pixels[3 * ((y + (size_t)region->y) * in->width + (size_t)region->x) + x]);
    }
    image_release(&codes);
    return result;
}

/* The same region of the first, a middle and the last available picture. */
static status set_regions(struct study_run *run, size_t first, struct error *err)
{
    static const char *const labels[REGIONS] = {"typical", "worst"};
    const size_t last = run->study->points.count - 1, span = last - first;
    const struct image *picture = &run->pairs[last][0];
    status result = STATUS_OK;

    for (int i = 0; i < REGIONS && result == STATUS_OK; i++) {
        struct study_region *region = study_add_region(run->study);
        study_text_set(&region->label, labels[i]);
        choose_region(&run->study->tile_error, i, picture->width, picture->height, region);
        for (size_t k = 0; k < CROPS && result == STATUS_OK; k++)
            if (k == 0 || span * k / (CROPS - 1) > span * (k - 1) / (CROPS - 1))
                result = add_crop(run, region, first + span * k / (CROPS - 1), err);
    }
    return result;
}

/* Would the first points have predicted the cost of the last one? */
static void set_predictions(struct study *s)
{
    const struct study_point *last = study_last_point(s);
    const struct study_fit whole = s->fit;
    const size_t count = s->points.count;

    s->predictions.count = 0;
    for (size_t k = 3; k < count; k++) {
        struct study_prediction *p = study_add_prediction(s);
        study_fit_points(&s->fit, s->points.items, k);
        p->round = (double)k;
        p->core_s_then = s->points.items[k - 1].core_s;
        p->target_codes = last->codes.value;
        p->core_s = study_cost_of(s, last->codes.value);
        p->core_s_true = last->core_s;
        s->fit = whole;
    }
}

static status measure_point(struct study_run *run, size_t point, float *pixels, struct error *err)
{
    struct pair_error e;
    status result = pair_error_of(&e, &run->shown, &run->pairs[point][0], &run->pairs[point][1], pixels, err);

    if (result == STATUS_OK)
        run_point_error(&run->study->points.items[point], &e);
    THEN(result,
         run_point_reference(run, &run->study->points.items[point], &run->pairs[point][0], &run->pairs[point][1], err));
    return result;
}

/* All available pictures, shown with the transform of the last one, and the results from them. */
static status finish(struct study_run *run, struct error *err)
{
    struct study *s = run->study;
    const size_t last = s->points.count - 1;
    const struct image *picture = &run->pairs[last][0];
    float *pixels;
    size_t first = last;
    status result;

    if (!picture->pixels)
        return STATUS_OK; /* an earlier run's */
    image_release(&run->usual);
    result = pair_mean(&run->usual, picture, &run->pairs[last][1], err);
    pixels = must(mem_alloc_array((size_t)picture->width * picture->height, sizeof *pixels));
    THEN(result,
         shown_meter(&run->shown, &run->usual, &run->request->output.tonemap, &run->request->output.tonemap_file, err));
    for (size_t i = 0; i <= last && result == STATUS_OK; i++)
        if (run->pairs[i][0].pixels) {
            first = i < first ? i : first;
            result = measure_point(run, i, pixels, err);
        }
    if (result == STATUS_OK)
        set_tile_errors(s, pixels, picture->width, picture->height);
    if (result == STATUS_OK)
        set_histogram(s, pixels, (size_t)picture->width * picture->height);
    THEN(result, set_tail(run, run->pairs[last], err));
    study_fit_points(&s->fit, s->points.items, s->points.count);
    if (result == STATUS_OK && s->regions.count == 0 && s->tile_error.values.count > 0)
        result = set_regions(run, first, err);
    if (result == STATUS_OK)
        set_predictions(s);
    mem_free(pixels);
    return result;
}

static status add_point(struct study_run *run, uint32_t spp, struct error *err)
{
    struct study *s = run->study;
    const size_t at = s->points.count;
    struct trial pair[2] = {0};
    struct image mean = {0};
    status result = run_pair(run, run->request, spp, run->request->settings.seed, "main curve", pair, err);

    if (result == STATUS_OK) {
        run_point_set(study_add_point(&s->points), pair);
        s->tail.index = pair_judge(&pair[0].figures, &pair[1].figures)->tail_index;
        s->traversal_share = pair[0].trace_s > 0 ? pair[0].trace_s / pair[0].core_s : NAN;
        for (size_t i = 0; i < 2; i++) {
            run->pairs[at][i] = pair[i].picture;
            memset(&pair[i].picture, 0, sizeof pair[i].picture);
        }
        result = pair_mean(&mean, &run->pairs[at][0], &run->pairs[at][1], err);
        THEN(result,
             shown_meter(&run->shown, &mean, &run->request->output.tonemap, &run->request->output.tonemap_file, err));
        THEN(result, measure_point(run, at, NULL, err));
        study_fit_points(&s->fit, s->points.items, s->points.count);
        THEN(result, run->save(run->user, err));
    }
    image_release(&mean);
    trial_release(&pair[1]);
    trial_release(&pair[0]);
    return result;
}

status run_main(struct study_run *run, struct error *err)
{
    const struct study *s = run->study;
    const double until = run_left_s(run) * (1 - MAIN_SHARE);
    status result = STATUS_OK;

    while (result == STATUS_OK && s->points.count < RUN_POINTS_MAX) {
        const struct study_point *last = study_last_point(s);
        const uint32_t spp = last ? (uint32_t)(2 * last->samples + 0.5) : RUN_SPP_FIRST;
        /* Render three points for a curve even if they take long, unless they would exceed the budget. */
        const double left = run_left_s(run) - (s->points.count < 3 ? 0 : until);
        if (spp > run->spp_most || (last && 2 * run_picture_s(run, spp) > left))
            break;
        result = add_point(run, spp, err);
    }
    if (s->points.count > 0) {
        struct error ignored = {0};
        status finished = finish(run, result == STATUS_OK ? err : &ignored);
        result = result == STATUS_OK ? finished : result;
    }
    return result;
}
