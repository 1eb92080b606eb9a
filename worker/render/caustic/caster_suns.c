/* caster_suns: from which casters the map's suns can be seen. Where none is seen, suns are left to paths that meet them by
 * chance, so a patch of sun that the rays here miss is noisy, but not missing. */
#include "common/base/memory.h"
#include "worker/render/base/sampler.h"
#include "worker/render/caustic/casters_parts.h"
#include "worker/render/path/kernel.h"
#include "worker/render/render_scene.h"
#include "worker/render/surface/surface.h"

/* Rays in all, shared by area, and of each node within bounds; where there are many nodes it is one of each. */
enum { RAYS_ALL = 65536, RAYS_MIN = 16, RAYS_MAX = 4096 };
#define SUNS_SEED 0x63617374737321ull

struct looking {
    const struct render_scene *scene;
    struct interior air;
    double area; /* of all faces, m^2 */
    uint32_t nodes, number;
};

static double area_of(const struct caster_face *face)
{
    double across[3];

    exact_cross(face->e1, face->e2, across);
    return sqrt(exact_dot(across, across)) / 2;
}

/* A place on the face as a hit from the side to which the direction points. */
static void surface_of(const struct looking *l, const struct caster_ref *ref, const struct caster_face *face, real u,
                       real v, struct vec3 direction, struct surface *s)
{
    const struct hit hit = {ref->instance, ref->triangle};
    struct ray ray = {.t_max = INFINITY};
    double d[3], p[3], side;

    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    exact_vec(direction, d);
    side = exact_dot(d, face->own) < 0 ? -1 : 1;
    for (int k = 0; k < 3; k++)
        p[k] = face->corner[0][k] + (double)u * face->e1[k] + (double)v * face->e2[k] + side * face->longest * face->own[k];
    ray.origin = exact_round(p, ray.rest);
    ray.direction = vec3_make((real)(-side * face->own[0]), (real)(-side * face->own[1]), (real)(-side * face->own[2]));
    surface_from_hit(l->scene, &ray, &hit, s);
}

/* Does the ray `number` from a face of the node meet a sun? */
static int sees_sun(const struct looking *l, const struct caster *caster, const struct caster_node *node,
                    uint32_t number)
{
    const struct caster_ref *ref = &caster->refs[node->first + number % node->count];
    struct sampler sampler = {0};
    struct caster_face face;
    struct light_sample sun;
    struct vec3 direction;
    struct surface s;
    struct sample2 at, to;
    real pdf;

    sampler_start(&sampler, SUNS_SEED, 0, l->number, node->first, 0, number);
    at = sampler_get(&sampler, 0);
    to = sampler_get(&sampler, 1);
    (void)caster_face_of(l->scene, ref, &face);
    environment_aim_at_windows(l->scene->environment, to.u, to.v, &direction, &pdf);
    surface_of(l, ref, &face, at.u, at.v, direction, &s);
    sun = light_of_sky(direction);
    return pdf > 0 && kernel_recording.arrives(l->scene, &sampler, &s, &l->air, &sun) > 0;
}

static void look_from(struct looking *l, const struct caster *caster, struct caster_node *node)
{
    double area = 0, rays;

    for (uint32_t i = 0; i < node->count; i++) {
        struct caster_face face;

        (void)caster_face_of(l->scene, &caster->refs[node->first + i], &face);
        area += area_of(&face);
    }
    rays = RAYS_ALL * (area / l->area);
    rays = rays < RAYS_MIN ? RAYS_MIN : rays > RAYS_MAX ? RAYS_MAX : rays;
    if ((uint64_t)l->nodes * RAYS_MIN > 4 * RAYS_ALL)
        rays = 1;
    node->sunlit = 0;
    for (uint32_t i = 0; i < (uint32_t)rays && !node->sunlit; i++)
        node->sunlit = sees_sun(l, caster, node, i);
}

static void mark_node(struct casters *casters, const struct caster *caster, const struct caster_node *node)
{
    for (uint32_t i = 0; i < node->count; i++) {
        const struct caster_ref *ref = &caster->refs[node->first + i];
        const uint64_t bit = casters->base[ref->instance] + ref->triangle;

        casters->sunlit[bit / 8] |= (uint8_t)(1 << bit % 8);
    }
    casters->suns = 1;
}

/* Children come after their node. */
static void look_from_caster(struct looking *l, struct casters *casters, struct caster *caster)
{
    for (uint32_t i = caster->node_count; i-- > 0;) {
        struct caster_node *node = &caster->nodes[i];

        if (node->count == 0) {
            node->sunlit = caster->nodes[i + 1].sunlit || caster->nodes[node->first].sunlit;
            continue;
        }
        look_from(l, caster, node);
        if (node->sunlit)
            mark_node(casters, caster, node);
    }
}

static status number_triangles(struct casters *casters, struct error *err)
{
    const struct render_scene *scene = casters->scene;
    uint64_t count = 0;

    casters->base = mem_calloc(scene->instance_count, sizeof *casters->base);
    if (!casters->base)
        return error_no_memory(err, "what casts caustics");
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        casters->base[i] = count;
        for (uint32_t k = 0; k < casters->count; k++)
            if (casters->list[k].material == scene->instances[i].material)
                count += scene->meshes[scene->instances[i].mesh].triangle_count;
    }
    casters->sunlit = mem_calloc((size_t)(count / 8 + 1), 1);
    return casters->sunlit ? STATUS_OK : error_no_memory(err, "what casts caustics");
}

status casters_look_for_suns(struct casters *casters, struct error *err)
{
    struct looking l = {.scene = casters->scene, .air.medium = -1};
    status s;

    if (!casters->scene->environment || !environment_has_windows(casters->scene->environment))
        return STATUS_OK;
    s = number_triangles(casters, err);
    for (uint32_t i = 0; i < casters->count && s == STATUS_OK; i++) {
        const struct caster *caster = &casters->list[i];

        l.nodes += caster->node_count;
        for (uint32_t k = 0; k < caster->face_count; k++) {
            struct caster_face face;

            (void)caster_face_of(l.scene, &caster->refs[k], &face);
            l.area += area_of(&face);
        }
    }
    for (; l.number < casters->count && s == STATUS_OK; l.number++)
        look_from_caster(&l, casters, &casters->list[l.number]);
    return s;
}
