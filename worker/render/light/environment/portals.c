#include "worker/render/light/environment/portals.h"

#include <string.h>

#include "common/base/memory.h"

status portals_init(struct portals *p, const struct scene_portal *portals, uint32_t count, struct error *err)
{
    memset(p, 0, sizeof *p);
    if (count == 0)
        return STATUS_OK;
    p->corners = mem_alloc_array(count, sizeof *p->corners);
    NEED(p->corners, err, "the portals");
    p->count = count;
    for (uint32_t i = 0; i < count; i++) {
        const double *c = portals[i].corner;
        const float32 *e = portals[i].edge1, *f = portals[i].edge2;
        struct vec3 corner = {(real)c[0], (real)c[1], (real)c[2]}, edge1 = {e[0], e[1], e[2]},
                    edge2 = {f[0], f[1], f[2]};

        p->corners[i][0] = corner;
        p->corners[i][1] = vec3_add(corner, edge1);
        p->corners[i][2] = vec3_add(vec3_add(corner, edge1), edge2);
        p->corners[i][3] = vec3_add(corner, edge2);
    }
    return STATUS_OK;
}

void portals_release(struct portals *p)
{
    mem_free(p->corners);
    memset(p, 0, sizeof *p);
}

static int is_above(const struct vec3 corner[4], const struct light_context *context)
{
    if (vec3_is_black(context->n))
        return 1;
    for (int k = 0; k < 4; k++)
        if (vec3_dot(vec3_sub(corner[k], context->p), context->n) > 0)
            return 1;
    return 0;
}

/* Both halves of a portal; its solid angle, 0 where it is below the horizon. */
static real halves(const struct vec3 corner[4], const struct light_context *context, struct spherical_triangle half[2])
{
    half[0].solid_angle = half[1].solid_angle = 0;
    if (!is_above(corner, context))
        return 0;
    /* The corners that both share are at the ends of the sampled arcs' first side. */
    spherical_triangle_init(&half[0], context->p, corner[0], corner[1], corner[2]);
    spherical_triangle_init(&half[1], context->p, corner[0], corner[2], corner[3]);
    return half[0].solid_angle + half[1].solid_angle;
}

void portals_look(const struct portals *portals, const struct light_context *context, struct portals_view *out)
{
    struct spherical_triangle half[2];

    out->solid_angle = 0;
    for (uint32_t i = 0; i < portals->count; i++) {
        real seen = halves(portals->corners[i], context, half);

        if (!(seen > 0))
            continue;
        out->solid_angle += seen;
        out->last = i;
        memcpy(out->half, half, sizeof half);
    }
}

/* The portal at `target` of the solid angle of all; `before`: where it begins. */
static void portal_at(const struct portals *portals, const struct light_context *context, real target,
                      struct portals_view *view, real *before)
{
    struct spherical_triangle half[2];

    *before = 0;
    for (uint32_t i = 0; i < view->last; i++) {
        real seen = halves(portals->corners[i], context, half);

        if (seen > 0 && target < *before + seen) {
            memcpy(view->half, half, sizeof half);
            return;
        }
        *before += seen;
    }
}

int portals_sample(const struct portals *portals, const struct light_context *context, const struct portals_view *view,
                   real u, real v, struct vec3 *direction)
{
    real target = u * view->solid_angle, before;
    struct portals_view chosen = *view;
    const struct spherical_triangle *half = chosen.half;

    portal_at(portals, context, target, &chosen, &before);
    if (!(half[0].solid_angle > 0) || (half[1].solid_angle > 0 && target >= before + half[0].solid_angle)) {
        before += half[0].solid_angle;
        half++;
    }
    u = (target - before) / half->solid_angle;
    return spherical_triangle_sample(half, real_min(real_max(u, 0), REAL_BELOW_ONE), v, direction);
}

/* Does the ray from p cross the parallelogram? */
static int crosses(const struct vec3 corner[4], struct vec3 p, struct vec3 direction)
{
    struct dvec3 e1 = dvec3_between(corner[0], corner[1]), e2 = dvec3_between(corner[0], corner[3]);
    struct dvec3 s = dvec3_between(corner[0], p), q = dvec3_cross(s, e1);
    struct dvec3 d = {(double)direction.x, (double)direction.y, (double)direction.z};
    struct dvec3 h = dvec3_cross(d, e2);
    double det = dvec3_dot(e1, h), u, v;

    if (det == 0)
        return 0;
    u = dvec3_dot(s, h) / det;
    v = dvec3_dot(d, q) / det;
    return u >= 0 && u <= 1 && v >= 0 && v <= 1 && dvec3_dot(e2, q) / det > 0;
}

real portals_crossed(const struct portals *portals, const struct light_context *context, struct vec3 direction)
{
    real crossed = 0;

    for (uint32_t i = 0; i < portals->count; i++)
        crossed += crosses(portals->corners[i], context->p, direction) && is_above(portals->corners[i], context);
    return crossed;
}
