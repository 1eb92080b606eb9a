/* path_light: the light that reaches a path: by next-event estimation, from emissive surfaces, and
 * from the environment.
 *
 * Light that both light sampling and BSDF or phase-function sampling can find is weighted by the
 * power heuristic with exponent 2 (Veach 1997, section 9.2.4), one sample of each.
 */
#include "worker/render/path/path_parts.h"

/* ---- next-event estimation ------------------------------------------------------------------- */

/* Veach's power heuristic for strategy a against b, in a form that neither overflows nor underflows. */
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

/* May a shadow ray be within a body that absorbs? */
static int has_absorbing_bodies(const struct path *path)
{
    return calls_for(path->scene->effects, EFFECT_ABSORPTION) && path_knows_filling(path->scene);
}

struct vec3 path_visibility(struct path *path, const struct ray *ray)
{
    path->query.ray_number++;
    if (calls_for(path->scene->effects, INDEX_MATCHED_EFFECTS))
        return path_transmittance(path, ray);
    if (path_occluded(path, ray))
        return vec3_splat(0);
    return has_absorbing_bodies(path) ? path_filling_transmittance(path->scene, &path->interior, ray->t_max) : vec3_splat(1);
}

void path_end_at_light(const struct light_sample *light, struct ray *ray)
{
    ray->t_max = light->on_face ? light->distance : light->distance * (1 - 0x1p-20f);
    ray->reaches = light->on_face;
    ray->end = light->face;
    ray->end_inset = light->inset;
    ray->end_cosine = light->cosine;
}

/* Does a lamp's coat lose what the index around it says? */
static int has_coats_in_bodies(const struct path *path)
{
    return calls_for(path->scene->effects, EFFECT_NESTED_DIELECTRIC) && calls_for(path->scene->effects, EFFECT_CLEARCOAT);
}

/* Sample one light with the vertex's random numbers. 0: no light, or no light from it. */
static int sample_light(const struct path *path, struct path_vertex *v, struct path_notes *notes,
                        const struct light_context *context)
{
    const struct sample2 point = sampler_get(path->sampler, v->dimension + VERTEX_LIGHT_POINT);

    notes->asked = 1;
    notes->found = emitters_sample(path->scene, context, point.u, point.v, &v->light);
    return notes->found && (v->light.unread || !vec3_is_black(v->light.radiance));
}

/* 1 / pdf, or 0 where a light has no density. */
static real inverse_density(real pdf)
{
    const real inverse = 1 / pdf;

    if (!SAFEGUARD(LIGHT_DENSITY) || inverse < INFINITY)
        return inverse;
    health_note(HEALTH_BAD_DENSITIES);
    return 0;
}

/* Contribution of the sampled light, of which the vertex scatters `value`. */
static struct vec3 weigh_light(const struct light_sample *light, struct vec3 value, struct path_notes *notes)
{
    value = vec3_mul(value, vec3_scale(light_radiance(light), inverse_density(light->pdf)));
    if (light->delta)
        return value;
    notes->weight = power_heuristic(light->pdf, notes->scatter_pdf);
    return vec3_scale(value, notes->weight);
}

/* The same towards wi: through the vertex's boundary if wi is on the other side. */
static struct vec3 visibility_from(struct path *path, const struct path_vertex *v, struct vec3 wi,
                                   const struct ray *ray)
{
    const int beyond = calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS) && wi.z < 0;
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

struct vec3 path_direct_surface(struct path *path, struct path_vertex *v, struct path_notes *notes)
{
    const struct vec3 black = {0, 0, 0};
    const struct surface *s = &v->s;
    const struct light_sample *light = &v->light;
    struct light_context context = {.p = s->p, .n = s->ng, .time = s->time};
    struct vec3 wi, value;
    struct ray ray;
    real pdf;

    if (s->material->flags & MATERIAL_TWO_WAY)
        context.n = black;
    if (has_coats_in_bodies(path)) {
        context.ior = interior_ior(path->scene, &path->interior);
        context.ior_beyond = interior_ior(path->scene, &v->crossing.beyond);
        context.front = s->basis.n;
    }
    if (!sample_light(path, v, notes, &context))
        return black;
    wi = basis_to_local(&s->basis, light->direction);
    if (!path_keeps_side(s, light->direction, wi))
        return black;
    if (path_meets_coincident(&v->crossing, wi))
        return black;
    value = notes->scatter = bsdf_eval_pdf(&v->bsdf, v->wo, wi, &pdf);
    notes->scatter_pdf = pdf;
    if (vec3_is_black(value))
        return black;
    surface_leave(s, light->direction, &ray);
    path_end_at_light(light, &ray);
    notes->traced = 1;
    notes->visible = visibility_from(path, v, wi, &ray);
    if (vec3_is_black(notes->visible))
        return black;
    if (calls_for(path->scene->effects, EFFECT_DISPERSION) && path_disperses_at(path, s))
        value = vec3_mul(value, path->wavelength.rgb);
    if (calls_for(path->scene->effects, INDEX_MATCHED_EFFECTS) || has_absorbing_bodies(path))
        value = vec3_mul(value, notes->visible);
    return weigh_light(light, value, notes);
}

