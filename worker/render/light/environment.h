/* environment: light from infinitely far away, by a lat-long map or a constant.
 *
 * Map coordinates: u = 0.5 + atan2(z, x) / (2 pi) after undoing the rotation about +Y,
 * v = acos(y) / pi from the zenith. Lookups are bilinear with texel centres at half
 * integers; u is periodic, and across a pole the neighbour is (u + 1/2, mirrored v).
 * Sampling: EITHER uniform over the sphere OR by a density that is positive wherever the
 * bilinear radiance is; pdf() agrees with sample() exactly (to rounding). The importance
 * density is the bilinear interpolant of luminance * sin(theta) in (u, v) between the texel
 * centres; at a pole its node is 0, unless the light across the pole is the brighter.
 * A direction of length 0, or not finite, sees black.
 * Immutable after environment_new.
 */
#ifndef AZULEJO_RENDER_ENVIRONMENT_H
#define AZULEJO_RENDER_ENVIRONMENT_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/image/image.h"
#include "common/math/vec.h"
#include "common/scene/settings.h"

struct environment;

/* Takes over the image's pixels (3 channels; released on failure too). Any size from 1x1.
 * `rotate_deg` turns the map about +Y, counter-clockwise seen from above, for lookups and
 * sampling alike; `strength` >= 0 multiplies. Values that are negative or NaN count as 0, and
 * products beyond float as its largest value (image_decode_hdr has counted what it mended).
 * An all-black map yields an environment whose environment_is_black is true. ERR_INPUT for
 * other channels, a rotation or strength that is not finite; ERR_NO_MEMORY. */
status environment_new(struct environment **out, struct image *map, float rotate_deg,
                       float strength, enum env_sampling sampling, struct error *err) MUST_CHECK;
status environment_new_constant(struct environment **out, struct vec3 radiance,
                                enum env_sampling sampling, struct error *err) MUST_CHECK;
void environment_free(struct environment *env);

int environment_is_black(const struct environment *env);
size_t environment_bytes(const struct environment *env);

/* Radiance arriving along -direction (unit, pointing away from the scene). */
struct vec3 environment_radiance(const struct environment *env, struct vec3 direction);

/* Solid-angle density of environment_sample; 0 with ENV_SAMPLING_BSDF and for black. */
float environment_pdf(const struct environment *env, struct vec3 direction);

/* Both, for a ray that leaves the scene: they share the trigonometry and the texels. */
struct vec3 environment_radiance_pdf(const struct environment *env, struct vec3 direction,
                                     float *pdf);

/* u, v in [0,1). Returns 0 for "no sample" (black, or ENV_SAMPLING_BSDF). */
int environment_sample(const struct environment *env, float u, float v, struct vec3 *direction,
                       struct vec3 *radiance, float *pdf);

/* Mean luminance over the sphere (for light selection). */
float environment_mean_luminance(const struct environment *env);

#endif
