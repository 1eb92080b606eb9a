/* pbrt_texture_parts: internals of pbrt_texture, private to its files.
 *
 * pbrt_texture.c       reads directives and parameters into expressions
 * pbrt_texture_look.c  evaluates an expression at a point
 * pbrt_noise.c         Perlin's noise
 * pbrt_texture_bake.c  computes a picture of an expression
 * pbrt_texture_slot.c  puts an expression into a material's slot: as it is, or baked
 */
#pragma once

#include "client/import/pbrt/read/pbrt_context.h"

static inline int pbrt_is_constant(const struct pbrt_texture *t) { return t->op == TEXTURE_CONSTANT; }

/* rgb, and the number as out[3]. `uv` are the mesh's. Depth and cost are limited; images must have been decoded. */
void pbrt_evaluate(const struct pbrt_texture *t, const double uv[2], double out[4]);

/* About -1..1, 0 at whole numbers; repeats after 256. Magnitudes below 2^52. */
double pbrt_noise(double x, double y, double z);

/* Compute a picture and put it into the slot. `alpha` may be NULL; the factor becomes 1. */
status pbrt_bake_color(struct pbrt *p, const struct pbrt_texture *color, const struct pbrt_texture *alpha, float limit,
                       float factor[3], struct scene_texture_slot *slot) MUST_CHECK;
status pbrt_bake_scalar(struct pbrt *p, const struct pbrt_texture *value, pbrt_change *change, double parameter,
                        float *factor, struct scene_texture_slot *slot) MUST_CHECK;

/* Make the slot show the texture, once each `period` of (s, t). */
status pbrt_slot_put(struct pbrt *p, const struct scene_texture *texture, const double mapping[2][3], double period,
                     struct scene_texture_slot *slot) MUST_CHECK;
