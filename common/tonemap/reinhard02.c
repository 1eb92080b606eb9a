/* Photographic tone reproduction of Reinhard et al. 2002: the global operator with burn-out at a white point (their
 * equations 1, 2 and 4), and the local one, dodging and burning (equations 5 to 9). Colours keep their ratios: every
 * channel is scaled like the luminance.
 *
 *   L  = key / log_mean * Y
 *   Ld = L (1 + L / white^2) / (1 + V)      V = L, or locally V1 at the pixel's scale
 *
 * The scale Ld / Y is computed without dividing by Y, so black stays black without a special case.
 *
 * Locally, V1(s) is L blurred by a Gaussian exp(-r^2 / (alpha1 s)^2), and a pixel takes the largest s up to which no
 * scale's centre and surround differ by more than the threshold. The surround's alpha2 is 1.6 alpha1 and the scales are
 * 1.6 apart, so a scale's surround is the next one's centre: eight scales are nine blurs, the last of them (s = 43)
 * only a surround. The paper has no white point here. Ours is in the numerator, with the same effect as in the global
 * operator: where the surroundings are as bright as the pixel the two agree.
 */
#include <math.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/tonemap/operators.h"

enum { KEY, WHITE, SCALE, SHARPNESS, THRESHOLD };
enum scale { SCALE_GLOBAL, SCALE_LOCAL };
enum { SCALES = 8 };

/* Pure white of the paper's Zone System (its section 2): middle grey, 0.18, is Zone V, and each zone doubles. The
 * paper's own preset, the picture's maximum, is one pixel: in a noisy picture it is luck. */
#define ZONE_X (0.18 * 32)

static const char *const scale_names[] = {"global", "local", NULL};

static const struct tonemap_parameter parameters[] = {
    [KEY] = {"key", 0.001, 100.0, 0.18,
             "what the picture's log-mean luminance becomes before compression; "
             "0.045 is low key, 0.72 high key", TONEMAP_NUMBER, NULL},
    [WHITE] = {"white", 0.0, 1e9, ZONE_X,
               "the scaled luminance that becomes white; 5.76: Zone X, five stops above middle grey; 0: the "
               "picture's maximum, which is one noisy pixel; 1e9: never",
               TONEMAP_NUMBER, NULL},
    [SCALE] = {"scale", 0, 1, SCALE_GLOBAL,
               "global: one curve for the picture; local: dodging and burning, each pixel by the "
               "brightness around it",
               TONEMAP_CHOICE, scale_names},
    [SHARPNESS] = {"sharpness", 0.0, 30.0, 8.0,
                   "local: phi of the paper; more keeps small scales, which sharpens edges",
                   TONEMAP_NUMBER, NULL},
    [THRESHOLD] = {"threshold", 0.0, 1e6, 0.05,
                   "local: the contrast that ends the growth of a pixel's surroundings",
                   TONEMAP_NUMBER, NULL},
};

struct curve {
    double scale, inverse_white2;
};

/* Scale a pixel whose surroundings have the scaled luminance `around`; negative: use its own. */
static void scale_pixel(const struct curve *curve, float *p, double around)
{
    double luminance = curve->scale * tonemap_luminance(p);
    double factor =
        curve->scale * (1.0 + luminance * curve->inverse_white2) / (1.0 + (around < 0.0 ? luminance : around));

    for (int c = 0; c < 3; c++) {
        double scaled = (double)p[c] * factor;
        p[c] = (float)(scaled < 1.0 ? scaled : 1.0);
    }
}

static void reinhard_row(const void *user, float *rgb, uint32_t width)
{
    for (float *p = rgb; p < rgb + (size_t)width * 3; p += 3)
        scale_pixel(user, p, -1.0);
}

/* ---- the local operator --------------------------------------------------------------------- */

static const double ALPHA = 0.35355339059327376; /* alpha1 of the paper: 1 / (2 sqrt 2) */
static const double RATIO = 1.6;
static const float LUMINANCE_MAX = 1e30f; /* so that sums and differences stay finite */

enum {
    RADIUS_MAX = 64,
    STRIP = 512, /* columns that are blurred together, so that they stay in the cache */
    LINES = 32,
};

/* Half of a symmetric Gaussian, cut off at three times alpha s: the middle, then one side. */
struct gaussian {
    int radius;
    float weights[RADIUS_MAX + 1];
};

