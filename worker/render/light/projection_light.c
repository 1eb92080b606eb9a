/* projection_light: a slide projector. The slide fills the frustum of the light's fields of view about its own -Z,
 * upright along +Y; outside it there is no light. Without an image it is white. */
#include "common/math/elementary.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/light/punctual.h"

static const struct scene_texture clamped = {.wrap_u = WRAP_CLAMP, .wrap_v = WRAP_CLAMP};

struct projection_light {
    struct punctual base;
    const struct texture_image *image; /* NULL: white */
    real slide_x, slide_y;             /* half the slide's size one metre ahead */
};

struct punctual *projection_light_new(const struct scene_light *light, const struct texture_image *image)
{
    struct projection_light *p = punctual_alloc(sizeof *p, LIGHT_PROJECTION, light);

    if (!p)
        return NULL;
    p->image = image;
    p->slide_y = real_tan(0.5f * light->projection_yfov_rad);
    p->slide_x = p->slide_y * light->projection_aspect;
    return &p->base;
}

void projection_light_weigh(const struct render_scene *scene, const void *light_, struct light_weight *out)
{
    const struct projection_light *light = light_;
    double x = (double)light->slide_x, y = (double)light->slide_y;
    double mean = light->image ? punctual_image_mean(light->image, &clamped, 0) : 1;

    (void)scene;
    punctual_weigh(&light->base, mean, out);
    /* Times the solid angle of the slide. */
    out->power = (double)vec3_luminance(light->base.intensity) * mean * 4 *
                 (double)real_atan2((real)(x * y), (real)sqrt(1 + x * x + y * y));
    out->bounds.emission_rad = 0;
    punctual_narrow(&light->base,
                    real_atan2(real_sqrt(light->slide_x * light->slide_x + light->slide_y * light->slide_y), 1),
                    &out->bounds);
}

/* What the slide transmits in this direction of the light's own frame. */
static struct vec3 slide_filter(const struct projection_light *light, struct vec3 d)
{
    real x, y;

    if (!(d.z < 0))
        return vec3_splat(0);
    x = d.x / (-d.z * light->slide_x);
    y = d.y / (-d.z * light->slide_y);
    if (!(real_abs(x) <= 1 && real_abs(y) <= 1))
        return vec3_splat(0);
    return light->image ? punctual_image(light->image, &clamped, 0.5f + 0.5f * x, 0.5f - 0.5f * y) : vec3_splat(1);
}

int projection_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context,
                            real u, real v, struct light_sample *out)
{
    const struct projection_light *light = light_;
    struct punctual_pose moved;
    const struct punctual_pose *pose = punctual_pose_at(&light->base, context->time, &moved);
    real share;

    (void)scene, (void)u, (void)v;
    if (!punctual_arrive(&light->base, pose->position, context->p, out, &share))
        return 0;
    (void)punctual_shine(&light->base, share, out);
    out->radiance = vec3_mul(out->radiance, slide_filter(light, punctual_to_local(pose, vec3_neg(out->direction))));
    return (vec3_max(out->radiance) > 0 && vec3_is_finite(out->radiance)) || health_throughput(out->radiance);
}
