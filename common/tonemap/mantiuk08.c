/* Display adaptive tone mapping: R. Mantiuk, S. Daly, L. Kerofsky 2008. A tone curve is fitted so that what a viewer
 * sees on a given display, in given light, is as close as possible to what they would see of the scene. The curve is
 * global; colours follow its slope (R. Mantiuk, A. Tomaszewska, W. Heidrich, "Color Correction for Tone Mapping", CGF
 * 28(2), 2009).
 *
 * `detail` is NOT in the paper: what is finer than half a degree of the viewer's eye and is not an edge
 * (mantiuk08_detail.c) keeps its contrast after the curve, times that factor. At 1 the operator equals the paper's, to
 * the bit.
 *
 * The state is the curve's y at its nodes, then its slope there. Both may be averaged over frames: a mean of curves
 * that do not decrease and stay within the display's range has the same properties.
 */
#include "common/tonemap/mantiuk08/mantiuk08.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/math/quick.h"
#include "common/tonemap/operators.h"

enum { CONTRAST, SATURATION, DETAIL, DISPLAY, WHITE, ADAPTATION, VISUAL_MODEL, PPD };

static const char *const displays[] = {
    [M08_LCD] = "lcd", [M08_LCD_OFFICE] = "lcd_office", [M08_LCD_BRIGHT] = "lcd_bright",
    [M08_CRT] = "crt", [M08_LUT] = "lut", [M08_DISPLAYS] = NULL,
};
static const char *const adaptations[] = {"fixed", "auto", NULL};
static const char *const visual_models[] = {"full", "none", NULL};

static const struct tonemap_parameter parameters[] = {
    [CONTRAST] = {"contrast", 0.0, 10.0, 1.0,
                  "factor on the contrasts that are sought; 1: as in the scene", TONEMAP_NUMBER,
                  NULL},
    [SATURATION] = {"saturation", 0.0, 2.0, 1.0,
                    "factor on the saturation of colours; 1: as it looks right for the curve, 0: "
                    "grey", TONEMAP_NUMBER, NULL},
    [DETAIL] = {"detail", 0.0, 5.0, 1.0,
                "factor on the contrast of fine detail after the curve, an addition to the paper; "
                "1: the paper's picture", TONEMAP_NUMBER, NULL},
    [DISPLAY] = {"display", 0.0, M08_DISPLAYS - 1, M08_LCD,
                 "what the picture is shown on: lcd (200 cd/m2 in a dim room), lcd_office (100, in "
                 "an office), lcd_bright (500), crt (80), or the table of a file",
                 TONEMAP_CHOICE, displays},
    [WHITE] = {"white", 0.0, 1e8, 0.0,
               "the luminance that shall become the display's white; 0: left to the curve",
               TONEMAP_NUMBER, NULL},
    [ADAPTATION] = {"adaptation", 0.0, 1.0, 0.0,
                    "the eye at the scene is adapted to 1000 cd/m2, or to what it looks at (for "
                    "pictures in cd/m2)", TONEMAP_CHOICE, adaptations},
    [VISUAL_MODEL] = {"visual-model", 0.0, 1.0, 0.0,
                      "contrasts are weighed as they are seen, or as they are", TONEMAP_CHOICE,
                      visual_models},
    [PPD] = {"ppd", 1.0, 240.0, 30.0, "pixels in a degree of the viewer's field of view",
             TONEMAP_NUMBER, NULL},
};

/* k1 and k2 of the colour correction's sigmoid. */
static const double COLOUR_K1 = 1.48, COLOUR_K2 = 0.82;
/* Limit of a channel's distance below the luminance, so that no colour jumps where the curve becomes level. */
static const double RATIO_MIN = 1e-4;

static status choose_display(struct m08_display *out, const struct tonemap_frame *frame, struct error *err)
{
    int model = (int)frame->values[DISPLAY];

    if (model == M08_LUT && !frame->file)
        return error_set(err, STATUS_ERR_INPUT, "mantiuk08's display is lut, but its file is "
                         "missing; give one, or another display");
    if (model != M08_LUT && frame->file)
        return error_set(err, STATUS_ERR_INPUT, "mantiuk08 was given the file of a display, but "
                         "its display is %s; set display to lut, or give no file",
                         displays[model]);
    m08_display_init(out, model, frame->file);
    return STATUS_OK;
}

/* ---- measure -------------------------------------------------------------------------------- */

static status measure(const struct tonemap_frame *frame, double *state, struct error *err)
{
    struct m08_contrasts *contrasts;
    struct m08_display display;
    struct m08_curve curve;
    struct m08_model model = {
        .display = &display, .contrast = frame->values[CONTRAST], .white = frame->values[WHITE],
        .adapts = frame->values[ADAPTATION] != 0.0, .no_vision = frame->values[VISUAL_MODEL] != 0.0,
    };
    status st = choose_display(&display, frame, err);

    if (st != STATUS_OK)
        return st;
    contrasts = mem_alloc(sizeof *contrasts);
    NEED(contrasts, err, "the contrasts of a picture");
    st = m08_contrasts_measure(contrasts, frame, frame->values[PPD], err);
    THEN(st, m08_curve_fit(&curve, contrasts, &model, err));
    if (st == STATUS_OK)
        memcpy(state, &curve, sizeof curve);
    mem_free(contrasts);
    return st;
}

