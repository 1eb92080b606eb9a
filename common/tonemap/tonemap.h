/* tonemap: scene-referred linear RGB to display values, by a named operator.
 *
 *   picture --white balance, exposure--> exposed --operator--> display light --sRGB--> codes 0..1
 *
 * One file per operator; each has one const `struct tonemap_operator`, and operators.h lists them. What an operator
 * must know of the whole picture (log-mean, maximum, a tone curve) is measured once, over the whole merged frame, in a
 * fixed order, in double: the *state*. States of several frames can be averaged, so that an animation does not flicker;
 * the picture is then a function of its pixels and the averaged state. The result is display-encoded (a transfer
 * function applied exactly once), within 0..1, never NaN, and the same with any number of threads.
 */
#pragma once

#include <stddef.h>

#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/image/image.h"
#include "common/schema/settings.h"
#include "common/tonemap/operator.h"

enum {
    TONEMAP_FILE_NAME_MAX = 127,
};
#define TONEMAP_FILE_BYTES_MAX ((size_t)64 << 20)

struct tonemap_settings {
    const struct tonemap_operator *op;
    double values[TONEMAP_PARAMETERS_MAX];
#define LOOK_MEMBER(o, KIND, type, name, ...) type name;
    LOOK_SETTINGS(LOOK_MEMBER, )
#undef LOOK_MEMBER
    int has_file;
    struct digest file;                        /* of the file's bytes */
    char file_name[TONEMAP_FILE_NAME_MAX + 1]; /* for messages */
};

enum look_name {
#define LOOK_NAME(o, KIND, type, name, ...) LOOK_##name,
    LOOK_SETTINGS(LOOK_NAME, )
#undef LOOK_NAME
    LOOK_COUNT
};
extern const struct setting look_rows[LOOK_COUNT]; /* of struct tonemap_settings */

/* Frames before, and as many after, that a denoised picture is made of. */
static inline uint32_t tonemap_around(const struct tonemap_settings *s)
{
    return s->denoise == DENOISING_OFF ? 0 : s->denoise_around;
}
/* Pictures are made of what other frames have, too. */
static inline int tonemap_takes_frames(const struct tonemap_settings *s) { return s->temporal > 1 || tonemap_around(s) > 0; }

const struct tonemap_operator *const *tonemap_operators(size_t *count);
const struct tonemap_operator *tonemap_find(const char *name); /* NULL: none */
/* The words, NULL at the end, of an operator's parameter that is a choice; NULL: it is none, or unknown. */
const char *const *tonemap_choices(const char *name, const char *parameter);
/* The word that this value of it stands for; NULL: none. */
const char *tonemap_choice_word(const char *name, const char *parameter, double value);

/* Look up the operator and fill in its presets. ERR_INPUT lists the known names. */
status tonemap_settings_init(struct tonemap_settings *s, const char *name, struct error *err) MUST_CHECK;
/* Set a parameter by name; ERR_INPUT names the range or the operator's parameters. */
status tonemap_settings_set(struct tonemap_settings *s, const char *parameter, double value,
                            struct error *err) MUST_CHECK;
/* The same from text: a number, or a choice's word. */
status tonemap_settings_set_text(struct tonemap_settings *s, const char *parameter, const char *text,
                                 struct error *err) MUST_CHECK;
/* Everything but the parameters, which _set checks: ERR_INPUT. */
status tonemap_settings_validate(const struct tonemap_settings *s, struct error *err) MUST_CHECK;

/* What is known of one frame, or of several together. */
struct tonemap_state {
    int counts;                         /* 0: no pixel counts, the frame is black */
    double metered_ev;                  /* automatic exposure */
    double ln_log_mean, ln_max, ln_min; /* of the statistics, before exposure_ev */
    double values[TONEMAP_STATE_MAX];
};

/* What is not part of the settings. Zero-initialise. */
struct tonemap_context {
    unsigned threads;         /* 0: one a processor */
    const uint8_t *file_data; /* the operator's file; NULL: none */
    size_t file_size;
    const struct tonemap_state *state; /* NULL: the picture's own */
    int linear;                        /* give display light instead of codes */
    uint32_t apart;                    /* 0, or the side of the tiles of which the picture is a sample */
};

/* Measure `in` (3 channels). ERR_INPUT: bad settings or file; ERR_NO_MEMORY. */
status tonemap_measure(struct tonemap_state *out, const struct image *in, const struct tonemap_settings *s,
                       const struct tonemap_context *context, struct error *err) MUST_CHECK;
/* The mean of states measured with the same settings; black frames do not count. */
void tonemap_state_mean(struct tonemap_state *out, const struct tonemap_state *const *states, size_t count,
                        const struct tonemap_settings *s);

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
void tonemap_pixels_codes(const struct tonemap_pixels *pixels, const float *rgb, uint32_t count, float *codes);
