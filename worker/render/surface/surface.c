#include "worker/render/surface/surface.h"

#include <string.h>

#include "common/base/safeguard.h"
#include "worker/render/base/exact.h"
#include "worker/render/render_scene.h"
#include "worker/render/surface/render_motion.h"
#include "worker/render/surface/surface_shape.h"

void triangle_of_instance(const struct render_scene *scene, const struct render_instance *instance, uint32_t triangle,
                          real time, struct vec3 corner[3])
{
    const struct render_mesh *mesh = &scene->meshes[instance->mesh];
    const uint32_t *vertex = triangle_vertices(mesh, triangle);
    const float32 *positions = instance->instance_positions;
    double c[3][3];

    if (positions && !instance_is_moving(instance)) { /* floats already */
        for (int k = 0; k < 3; k++) {
            const float32 *p = positions + 3 * (size_t)vertex[k];
            corner[k] = vec3_make(p[0], p[1], p[2]);
        }
        return;
    }
    corners_of_triangle(scene, instance, vertex, time, c);
    for (int k = 0; k < 3; k++)
        corner[k] = vec3_make((real)c[k][0], (real)c[k][1], (real)c[k][2]);
}

/* The longest edge, and a lower bound of the distance to the nearest: the smallest weight times the smallest height. */
static inline void surface_set_edges(double u, double v, double double_area, const double e1[3], const double e2[3],
                                     struct surface *s)
{
    double a = exact_dot(e1, e1), b = exact_dot(e2, e2), ab = exact_dot(e1, e2);
    double c = a + b - 2 * ab, w = 1 - u - v, least, longest;

    least = u < v ? u : v;
    least = w < least ? w : least;
    longest = a > b ? a : b;
    longest = c > longest ? c : longest;
    s->edge = (real)sqrt(longest);
    s->inset = longest > 0 ? (real)(least * double_area / sqrt(longest)) : 0;
}

/* The hit's place, after s->t. Far from the origin of world or ray, a place along the ray in float
 * lies off the face. */
static inline void surface_set_place(const struct ray *ray, const double p[3], struct surface *s)
{
    if (SAFEGUARD(HIT_IN_DOUBLE)) {
        s->p = exact_round(p, s->rest);
    } else {
        s->p = vec3_mad(ray->origin, ray->direction, s->t);
        memset(s->rest, 0, sizeof s->rest);
    }
}

/* Does the mesh's winding, in the world, call the side counter-clockwise from which it is not? */
static inline double surface_winding(const struct render_instance *instance)
{
    return instance->flipped && SAFEGUARD(MIRRORED_WINDING) ? -1 : 1;
}

void surface_from_hit(const struct render_scene *scene, const struct ray *ray, const struct hit *hit, struct surface *s)
{
    double c[3][3], e1[3], e2[3], n[3], to_origin[3], m[3], p[3], d[3], o[3];
    double along, u, v, length, sign;

    exact_vec(ray->direction, d);
    exact_origin(ray, o);
    s->number = hit->instance;
    s->instance = &scene->instances[hit->instance];
    s->footprint = 0;
    s->other_count = 0;
    s->time = ray->time;
    s->came = ray->direction;
    s->material = &scene->materials[s->instance->material];
    s->mesh = &scene->meshes[s->instance->mesh];
    if (s->instance->shape) {
        surface_on_shape(scene, ray, hit, s);
        return;
    }
    s->triangle = hit->triangle;
    s->vertex = triangle_vertices(s->mesh, hit->triangle);
    corners_of_triangle(scene, s->instance, s->vertex, ray->time, c);
    exact_sub(c[1], c[0], e1);
    exact_sub(c[2], c[0], e2);
    exact_sub(o, c[0], to_origin);
    exact_cross(e1, e2, n);
    length = sqrt(exact_dot(n, n));

    /* Moeller-Trumbore in double, by the normal, which is needed anyway, and one more cross product; the clamp only
     * removes rounding errors at an edge. */
    along = exact_dot(n, d);
    if (fabs(along) > 0x1p-1024) { /* 1 / along is finite */
        const double scale = 1 / along;
        exact_cross(d, to_origin, m);
        u = exact_dot(e2, m) * scale;
        v = -exact_dot(e1, m) * scale;
        u = u > 0 ? u : 0;
        u = u < 1 ? u : 1;
        v = v > 0 ? v : 0;
        v = v < 1 - u ? v : 1 - u;
    } else {
        u = v = 1.0 / 3;
    }
    for (int a = 0; a < 3; a++)
        p[a] = c[0][a] + u * e1[a] + v * e2[a];
    s->b1 = (real)u;
    s->b2 = (real)v;
    s->t = (real)((p[0] - o[0]) * d[0] + (p[1] - o[1]) * d[1] + (p[2] - o[2]) * d[2]);
    surface_set_place(ray, p, s);
    s->area = (real)(0.5 * length);
    surface_set_edges(u, v, length, e1, e2, s);
    s->contacts = render_near_face(scene, s->instance, hit->triangle, s->p, s->inset);

    sign = surface_winding(s->instance);
    s->front = along * sign < 0;
    sign = (s->front ? sign : -sign) / length;
    if (length > 0)
        s->ng = vec3_make((real)(n[0] * sign), (real)(n[1] * sign), (real)(n[2] * sign));
    else
        s->ng = vec3_neg(ray->direction);
}

void surface_uv(const struct surface *s, real *u, real *v)
{
    const float32 *uv = s->mesh->uv[0], *a, *b, *c;
    real b0 = 1 - s->b1 - s->b2;

    *u = *v = 0;
    if (!uv)
        return;
    a = uv + 2 * (size_t)s->vertex[0];
    b = uv + 2 * (size_t)s->vertex[1];
    c = uv + 2 * (size_t)s->vertex[2];
    *u = b0 * a[0] + s->b1 * b[0] + s->b2 * c[0];
    *v = b0 * a[1] + s->b1 * b[1] + s->b2 * c[1];
}

void surface_leave(const struct surface *s, struct vec3 direction, struct ray *ray)
{
    ray->origin = s->p;
    ray->direction = direction;
    ray->t_max = INFINITY;
    ray->time = s->time;
    memcpy(ray->rest, s->rest, sizeof ray->rest);
    ray->left_count = 1 + s->other_count;
    ray->left[0] = (struct hit){s->number, s->triangle};
    for (uint32_t i = 0; i < s->other_count; i++)
        ray->left[1 + i] = s->others[i];
    ray->reaches = 0;
    ray->contacts = s->contacts;
    ray->inset = s->inset;
    ray->edge = s->edge;
    ray->came = s->came;
    ray->came_t = s->material->flags & (MATERIAL_TWO_WAY | MATERIAL_BOUNDS) ? 0 : s->t;
    ray->off = vec3_dot(direction, s->ng) < 0 ? vec3_neg(s->ng) : s->ng;
}