struct local {
    const struct tonemap_frame *frame;
    struct curve curve;
    uint32_t width, height;
    struct gaussian gaussian;
    float *luminance; /* L */
    float *rows;      /* L blurred along the lines */
    float *centre;    /* V1 at the current scale */
    float *chosen;    /* V1 at the pixel's scale; its sign bit: larger scales may follow */
    float activity;   /* 2^phi key / s^2 */
    float threshold;
};

static void gaussian_init(struct gaussian *gaussian, double s)
{
    double sum = 0.0, weights[RADIUS_MAX + 1];

    gaussian->radius = (int)floor(3.0 * ALPHA * s);
    for (int i = 0; i <= gaussian->radius; i++) {
        double r = (double)i / (ALPHA * s);
        weights[i] = det_exp_d(-r * r);
        sum += i ? 2.0 * weights[i] : weights[i];
    }
    for (int i = 0; i <= gaussian->radius; i++)
        gaussian->weights[i] = (float)(weights[i] / sum);
}

/* The index of a picture mirrored at its borders at `i`: ... 1 0 0 1 2 ... n-1 n-1 ... */
static size_t mirrored(ptrdiff_t i, size_t count)
{
    ptrdiff_t period = 2 * (ptrdiff_t)count;

    i %= period;
    i = i < 0 ? i + period : i;
    return (size_t)(i < (ptrdiff_t)count ? i : period - 1 - i);
}

static void luminance_lines(void *user, size_t begin, size_t end)
{
    struct local *l = user;

    for (size_t i = begin * l->width; i < end * l->width; i++) {
        double value = l->curve.scale * tonemap_luminance(l->frame->image->pixels + 3 * i);

        l->luminance[i] = value < (double)LUMINANCE_MAX || !SAFEGUARD(REINHARD_SUN) ? (float)value : LUMINANCE_MAX;
    }
}

/* out[0..count) = the Gaussian over from[-radius .. count + radius). */
static void blur_along(const struct gaussian *k, float *restrict out, const float *from, size_t count)
{
    for (size_t x = 0; x < count; x++)
        out[x] = k->weights[0] * from[x];
    for (int i = 1; i <= k->radius; i++) {
        const float *before = from - i, *after = from + i;
        float weight = k->weights[i];

        for (size_t x = 0; x < count; x++)
            out[x] += weight * (before[x] + after[x]);
    }
}

static void blur_rows(void *user, size_t begin, size_t end)
{
    struct local *l = user;
    float padded[STRIP + 2 * RADIUS_MAX];
    size_t radius = (size_t)l->gaussian.radius;

    for (size_t y = begin; y < end; y++)
        for (size_t x = 0; x < l->width; x += STRIP) {
            const float *line = l->luminance + y * l->width;
            size_t count = l->width - x < STRIP ? l->width - x : STRIP;

            for (size_t i = 0; i < count + 2 * radius; i++) {
                size_t at = x + i - radius; /* wraps below 0, which counts as outside too */
                padded[i] = line[at < l->width ? at : mirrored((ptrdiff_t)at, l->width)];
            }
            blur_along(&l->gaussian, l->rows + y * l->width + x, padded + radius, count);
        }
}

/* out[0..count) = the Gaussian over the column of lines around y, from column x on. */
static void blur_across(const struct local *l, float *restrict out, size_t y, size_t x, size_t count)
{
    const struct gaussian *k = &l->gaussian;
    const float *middle = l->rows + y * l->width + x;

    for (size_t i = 0; i < count; i++)
        out[i] = k->weights[0] * middle[i];
    for (int r = 1; r <= k->radius; r++) {
        const float *above = l->rows + mirrored((ptrdiff_t)y - r, l->height) * l->width + x;
        const float *below = l->rows + mirrored((ptrdiff_t)y + r, l->height) * l->width + x;
        float weight = k->weights[r];

        for (size_t i = 0; i < count; i++)
            out[i] += weight * (above[i] + below[i]);
    }
}

static void first_scale(void *user, size_t begin, size_t end)
{
    struct local *l = user;

    for (size_t x = 0; x < l->width; x += STRIP)
        for (size_t y = begin; y < end; y++) {
            size_t count = l->width - x < STRIP ? l->width - x : STRIP;
            float *centre = l->centre + y * l->width + x;
            float *chosen = l->chosen + y * l->width + x;

            blur_across(l, centre, y, x, count);
            for (size_t i = 0; i < count; i++)
                chosen[i] = -centre[i];
        }
}

