#include "worker/render/light/environment/environment_light.h"

#include "common/math/elementary.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/light/light.h"
#include "worker/render/render_scene.h"

/* The share of the samples that go through portals, where any is visible. */
#define PORTAL_SHARE 0.5f

void environment_light_weigh(const struct render_scene *scene, const void *light_, struct light_weight *out)
{
    const struct environment_light *light = light_;
    double radius = (double)scene->bounds_radius;

    out->power = 4 * PI_D * PI_D * radius * radius * (double)environment_mean_luminance(light->map);
}

/* Density of a direction, given the map's and the portals' solid angle. */
static real mixture_pdf(const struct environment_light *light, const struct light_context *context,
                        struct vec3 direction, real solid_angle, real map_pdf)
{
    real portal_pdf = portals_crossed(&light->portals, context, direction) / solid_angle;

    return (1 - PORTAL_SHARE) * map_pdf + PORTAL_SHARE * portal_pdf;
}

struct vec3 environment_light_radiance(const struct environment_light *light, const struct light_context *context,
                                       struct vec3 direction, real *pdf)
{
    const struct sky_region *region = sky_guide_region(&light->guide, context);
    struct vec3 radiance;

    if (region)
        return sky_guide_radiance(&light->guide, light->map, region, direction, pdf);
    radiance = environment_radiance_pdf(light->map, direction, pdf);
    if (light->portals.count > 0) {
        struct portals_view view;

        PROFILE_EFFECT(PORTAL);
        portals_look(&light->portals, context, &view);
        if (view.solid_angle > 0)
            *pdf = mixture_pdf(light, context, direction, view.solid_angle, *pdf);
    }
    return radiance;
}

/* Half of the samples go through the portals, where any is visible. The same numbers choose map or portals
 * and, rescaled, the direction. */
static int aim(const struct environment_light *light, const struct light_context *context, real u, real v,
               struct vec3 *direction, real *pdf)
{
    const struct sky_region *region = sky_guide_region(&light->guide, context);
    struct portals_view view;

    if (region)
        return sky_guide_aim(&light->guide, light->map, region, u, v, direction, pdf);
    if (light->portals.count == 0)
        return environment_aim(light->map, u, v, direction, pdf);
    PROFILE_EFFECT(PORTAL);
    portals_look(&light->portals, context, &view);
    if (!(view.solid_angle > 0))
        return environment_aim(light->map, u, v, direction, pdf);
    if (u < PORTAL_SHARE) {
        if (!portals_sample(&light->portals, context, &view, light_rescaled(u, 0, PORTAL_SHARE), v, direction))
            return 0;
        *pdf = environment_pdf(light->map, *direction);
    } else if (!environment_aim(light->map, light_rescaled(u, PORTAL_SHARE, 1 - PORTAL_SHARE), v, direction, pdf)) {
        return 0;
    }
    *pdf = mixture_pdf(light, context, *direction, view.solid_angle, *pdf);
    return 1;
}

int environment_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context,
                             real u, real v, struct light_sample *out)
{
    const struct environment_light *light = light_;
    real pdf;

    (void)scene;
    out->delta = light->alone;
    out->distance = INFINITY;
    if (!aim(light, context, u, v, &out->direction, &pdf))
        return 0;
    if (environment_has_black(light->map))
        out->radiance = environment_radiance(light->map, out->direction);
    else
        out->unread = light->map;
    out->pdf *= pdf;
    return out->pdf > 0;
}
