/* tonemap: scene-referred linear RGB to display values, by a named operator.
 *
 *   picture --white balance, exposure--> exposed --operator--> display light --sRGB--> codes 0..1
 *
 * One file per operator; each has one const `struct tonemap_operator`, and operators.h lists them.
 * What an operator must know of the whole picture (log-mean, maximum, a tone curve) is measured
 * once, over the whole merged frame, in a fixed order, in double: the *state*. States of several
 * frames can be averaged, so that an animation does not flicker; the picture is then a function of
 * its pixels and the averaged state. The result is display-encoded (a transfer function applied
 * exactly once), within 0..1, never NaN, and the same with any number of threads.
 */
#ifndef AZULEJO_TONEMAP_TONEMAP_H
#define AZULEJO_TONEMAP_TONEMAP_H

#include <stddef.h>

#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/image/image.h"

enum {
    TONEMAP_PARAMETERS_MAX = 16,
    TONEMAP_EXPOSURE_MAX = 100,  /* stops, either way */
    TONEMAP_STATE_MAX = 512,     /* numbers of an operator's state */
    TONEMAP_FILE_NAME_MAX = 127,
    TONEMAP_TEMPORAL_MAX = 240,  /* frames */
    TONEMAP_KELVIN_MIN = 1667, TONEMAP_KELVIN_MAX = 25000,
};
#define TONEMAP_FILE_BYTES_MAX ((size_t)64 << 20)

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
    /* exp(mean(ln Y)) over the pixels that count, 1 if there is none; BEFORE settings.exposure_ev,
     * so that exposure also acts on operators that divide by it. */
    double log_mean;
    double max;        /* largest luminance, after exposure; 0 if no pixel counts */
    double min;        /* smallest, after exposure; 0 if no pixel counts */
    size_t counted;
};

/* The input of an operator. */
struct tonemap_frame {
    struct image *image;   /* rgb[height][width][3], exposed; every value finite and >= 0 */
    struct tonemap_statistics statistics;
    double gain;           /* 2^exposure_ev, which the image and max and min contain */
    const double *values;  /* of the operator's parameters */
    const void *file;      /* the result of file_load; NULL: no file was given */
    const void *prepared;  /* the result of prepare; NULL: the operator has none */
    unsigned threads;      /* for parallel_for */
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
    status (*prepare)(void **out, const struct tonemap_frame *frame, const double *state,
                      struct error *err);
    void (*prepared_free)(void *prepared);
    /* In place. `state`: as measured, or a mean over frames; NULL when state_count is 0 or no pixel
     * counts (the frame is black). */
    status (*apply)(const struct tonemap_frame *frame, const double *state, struct error *err);
    /* Only for operators that take a file; otherwise NULL. */
    const char *file_help;
    int file_required;
    status (*file_load)(void **out, const uint8_t *data, size_t size_bytes, const char *name,
                        struct error *err);
    void (*file_free)(void *file);
};

/* How the exposure is found automatically. */
enum tonemap_metering {
    TONEMAP_METERING_OFF,
    TONEMAP_METERING_KEY,        /* the log-mean luminance becomes 0.18 */
    TONEMAP_METERING_PERCENTILE, /* a percentile of the luminance becomes 1 */
    TONEMAP_METERING_COUNT
};
const char *tonemap_metering_name(enum tonemap_metering metering);
int tonemap_metering_parse(const char *name); /* -1: no such */

struct tonemap_settings {
    const struct tonemap_operator *op;
    double values[TONEMAP_PARAMETERS_MAX];
    double exposure_ev;             /* 2^ev multiplies the picture, on top of the metering */
    enum tonemap_metering metering;
    double metering_percentile;     /* 0..100 */
    double white_kelvin;            /* colour temperature of the light that should look white; 0:
                                     * unchanged */
    uint32_t temporal;              /* the states of so many frames, the last of them this one,
                                     * are averaged; 0 and 1: only its own */
    int has_file;
    struct digest file;             /* of the file's bytes */
    char file_name[TONEMAP_FILE_NAME_MAX + 1]; /* for messages */
};

