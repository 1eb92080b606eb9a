/* punctual: lights without a surface: points, spots, the sun's kind, and points that shine
 * through an image.
 *
 * An image is looked up at its finest, bilinear, decoded from sRGB where it is of integers.
 * Goniometric: latitude and longitude of the direction in the light's own frame, laid out as
 * an environment map. Projection: the slide fills the frustum of the light's fields of view
 * about its own -Z, upright along +Y; outside of it there is no light.
 *
 * A light that moves has its pose at `motion_steps` moments, evenly from the shutter's opening to
 * its closing; in between places run along straight lines and directions are mixed.
 */
#ifndef AZULEJO_RENDER_PUNCTUAL_H
#define AZULEJO_RENDER_PUNCTUAL_H

#include "common/scene/scene.h"
#include "worker/render/light/tree.h"
#include "worker/render/texture.h"

/* Where it is. What the light's kind does not ask for is 0. */
struct punctual_pose {
    struct vec3 position, direction;
    struct vec3 axis[3];                /* the light's x, y, z in the world */
};

struct punctual_motion {
    uint32_t steps;                     /* 0: it stands still while the shutter is open; else >= 2 */
    const struct punctual_pose *at;     /* [steps] */
};

struct punctual {
    enum scene_light_kind kind;
    enum scene_falloff falloff;
    struct punctual_pose pose;          /* at the shutter's opening */
    struct punctual_motion motion;
    struct vec3 intensity;
    float range;
    float cos_inner, cos_outer;
    float slide_x, slide_y;             /* half the slide's size one metre ahead */
    const struct texture_image *image;  /* NULL: white */
};

void punctual_pose_of(struct punctual_pose *out, const struct scene_light *light);

/* One that stands still. `image`: decoded, or NULL; must outlive it. */
void punctual_init(struct punctual *p, const struct scene_light *light,
                   const struct texture_image *image);

/* What a light that is not directional can do while the shutter is open; its intensity is a luminance. */
void punctual_bounds(const struct punctual *p, struct light_bounds *out);
/* Luminous power, W; of a directional light through the scene's sphere of this radius. */
double punctual_power(const struct punctual *p, double scene_radius);

/* At `time` (0..1 of the shutter): direction (unit) to the light, distance (INFINITY:
 * directional), and the irradiance of a surface at p that faces it. 0: none arrives. */
int punctual_sample(const struct punctual *light, struct vec3 p, float time,
                    struct vec3 *direction, float *distance, struct vec3 *irradiance);

#endif
