/* measure: a picture's errors, from its two groups of samples and the way it is shown.
 *
 * common/accuracy computes; this file prepares its input: copies of a film's groups and of its
 * largest contributions, and the job's tone mapping. The mean and both groups are metered each by itself: what
 * noise moves in the picture's metering moves in the groups' too, and is part of the error.
 */
#pragma once

#include "common/accuracy/figures.h"
#include "common/base/status.h"
#include "common/denoise/denoise.h"
#include "common/film/film.h"
#include "common/tonemap/tonemap.h"

struct film_reader;

/* What guides a denoiser: means of each group, [height][width][3]; NULL: the film has none. */
struct measurement_guides {
    float *albedo[GROUPS], *normal[GROUPS], *emission[GROUPS];
    float *position; /* of the picture, [3][height][width]; NULL: not asked for, or the film has none */
    float *object;   /* the same, [height][width] */
};

/* Copied from a film, which may change afterwards; or without its groups, which are then read from it in strips. */
struct measurement {
    uint32_t width, height, tiles;
    const struct film *film; /* NULL, or `groups` are */
    float *groups[GROUPS];   /* means, [height][width][3] */
    uint32_t *samples;       /* [tiles][GROUPS], of a pixel */
    float *subject;          /* [tiles], the share of their samples that see it */
    float *tails;            /* [tiles][GROUPS][TAIL_MAX] */
    uint64_t pixel_samples;  /* of all pixels */
    uint32_t of_tiles;       /* they are a sample of so many tiles of the film; 0: they are all */
    struct measurement_guides guides;
};

/* ERR_NO_MEMORY. Then measurement_take_tile() for each tile. */
status measurement_begin(struct measurement *out, const struct film *film, int guided, struct error *err) MUST_CHECK;
void measurement_take_tile(struct measurement *m, const struct film *film, uint32_t tile);
/* The same of a film that stays as it is: its groups are not copied. For measurement_figures alone. */
status measurement_of(struct measurement *out, const struct film *film, struct error *err) MUST_CHECK;
/* Of a sample of about `count` of its tiles, beside each other: whole ones (16x16 pixels), evenly spread, of which each smaller
 * sample is a part. Only where measurement_sample() is not 0. */
status measurement_take_sample(struct measurement *out, const struct film *film, uint32_t count,
                               struct error *err) MUST_CHECK;
/* How many tiles a sample of about `count` has; 0: it is the whole film. */
uint32_t measurement_sample(const struct film *film, uint32_t count);
/* All tiles at once, with the guides that the film has. */
status measurement_take_guided(struct measurement *out, const struct film *film, struct error *err) MUST_CHECK;
/* The same, from a film that is read tile by tile, `positions` too if they are wanted. Errors of film_reader_next, too. */
status measurement_read_guided(struct measurement *out, struct film_reader *reader, int positions,
                               struct error *err) MUST_CHECK;
/* What a denoiser takes of it. It points into `m`. */
struct denoise_input measurement_input(const struct measurement *m);
int measurement_is_guided(const struct measurement *m);
void measurement_release(struct measurement *m);

/* How the job shows its pictures, `context` with the operator's file; `effects` that the frame calls for; `brightest`:
 * accuracy_brightest of its scene, 0: not known. `map` may be NULL. ERR_NO_MEMORY, and errors of the tone mapping. */
status measurement_figures(const struct measurement *m, const struct tonemap_settings *tone,
                           const struct tonemap_context *context, uint64_t effects, double brightest,
                           struct accuracy_figures *out, struct accuracy_map *map, struct error *err) MUST_CHECK;

/* The picture without its noise; `raw` is the picture itself. With its RMSE if `evidence` is given, else without. It has no
 * figures of what a display shows: those that were tried state .4 to 1.1 of the truth (docs/DENOISING.md). A tile that
 * lacks a group is as in `raw`. `threads` 0: one for each processor. */
struct measurement_evidence {
    uint64_t effects; /* as above */
    double brightest;
};
/* `others`: where denoise_input has other frames from; NULL: there are none. */
struct measurement_others {
    uint32_t count;
    status (*find)(void *user, uint32_t k, struct denoise_other *out, struct error *err);
    void *user;
};
status measurement_denoise(const struct measurement *m, const struct measurement_others *others, const struct image *raw,
                           enum denoise_method method, unsigned threads, const struct measurement_evidence *evidence,
                           struct denoise_result *out, struct error *err) MUST_CHECK;

/* The transform in words: "reinhard02, exposure +1 EV, sRGB". */
enum { MEASURE_TEXT_MAX = 96 };
void measure_transform_text(const struct tonemap_settings *tone, char out[MEASURE_TEXT_MAX]);
