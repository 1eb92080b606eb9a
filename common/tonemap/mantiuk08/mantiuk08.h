/* The parts of the operator mantiuk08. Private to common/tonemap and its tests.
 *
 *   picture --log10 luminance, pyramid--> contrasts   (mantiuk08_contrasts.c)
 *   contrasts --visual model, iteration--> tone curve (mantiuk08_curve.c)
 *                 each step of it a quadratic programme (mantiuk08_solve.c)
 *   picture --tone curve, detail, colour, display--> codes (mantiuk08.c, _detail.c, _display.c)
 *
 * Symbols and equation names as in the paper; x is log10 of scene luminance, y log10 of display luminance in cd/m^2.
 */
#pragma once

#include "common/tonemap/tonemap.h"

enum {
    M08_NODES = 161,              /* of the tone curve: x from -8 to 8 */
    M08_SEGMENTS = M08_NODES - 1, /* between two nodes each */
    M08_BINS = 15,                /* of contrast: -0.7 to 0.7 */
    M08_CENTRE = M08_BINS / 2,    /* the bin of contrasts too weak to see */
    M08_BANDS_MAX = 8,
};
#define M08_X_MIN (-8.0)
#define M08_STEP 0.1       /* between nodes and between bins */
#define M08_LN10 2.30258509299404568402
#define M08_INV_LN10 0.43429448190325182765
#define M08_LOG10_2 0.30102999566398119521
#define M08_LOG2_10 3.32192809488736234787

/* log10 of a positive luminance, within the nodes' range. */
double m08_log(double luminance);

/* ---- display ---- */

/* A table of display luminance over code, from a file. */
struct m08_lut {
    size_t count;
    struct {
        double code, log_light; /* 0..1 and log10 cd/m^2, both strictly increasing */
    } rows[];
};

struct m08_display {
    double gamma, range, offset; /* cd/m^2: range code^gamma + offset */
    const struct m08_lut *lut;   /* instead, if not NULL */
};

enum { M08_LCD, M08_LCD_OFFICE, M08_LCD_BRIGHT, M08_CRT, M08_LUT, M08_DISPLAYS };
void m08_display_init(struct m08_display *display, int model, const struct m08_lut *lut);
/* The luminance that the display shows for a code. */
double m08_display_light(const struct m08_display *display, double code);
/* The code, 0..1, whose luminance is closest to `light`. */
double m08_display_code(const struct m08_display *display, double light);

/* Read rows "code,luminance". ERR_INPUT and ERR_LIMIT name the file, the line and the remedy. */
status m08_lut_load(void **out, const uint8_t *data, size_t size, const char *name, struct error *err) MUST_CHECK;
void m08_lut_free(void *lut);

/* ---- contrasts: how often which contrast stands on which background ---- */

struct m08_contrasts {
    uint32_t bands;
    double frequency[M08_BANDS_MAX]; /* cycles per degree at a band's peak */
    uint64_t counts[M08_BANDS_MAX][M08_NODES][M08_BINS];
};

/* Of the frame's picture, where one degree of the viewer's eye spans `ppd` pixels. */
status m08_contrasts_measure(struct m08_contrasts *out, const struct tonemap_frame *frame, double ppd,
                             struct error *err) MUST_CHECK;

/* ---- curve ---- */

struct m08_model {
    const struct m08_display *display;
    double contrast; /* e: 1 keeps the picture's contrasts */
    double white;    /* luminance to be shown at the peak; 0: none */
    int adapts;      /* in the scene the eye adapts to each luminance, instead of to one */
    int no_vision;   /* contrasts as they are, not as perceived */
};

/* y at every node, non-decreasing and within the display's range; and the curve's slope dy/dx
 * there; beyond the luminances of the picture, the slope of the nearest one. */
struct m08_curve {
    double y[M08_NODES], slope[M08_NODES];
};

status m08_curve_fit(struct m08_curve *out, const struct m08_contrasts *contrasts, const struct m08_model *model,
                     struct error *err) MUST_CHECK;

/* The eye's sensitivity (1 / threshold contrast) to a grating of that frequency (cycles per
 * degree) when adapted to that luminance (cd/m^2). */
double m08_sensitivity(double frequency, double luminance);
/* The response, in just noticeable differences, to a contrast in log10 luminance. */
double m08_response(double contrast, double sensitivity);

/* ---- quadratic programme ---- */

/* Find d that minimises d'Hd/2 + f'd under d >= 0 and sum(d) <= limit. H symmetric and positive
 * semidefinite; only its lower triangle is read. Zero-initialise. */
struct m08_programme {
    size_t count; /* of d */
    double limit; /* > 0 */
    double h[M08_SEGMENTS][M08_SEGMENTS], f[M08_SEGMENTS];
    double d[M08_SEGMENTS];
    /* The solver's own. */
    double factor[M08_SEGMENTS][M08_SEGMENTS];
    size_t first[M08_SEGMENTS];
};
/* Returns the iterations it took. */
int m08_programme_solve(struct m08_programme *p);

/* ---- detail ---- */

/* Coefficients of the base layer of a plane of log luminance: base = mean(a) value + mean(b). */
struct m08_base {
    uint32_t width, height;
    int radius;
    float *value, *a, *b; /* [height][width] */
};
status m08_base_init(struct m08_base *base, const struct tonemap_frame *frame, double ppd,
                     struct error *err) MUST_CHECK;
void m08_base_release(struct m08_base *base);
/* Call row(user, y, base[width]) for every line, on the frame's threads. */
status m08_base_each_row(const struct m08_base *base, unsigned threads,
                         void (*row)(const void *user, size_t y, const float *layer), const void *user,
                         struct error *err) MUST_CHECK;

/* Fill plane[height][width] with the picture's log10 luminance; black pixels get that of the
 * darkest pixel that is not black. */
void m08_log_plane(float *plane, const struct tonemap_frame *frame);
