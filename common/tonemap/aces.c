/* The output transform of ACES 1.x, exactly: the reference rendering transform (RRT a1.0.3) and the output device
 * transform for sRGB displays at 100 cd/m2 in dim surroundings. Light in, display light out; the sRGB curve follows.
 *
 *   Rec. 709 -Bradford-> AP0: glow, red modifier -> AP1: desaturation, the RRT's tone scale,
 *   the ODT's tone scale, dim surround, desaturation -Bradford-> Rec. 709
 *
 * Both tone scales are applied to each channel of AP1 with only a matrix and its inverse between them, so they form one
 * curve and one table. Constants from the Academy's published transforms (S-2014-004 for the primaries,
 * ACESlib.Tonescales for the splines); the 48-nit spline's were checked against the knots in OpenColorIO 2.1.
 */
#include <math.h>
#include <pthread.h>

#include "common/image/color.h"
#include "common/math/curve_table.h"
#include "common/tonemap/operators.h"

static const struct color_primaries ap0 = {
    {0.7347, 0.2653}, {0.0, 1.0}, {0.0001, -0.0770}, {0.32168, 0.33767}};
static const struct color_primaries ap1 = {
    {0.713, 0.293}, {0.165, 0.830}, {0.128, 0.044}, {0.32168, 0.33767}};
static const double ap1_luminance[3] = {0.2722287168, 0.6740817658, 0.0536895174};

static const double HALF_MAX = 65504.0;
static const double RRT_SATURATION = 0.96, ODT_SATURATION = 0.93, DIM_SURROUND = 0.9811;
static const double CINEMA_BLACK = 0.02, CINEMA_WHITE = 48.0; /* cd/m2 */

/* ---- tone scales ---------------------------------------------------------------------------- */

/* A uniform quadratic B-spline in log10 below the middle, another above it, and straight lines with
 * the given slopes beyond the ends. */
struct tone_scale {
    double min, middle, max;     /* log10 of the argument */
    double value_min, value_max; /* log10 of the value */
    double slope_max;            /* below the minimum it is 0 */
    int segments;                /* of either half; a half has two coefficients more */
    const double *low, *high;
};

static const double rrt_low[] = {-4.0, -4.0, -3.1573765773, -0.4852499958, 1.8477324706};
static const double rrt_high[] = {-0.7185482425, 2.0810307172, 3.6681241237, 4.0, 4.0};
static const double odt_low[] = {-1.6989700043, -1.6989700043, -1.4779, -1.2291, -0.8648,
                                 -0.4480,       0.00518,       0.4511080334, 0.9113744414};
static const double odt_high[] = {0.5154386965, 0.8470437783, 1.1358, 1.3802, 1.5197,
                                  1.5985,       1.6467,       1.6746091357, 1.6878733390};

static double spline(const double *coefficients, int segments, double position)
{
    int at = (int)position < segments - 1 ? (int)position : segments - 1;
    const double *c = coefficients + at;
    double t = position - at;

    return 0.5 * (c[0] + c[1]) + t * ((c[1] - c[0]) + t * 0.5 * (c[0] - 2.0 * c[1] + c[2]));
}

static double tone_scale_at(const struct tone_scale *s, double x)
{
    if (x <= s->min)
        return s->value_min;
    if (x < s->middle)
        return spline(s->low, s->segments, s->segments * (x - s->min) / (s->middle - s->min));
    if (x < s->max)
        return spline(s->high, s->segments, s->segments * (x - s->middle) / (s->max - s->middle));
    return s->value_max + s->slope_max * (x - s->max);
}

static double log10_of(double x) { return det_log_d(x) / det_log_d(10.0); }

struct tone_scales {
    struct tone_scale rrt, odt;
};

