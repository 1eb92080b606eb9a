#include "common/accuracy/contrasts.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"

/* The variance of (mean of the three contrasts - real error), relative to that of the contrasts. */
#define UNKNOWN_SHARE (4.0 / 3)

static const float signs[CONTRASTS][ACCURACY_REPLICATES] = {
    {0.25f, -0.25f, 0.25f, -0.25f},
    {0.25f, -0.25f, -0.25f, 0.25f},
    {0.25f, 0.25f, -0.25f, -0.25f},
};

static size_t pixel_count(const struct accuracy_picture *p)
{
    return (size_t)p->width * p->height;
}

/* The replicates' values at pixel value `at`. If the tile lacks a group, the other's values stand
 * in, so that the mean is that group's mean and the first contrast its error. */
static void values_at(const struct view *v, size_t at, float out[ACCURACY_REPLICATES])
{
    const struct accuracy_picture *p = v->picture;

    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        out[r] = p->replicates[r][at];
    if (p->samples) {
        size_t pixel = at / 3;
        size_t tile = pixel / p->width / ACCURACY_TILE * v->across + pixel % p->width / ACCURACY_TILE;
        if (p->samples[tile * 2] == 0)
            memcpy(out, out + 2, 2 * sizeof *out);
        else if (p->samples[tile * 2 + 1] == 0)
            memcpy(out + 2, out, 2 * sizeof *out);
    }
}

int view_is_known(const struct accuracy_picture *p)
{
    size_t tiles = (size_t)((p->width + ACCURACY_TILE - 1) / ACCURACY_TILE) * ((p->height + ACCURACY_TILE - 1) / ACCURACY_TILE);

    for (size_t i = 0; p->samples && i < tiles; i++) {
        const uint32_t *n = p->samples + i * 2;
        if ((n[0] < 2 && n[1] < 2) || n[0] == 1 || n[1] == 1)
            return 0;
    }
    return 1;
}

static float mean_of(const float values[ACCURACY_REPLICATES])
{
    return (values[0] + values[1] + values[2] + values[3]) / 4;
}

/* Sums over a frame are in double: 2^24 additions of float lose a tenth of a frame's light. */
static double frame_add(double sum, float more)
{
    return SAFEGUARD(FRAME_DOUBLE) ? sum + (double)more : (double)((float)sum + more);
}

static float contrast_of(const float values[ACCURACY_REPLICATES], int k)
{
    float sum = 0;

    for (int r = 0; r < ACCURACY_REPLICATES; r++)
        sum += signs[k][r] * values[r];
    return sum;
}

/* If a group is missing, the other contrasts are meaningless; the first replaces all. */
static int contrast_at(const struct view *v, size_t pixel, int k)
{
    const struct accuracy_picture *p = v->picture;
    size_t tile = pixel / p->width / ACCURACY_TILE * v->across + pixel % p->width / ACCURACY_TILE;

    return p->samples && (p->samples[tile * 2] == 0 || p->samples[tile * 2 + 1] == 0) ? 0 : k;
}

void view_release(struct view *v)
{
    mem_free(v->half);
    mem_free(v->mean);
    mem_free(v->codes);
}

status view_init(struct view *v, const struct accuracy_picture *picture,
                        const struct accuracy_transform *transform, struct error *err)
{
    size_t values = pixel_count(picture) * 3;

    *v = (struct view){.picture = picture,
                       .transform = transform,
                       .across = (picture->width + ACCURACY_TILE - 1) / ACCURACY_TILE,
                       .half = mem_alloc_array(values, sizeof(float)),
                       .mean = mem_alloc_array(values, sizeof(float)),
                       .codes = mem_alloc_array(values, sizeof(float))};
    status s = STATUS_OK;

    if (!v->half || !v->mean || !v->codes)
        s = error_no_memory(err, "the figures of a picture's error");
    for (size_t i = 0; i < values && s == STATUS_OK; i++) {
        float r[ACCURACY_REPLICATES];
        values_at(v, i, r);
        v->half[i] = mean_of(r);
    }
    if (s == STATUS_OK)
        s = transform->apply(transform->user, v->half, picture->width, picture->height, v->mean, err);
    if (s != STATUS_OK)
        view_release(v);
    return s;
}

/* Codes of the mean with contrast k times `sign` added, minus those of the mean. */
static status view_shift(struct view *v, int k, float sign, struct error *err)
{
    size_t values = pixel_count(v->picture) * 3;
    status s;

    for (size_t i = 0; i < values; i++) {
        float r[ACCURACY_REPLICATES];
        values_at(v, i, r);
        v->half[i] = mean_of(r) + sign * contrast_of(r, contrast_at(v, i / 3, k));
    }
    s = v->transform->apply(v->transform->user, v->half, v->picture->width, v->picture->height,
                            v->codes, err);
    for (size_t i = 0; i < values && s == STATUS_OK; i++)
        v->codes[i] -= v->mean[i];
    return s;
}

/* ---- what is gathered ------------------------------------------------------------------------ */

void gathered_release(struct gathered *g)
{
    for (int k = 0; k < CONTRASTS; k++)
        mem_free(g->errors[k]);
    mem_free(g->squared);
    mem_free(g->lone);
    mem_free(g->spread);
}

