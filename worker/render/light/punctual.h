/* punctual: lights without a surface: points, spots, the sun's kind, and points that shine
 * through an image.
 *
 * An image is looked up at its finest, bilinear, decoded from sRGB where it is of integers.
 * Goniometric: latitude and longitude of the direction in the light's own frame, laid out as
 * an environment map. Projection: the slide fills the frustum of the light's fields of view
 * about its own -Z, upright along +Y; outside of it there is no light.
 */
#ifndef AZULEJO_RENDER_PUNCTUAL_H
#define AZULEJO_RENDER_PUNCTUAL_H

#include "common/scene/scene.h"
#include "worker/render/light/tree.h"
#include "worker/render/texture.h"

struct punctual {
    enum scene_light_kind kind;
    enum scene_falloff falloff;
    struct vec3 position, direction, intensity;
    float range;
    float cos_inner, cos_outer;
    struct vec3 axis[3];                /* the light's x, y, z in the world */
    float slide_x, slide_y;             /* half the slide's size one metre ahead */
    const struct texture_image *image;  /* NULL: white */
};

/* `image`: decoded, or NULL; must outlive it. */
void punctual_init(struct punctual *p, const struct scene_light *light,
                   const struct texture_image *image);

/* What a light that is not directional can do; its intensity is a luminance. */
void punctual_bounds(const struct punctual *p, struct light_bounds *out);
/* Luminous power, W; of a directional light through the scene's sphere of this radius. */
double punctual_power(const struct punctual *p, double scene_radius);

/* Direction (unit) to the light, distance (INFINITY: directional), and the irradiance of a
 * surface at p that faces it. 0: none arrives. */
int punctual_sample(const struct punctual *light, struct vec3 p, struct vec3 *direction,
                    float *distance, struct vec3 *irradiance);

#endif