/* ---- apply ---------------------------------------------------------------------------------- */

struct mapping {
    const struct image *image;
    struct m08_display display;
    double inverse_range, inverse_gamma; /* of the display */
    double y[M08_NODES];
    double power[M08_NODES]; /* of a channel's ratio to the luminance */
    double detail;
    struct quick quick;
};

/* s of the colour correction. */
static double colour_power(double slope, double saturation)
{
    double p = det_pow_d(fmax(slope, 0.0), COLOUR_K2);

    return saturation * (1.0 + COLOUR_K1) * p / (1.0 + COLOUR_K1 * p);
}

/* `x` is brought within the nodes. */
static double at_node(const double *values, double x)
{
    double place = (x - M08_X_MIN) * (1.0 / M08_STEP);
    int node;

    place = place > 0.0 ? place : 0.0;
    place = place < M08_NODES - 1 ? place : M08_NODES - 1;
    node = place < M08_NODES - 2 ? (int)place : M08_NODES - 2;
    return values[node] + (place - node) * (values[node + 1] - values[node]);
}

/* m08_display_code of 2^log2_light. */
static float code_of(const struct mapping *m, double log2_light)
{
    double light = quick_exp2(&m->quick, log2_light), share;

    if (m->display.lut)
        return (float)m08_display_code(&m->display, light);
    share = (light - m->display.offset) * m->inverse_range;
    if (!(share > 0.0))
        return 0.0f;
    if (share >= 1.0)
        return 1.0f;
    return (float)quick_exp2(&m->quick, quick_log2(&m->quick, share) * m->inverse_gamma);
}

/* `base`: of the pixel's log luminance, or NULL. */
static void map_pixel(const struct mapping *m, float *rgb, const float *base)
{
    double luminance = tonemap_luminance(rgb), log2_l, x, y, power, inverse;

    if (!(luminance > 0.0)) {
        rgb[0] = rgb[1] = rgb[2] = 0.0f;
        return;
    }
    log2_l = quick_log2(&m->quick, luminance);
    x = log2_l * M08_LOG10_2;
    y = at_node(m->y, x);
    power = at_node(m->power, x);
    if (base) {
        double level = at_node(m->y, (double)*base);

        y = level + m->detail * (y - level);
    }
    inverse = 1.0 / luminance;
    for (int c = 0; c < 3; c++) {
        double ratio = (double)rgb[c] * inverse;

        ratio = ratio > RATIO_MIN ? ratio : RATIO_MIN;
        rgb[c] = code_of(m, power * quick_log2(&m->quick, ratio) + y * M08_LOG2_10);
    }
}

static void map_row(const void *user, float *rgb, uint32_t width)
{
    for (uint32_t x = 0; x < width; x++)
        map_pixel(user, rgb + 3 * (size_t)x, NULL);
}

static void map_row_detail(const void *user, size_t y, const float *base)
{
    const struct mapping *m = user;
    float *rgb = m->image->pixels + y * m->image->width * 3;

    for (size_t x = 0; x < m->image->width; x++)
        map_pixel(m, rgb + 3 * x, base + x);
}

/* No pixel counted: those that are not black must have been infinite. */
static void map_row_black(const void *user UNUSED, float *rgb, uint32_t width)
{
    for (size_t i = 0; i < (size_t)width * 3; i++)
        rgb[i] = rgb[i] > 0.0f ? 1.0f : 0.0f;
}

static status apply_detail(const struct tonemap_frame *frame, const struct mapping *m, struct error *err)
{
    struct m08_base base;
    status st = m08_base_init(&base, frame, frame->values[PPD], err);

    THEN(st, m08_base_each_row(&base, frame->threads, map_row_detail, m, err));
    m08_base_release(&base);
    return st;
}

static status apply(const struct tonemap_frame *frame, const double *state, struct error *err)
{
    struct mapping m = {.image = frame->image, .detail = frame->values[DETAIL]};
    TRY(choose_display(&m.display, frame, err));
    if (!state) {
        tonemap_each_row(frame, map_row_black, NULL);
        return STATUS_OK;
    }
    quick_init(&m.quick);
    m.inverse_range = 1.0 / m.display.range;
    m.inverse_gamma = 1.0 / m.display.gamma;
    for (int i = 0; i < M08_NODES; i++) {
        m.y[i] = state[i];
        m.power[i] = colour_power(state[M08_NODES + i], frame->values[SATURATION]);
    }
    if (m.detail != 1.0)
        return apply_detail(frame, &m, err);
    tonemap_each_row(frame, map_row, &m);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_mantiuk08 = {
    .name = "mantiuk08",
    .summary = "Display adaptive: the curve that keeps most of what is seen on a given display.",
    .source = "R. Mantiuk, S. Daly, L. Kerofsky, \"Display Adaptive Tone Mapping\", ACM TOG "
              "27(3), 2008",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .display_encoded = 1,
    .adaptive = 1,
    .measured = 1,
    .is_local = tonemap_always_local,
    .state_count = sizeof(struct m08_curve) / sizeof(double),
    .measure = measure,
    .apply = apply,
    .file_help = "a display's table for display=lut: rows \"code,luminance\", the code from 0 to 1, "
                 "the luminance in cd/m2",
    .file_load = m08_lut_load,
    .file_free = m08_lut_free,
};