status gathered_init(struct gathered *g, size_t pixels, struct error *err)
{
    *g = (struct gathered){.pixels = pixels, .squared = mem_alloc_array(pixels, sizeof(float)),
                           .lone = mem_alloc_array(pixels, sizeof(float)),
                           .spread = mem_alloc_array(pixels, sizeof(float))};
    for (int k = 0; k < CONTRASTS; k++)
        g->errors[k] = mem_calloc(pixels, sizeof(float));
    if (g->squared && g->lone && g->spread && g->errors[0] && g->errors[1] && g->errors[2])
        return STATUS_OK;
    gathered_release(g);
    return error_no_memory(err, "the figures of a picture's error");
}

static double mean3(const double x[CONTRASTS])
{
    return (x[0] + x[1] + x[2]) / 3;
}

double contrasts_variance(const double x[CONTRASTS])
{
    double m = mean3(x);

    return UNKNOWN_SHARE *
           ((x[0] - m) * (x[0] - m) + (x[1] - m) * (x[1] - m) + (x[2] - m) * (x[2] - m)) / 2;
}

/* The products of two contrasts' squares over those of one with itself. 1 if all are equal, as when
 * one replicate alone was lit, or none. */
static float lone_share(const double squares[CONTRASTS])
{
    double both = squares[0] * squares[1] + squares[1] * squares[2] + squares[0] * squares[2];
    double one = squares[0] * squares[0] + squares[1] * squares[1] + squares[2] * squares[2];

    return one > 0 || !SAFEGUARD(LONE_OF_BLACK) ? (float)(both / one) : 1;
}

/* The weight of a squared error of the group in the comparison of the groups: its number of
 * samples, so that equal noise per sample compares as equal. 0 if a group is missing. */
static double group_weight(const struct view *v, size_t pixel, int group)
{
    const struct accuracy_picture *p = v->picture;
    size_t tile = pixel / p->width / ACCURACY_TILE * v->across + pixel % p->width / ACCURACY_TILE;

    if (!p->samples)
        return 1;
    return p->samples[tile * 2] > 0 && p->samples[tile * 2 + 1] > 0 ? p->samples[tile * 2 + (size_t)group] : 0;
}

void gather_linear(struct gathered *g, const struct view *a)
{
    double means[CONTRASTS] = {0};

    for (size_t p = 0; p < g->pixels; p++) {
        double squares[CONTRASTS] = {0}, weights[2] = {group_weight(a, p, 0), group_weight(a, p, 1)};
        for (size_t i = p * 3; i < p * 3 + 3; i++) {
            float ra[ACCURACY_REPLICATES];
            values_at(a, i, ra);
            g->mean = frame_add(g->mean, mean_of(ra));
            for (int k = 0; k < CONTRASTS; k++) {
                double c = (double)contrast_of(ra, contrast_at(a, p, k));
                squares[k] += c * c;
                means[k] += c;
            }
            for (int group = 0; group < 2; group++) {
                double d = ((double)ra[group * 2] - (double)ra[group * 2 + 1]) / 2;
                g->groups[group] += d * d * weights[group];
            }
        }
        g->squared[p] = (float)mean3(squares);
        g->lone[p] = lone_share(squares);
        g->linear += mean3(squares);
        g->linear_variance += contrasts_variance(squares);
    }
    g->mean /= (double)g->pixels * 3;
    for (int k = 0; k < CONTRASTS; k++)
        g->mean_variance += means[k] * means[k] / ((double)g->pixels * 3 * (double)g->pixels * 3) / 3;
}

/* Add what contrast k shows with one sign: the square of the largest channel's error to errors[k],
 * that of all channels to `squares`. */
static status add_codes(struct gathered *g, struct view *a, int k, float sign,
                        float *squares, struct error *err)
{
    status s = view_shift(a, k, sign, err);

    for (size_t p = 0; p < g->pixels && s == STATUS_OK; p++) {
        float largest = 0;
        for (size_t i = p * 3; i < p * 3 + 3; i++) {
            float d = a->codes[i];
            largest = d * d > largest ? d * d : largest;
            squares[p] += d * d / 2;
        }
        g->errors[k][p] += largest / 2;
    }
    return s;
}

/* Errors in display codes: what each contrast shows, added and subtracted. */
status gather_codes(struct gathered *g, struct view *a, struct error *err)
{
    float *squares[CONTRASTS] = {NULL};
    status s = STATUS_OK;

    for (int k = 0; k < CONTRASTS && s == STATUS_OK; k++) {
        squares[k] = mem_calloc(g->pixels, sizeof(float));
        s = squares[k] ? add_codes(g, a, k, 1, squares[k], err)
                       : error_no_memory(err, "a picture's error");
        if (s == STATUS_OK)
            s = add_codes(g, a, k, -1, squares[k], err);
        for (size_t p = 0; p < g->pixels && s == STATUS_OK; p++)
            g->errors[k][p] = sqrtf(g->errors[k][p]);
    }
    for (size_t p = 0; p < g->pixels && s == STATUS_OK; p++) {
        double x[CONTRASTS] = {(double)squares[0][p], (double)squares[1][p], (double)squares[2][p]};
        g->codes += mean3(x);
        g->codes_variance += contrasts_variance(x);
    }
    for (int k = 0; k < CONTRASTS; k++)
        mem_free(squares[k]);
    return s;
}

double gathered_square(const struct gathered *g, size_t p)
{
    double sum = 0;

    for (int k = 0; k < CONTRASTS; k++)
        sum += (double)g->errors[k][p] * (double)g->errors[k][p];
    return sum / CONTRASTS;
}

