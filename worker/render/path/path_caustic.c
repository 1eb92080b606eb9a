/* path_caustic: light of a small lamp, or of the map's suns, that reaches a vertex by way of a smooth surface
 * (caustic/casters.h).
 *
 * Each solution is followed as a path would go: a ray to the caster meets it, with the volumes, coincident faces,
 * textures and absorption on its way; what its smooth lobes send on towards the lamp counts. No scattered ray meets a
 * lamp without size. A sun, or a lamp with area, is met by chance, by paths that scatter at a vertex, then at a caster:
 * what they bring of it does not count, because it is asked for here (path_is_cast, path_lamp_is_cast). So the set of
 * paths is split by a rule and nothing is weighed. Where a caster shades otherwise than its faces say (a bent normal,
 * other indices in front), these are left to chance, and the light of a lamp without size is missing.
 */
#include "worker/render/path/path_parts.h"

/* How far, in metres of distance, the ray may miss the point; and the cosine by which the way on may miss the lamp. */
#define POINT_SLACK 1e-4
#define LAMP_COSINE REAL(0.999999)
/* The cosine by which a caster's normal may be off that of its vertices. */
#define NORMAL_COSINE REAL(0.999999)

/* A vertex that looks for light of one lamp. */
struct caustic {
    struct path *path;
    struct path_vertex *v;
    const struct punctual *lamp; /* NULL: a face of a small lamp, and the numbers of the point on it: */
    const struct hit *face;      /* NULL, too: a sun, in this direction: */
    real face_u, face_v;
    struct vec3 sun;
    real odds; /* of this lamp, or face; of a sun, times the density of the direction, per sr */
    struct vec3 sum;
};

/* ---- what is a caster, at a vertex ------------------------------------------------------------ */

/* Does the vertex reflect, or refract, as its caster's faces say? */
static int casts(const struct path *path, const struct path_vertex *v, enum caster_event event)
{
    const struct surface *s = &v->s;
    const uint32_t material = (uint32_t)(s->material - path->scene->materials);
    double ior;

    if (s->instance->motion_steps || s->instance->shape || !casters_have(path->scene->casters, material, event, &ior) ||
        (calls_for(EFFECTS_ALL, EFFECT_CLEARCOAT) && v->bsdf.lobes >> BSDF_LOBE_COAT & 1 && v->bsdf.coat.normal.z != 1))
        return 0;
    if (event == CASTER_REFRACTS && fabs((double)v->bsdf.eta - (s->front ? ior : 1 / ior)) > 1e-5 * (double)v->bsdf.eta)
        return 0;
    return real_abs(vec3_dot(surface_vertex_normal(s), s->basis.n)) > NORMAL_COSINE;
}

enum path_chain path_chain_at(const struct path *path, const struct path_vertex *v)
{
    const int delta = (v->sample.flags & BSDF_DELTA) != 0, through = v->sample.wi.z < 0;

    if (!delta)
        return path_meets_coincident(&v->crossing, v->sample.wi) || path->depth + 1 >= path->scene->settings.max_depth
                   ? CHAIN_NONE : CHAIN_ASKED;
    if (path->caustics.chain != CHAIN_ASKED || !casts(path, v, through ? CASTER_REFRACTS : CASTER_REFLECTS) ||
        path_meets_coincident(&v->crossing, v->sample.wi))
        return CHAIN_NONE;
    return casters_are_sunlit(path->scene->casters, v->s.number, v->s.triangle) ? CHAIN_CAST_SUNLIT : CHAIN_CAST;
}

/* ---- a solution ------------------------------------------------------------------------------- */

/* A path of its own from the vertex towards the caster. */
static int set_out(const struct caustic *c, struct vec3 direction, struct vec3 wi, struct path *way)
{
    *way = *c->path;
    way->throughput = vec3_splat(1);
    way->depth++;
    way->next.there = 0;
    way->specular = 0;
    if (calls_for(way->scene->effects, VOLUME_EFFECTS) && wi.z < 0)
        way->interior = c->v->crossing.beyond;
    surface_leave(&c->v->s, direction, &way->ray);
    return !path_meets_coincident(&c->v->crossing, wi);
}