/* Compare a scale's centre with its surround, the next scale's centre. Where they agree, the scale is chosen for now;
 * elsewhere the previous one is final (equation 8). A pixel at which even the smallest scale fails keeps that. */
static void next_scale(void *user, size_t begin, size_t end)
{
    struct local *l = user;
    float surround[STRIP];

    for (size_t x = 0; x < l->width; x += STRIP)
        for (size_t y = begin; y < end; y++) {
            size_t count = l->width - x < STRIP ? l->width - x : STRIP;
            float *centre = l->centre + y * l->width + x;
            float *chosen = l->chosen + y * l->width + x;

            blur_across(l, surround, y, x, count);
            for (size_t i = 0; i < count; i++) {
                int alike = fabsf(centre[i] - surround[i]) <= l->threshold * (l->activity + centre[i]);
                if (signbit(chosen[i]))
                    chosen[i] = alike ? -centre[i] : -chosen[i];
                centre[i] = surround[i];
            }
        }
}

static void scale_lines(void *user, size_t begin, size_t end)
{
    const struct local *l = user;

    for (size_t i = begin * l->width; i < end * l->width; i++)
        scale_pixel(&l->curve, l->frame->image->pixels + 3 * i, (double)fabsf(l->chosen[i]));
}

static void local_blur(struct local *l, double s, void (*across)(void *, size_t, size_t))
{
    gaussian_init(&l->gaussian, s);
    parallel_for(l->frame->threads, l->height, LINES, blur_rows, l);
    parallel_for(l->frame->threads, l->height, LINES, across, l);
}

static void local_run(struct local *l)
{
    const double *values = l->frame->values;
    double s = 1.0;

    parallel_for(l->frame->threads, l->height, LINES, luminance_lines, l);
    l->threshold = (float)values[THRESHOLD];
    local_blur(l, s, first_scale);
    for (int i = 0; i < SCALES; i++) {
        l->activity = (float)(det_pow_d(2.0, values[SHARPNESS]) * values[KEY] / (s * s));
        s *= RATIO;
        local_blur(l, s, next_scale);
    }
    parallel_for(l->frame->threads, l->height, LINES, scale_lines, l);
}

static status local_apply(const struct tonemap_frame *frame, const struct curve *curve, struct error *err)
{
    struct local l = {.frame = frame, .curve = *curve, .width = frame->image->width,
                      .height = frame->image->height};
    size_t pixels = (size_t)l.width * l.height;
    status st = STATUS_OK;

    l.luminance = mem_alloc_array(pixels, sizeof *l.luminance);
    l.rows = mem_alloc_array(pixels, sizeof *l.rows);
    l.centre = mem_alloc_array(pixels, sizeof *l.centre);
    l.chosen = mem_alloc_array(pixels, sizeof *l.chosen);
    if (l.luminance && l.rows && l.centre && l.chosen)
        local_run(&l);
    else
        st = error_no_memory(err, "dodging and burning");
    mem_free(l.chosen);
    mem_free(l.centre);
    mem_free(l.rows);
    mem_free(l.luminance);
    return st;
}

static status reinhard_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err)
{
    struct curve curve = {.scale = frame->values[KEY] / frame->statistics.log_mean};
    double white = frame->values[WHITE] > 0.0 ? frame->values[WHITE] : curve.scale * frame->statistics.max;

    curve.inverse_white2 = white > 0.0 || !SAFEGUARD(REINHARD_BLACK) ? 1.0 / (white * white) : 0.0;
    if ((int)frame->values[SCALE] == SCALE_LOCAL)
        return local_apply(frame, &curve, err);
    tonemap_each_row(frame, reinhard_row, &curve);
    return STATUS_OK;
}

static int reinhard_is_local(const double *values) { return (int)values[SCALE] == SCALE_LOCAL; }

const struct tonemap_operator tonemap_reinhard02 = {
    .name = "reinhard02",
    .summary = "Photographic tone reproduction, global or local, with a white point.",
    .source = "E. Reinhard, M. Stark, P. Shirley, J. Ferwerda, \"Photographic Tone Reproduction "
              "for Digital Images\", ACM TOG 21(3), 2002",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .measured = 1,
    .is_local = reinhard_is_local,
    .apply = reinhard_apply,
};
