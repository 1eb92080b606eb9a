/* goniometric_light: a point light with an image over its sphere of directions: latitude and
 * longitude in the light's own frame, laid out like an environment map. */
#include "common/math/elementary.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/light/punctual.h"

static const struct scene_texture lat_long = {.wrap_u = WRAP_REPEAT, .wrap_v = WRAP_CLAMP};

struct goniometric_light {
    struct punctual base;
    const struct texture_image *image;
};

/* Without an image it is a point light. */
struct punctual *goniometric_light_new(const struct scene_light *light, const struct texture_image *image)
{
    struct goniometric_light *g;

    if (!image)
        return point_light_new(light, NULL);
    g = punctual_alloc(sizeof *g, LIGHT_GONIOMETRIC, light);
    if (!g)
        return NULL;
    g->image = image;
    return &g->base;
}

void goniometric_light_weigh(const struct render_scene *scene, const void *light_, struct light_weight *out)
{
    const struct goniometric_light *light = light_;

    (void)scene;
    punctual_weigh(&light->base, punctual_image_mean(light->image, &lat_long, 1), out);
}

int goniometric_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context,
                             real u, real v, struct light_sample *out)
{
    const struct goniometric_light *light = light_;
    struct punctual_pose moved;
    const struct punctual_pose *pose = punctual_pose_at(&light->base, context->time, &moved);
    struct vec3 d;
    real share;

    (void)scene, (void)u, (void)v;
    if (!punctual_arrive(&light->base, pose->position, context->p, out, &share))
        return 0;
    (void)punctual_shine(&light->base, share, out);
    d = punctual_to_local(pose, vec3_neg(out->direction));
    out->radiance =
        vec3_mul(out->radiance, punctual_image(light->image, &lat_long, 0.5f + real_atan2(d.z, d.x) * REAL_INV_2PI,
                                               real_atan2(real_sqrt(d.x * d.x + d.z * d.z), d.y) * REAL_INV_PI));
    return (vec3_max(out->radiance) > 0 && vec3_is_finite(out->radiance)) || health_throughput(out->radiance);
}
