/* spot_light: a point that emits within a cone with a soft edge: KHR_lights_punctual's ramp or
 * pbrt's smooth step. */
#include "common/math/elementary.h"
#include "worker/render/light/punctual.h"

struct spot_light {
    struct punctual base;
    enum scene_falloff falloff;
    float cos_inner, cos_outer;
};

struct punctual *spot_light_new(const struct scene_light *light, const struct texture_image *image)
{
    struct spot_light *s = punctual_alloc(sizeof *s, LIGHT_SPOT, light);

    (void)image;
    if (!s)
        return NULL;
    s->falloff = light->falloff;
    s->cos_inner = det_cos(light->inner_cone_rad);
    s->cos_outer = det_cos(light->outer_cone_rad);
    return &s->base;
}

void spot_light_weigh(const struct render_scene *scene, const void *light_,
                      struct light_weight *out)
{
    const struct spot_light *light = light_;
    float inner_rad = det_acos(light->cos_inner);

    (void)scene;
    punctual_weigh(&light->base, 1, out);
    out->power = (double)vec3_luminance(light->base.intensity) * 2 * PI_D *
                 (1 - (double)light->cos_outer);
    out->bounds.emission_rad = float_max(0, det_acos(light->cos_outer) - inner_rad);
    punctual_narrow(&light->base, inner_rad, &out->bounds);
}

static float cone_falloff(const struct spot_light *light, float cos_angle)
{
    float span = light->cos_inner - light->cos_outer, fade;

    if (light->falloff == FALLOFF_GLTF)
        span = float_max(0.001f, span);
    else if (!(span > 0))
        return cos_angle >= light->cos_outer ? 1 : 0;
    fade = float_min(1, float_max(0, (cos_angle - light->cos_outer) / span));
    return light->falloff == FALLOFF_GLTF ? fade * fade : fade * fade * (3 - 2 * fade);
}

int spot_light_sample(const struct render_scene *scene, const void *light_,
                      const struct light_context *context, float u, float v,
                      struct light_sample *out)
{
    const struct spot_light *light = light_;
    struct punctual_pose moved;
    const struct punctual_pose *pose = punctual_pose_at(&light->base, context->time, &moved);
    float share;

    (void)scene, (void)u, (void)v;
    if (!punctual_arrive(&light->base, pose->position, context->p, out, &share))
        return 0;
    share *= cone_falloff(light, -vec3_dot(pose->direction, out->direction));
    return punctual_shine(&light->base, share, out);
}
