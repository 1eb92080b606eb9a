/* groups: a whole frame, and how far its two groups of samples are apart. */
#pragma once

#include "worker/render/render.h"

/* Render the whole frame: mean of all samples, and the variance of that mean estimated from
 * the difference of the groups, with one degree of freedom, both [height][width][3]; `variance` may be NULL. Adds to *stats.
 * Both arrays are the caller's. */
void groups_render(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                   double *mean, double *variance, struct render_stats *stats);
/* The same with half of what the first group has more than the second: the variance is its square. */
void groups_render_apart(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                         double *mean, double *apart, struct render_stats *stats);
