#include "worker/render/light/environment_light.h"

#include "common/math/elementary.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/light/light.h"
#include "worker/render/world.h"

/* The share of the samples that go through portals, where any is visible. */
#define PORTAL_SHARE 0.5f

void environment_light_weigh(const struct render_scene *scene, const void *light_,
                             struct light_weight *out)
{
    const struct environment_light *light = light_;
    double radius = (double)scene->bounds_radius;

    out->power = 4 * PI_D * PI_D * radius * radius *
                 (double)environment_mean_luminance(light->map);
}

/* Density of a direction, given the map's. */
static real mixture_pdf(const struct environment_light *light,
                         const struct light_context *context, struct vec3 direction, real map_pdf)
{
    real portal_pdf;

    if (light->portals.count == 0)
        return map_pdf;
    PROFILE_EFFECT(PORTAL);
    portal_pdf = portals_pdf(&light->portals, context, direction);
    return portal_pdf < 0 ? map_pdf : (1 - PORTAL_SHARE) * map_pdf + PORTAL_SHARE * portal_pdf;
}

struct vec3 environment_light_radiance(const struct environment_light *light,
                                       const struct light_context *context,
                                       struct vec3 direction, real *pdf)
{
    struct vec3 radiance = environment_radiance_pdf(light->map, direction, pdf);

    *pdf = mixture_pdf(light, context, direction, *pdf);
    return radiance;
}

static int sample_map(const struct environment_light *light, real u, real v,
                      struct light_sample *out, real *pdf)
{
    return environment_sample(light->map, u, v, &out->direction, &out->radiance, pdf);
}

/* Where portals are visible. The same numbers choose map or portals and, rescaled, the
 * direction. */
static int sample_mixture(const struct environment_light *light,
                          const struct light_context *context, real u, real v,
                          struct light_sample *out, real *pdf)
{
    if (u < PORTAL_SHARE) {
        PROFILE_EFFECT(PORTAL);
        if (!portals_sample(&light->portals, context, light_rescaled(u, 0, PORTAL_SHARE), v,
                            &out->direction))
            return 0;
        out->radiance = environment_light_radiance(light, context, out->direction, pdf);
        return 1;
    }
    if (!sample_map(light, light_rescaled(u, PORTAL_SHARE, 1 - PORTAL_SHARE), v, out, pdf))
        return 0;
    *pdf = mixture_pdf(light, context, out->direction, *pdf);
    return 1;
}

static int sees_portal(const struct environment_light *light, const struct light_context *context)
{
    PROFILE_EFFECT(PORTAL);
    return portals_visible(&light->portals, context);
}

int environment_light_sample(const struct render_scene *scene, const void *light_,
                             const struct light_context *context, real u, real v,
                             struct light_sample *out)
{
    const struct environment_light *light = light_;
    real pdf;

    (void)scene;
    out->delta = light->alone;
    out->distance = INFINITY;
    if (light->portals.count > 0 && sees_portal(light, context)
            ? !sample_mixture(light, context, u, v, out, &pdf)
            : !sample_map(light, u, v, out, &pdf))
        return 0;
    out->pdf *= pdf;
    return out->pdf > 0;
}
