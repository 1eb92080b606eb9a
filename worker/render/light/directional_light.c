/* directional_light: parallel light from infinitely far away; its intensity is an irradiance. */
#include "common/math/elementary.h"
#include "worker/render/light/punctual.h"
#include "worker/render/render_scene.h"

struct punctual *directional_light_new(const struct scene_light *light, const struct texture_image *image)
{
    (void)image;
    return punctual_alloc(sizeof(struct punctual), LIGHT_DIRECTIONAL, light);
}

void directional_light_weigh(const struct render_scene *scene, const void *light_, struct light_weight *out)
{
    const struct punctual *light = light_;
    double radius = (double)scene->bounds_radius;

    out->power = (double)vec3_luminance(light->intensity) * PI_D * radius * radius;
}

int directional_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context,
                             real u, real v, struct light_sample *out)
{
    const struct punctual *light = light_;
    struct punctual_pose moved;

    (void)scene, (void)u, (void)v;
    out->direction = vec3_neg(punctual_pose_at(light, context->time, &moved)->direction);
    out->distance = INFINITY;
    return punctual_shine(light, 1, out);
}
