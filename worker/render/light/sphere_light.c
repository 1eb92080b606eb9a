/* sphere_light: an emissive sphere (shape/sphere.h), sampled by the directions in which it is seen:
 * uniformly in the cone around it (Shirley, Wang and Zimmerman 1996, "Monte Carlo Techniques for
 * Direct Lighting Calculations", section 3.2.2), from inside uniformly over its surface. */
#include "worker/render/light/face_light.h"

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/bsdf/warp.h"
#include "worker/render/base/exact.h"
#include "worker/render/shape/sphere.h"
#include "worker/render/render_scene.h"

/* The sphere as seen from a point. */
struct sphere_view {
    const struct sphere_shape *sphere;
    double to_centre[3], distance; /* metres, from the place */
    int inside;
    int lit;       /* it emits towards the point */
    double height; /* of the cone's cap: 1 - cos of its half angle; if outside */
};

/* 1 - cos of the half angle at which a sphere is seen, from the square of its sine; does not cancel far away. */
static double cap_height(double sine2)
{
    if (!SAFEGUARD(SPHERE_LAMP_FAR))
        return (double)(1.0f - real_sqrt(1.0f - (real)sine2));
    return sine2 / (1 + sqrt(1 - sine2));
}

/* Is it sampled by a cone? From inside there is none around it. */
static int has_cone(int inside) { return !inside || !SAFEGUARD(SPHERE_LAMP_INSIDE); }

static void sphere_view_init(struct sphere_view *view, const struct render_scene *scene, const struct hit *light,
                             struct vec3 from)
{
    const struct render_instance *instance = &scene->instances[light->instance];
    const struct sphere_shape *sphere = sphere_of(instance->shape);
    double p[3], sine2;

    exact_vec(from, p);
    view->sphere = sphere;
    exact_sub(sphere->centre, p, view->to_centre);
    view->distance = sqrt(exact_dot(view->to_centre, view->to_centre));
    view->inside = !(view->distance > sphere->radius);
    view->lit = view->inside == (int)sphere->shape.front || scene->materials[instance->material].m.double_sided;
    sine2 = sphere->radius / view->distance;
    sine2 *= sine2;
    view->height = has_cone(view->inside) ? cap_height(sine2) : 0;
}

static real cone_pdf(const struct sphere_view *view) { return (real)(1 / (2 * PI_D * view->height)); }

/* Per solid angle, of a point of the surface that is chosen uniformly. */
static real surface_pdf(const struct sphere_view *view, real distance_squared, real cosine)
{
    double radius = view->sphere->radius;
    struct light_meeting met = {.odds = 1, .distance_squared = distance_squared, .cosine = cosine};

    return face_light_area_pdf(&met, (real)(4 * PI_D * radius * radius));
}

/* The distance and the cosine count only inside. */
real sphere_light_pdf(const struct render_scene *scene, const void *light, const struct light_context *context,
                      const struct light_meeting *met)
{
    struct sphere_view view;

    sphere_view_init(&view, scene, light, context->p);
    if (!view.lit)
        return 0;
    return met->odds *
           (has_cone(view.inside) ? cone_pdf(&view) : surface_pdf(&view, met->distance_squared, met->cosine));
}

/* A unit vector around the axis +z of a cap, uniform in solid angle: 1 - cos is `rise`. */
static struct vec3 cap_direction(double rise, real v)
{
    real width = (real)sqrt(rise * (2 - rise)), sine, cosine;

    sincos_turn(v, &sine, &cosine);
    return vec3_make(width * cosine, width * sine, (real)(1 - rise));
}

/* Direction, distance and cosine at the light. */
static void sample_cone(const struct sphere_view *view, real u, real v, struct light_sample *out)
{
    double radius = view->sphere->radius, rise = (double)u * view->height;
    double aside2 = rise * (2 - rise) * view->distance * view->distance;
    double depth = sqrt(fmax(radius * radius - aside2, 0));
    struct basis frame = basis_from_normal(vec3_make((real)(view->to_centre[0] / view->distance),
                                                     (real)(view->to_centre[1] / view->distance),
                                                     (real)(view->to_centre[2] / view->distance)));

    out->direction = vec3_normalize(basis_to_world(&frame, cap_direction(rise, v)));
    out->distance = (real)(view->distance * (1 - rise) - depth);
    out->cosine = (real)(depth / radius);
    out->pdf *= cone_pdf(view);
}