static void tone_scales_init(struct tone_scales *s)
{
    double grey = log10_of(0.18), stop = log10_of(2.0);

    s->rrt = (struct tone_scale){
        .min = grey - 15.0 * stop, .middle = grey, .max = grey + 18.0 * stop,
        .value_min = -4.0, .value_max = 4.0, .segments = 3, .low = rrt_low, .high = rrt_high,
    };
    s->odt = (struct tone_scale){
        .min = tone_scale_at(&s->rrt, grey - 6.5 * stop), .middle = log10_of(4.8),
        .max = tone_scale_at(&s->rrt, grey + 6.5 * stop),
        .value_min = log10_of(CINEMA_BLACK), .value_max = log10_of(CINEMA_WHITE),
        .slope_max = 0.04, .segments = 7, .low = odt_low, .high = odt_high,
    };
}

/* Display light of one channel: 0 at the cinema's black, 1 at its white. */
static double tone(double x, const void *user)
{
    const struct tone_scales *s = user;
    double log_nits = tone_scale_at(&s->odt, tone_scale_at(&s->rrt, log10_of(x)));

    if (log_nits <= s->odt.value_min)
        return 0.0;
    return (det_exp_d(log_nits * det_log_d(10.0)) - CINEMA_BLACK) / (CINEMA_WHITE - CINEMA_BLACK);
}

static double dim_surround(double luminance, const void *user UNUSED) { return det_pow_d(luminance, DIM_SURROUND); }

/* ---- what is made once ---------------------------------------------------------------------- */

/* The tone curve is 0 below 2^-9 and constant from 0.18 * 2^18 < 2^16 on. For luminances below
 * 2^-30 the dim surround's exponent is set to 1: they are below 1e-9. */
enum { TONE_FIRST = -9, TONE_OCTAVES = 25, DIM_FIRST = -30, DIM_OCTAVES = 31 };

static struct {
    double into_ap0[3][3], into_ap1[3][3], out_of_ap1[3][3];
    struct curve_table tone, dim;
} made;
static float tone_pieces[TONE_OCTAVES * CURVE_PIECES][4];
static float dim_pieces[DIM_OCTAVES * CURVE_PIECES][4];
static pthread_once_t made_once = PTHREAD_ONCE_INIT;

