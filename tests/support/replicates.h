/* replicates: a whole frame, and how far its replicates are apart. */
#ifndef AZULEJO_TESTS_REPLICATES_H
#define AZULEJO_TESTS_REPLICATES_H

#include "worker/render/render.h"

/* Render the whole frame: mean of all samples, and the variance of that mean estimated from
 * the two replicates of each group, both [height][width][3]; `variance` may be NULL. Adds to *stats.
 * Both arrays are the caller's. */
void replicates_render(const struct render_scene *scene, const struct render_settings *settings,
                       uint32_t frame, double *mean, double *variance, struct render_stats *stats);

#endif