struct vec3 path_direct_medium(struct path *path, struct path_vertex *v, struct path_notes *notes,
                               struct vec3 direction)
{
    const struct light_context context = {.p = path->ray.origin, .time = path->ray.time,
                                          .ior = has_coats_in_bodies(path) ? interior_ior(path->scene, &path->interior) : 0};
    const struct light_sample *light = &v->light;
    struct ray ray = path->ray;

    if (!sample_light(path, v, notes, &context))
        return vec3_splat(0);
    ray.direction = light->direction;
    path_end_at_light(light, &ray);
    notes->scatter_pdf = medium_phase(v->medium, vec3_dot(direction, light->direction));
    notes->scatter = vec3_splat(notes->scatter_pdf);
    notes->traced = 1;
    notes->visible = path_visibility(path, &ray);
    if (vec3_is_black(notes->visible))
        return vec3_splat(0);
    return weigh_light(light, vec3_scale(notes->visible, notes->scatter_pdf), notes);
}

/* ---- light that the path's own ray meets ----------------------------------------------------- */

/* Is this caustic light (it reaches a surface through a mirror or a lens), and is it switched off? */
static int is_unwanted_caustic(const struct path *path)
{
    return path->specular && path->caustics.any_diffuse && (path->scene->settings.without & EFFECT_CAUSTICS);
}

/* Light that the ray met, and that light sampling would have found with density `pdf`. */
static struct vec3 weigh_met(const struct path *path, struct vec3 radiance, real pdf, struct path_notes *notes)
{
    notes->met_pdf = pdf;
    notes->met_weight = power_heuristic(path->pdf, pdf);
    return vec3_scale(radiance, notes->met_weight);
}

struct vec3 path_escaped(const struct path *path, struct path_notes *notes)
{
    const struct render_scene *scene = path->scene;
    struct vec3 radiance;
    real pdf;

    if (!calls_for(scene->effects, EFFECT_ENVIRONMENT) || !scene->environment || is_unwanted_caustic(path))
        return vec3_splat(0);
    if (calls_for(scene->effects, EFFECT_CAUSTICS) && path_is_cast(path))
        return vec3_splat(0);
    PROFILE_STAGE_EFFECT(LIGHT, PROFILE_ACCOUNT(ENVIRONMENT));
    if (path->specular || !scene->emitters.has_environment)
        return environment_radiance(scene->environment, path->ray.direction);
    if (scene->emitters.environment.alone)
        return vec3_splat(0);
    radiance = emitters_environment(scene, &path->context, path->ray.direction, &pdf);
    return weigh_met(path, radiance, pdf, notes);
}

/* An unlit material shows its base colour, whatever the light. */
static struct vec3 unlit_color(const struct path *path, const struct surface *s)
{
    const struct scene_material *m = &s->material->m;
    struct vec3 color = vec3_make(m->base_color[0], m->base_color[1], m->base_color[2]);

    if (s->material->base_color.image) {
        struct texel texel = slot_lookup(&s->material->base_color, s->mesh, s->vertex, s->b1, s->b2, s->footprint, 1);
        color = vec3_mul(color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (calls_for(path->scene->effects, EFFECT_VERTEX_COLOR) && s->mesh->colors)
        color = vec3_mul(color, surface_vertex_color(s));
    return color;
}

struct vec3 path_emitted(const struct path *path, const struct surface *s, struct path_notes *notes)
{
    const struct render_scene *scene = path->scene;
    const struct render_material *material = s->material;
    struct vec3 radiance;
    real cosine, pdf;
    uint32_t face;

    if (path_is_unlit(path, s))
        return unlit_color(path, s);
    if (!(material->flags & MATERIAL_EMISSIVE) || (!s->front && !material->m.double_sided) || is_unwanted_caustic(path))
        return vec3_splat(0); /* a light source emits on its front only */
    if (calls_for(scene->effects, EFFECT_CAUSTICS) && path_lamp_is_cast(path, s))
        return vec3_splat(0);
    PROFILE_STAGE_EFFECT(LIGHT, PROFILE_ACCOUNT(EMISSIVE_MESH));
    face = emitters_face_at(scene, s);
    if (face != EMITTERS_NO_FACE && emitters_is_dark(&scene->emitters, face))
        return vec3_splat(0);
    cosine = real_abs(vec3_dot(s->ng, path->ray.direction));
    radiance = material_emitted(material, s->mesh, s->vertex, s->b1, s->b2, cosine,
                                has_coats_in_bodies(path) ? interior_ior(scene, &path->interior) : 1);
    if (path->specular || face == EMITTERS_NO_FACE)
        return radiance;
    pdf = emitters_face_pdf(scene, &path->context, face, vec3_length_squared(vec3_sub(s->p, path->context.p)), cosine,
                            s->area);
    return weigh_met(path, radiance, pdf, notes);
}