static void multiply(const double a[3][3], const double b[3][3], double out[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/* The three matrices: both ACES spaces have the same white, so its adaptation cancels between them. */
static void make_matrices(void)
{
    double from_ap0[3][3], from_ap1[3][3], into_ap1[3][3], desaturate[3][3];

    if (!color_to_rec709(&ap0, from_ap0) || !color_to_rec709(&ap1, from_ap1) ||
        !color_matrix_invert(from_ap0, made.into_ap0) || !color_matrix_invert(from_ap1, into_ap1))
        return; /* impossible: the primaries above define colour spaces */
    multiply(into_ap1, from_ap0, made.into_ap1);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            desaturate[i][j] = (1.0 - ODT_SATURATION) * ap1_luminance[j] + (i == j ? ODT_SATURATION : 0.0);
    multiply(from_ap1, desaturate, made.out_of_ap1);
}

static void make(void)
{
    struct tone_scales scales;

    make_matrices();
    tone_scales_init(&scales);
    curve_table_build(&made.tone, tone_pieces, TONE_FIRST, TONE_OCTAVES, tone, &scales);
    curve_table_build(&made.dim, dim_pieces, DIM_FIRST, DIM_OCTAVES, dim_surround, NULL);
}

/* ---- the pixels ----------------------------------------------------------------------------- */

/* Without calls to libm, for values that are never NaN. */
static double larger(double a, double b) { return a > b ? a : b; }

static double smaller(double a, double b) { return a < b ? a : b; }

/* The factor for dark and saturated colours. */
static double glow(const double aces[3], double saturation)
{
    const double gain_max = 0.05, middle = 0.08;
    double red_green = aces[0] - aces[1], green_blue = aces[1] - aces[2];
    double blue_red = aces[2] - aces[0], x, t, gain, y;

    /* Weighted luminance: the chroma counts as the sqrt of half the sum of squares. */
    y = (aces[0] + aces[1] + aces[2] +
         1.75 * sqrt(0.5 * (red_green * red_green + green_blue * green_blue + blue_red * blue_red))) *
        (1.0 / 3.0);
    if (y >= 2.0 * middle)
        return 1.0;
    x = (saturation - 0.4) / 0.2;
    t = larger(1.0 - 0.5 * fabs(x), 0.0);
    gain = gain_max * 0.5 * (x < 0.0 ? t * t : 2.0 - t * t);
    return 1.0 + (y <= 2.0 / 3.0 * middle ? gain : gain * (middle / y - 0.5));
}

/* A cubic B-spline over the 135 degrees around red, 1 at red itself. Neutrals have no hue. */
static double redness(const double aces[3])
{
    double x = 2.0 * aces[0] - aces[1] - aces[2], y = sqrt(3.0) * (aces[1] - aces[2]), u;

    if (!(x > 0.0)) /* neutral, or more than 90 degrees away */
        return 0.0;
    u = fabs(det_atan2_d(y, x)) * (180.0 / PI_D) / (135.0 / 4.0);
    if (u >= 2.0)
        return 0.0;
    return u >= 1.0 ? 0.25 * (2.0 - u) * (2.0 - u) * (2.0 - u) : 0.25 * ((3.0 * u - 6.0) * u * u + 4.0);
}

static void rrt_modifiers(double aces[3])
{
    const double tiny = 1e-10, red_pivot = 0.03, red_scale = 0.82;
    double high = larger(aces[0], larger(aces[1], aces[2]));
    double low = smaller(aces[0], smaller(aces[1], aces[2]));
    double saturation = (larger(high, tiny) - larger(low, tiny)) / larger(high, 1e-2);
    double factor = glow(aces, saturation);

    for (int i = 0; i < 3; i++)
        aces[i] *= factor;
    aces[0] += redness(aces) * saturation * (red_pivot - aces[0]) * (1.0 - red_scale);
}

static void transform(const double m[3][3], const double from[3], double to[3])
{
    for (int i = 0; i < 3; i++)
        to[i] = m[i][0] * from[0] + m[i][1] * from[1] + m[i][2] * from[2];
}

static void aces_pixel(float rgb[3])
{
    const double light[3] = {(double)rgb[0], (double)rgb[1], (double)rgb[2]};
    double v[3], display[3], luminance, factor;

    transform((const double(*)[3])made.into_ap0, light, v);
    rrt_modifiers(v);
    for (int i = 0; i < 3; i++)
        v[i] = larger(v[i], 0.0);
    transform((const double(*)[3])made.into_ap1, v, display);
    luminance = 0.0;
    for (int i = 0; i < 3; i++) {
        v[i] = smaller(larger(display[i], 0.0), HALF_MAX);
        luminance += ap1_luminance[i] * v[i];
    }
    for (int i = 0; i < 3; i++)
        v[i] = (double)curve_table_at(&made.tone, (float)(luminance + RRT_SATURATION * (v[i] - luminance)));
    luminance = ap1_luminance[0] * v[0] + ap1_luminance[1] * v[1] + ap1_luminance[2] * v[2];
    luminance = larger(luminance, (double)made.dim.low);
    transform((const double(*)[3])made.out_of_ap1, v, display);
    factor = (double)curve_table_at(&made.dim, (float)luminance) / luminance;
    for (int i = 0; i < 3; i++)
        rgb[i] = (float)larger(display[i] * factor, 0.0);
}

static void aces_row(const void *user UNUSED, float *rgb, uint32_t width)
{
    for (float *p = rgb; p < rgb + (size_t)width * 3; p += 3)
        aces_pixel(p);
}

static status aces_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err UNUSED)
{
    pthread_once(&made_once, make);
    tonemap_each_row(frame, aces_row, NULL);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_aces = {
    .name = "aces",
    .summary = "The ACES 1.x output transform, exactly: RRT and the ODT for sRGB, dim surround.",
    .source = "Academy of Motion Picture Arts and Sciences, aces-dev: RRT a1.0.3, "
              "ODT.Academy.sRGB_100nits_dim a1.0.3",
    .apply = aces_apply,
};
