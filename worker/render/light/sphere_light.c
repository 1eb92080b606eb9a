#include "worker/render/light/sphere_light.h"

#include "common/math/elementary.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/bsdf/warp.h"
#include "worker/render/base/exact.h"
#include "worker/render/surface/surface_sphere.h"

/* What a place sees of the sphere. */
struct sphere_view {
    const struct world_sphere *sphere;
    double to_centre[3], distance; /* metres, from the place */
    int inside;
    int lit;                       /* it shines towards the place */
    double height;                 /* of the cone's cap: 1 - cos of its half angle; outside */
};

static void sphere_view_init(struct sphere_view *view, const struct render_scene *scene,
                             const struct triangle_light *light, struct vec3 from)
{
    const struct world_instance *instance = &scene->instances[light->instance];
    const struct accel_sphere *shape = &instance->sphere->shape;
    double p[3], sine2;

    exact_vec(from, p);
    view->sphere = instance->sphere;
    exact_sub(shape->centre, p, view->to_centre);
    view->distance = sqrt(exact_dot(view->to_centre, view->to_centre));
    view->inside = !(view->distance > shape->radius);
    view->lit = view->inside == view->sphere->inward ||
                scene->materials[instance->material].m.double_sided;
    sine2 = shape->radius / view->distance;
    sine2 *= sine2;
    view->height = view->inside ? 0 : sine2 / (1 + sqrt(1 - sine2)); /* does not cancel far away */
}

/* Per solid angle, of a point of the surface that is chosen uniformly. */
static float surface_pdf(double radius, float distance_squared, float cosine)
{
    return triangle_light_pdf(1, distance_squared, cosine, (float)(4 * PI_D * radius * radius));
}

static float cone_pdf(const struct sphere_view *view)
{
    return (float)(1 / (2 * PI_D * view->height));
}

float sphere_light_pdf(const struct render_scene *scene, const struct triangle_light *light,
                       const struct light_context *context, float distance_squared, float cosine)
{
    struct sphere_view view;

    sphere_view_init(&view, scene, light, context->p);
    if (!view.lit)
        return 0;
    return view.inside ? surface_pdf(view.sphere->shape.radius, distance_squared, cosine)
                       : cone_pdf(&view);
}

/* A unit vector around the axis +z of a cap, uniform in solid angle: 1 - cos is `rise`. */
static struct vec3 cap_direction(double rise, float v)
{
    float width = (float)sqrt(rise * (2 - rise)), sine, cosine;

    sincos_turn(v, &sine, &cosine);
    return vec3_make(width * cosine, width * sine, (float)(1 - rise));
}

/* The direction, the distance and the cosine at the light. */
static void sample_cone(const struct sphere_view *view, float u, float v, struct light_sample *out)
{
    double radius = view->sphere->shape.radius, rise = (double)u * view->height;
    double aside2 = rise * (2 - rise) * view->distance * view->distance;
    double depth = sqrt(fmax(radius * radius - aside2, 0));
    struct basis frame = basis_from_normal(
        vec3_make((float)(view->to_centre[0] / view->distance),
                  (float)(view->to_centre[1] / view->distance),
                  (float)(view->to_centre[2] / view->distance)));

    out->direction = vec3_normalize(basis_to_world(&frame, cap_direction(rise, v)));
    out->distance = (float)(view->distance * (1 - rise) - depth);
    out->cosine = (float)(depth / radius);
    out->pdf *= cone_pdf(view);
}

static void sample_surface(const struct sphere_view *view, float u, float v,
                           struct light_sample *out)
{
    double radius = view->sphere->shape.radius;
    struct vec3 normal = cap_direction(2 * (double)u, v);
    struct vec3 to_light = vec3_make((float)(view->to_centre[0] + radius * (double)normal.x),
                                     (float)(view->to_centre[1] + radius * (double)normal.y),
                                     (float)(view->to_centre[2] + radius * (double)normal.z));

    out->distance = vec3_length(to_light);
    out->direction = vec3_normalize(to_light);
    out->cosine = fabsf(vec3_dot(normal, out->direction));
    out->pdf *= surface_pdf(radius, out->distance * out->distance, out->cosine);
}

/* An even lamp: its vertex does not matter. */
static struct vec3 radiance_towards(const struct render_scene *scene,
                                    const struct triangle_light *light, float cosine)
{
    const struct world_instance *instance = &scene->instances[light->instance];
    const struct world_material *material = &scene->materials[instance->material];
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    struct vec3 radiance = world_emission(material, mesh, mesh->indices, 0, 0);

    if (material->m.clearcoat > 0)
        radiance = vec3_scale(radiance, world_emission_scale(material, mesh, mesh->indices, 0, 0,
                                                             cosine));
    return radiance;
}

int sphere_light_sample(const struct render_scene *scene, const void *light_,
                        const struct light_context *context, float u, float v,
                        struct light_sample *out)
{
    const struct triangle_light *light = light_;
    struct sphere_view view;

    sphere_view_init(&view, scene, light, context->p);
    if (!view.lit)
        return 0;
    if (view.inside)
        sample_surface(&view, u, v, out);
    else
        sample_cone(&view, u, v, out);
    if (!(out->distance > 0))
        return health_distance(out->distance);
    if (!(out->pdf > 0) || !isfinite(out->pdf))
        return health_density(out->pdf);
    out->on_face = 1;
    out->face = (struct hit){light->instance, 0};
    /* There are no edges; near boundaries what is right before the end counts. */
    out->inset = world_near_boundary(scene, vec3_mad(context->p, out->direction, out->distance))
                     ? 0 : INFINITY;
    out->radiance = radiance_towards(scene, light, out->cosine);
    out->delta = 0;
    return 1;
}

void sphere_light_weigh(const struct render_scene *scene, const void *light_,
                        struct light_weight *out)
{
    const struct triangle_light *light = light_;
    const struct world_instance *instance = &scene->instances[light->instance];
    const struct world_material *material = &scene->materials[instance->material];
    const struct accel_sphere *shape = &instance->sphere->shape;
    struct vec3 centre = vec3_make((float)shape->centre[0], (float)shape->centre[1],
                                   (float)shape->centre[2]);
    /* A little larger: the centre was rounded. */
    float reach = (float)(shape->radius + 0x1p-22 * exact_largest(shape->centre));

    out->bounds.min = vec3_sub(centre, vec3_splat(reach));
    out->bounds.max = vec3_add(centre, vec3_splat(reach));
    out->bounds.axis = vec3_make(0, 0, 1);
    out->bounds.spread_rad = PI_F;
    out->bounds.emission_rad = PI_F / 2;
    out->bounds.reach = INFINITY;
    out->bounds.lamp = light->instance;
    out->bounds.two_sided = material->m.double_sided;
    /* It sends to every side what its disk does. */
    out->intensity = PI_D * shape->radius * shape->radius *
                     (double)vec3_luminance(radiance_towards(scene, light, 1));
    if (!(out->intensity > 0 && isfinite(out->intensity)))
        out->intensity = 0;
    out->power = 4 * PI_D * out->intensity * (out->bounds.two_sided ? 2 : 1);
}
