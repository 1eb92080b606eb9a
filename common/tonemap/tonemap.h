/* tonemap: scene-referred linear RGB to display values, by a named operator.
 *
 * One file an operator; each has one const `struct tonemap_operator`, and tonemap.c lists
 * them. Statistics are taken over the whole picture, in a fixed order, in double; pixels
 * that are not finite or not positive do not count. The result is display-encoded (sRGB
 * transfer applied exactly once), within 0..1, never NaN.
 */
#ifndef AZULEJO_TONEMAP_TONEMAP_H
#define AZULEJO_TONEMAP_TONEMAP_H

#include <stddef.h>

#include "common/base/status.h"
#include "common/image/image.h"

enum {
    TONEMAP_PARAMETERS_MAX = 8,
    TONEMAP_EXPOSURE_MAX = 60, /* stops, either way */
};

struct tonemap_parameter {
    const char *name;
    double min, max, preset;
    const char *help;
};

struct tonemap_statistics {
    /* exp(mean(ln Y)) over the positive finite pixels, 1 if there is none; BEFORE exposure, so
     * that exposure also acts on operators that divide by it. */
    double log_mean;
    double max;        /* largest finite luminance after exposure; 0 if there is none */
    double min;        /* smallest positive luminance after exposure; 0 if there is none */
    size_t counted;    /* pixels that counted */
};

struct tonemap_operator {
    const char *name;
    const char *summary; /* one sentence */
    const char *source;  /* paper or standard */
    const struct tonemap_parameter *parameters;
    size_t parameter_count;
    int display_encoded; /* the operator applies the transfer function itself */
    /* In place on rgb[height][width][3], all values finite and >= 0. `values` follow
     * `parameters`. */
    status (*apply)(struct image *image, const struct tonemap_statistics *statistics,
                    const double *values, struct error *err);
};

struct tonemap_settings {
    const struct tonemap_operator *op;
    double exposure_ev;                     /* 2^ev multiplies the picture first; see log_mean */
    double values[TONEMAP_PARAMETERS_MAX];
};

const struct tonemap_operator *const *tonemap_operators(size_t *count);
const struct tonemap_operator *tonemap_find(const char *name); /* NULL: none */

/* Look up the operator and fill in its presets. ERR_INPUT lists the known names. */
status tonemap_settings_init(struct tonemap_settings *s, const char *name, struct error *err)
    MUST_CHECK;
/* Set a parameter by name; ERR_INPUT names the range or the operator's parameters. */
status tonemap_settings_set(struct tonemap_settings *s, const char *parameter, double value,
                            struct error *err) MUST_CHECK;

/* Tone map `in` (3 channels) into `out` (initialised here): display values for png_encode. */
status tonemap_apply(struct image *out, const struct image *in, const struct tonemap_settings *s,
                     struct error *err) MUST_CHECK;

#endif
