/* path_light: the light that reaches a path: by next-event estimation, from emissive surfaces, and
 * from the environment.
 *
 * Light that both light sampling and BSDF or phase-function sampling can find is weighted by the
 * power heuristic with exponent 2 (Veach 1997, section 9.2.4), one sample of each.
 */
#include "worker/render/path/path_parts.h"

/* ---- next-event estimation ------------------------------------------------------------------- */

/* Veach's power heuristic for strategy a against b, in a form that neither overflows nor
 * underflows. */
static real power_heuristic(real a, real b)
{
    real r;

    if (!(a > 0))
        return 0;
    r = b / a;
    if (!SAFEGUARD(MIS_OVERFLOW))
        return a * a / (a * a + b * b);
    return 1 / (1 + r * r);
}

/* Transmittance from the ray's origin to its end. */
static struct vec3 path_visibility(struct path *path, const struct ray *ray)
{
    path->query.ray_number++;
    if (path_features_of(path->scene).index_matched)
        return path_transmittance(path, ray);
    return vec3_splat(path_occluded(path, ray) ? 0 : 1);
}

/* Where the ray to a sampled light ends. An area light must not occlude itself. A light without
 * area may lie on a surface. */
static void end_at_light(const struct light_sample *light, struct ray *ray)
{
    ray->t_max = light->on_face ? light->distance : light->distance * (1 - 0x1p-20f);
    ray->reaches = light->on_face;
    ray->end = light->face;
    ray->end_inset = light->inset;
    ray->end_cosine = light->cosine;
}

/* Sample one light with the vertex's random numbers. 0: no light, or no light from it. */
static int sample_light(const struct path *path, const struct light_context *context,
                        uint32_t dimension, struct light_sample *light)
{
    struct sample2 point = sampler_get(path->sampler, dimension + VERTEX_LIGHT_POINT);

    PROFILE_STAGE(LIGHT);
    RECORD(recorded->light.asked = 1, recorded->adding = RECORD_FROM_LIGHT);
    if (!emitters_sample(path->scene, context, point.u, point.v, light))
        return 0;
    RECORD(record_light_found(light));
    return !vec3_is_black(light->radiance);
}

/* Contribution of the sampled light. The vertex scatters `value` of it; BSDF or phase sampling
 * finds its direction with density `pdf`. */
static struct vec3 weigh_light(const struct light_sample *light, struct vec3 value, real pdf)
{
    const real weight = 1 / (FAULT(ZERO_DENSITY) ? 0 : light->pdf);

    if (SAFEGUARD(LIGHT_DENSITY) && !(weight < INFINITY)) {
        health_note(HEALTH_BAD_DENSITIES);
        return vec3_splat(0);
    }
    value = vec3_mul(value, vec3_scale(light->radiance, weight));
    RECORD(recorded->light.weight = light->delta ? 1 : power_heuristic(light->pdf, pdf));
    return light->delta ? value : vec3_scale(value, power_heuristic(light->pdf, pdf));
}

static struct vec3 eval_bsdf(const struct path_vertex *v, struct vec3 wi, real *pdf)
{
    PROFILE_STAGE(SCATTER);
    return bsdf_eval_pdf(&v->bsdf, v->wo, wi, pdf);
}

/* The same towards wi: through the vertex's boundary if wi is on the other side. */
static struct vec3 visibility_from(struct path *path, const struct path_vertex *v, struct vec3 wi,
                                   const struct ray *ray)
{
    const int beyond = path_features_of(path->scene).coincident && wi.z < 0;
    struct interior here;
    struct vec3 visible;

    if (beyond) {
        here = path->interior;
        path->interior = v->crossing.beyond;
    }
    visible = path_visibility(path, ray);
    if (beyond)
        path->interior = here;
    return visible;
}

PATH_FUNCTION struct vec3 path_direct_surface(struct path *path, const struct path_vertex *v)
{
    const struct path_features f = path_features_of(path->scene);
    const struct vec3 black = {0, 0, 0};
    const struct surface *s = &v->s;
    struct light_context context = {s->p, s->ng, s->time};
    struct light_sample light;
    struct vec3 wi, value, visible;
    struct ray ray;
    real pdf;

    if (s->material->flags & MATERIAL_TWO_WAY)
        context.n = black;
    if (!sample_light(path, &context, v->dimension, &light))
        return black;
    wi = basis_to_local(&s->basis, light.direction);
    if (!path_keeps_side(s, light.direction, wi))
        return black;
    if (path_meets_coincident(path, &v->crossing, wi))
        return black;
    value = eval_bsdf(v, wi, &pdf);
    RECORD(recorded->light.scatter = value, recorded->light.scatter_pdf = pdf);
    if (vec3_is_black(value))
        return black;
    surface_leave(s, light.direction, &ray);
    end_at_light(&light, &ray);
    visible = visibility_from(path, v, wi, &ray);
    RECORD(recorded->light.traced = 1, recorded->light.visible = visible);
    if (vec3_is_black(visible))
        return black;
    if (f.dispersion && path_disperses_at(path, s))
        value = vec3_mul(value, path->wavelength_rgb);
    if (f.index_matched)
        value = vec3_mul(value, visible);
    return weigh_light(&light, value, pdf);
}