/* Follow it to the caster. 0: it meets something else. */
static int reach_caster(struct path *way, struct path_vertex *v, const struct caster_solution *solution)
{
    const struct render_scene *scene = way->scene;
    double off = 0;

    for (int i = 0; i < INDEX_MATCHED_MAX; i++) {
        if (!path_intersect(way, v))
            return 0;
        if (calls_for(scene->effects, EFFECT_MEDIUM)) {
            struct ray stretch = way->ray;

            stretch.t_max = v->s.t;
            stretch.reaches = 1;
            stretch.end = (struct hit){v->s.number, v->s.triangle};
            stretch.end_inset = v->s.inset;
            stretch.end_cosine = real_abs(vec3_dot(v->s.ng, stretch.direction));
            way->throughput = vec3_mul(way->throughput, path_transmittance(way, &stretch));
        }
        if (calls_for(scene->effects, EFFECT_ABSORPTION) && !(calls_for(scene->effects, EFFECT_MEDIUM) && path_knows_filling(scene)))
            path_absorb(way, &v->s); /* else path_transmittance has done it */
        if (calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS))
            path_crossing_none(&v->crossing);
        if ((calls_for(scene->effects, VOLUME_EFFECTS) ||
             (calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS) && crossing_touches(&v->s))) &&
            !path_boundary(way, v))
            continue;
        off = fabs((double)v->s.p.x + v->s.rest[0] - solution->point[0]) +
              fabs((double)v->s.p.y + v->s.rest[1] - solution->point[1]) +
              fabs((double)v->s.p.z + v->s.rest[2] - solution->point[2]);
        return v->s.material == &scene->materials[solution->material] && off < POINT_SLACK * solution->distance;
    }
    return 0;
}

/* What the caster sends from the lamp to the vertex, for a lamp of intensity 1. `light`: sampled at the caster. */
static struct vec3 sent(const struct path *way, struct path_vertex *v, const struct caster_solution *solution,
                        const struct light_sample *light)
{
    const int through = solution->event == CASTER_REFRACTS;
    const struct vec3 to_lamp = basis_to_local(&v->s.basis, light->direction);
    struct vec3 wi, weight;

    if (!bsdf_delta(&v->bsdf, v->wo, through, &wi, &weight) || !casts(way, v, solution->event) ||
        path_meets_coincident(&v->crossing, wi) || !(vec3_dot(wi, to_lamp) > LAMP_COSINE) || !path_keeps_side(&v->s, light->direction, wi))
        return vec3_splat(0);
    return vec3_mul(way->throughput, weight);
}

/* Absorption between the caster and a lamp inside of a body, where path_visibility does not know that. */
static void absorb_to_lamp(struct path *way, const struct path_vertex *v, int through, real distance)
{
    struct surface end = v->s;

    if (!calls_for(way->scene->effects, EFFECT_ABSORPTION) || path_knows_filling(way->scene) || !(distance < INFINITY))
        return;
    end.front = through ? !v->s.front : v->s.front;
    end.t = distance;
    path_absorb(way, &end);
}

/* The lamp, seen from the caster. 0: it does not shine there. */
static int sample_lamp(const struct caustic *c, const struct path *way, const struct path_vertex *v,
                       struct light_sample *light)
{
    const struct light_context context = {.p = v->s.p, .time = v->s.time, .ior = 1};

    if (c->lamp)
        return emitters_sample_one(way->scene, c->lamp, &context, c->odds, light);
    if (c->face) {
        *light = (struct light_sample){.pdf = c->odds};
        return triangle_light_sample(way->scene, c->face, &context, c->face_u, c->face_v, light);
    }
    *light = (struct light_sample){.direction = c->sun, .distance = INFINITY, .pdf = c->odds};
    light->radiance = environment_radiance(way->scene->environment, c->sun);
    return 1;
}

