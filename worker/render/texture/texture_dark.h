/* texture_dark: which areas of an image are exactly black.
 *
 * Most of an emissive texture usually is; areas that are black everywhere are not light sources.
 */
#pragma once

#include "common/base/status.h"
#include "worker/render/texture/texture.h"

struct texture_dark;

status texture_dark_new(struct texture_dark **out, const struct texture_image *image, struct error *err) MUST_CHECK;
void texture_dark_free(struct texture_dark *dark);

/* Do all lookups of the finest level with u, v in these closed ranges give r, g and b of exactly 0?
 * If in doubt: no. Ends that are not finite: no. */
int texture_dark_in(const struct texture_dark *dark, const struct scene_texture *texture, const double u[2],
                    const double v[2]);