PATH_FUNCTION struct vec3 path_direct_medium(struct path *path, const struct world_medium *medium,
                                             struct vec3 direction, uint32_t dimension)
{
    const struct light_context context = {path->ray.origin, {0, 0, 0}, path->ray.time};
    struct ray ray = path->ray;
    struct light_sample light;
    struct vec3 visible;
    real pdf;

    if (!sample_light(path, &context, dimension, &light))
        return vec3_splat(0);
    ray.direction = light.direction;
    end_at_light(&light, &ray);
    pdf = medium_phase(medium, vec3_dot(direction, light.direction));
    RECORD(recorded->light.scatter = vec3_splat(pdf), recorded->light.scatter_pdf = pdf);
    visible = path_visibility(path, &ray);
    RECORD(recorded->light.traced = 1, recorded->light.visible = visible);
    return weigh_light(&light, vec3_scale(visible, pdf), pdf);
}

/* ---- light that the path's own ray meets ----------------------------------------------------- */

/* Is this caustic light (it reaches a surface through a mirror or a lens), and is it switched off?
 * */
static int is_unwanted_caustic(const struct path *path)
{
    return path->specular && path->any_diffuse &&
           (path->scene->settings.without & EFFECT_CAUSTICS);
}

PATH_FUNCTION struct vec3 path_escaped(const struct path *path)
{
    const struct render_scene *scene = path->scene;
    struct vec3 radiance;
    real light_pdf;

    RECORD(recorded->adding = RECORD_FROM_PATH);
    if (!path_features_of(scene).environment || !scene->environment || is_unwanted_caustic(path))
        return vec3_splat(0);
    PROFILE_STAGE_EFFECT(LIGHT, PROFILE_ACCOUNT(ENVIRONMENT));
    if (path->specular || !scene->emitters.has_environment)
        return environment_radiance(scene->environment, path->ray.direction);
    if (scene->emitters.environment.alone)
        return vec3_splat(0);
    radiance = emitters_environment(scene, &path->context, path->ray.direction, &light_pdf);
    RECORD(recorded->met_pdf = light_pdf,
           recorded->met_weight = power_heuristic(path->pdf, light_pdf));
    return vec3_scale(radiance, power_heuristic(path->pdf, light_pdf));
}

/* An unlit material shows its base colour, whatever the light. */
static struct vec3 unlit_color(const struct path *path, const struct surface *s)
{
    const struct scene_material *m = &s->material->m;
    struct vec3 color = vec3_make(m->base_color[0], m->base_color[1], m->base_color[2]);

    if (s->material->base_color.image) {
        struct texel texel = world_slot_lookup(&s->material->base_color, s->mesh, s->vertex, s->b1,
                                               s->b2, s->footprint, 1);
        color = vec3_mul(color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (path_features_of(path->scene).vertex_colors && s->mesh->colors)
        color = vec3_mul(color, surface_vertex_color(s));
    return color;
}

PATH_FUNCTION struct vec3 path_emitted(const struct path *path, const struct surface *s)
{
    const struct render_scene *scene = path->scene;
    const struct world_material *material = s->material;
    struct vec3 radiance;
    real cosine, light_pdf;
    uint32_t face;

    RECORD(recorded->adding = RECORD_FROM_PATH);
    if (path_is_unlit(path, s))
        return unlit_color(path, s);
    if (!(material->flags & MATERIAL_EMISSIVE) || (!s->front && !material->m.double_sided) ||
        is_unwanted_caustic(path))
        return vec3_splat(0); /* a light source emits on its front only */
    PROFILE_STAGE_EFFECT(LIGHT, PROFILE_ACCOUNT(EMISSIVE_MESH));
    face = emitters_face_at(scene, s);
    if (face != EMITTERS_NO_FACE && emitters_is_dark(&scene->emitters, face))
        return vec3_splat(0);
    cosine = real_abs(vec3_dot(s->ng, path->ray.direction));
    radiance = world_emitted(material, s->mesh, s->vertex, s->b1, s->b2, cosine);
    if (path->specular || face == EMITTERS_NO_FACE)
        return radiance;
    light_pdf = emitters_face_pdf(scene, &path->context, face,
                                  vec3_length_squared(vec3_sub(s->p, path->context.p)), cosine,
                                  s->area);
    RECORD(recorded->met_pdf = light_pdf,
           recorded->met_weight = power_heuristic(path->pdf, light_pdf));
    return vec3_scale(radiance, power_heuristic(path->pdf, light_pdf));
}
