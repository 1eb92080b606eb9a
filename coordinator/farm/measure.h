/* measure: a picture's errors, from its four replicates and the way it is shown.
 *
 * common/accuracy computes; this file prepares its input: copies of a film's replicates and of its
 * largest contributions, and the job's tone mapping with its measurements of the mean, so that a
 * display code means the same in every replicate.
 */
#ifndef AZULEJO_COORDINATOR_MEASURE_H
#define AZULEJO_COORDINATOR_MEASURE_H

#include "common/accuracy/figures.h"
#include "common/base/status.h"
#include "common/film/film.h"
#include "common/tonemap/tonemap.h"

/* Copied from a film, which may change afterwards. */
struct measurement {
    uint32_t width, height, tiles;
    float *replicates[REPLICATES];  /* [height][width][3] */
    uint32_t *samples;              /* [tiles][GROUPS], of a pixel */
    float *tails;                   /* [tiles][GROUPS][TAIL_MAX] */
    uint64_t pixel_samples;         /* of all pixels */
};

/* ERR_NO_MEMORY. */
status measurement_take(struct measurement *out, const struct film *film,
                        struct error *err) MUST_CHECK;
void measurement_release(struct measurement *m);

/* How the job shows its pictures, `context` with the operator's file; `effects` that the frame
 * calls for; `brightest`: accuracy_brightest of its scene, 0: not known. `map` may be NULL.
 * ERR_NO_MEMORY, and errors of the tone mapping. */
status measurement_figures(const struct measurement *m, const struct tonemap_settings *tone,
                           const struct tonemap_context *context, uint64_t effects,
                           double brightest, struct accuracy_figures *out,
                           struct accuracy_map *map, struct error *err) MUST_CHECK;

/* The transform in words: "reinhard02, exposure +1 EV, sRGB". */
enum { MEASURE_TEXT_MAX = 96 };
void measure_transform_text(const struct tonemap_settings *tone, char out[MEASURE_TEXT_MAX]);

#endif
