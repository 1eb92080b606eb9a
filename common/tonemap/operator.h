/* operator: what a tone mapping operator is and what it is given. tonemap.h applies one by its name. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/image/image.h"

enum {
    TONEMAP_PARAMETERS_MAX = 16,
    TONEMAP_STATE_MAX = 512,     /* numbers of an operator's state */
};

enum tonemap_kind { TONEMAP_NUMBER, TONEMAP_INTEGER, TONEMAP_CHOICE };

struct tonemap_parameter {
    const char *name;
    double min, max, preset;
    const char *help;
    enum tonemap_kind kind;
    const char *const *choices; /* of a CHOICE: words, NULL at the end; its value is the index */
};

/* Of the picture after white balance and automatic exposure. Pixels with a channel that is not
 * finite, or without positive luminance, do not count. */
struct tonemap_statistics {
    /* exp(mean(ln Y)), Y the mean of 9x9 pixels around each that counts; 1 if there is none; BEFORE
     * settings.exposure_ev, so that exposure also acts on operators that divide by it. */
    double log_mean;
    double max; /* largest luminance, after exposure; 0 if no pixel counts */
    double min; /* smallest, after exposure; 0 if no pixel counts */
    size_t counted;
};

/* The input of an operator. */
struct tonemap_frame {
    struct image *image; /* rgb[height][width][3], exposed; every value finite and >= 0 */
    struct tonemap_statistics statistics;
    double gain;          /* 2^exposure_ev, which the image and max and min contain */
    const double *values; /* of the operator's parameters */
    const void *file;     /* the result of file_load; NULL: no file was given */
    const void *prepared; /* the result of prepare; NULL: the operator has none */
    unsigned threads;     /* for parallel_for */
};

struct tonemap_operator {
    const char *name;
    const char *summary; /* one sentence */
    const char *source;  /* paper or standard */
    const struct tonemap_parameter *parameters;
    size_t parameter_count;
    /* The result of apply: display codes (it applied a transfer function itself), or else display
     * light, to which the sRGB curve is applied. Values outside 0..1 are then cut off. */
    int display_encoded;
    /* Exposure does not brighten it: the operator fits the picture to the display. */
    int adaptive;
    /* Numbers that `measure` fills in, in a domain in which a mean over frames is meaningful (for
     * example logarithms); up to TONEMAP_STATE_MAX. 0: the statistics are enough. */
    size_t state_count;
    /* A pixel's result depends on the frame's statistics or on the state. */
    int measured;
    /* With these values it depends on other pixels, too. NULL: never. */
    int (*is_local)(const double *values);
    /* Only reads the frame. Called only if a pixel counts. */
    status (*measure)(const struct tonemap_frame *frame, double *state, struct error *err);
    /* Make tables that apply needs and that are the same for every picture with these values and
     * that state. Does not read the frame's image. NULL: nothing to prepare. */
    status (*prepare)(void **out, const struct tonemap_frame *frame, const double *state, struct error *err);
    void (*prepared_free)(void *prepared);
    /* In place. `state`: as measured, or a mean over frames; NULL when state_count is 0 or no pixel
     * counts (the frame is black). */
    status (*apply)(const struct tonemap_frame *frame, const double *state, struct error *err);
    /* Only for operators that take a file; otherwise NULL. */
    const char *file_help;
    int file_required;
    status (*file_load)(void **out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err);
    void (*file_free)(void *file);
};
