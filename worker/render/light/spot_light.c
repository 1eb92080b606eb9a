/* spot_light: a point that emits within a cone with a soft edge: KHR_lights_punctual's ramp or pbrt's, of either version. */
#include "common/math/elementary.h"
#include "worker/render/light/punctual.h"

struct spot_light {
    struct punctual base;
    enum scene_falloff falloff;
    real cos_inner, cos_outer;
};

struct punctual *spot_light_new(const struct scene_light *light, const struct texture_image *image)
{
    struct spot_light *s = punctual_alloc(sizeof *s, LIGHT_SPOT, light);

    (void)image;
    if (!s)
        return NULL;
    s->falloff = light->falloff;
    s->cos_inner = real_cos(light->inner_cone_rad);
    s->cos_outer = real_cos(light->outer_cone_rad);
    return &s->base;
}

void spot_light_weigh(const struct render_scene *scene, const void *light_, struct light_weight *out)
{
    const struct spot_light *light = light_;
    real inner_rad = real_acos(light->cos_inner);

    (void)scene;
    punctual_weigh(&light->base, 1, out);
    out->power = (double)vec3_luminance(light->base.intensity) * 2 * PI_D * (1 - (double)light->cos_outer);
    out->bounds.emission_rad = real_max(0, real_acos(light->cos_outer) - inner_rad);
    punctual_narrow(&light->base, inner_rad, &out->bounds);
}

static real cone_falloff(const struct spot_light *light, real cos_angle)
{
    real span = light->cos_inner - light->cos_outer, fade;

    if (light->falloff == FALLOFF_GLTF)
        span = real_max(REAL(0.001), span);
    else if (!(span > 0))
        return cos_angle >= light->cos_outer ? 1 : 0;
    fade = real_min(1, real_max(0, (cos_angle - light->cos_outer) / span));
    switch (light->falloff) {
    case FALLOFF_SMOOTHSTEP: return fade * fade * (3 - 2 * fade);
    case FALLOFF_FOURTH: return fade * fade * (fade * fade);
    default: return fade * fade;
    }
}

int spot_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context, real u,
                      real v, struct light_sample *out)
{
    const struct spot_light *light = light_;
    struct punctual_pose moved;
    const struct punctual_pose *pose = punctual_pose_at(&light->base, context->time, &moved);
    real share;

    (void)scene, (void)u, (void)v;
    if (!punctual_arrive(&light->base, pose->position, context->p, out, &share))
        return 0;
    share *= cone_falloff(light, -vec3_dot(pose->direction, out->direction));
    return punctual_shine(&light->base, share, out);
}
