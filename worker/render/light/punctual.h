/* punctual: what the lights of a scene's list have in common. They have no surface: the light comes from one point or
 * from one direction.
 *
 * A light that moves has its pose at `motion_steps` moments, evenly spaced from the shutter's opening to its closing;
 * in between, positions move along straight lines and directions are interpolated.
 */
#pragma once

#include "worker/render/light/light.h"

/* The pose of the light. Fields that its kind does not use are 0. */
struct punctual_pose {
    struct vec3 position, direction;
    struct vec3 axis[3]; /* the light's x, y, z in world space */
};

struct punctual_motion {
    uint32_t steps;                 /* 0: no motion while the shutter is open; else >= 2 */
    const struct punctual_pose *at; /* [steps] */
};

/* Each kind's struct begins with it. */
struct punctual {
    enum scene_light_kind kind;
    struct punctual_pose pose; /* at the shutter's opening */
    struct punctual_motion motion;
    struct vec3 intensity;
    real range; /* metres; 0: unlimited */
};

void punctual_pose_of(struct punctual_pose *out, const struct scene_light *light);

/* A zeroed struct of that size that begins with a struct punctual filled from the description,
 * without motion. NULL: out of memory. */
void *punctual_alloc(size_t size, enum scene_light_kind kind, const struct scene_light *light);

/* The pose at `time` (0..1 of the shutter); `moved` is storage for a pose between steps. */
const struct punctual_pose *punctual_pose_at(const struct punctual *p, real time, struct punctual_pose *moved);

/* ---- for kinds at a point --------------------------------------------------------------------- */

/* Bounds of a light that emits equally in all directions, or whose mean over them is `mean`; its
 * intensity and its power. */
void punctual_weigh(const struct punctual *p, double mean, struct light_weight *out);
/* Then, for a light that emits within `spread_rad` of its direction, which may turn. */
void punctual_narrow(const struct punctual *p, real spread_rad, struct light_bounds *bounds);

/* Direction and distance of the light at `position`, and the share of its intensity that arrives:
 * inverse-square falloff within its range. 0: nothing. */
int punctual_arrive(const struct punctual *p, struct vec3 position, struct vec3 at, struct light_sample *out,
                    real *share);
/* Complete the sample with that share of the intensity. 0: nothing arrives. */
int punctual_shine(const struct punctual *p, real share, struct light_sample *out);

/* What an image transmits, at its finest level, bilinear, decoded from sRGB if its values are
 * integers; u, v as in texture_lookup. */
struct vec3 punctual_image(const struct texture_image *image, const struct scene_texture *wrap, real u, real v);
/* Mean luminance of an image on a grid; `latitudes`: it covers the sphere, so rows weigh by their solid angle. */
double punctual_image_mean(const struct texture_image *image, const struct scene_texture *wrap, int latitudes);
/* A direction in the light's own frame. */
struct vec3 punctual_to_local(const struct punctual_pose *pose, struct vec3 direction);
