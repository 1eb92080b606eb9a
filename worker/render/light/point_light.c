/* point_light: emits equally in all directions. */
#include "worker/render/light/punctual.h"

struct punctual *point_light_new(const struct scene_light *light, const struct texture_image *image)
{
    (void)image;
    return punctual_alloc(sizeof(struct punctual), LIGHT_POINT, light);
}

void point_light_weigh(const struct render_scene *scene, const void *light, struct light_weight *out)
{
    (void)scene;
    punctual_weigh(light, 1, out);
}

int point_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context,
                       real u, real v, struct light_sample *out)
{
    const struct punctual *light = light_;
    struct punctual_pose moved;
    real share;

    (void)scene, (void)u, (void)v;
    return punctual_arrive(light, punctual_pose_at(light, context->time, &moved)->position, context->p, out, &share) &&
           punctual_shine(light, share, out);
}