const struct tonemap_operator *const *tonemap_operators(size_t *count);
const struct tonemap_operator *tonemap_find(const char *name); /* NULL: none */

/* Look up the operator and fill in its presets. ERR_INPUT lists the known names. */
status tonemap_settings_init(struct tonemap_settings *s, const char *name, struct error *err)
    MUST_CHECK;
/* Set a parameter by name; ERR_INPUT names the range or the operator's parameters. */
status tonemap_settings_set(struct tonemap_settings *s, const char *parameter, double value,
                            struct error *err) MUST_CHECK;
/* The same from text: a number, or a choice's word. */
status tonemap_settings_set_text(struct tonemap_settings *s, const char *parameter,
                                 const char *text, struct error *err) MUST_CHECK;
/* Everything but the parameters, which _set checks: ERR_INPUT. */
status tonemap_settings_validate(const struct tonemap_settings *s, struct error *err) MUST_CHECK;

/* What is known of one frame, or of several together. */
struct tonemap_state {
    int counts;                  /* 0: no pixel counts, the frame is black */
    double metered_ev;           /* automatic exposure */
    double ln_log_mean, ln_max, ln_min; /* of the statistics, before exposure_ev */
    double values[TONEMAP_STATE_MAX];
};

/* What is not part of the settings. Zero-initialise. */
struct tonemap_context {
    unsigned threads;            /* 0: one a processor */
    const uint8_t *file_data;    /* the operator's file; NULL: none */
    size_t file_size;
    const struct tonemap_state *state; /* NULL: the picture's own */
    int linear;                  /* give display light instead of codes */
};

/* Measure `in` (3 channels). ERR_INPUT: bad settings or file; ERR_NO_MEMORY. */
status tonemap_measure(struct tonemap_state *out, const struct image *in,
                       const struct tonemap_settings *s, const struct tonemap_context *context,
                       struct error *err) MUST_CHECK;
/* The mean of states measured with the same settings; black frames do not count. */
void tonemap_state_mean(struct tonemap_state *out, const struct tonemap_state *const *states,
                        size_t count, const struct tonemap_settings *s);

/* Tone map `in` (3 channels) into `out` (initialised here): display values for png_encode.
 * `context` may be NULL. The same errors. */
status tonemap_apply(struct image *out, const struct image *in, const struct tonemap_settings *s,
                     const struct tonemap_context *context, struct error *err) MUST_CHECK;

/* ---- pixels without their picture ---- */

/* What must be known before a pixel can be tone mapped. */
enum tonemap_reach {
    TONEMAP_REACH_PIXEL,   /* nothing else */
    TONEMAP_REACH_STATE,   /* what is measured of the whole picture */
    TONEMAP_REACH_PICTURE, /* other pixels */
};
enum tonemap_reach tonemap_reach(const struct tonemap_settings *s);
/* The nearest settings that depend on no more than the state of one frame. They replace `s` where
 * pixels must be shown before their picture is complete. */
void tonemap_stand_in(struct tonemap_settings *out, const struct tonemap_settings *s);

/* Settings and a state, ready for any number of pixels. */
struct tonemap_pixels;
/* `state`: from tonemap_measure; not used if a pixel's result depends on the pixel alone.
 * ERR_INPUT: bad settings or file, or settings that depend on more; ERR_NO_MEMORY. */
status tonemap_pixels_new(struct tonemap_pixels **out, const struct tonemap_settings *s,
                          const struct tonemap_state *state, const struct tonemap_context *context,
                          struct error *err) MUST_CHECK;
void tonemap_pixels_free(struct tonemap_pixels *pixels);
const struct tonemap_settings *tonemap_pixels_settings(const struct tonemap_pixels *pixels);
/* The codes 0..255, not rounded, of rgb[count][3]: the same as tonemap_apply gives for a picture
 * that contains the pixels. [any thread] */
void tonemap_pixels_codes(const struct tonemap_pixels *pixels, const float *rgb, uint32_t count,
                          float *codes);

#endif
