/* environment: light from infinitely far away, from a lat-long map or a constant.
 *
 * Map coordinates of a direction in the map's own axes: u = 0.5 + atan2(z, x) / (2 pi), v = acos(y) / pi from the
 * zenith. Lookups are bilinear with texel centres at half integers; u is periodic, and across a pole the neighbour is
 * (u + 1/2, mirrored v).
 * Sampling is EITHER uniform over the sphere OR by importance. pdf() agrees with sample() exactly (up to rounding,
 * which at the edge of a cell may give the neighbour's).
 *
 * The importance of a direction is its excess brightness over the mean of the map (Karlik et al. 2019, "MIS
 * compensation"). Darker directions are not sampled at all: every use is combined with sampling of the BSDF or the
 * phase function, which finds that light. A map that is nearly constant is sampled by its luminance. So is every map
 * for ENV_SAMPLING_IMPORTANCE_ONLY, where nothing else finds the darker light; a share of its samples is uniform over
 * the sphere.
 * The importance is stored as a grid just fine enough for the map, usually much coarser than the map, and a few small
 * windows, finer than the map, around suns and lamps: compact regions that hold a large share of all importance.
 * A direction of length 0, or not finite, sees black.
 * Immutable after environment_new.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/image/image.h"
#include "common/math/vec.h"
#include "common/scene/settings.h"

struct environment;

/* Takes over the image's pixels (3 channels; released on failure too). Any size from 1x1. A direction in the world is
 * first turned back by `rotate_deg` about +Y (the map turns counter-clockwise seen from above), then by `to_map`
 * (orthonormal rows; NULL: not at all). `factor` >= 0 multiplies. Values that are negative or NaN count as 0, and
 * products too large for float as its largest value (image_decode_hdr has counted what it corrected). For an all-black
 * map environment_is_black is true. ERR_INPUT for other channels or an invalid rotation or factor; ERR_NO_MEMORY. */
status environment_new(struct environment **out, struct image *map, const float32 to_map[3][3], real rotate_deg,
                       struct vec3 factor, enum env_sampling sampling, struct error *err) MUST_CHECK;
status environment_new_constant(struct environment **out, struct vec3 radiance, enum env_sampling sampling,
                                struct error *err) MUST_CHECK;
void environment_free(struct environment *env);

int environment_is_black(const struct environment *env);
size_t environment_bytes(const struct environment *env);

/* Radiance arriving along -direction (unit, pointing away from the scene). */
struct vec3 environment_radiance(const struct environment *env, struct vec3 direction);

/* Solid-angle density of environment_sample; 0 with ENV_SAMPLING_BSDF and for black. */
real environment_pdf(const struct environment *env, struct vec3 direction);

/* Both, for a ray that leaves the scene: they share the trigonometry. */
struct vec3 environment_radiance_pdf(const struct environment *env, struct vec3 direction, real *pdf);

/* May a direction of some density be black? Then the radiance tells whether a shadow ray is needed. */
int environment_has_black(const struct environment *env);

/* u, v in [0,1). Returns 0 for "no sample" (black, or ENV_SAMPLING_BSDF). */
int environment_sample(const struct environment *env, real u, real v, struct vec3 *direction, struct vec3 *radiance,
                       real *pdf);
/* The same without the radiance: reading a map's texels often misses every cache, so a light sample reads them after
 * its shadow ray arrived. */
int environment_aim(const struct environment *env, real u, real v, struct vec3 *direction, real *pdf);

/* The windows alone, if the map is sampled by importance and has any: suns and lamps. u, v in [0,1); density per solid
 * angle, 0 outside of them. */
int environment_has_windows(const struct environment *env);
void environment_aim_at_windows(const struct environment *env, real u, real v, struct vec3 *direction, real *pdf);
real environment_windows_pdf(const struct environment *env, struct vec3 direction);

/* Mean luminance over the sphere (for light selection). */
real environment_mean_luminance(const struct environment *env);

/* The size of the stored importance: columns of the grid (0: none), and windows. */
void environment_importance(const struct environment *env, uint32_t *columns, uint32_t *windows);
