/* punctual: what the lights of a scene's list have in common. They have no surface: light comes from
 * one point, or from one direction.
 *
 * A light that moves has its pose at `motion_steps` moments, evenly from the shutter's opening to
 * its closing; in between places run along straight lines and directions are mixed.
 */
#ifndef AZULEJO_RENDER_PUNCTUAL_H
#define AZULEJO_RENDER_PUNCTUAL_H

#include "worker/render/light/light.h"

/* Where it is. What the light's kind does not ask for is 0. */
struct punctual_pose {
    struct vec3 position, direction;
    struct vec3 axis[3];                /* the light's x, y, z in the world */
};

struct punctual_motion {
    uint32_t steps;                     /* 0: it stands still while the shutter is open; else >= 2 */
    const struct punctual_pose *at;     /* [steps] */
};

/* Each kind's struct begins with it. */
struct punctual {
    enum scene_light_kind kind;
    struct punctual_pose pose;          /* at the shutter's opening */
    struct punctual_motion motion;
    struct vec3 intensity;
    float range;                        /* metres; 0: unlimited */
};

void punctual_pose_of(struct punctual_pose *out, const struct scene_light *light);

/* A zeroed struct of that size that begins with a struct punctual of the description, which stands
 * still. NULL: out of memory. */
void *punctual_alloc(size_t size, enum scene_light_kind kind, const struct scene_light *light);

/* The pose at `time` (0..1 of the shutter); `moved` is where to put one between steps. */
const struct punctual_pose *punctual_pose_at(const struct punctual *p, float time,
                                             struct punctual_pose *moved);

/* ---- for kinds at a point --------------------------------------------------------------------- */

/* Bounds of a light that shines evenly in all directions, or whose mean over them is `mean`; its
 * intensity and its power. */
void punctual_weigh(const struct punctual *p, double mean, struct light_weight *out);
/* Then, of one that shines within `spread_rad` of its direction, which may turn. */
void punctual_narrow(const struct punctual *p, float spread_rad, struct light_bounds *bounds);

/* Direction and distance of the light at `position`, and the share that arrives of its intensity:
 * inverse-square falloff within its range. 0: nothing. */
int punctual_arrive(const struct punctual *p, struct vec3 position, struct vec3 at,
                    struct light_sample *out, float *share);
/* Finishes the sample with that share of the intensity. 0: nothing arrives. */
int punctual_shine(const struct punctual *p, float share, struct light_sample *out);

/* What an image lets through, at its finest, bilinear, decoded from sRGB where it is of integers;
 * u, v as texture_lookup has them. */
struct vec3 punctual_image(const struct texture_image *image, const struct scene_texture *wrap,
                           float u, float v);
/* Mean luminance of an image on a grid; `latitudes`: it is wrapped round the sphere, so that rows
 * weigh by their solid angle. */
double punctual_image_mean(const struct texture_image *image, const struct scene_texture *wrap,
                           int latitudes);
/* A direction in the light's own frame. */
struct vec3 punctual_to_local(const struct punctual_pose *pose, struct vec3 direction);

#endif