static void add_solution(void *user, const struct caster_solution *solution)
{
    struct caustic *c = user;
    const struct surface *s = &c->v->s;
    const struct vec3 direction = vec3_normalize(
        vec3_make((real)solution->direction[0], (real)solution->direction[1], (real)solution->direction[2]));
    const struct vec3 wi = basis_to_local(&s->basis, direction);
    const int through = solution->event == CASTER_REFRACTS;
    struct light_sample light;
    struct path_vertex v;
    struct vec3 value, scattered;
    struct path way;
    struct ray ray;
    real pdf, spread;

    if (!path_keeps_side(s, direction, wi))
        return;
    scattered = bsdf_eval_pdf(&c->v->bsdf, c->v->wo, wi, &pdf);
    if (vec3_is_black(scattered) || !set_out(c, direction, wi, &way) || !reach_caster(&way, &v, solution))
        return;
    v.s.footprint = 0;
    if (!path_bsdf(&way, &v) || !sample_lamp(c, &way, &v, &light))
        return;
    value = sent(&way, &v, solution, &light);
    if (vec3_is_black(value))
        return;
    if (through)
        way.interior = v.crossing.beyond;
    surface_leave(&v.s, light.direction, &ray);
    path_end_at_light(&light, &ray);
    way.query.ray_number++;
    value = vec3_mul(value, path_visibility(&way, &ray));
    if (vec3_is_black(value))
        return;
    way.throughput = value;
    absorb_to_lamp(&way, &v, through, light.distance);
    spread = (real)solution->spread;
    if (light.distance < INFINITY)
        spread /= light.distance * light.distance;
    value = vec3_mul(way.throughput, vec3_scale(light.radiance, 1 / (spread * light.pdf)));
    if (calls_for(way.scene->effects, EFFECT_DISPERSION) && path_disperses_at(c->path, s))
        value = vec3_mul(value, c->path->wavelength.rgb);
    value = vec3_mul(value, scattered);
    if (vec3_is_finite(value))
        c->sum = vec3_add(c->sum, value);
    else
        health_note(HEALTH_BAD_DENSITIES);
}

static void choose_sun(struct caustic *c, real u, real v, struct caster_lamp *lamp)
{
    real pdf;

    environment_aim_at_windows(c->path->scene->environment, u, v, &c->sun, &pdf);
    c->odds *= pdf;
    exact_vec(c->sun, lamp->at);
    lamp->kind = CASTER_LAMP_SUN;
    lamp->moves = 0;
    lamp->radius = 0;
}

static void choose_face(struct caustic *c, real u, real v, struct caster_lamp *lamp)
{
    real odds;

    c->face = casters_choose_face(c->path->scene->casters, &u, &v, &odds, lamp);
    c->face_u = u;
    c->face_v = v;
    c->odds *= odds;
    exact_vec(triangle_light_point(c->path->scene, c->face, c->v->s.time, u, v), lamp->at);
}

/* One lamp, by the numbers of next-event estimation: each is as likely, but the faces of small lamps, which share the
 * odds of these; the map's suns count as one. */
static void choose_lamp(struct caustic *c, struct sample2 point, struct caster_lamp *lamp)
{
    const struct render_scene *scene = c->path->scene;
    const struct emitters *e = &scene->emitters;
    const uint32_t small = casters_lamp_count(scene->casters), points = e->punctual_count;
    const real count = (real)(points + small + (uint32_t)casters_have_suns(scene->casters));
    const uint32_t number = (uint32_t)(point.u * count);
    const struct punctual_pose *pose;
    struct punctual_pose moved;

    c->odds = 1 / count;
    if (number >= points + small && casters_have_suns(scene->casters)) {
        choose_sun(c, light_rescaled(point.u, (real)(points + small) / count, 1 / count), point.v, lamp);
        return;
    }
    if (number >= points && small > 0) {
        c->odds = (real)small / count;
        choose_face(c, light_rescaled(point.u, (real)points / count, c->odds), point.v, lamp);
        return;
    }
    c->lamp = e->punctual[number < points ? number : points - 1];
    pose = punctual_pose_at(c->lamp, c->v->s.time, &moved);
    lamp->kind = c->lamp->kind == LIGHT_DIRECTIONAL ? CASTER_LAMP_FAR : CASTER_LAMP_NEAR;
    lamp->moves = pose == &moved;
    exact_vec(lamp->kind == CASTER_LAMP_FAR ? vec3_neg(pose->direction) : pose->position, lamp->at);
    memcpy(lamp->middle, lamp->at, sizeof lamp->middle);
    lamp->radius = 0;
}

struct vec3 path_caustic(struct path *path, struct path_vertex *v)
{
    struct caustic c = {.path = path, .v = v};
    const real share = path->scene->caster_share;
    struct sample2 u = sampler_get(path->sampler, v->dimension + VERTEX_LIGHT_POINT);
    struct caster_lamp lamp;
    double place[3];

    if (!(u.u < share))
        return c.sum;
    u.u = light_rescaled(u.u, 0, share);
    choose_lamp(&c, u, &lamp);
    c.odds *= share;
    if (!(c.odds > 0))
        return c.sum;
    exact_vec(v->s.p, place);
    for (int k = 0; k < 3; k++)
        place[k] += v->s.rest[k];
    casters_find(path->scene->casters, place, &lamp, add_solution, &c);
    return c.sum;
}