static void sample_surface(const struct sphere_view *view, real u, real v, struct light_sample *out)
{
    double radius = view->sphere->radius;
    struct vec3 normal = cap_direction(2 * (double)u, v);
    struct vec3 to_light = vec3_make((real)(view->to_centre[0] + radius * (double)normal.x),
                                     (real)(view->to_centre[1] + radius * (double)normal.y),
                                     (real)(view->to_centre[2] + radius * (double)normal.z));

    out->distance = vec3_length(to_light);
    out->direction = vec3_normalize(to_light);
    out->cosine = real_abs(vec3_dot(normal, out->direction));
    out->pdf *= surface_pdf(view, out->distance * out->distance, out->cosine);
}

/* Uniform emission: any vertex of the mesh will do. */
static struct vec3 radiance_towards(const struct render_scene *scene, const struct hit *light, real cosine, real outside)
{
    const struct render_instance *instance = &scene->instances[light->instance];
    const struct render_material *material = &scene->materials[instance->material];
    const struct render_mesh *mesh = &scene->meshes[instance->mesh];

    return material_emitted(material, mesh, mesh->indices, 0, 0, cosine, outside);
}

int sphere_light_sample(const struct render_scene *scene, const void *light_, const struct light_context *context,
                        real u, real v, struct light_sample *out)
{
    const struct hit *light = light_;
    struct sphere_view view;

    sphere_view_init(&view, scene, light, context->p);
    if (!view.lit)
        return 0;
    if (has_cone(view.inside))
        sample_cone(&view, u, v, out);
    else
        sample_surface(&view, u, v, out);
    if (!(out->distance > 0))
        return health_distance(out->distance);
    if (!(out->pdf > 0) || !isfinite(out->pdf))
        return health_density(out->pdf);
    out->on_face = 1;
    out->face = *light;
    /* There are no edges; near boundaries what is right before the end counts. */
    out->inset = render_near_face(scene, &scene->instances[light->instance], 0,
                                  vec3_mad(context->p, out->direction, out->distance), INFINITY)
                     ? 0
                     : INFINITY;
    out->radiance = radiance_towards(scene, light, out->cosine, light_context_ior(context, out->direction));
    out->delta = 0;
    return 1;
}

void sphere_light_weigh(const struct render_scene *scene, const void *light_, struct light_weight *out)
{
    const struct hit *light = light_;
    const struct render_instance *instance = &scene->instances[light->instance];
    const struct render_material *material = &scene->materials[instance->material];
    const struct sphere_shape *sphere = sphere_of(instance->shape);
    struct vec3 centre = vec3_make((real)sphere->centre[0], (real)sphere->centre[1], (real)sphere->centre[2]);
    /* A little larger: the centre was rounded. */
    real reach = (real)(sphere->radius + 0x1p-22 * exact_largest(sphere->centre));

    out->bounds.min = vec3_sub(centre, vec3_splat(reach));
    out->bounds.max = vec3_add(centre, vec3_splat(reach));
    out->bounds.axis = vec3_make(0, 0, 1);
    out->bounds.spread_rad = REAL_PI;
    out->bounds.emission_rad = REAL_PI / 2;
    out->bounds.reach = INFINITY;
    out->bounds.lamp = light->instance;
    out->bounds.two_sided = material->m.double_sided;
    /* It sends to every side what its disk does. */
    out->intensity = PI_D * sphere->radius * sphere->radius * (double)vec3_luminance(radiance_towards(scene, light, 1, 1));
    if (!(out->intensity > 0 && isfinite(out->intensity)))
        out->intensity = 0;
    out->power = 4 * PI_D * out->intensity * (out->bounds.two_sided ? 2 : 1);
}
