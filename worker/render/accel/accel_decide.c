#include "worker/render/accel/accel_parts.h"

#include <math.h>
#include <string.h>

#include "common/base/safeguard.h"

/* A face in front of another, in the same place but for rounding: their normals' least cosine, and by
 * how many times their distance the first may lie to the side. */
#define PASSED_COSINE (1 - 0x1p-14)
#define PASSED_SLACK 8.0

/* What rounding may make of a height over a plane through `from`, times the normal's length. */
static double height_noise(const double normal[3], const double to[3], const double from[3])
{
    return 0x1p-49 * (fabs(normal[0]) + fabs(normal[1]) + fabs(normal[2])) * (exact_largest(to) + exact_largest(from));
}

/* The height over the plane of the corner farthest from it, times the normal's length. */
static double farthest(const double corner[3][3], const double plane[3], const double normal[3], double sign)
{
    double most = -INFINITY, to_corner[3];

    for (int k = 0; k < 3; k++) {
        double height;

        exact_sub(corner[k], plane, to_corner);
        height = sign * exact_dot(normal, to_corner);
        if (height > height_noise(normal, to_corner, plane))
            most = fmax(most, height);
    }
    return most;
}

/* A face in double, as the row of its kind takes it. */
struct face {
    const struct shape_row *row;
    const void *face; /* the shape, or: */
    double corner[3][3];
};

static inline void find_face(const struct query_context *q, const struct hit *name, struct face *out)
{
    const struct shape *shape = q->accel->geometries[name->instance].shape;

    out->row = &shape_rows[shape_kind_of(shape)];
    out->face = shape;
    if (shape)
        return;
    q->accel->corners(q->accel->scene, name->instance, name->triangle, q->ray->time, out->corner);
    out->face = out->corner;
}

double accel_ray_end(const struct query_context *q)
{
    struct face end;

    if (!q->ray->reaches)
        return (double)q->ray->t_max;
    find_face(q, &q->ray->end, &end);
    return end.row->end(end.face, q->origin, q->direction, (double)q->ray->t_max);
}

/* Is the whole triangle behind the plane of a face that the ray leaves (`sign` 1), or beyond the
 * plane of the face on which it ends (-1)? Then the ray cannot meet it, whatever the rounding. */
static int is_beyond(const struct query_context *q, const struct hit *face, double sign, const double corner[3][3])
{
    double plane[3], n[3], towards[3];
    struct face touched;

    if (!SAFEGUARD(BEHIND_LEFT_PLANE))
        return 0;
    /* Rounding may tilt a direction along the plane: the ray's record says on which side it goes. */
    exact_vec(sign > 0 ? q->ray->off : q->ray->direction, towards);
    find_face(q, face, &touched);
    touched.row->plane(touched.face, q->origin, q->direction, sign > 0 ? 0 : (double)q->ray->t_max, plane, n);
    if (exact_dot(n, n) == 0)
        return 0;
    if (exact_dot(n, towards) < 0)
        sign = -sign;
    return !(farthest(corner, plane, n, sign) > 0);
}

/* A ray that starts on a triangle's plane, for example on an edge shared with the face it leaves,
 * starts on the side of that face. Does it go to the other side? */
static int goes_through(const struct query_context *q, const double corner[3][3], const double normal[3])
{
    struct face left;
    double face[3][3], before, behind;

    if (!SAFEGUARD(EDGE_SIDE))
        return 1;
    find_face(q, &q->ray->left[0], &left);
    left.row->corners(left.face, face);
    before = farthest(face, corner[0], normal, 1);
    behind = farthest(face, corner[0], normal, -1);
    return before > behind ? exact_dot(normal, q->direction) < 0 : exact_dot(normal, q->direction) > 0;
}

/* Does the triangle, widened by `slack` metres, contain the point where the line through the origin meets
 * its plane? Weights of corners 1 and 2. */
static int covers(const struct query_context *q, const double corner[3][3], const double direction[3], double slack,
                  double *u, double *v, int *facing)
{
    double e1[3], e2[3], e3[3], n[3], p[3], s[3], m[3], determinant, size;

    exact_sub(corner[1], corner[0], e1);
    exact_sub(corner[2], corner[0], e2);
    exact_sub(corner[2], corner[1], e3);
    exact_sub(q->origin, corner[0], s);
    exact_cross(e1, e2, n);
    exact_cross(direction, e2, p);
    exact_cross(s, e1, m);
    determinant = exact_dot(e1, p);
    size = sqrt(exact_dot(n, n));
    if (determinant == 0 || !(size > 0))
        return 0;
    *u = exact_dot(s, p) / determinant;
    *v = exact_dot(direction, m) / determinant;
    *facing = determinant > 0;
    slack += 0x1p-22 * fabs(exact_dot(e2, m) / determinant);
    return *u >= -slack * sqrt(exact_dot(e2, e2)) / size && *v >= -slack * sqrt(exact_dot(e1, e1)) / size &&
           1 - *u - *v >= -slack * sqrt(exact_dot(e3, e3)) / size;
}

int accel_covers(const struct query_context *q, const struct hit *face, double *u, double *v, int *facing)
{
    double corner[3][3];

    q->accel->corners(q->accel->scene, face->instance, face->triangle, q->ray->time, corner);
    return covers(q, corner, q->direction, q->error, u, v, facing);
}

/* Would every ray have been stopped where this one passed the face? Not by a veil, and not by the invisible
 * side of a face, unless it may as well lie behind. */
static int stops_all(const struct query_context *q, const struct hit *face, const double corner[3][3], double u,
                     double v, int facing, double apart)
{
    const struct accel *accel = q->accel;
    double gap = 0;

    if (!accel->geometries[face->instance].filtered)
        return 1;
    if (accel->accept(accel->scene, NULL, face->instance, face->triangle, (real)u, (real)v, facing))
        return 1;
    for (int k = 0; k < 3; k++)
        gap = fmax(gap, accel_gap(&accel->digits, corner[k]));
    return apart < gap && accel->accept(accel->scene, NULL, face->instance, face->triangle, (real)u, (real)v, !facing);
}

/* Has the path passed the triangle on the way to the opaque face that the ray leaves, and nearly parallel
 * to that face, so close before it that Embree took the second for the first? Of such faces one counts:
 * met from behind, the other would keep the light in a gap that floats do not have. */
static int was_passed(const struct query_context *q, const struct hit *face, const double corner[3][3],
                      const double normal[3], double height)
{
    const struct ray *ray = q->ray;
    double off[3], came[3], u, v, length = sqrt(exact_dot(normal, normal));
    int facing;

    if (!ray->left_count || !(fabs(height) <= q->blur * length) || !SAFEGUARD(PASSED_BEFORE))
        return 0;
    exact_vec(ray->off, off);
    exact_vec(ray->came, came);
    if (!(fabs(exact_dot(normal, off)) > PASSED_COSINE * length) || (height < 0) != (exact_dot(normal, came) > 0))
        return 0;
    return covers(q, corner, came, PASSED_SLACK * fabs(height) / length, &u, &v, &facing) &&
           stops_all(q, face, corner, u, v, facing, fabs(height) / length);
}

int accel_decide(struct query_context *q, const struct hit *face, double *t)
{
    double corner[3][3], n[3], to_corner[3], height;

    q->accel->corners(q->accel->scene, face->instance, face->triangle, q->ray->time, corner);
    exact_normal(corner, n);
    exact_sub(corner[0], q->origin, to_corner);
    height = exact_dot(n, to_corner);
    *t = height / exact_dot(n, q->direction);
    if (q->kind == QUERY_COINCIDENT)
        return fabs(*t) < q->gap_max;
    if (q->ray->left_count && fabs(height) <= height_noise(n, to_corner, q->origin)) {
        *t = goes_through(q, corner, n) ? 0 : -1;
    } else if (!(*t < accel_ray_end(q))) {
        return 0;
    }
    for (uint32_t i = 0; i < q->ray->left_count; i++)
        if (is_beyond(q, &q->ray->left[i], 1, corner))
            return 0;
    if (!(*t >= 0)) {
        q->doubt = q->at_edge;
        return 0;
    }
    if (was_passed(q, face, corner, n, height))
        return 0;
    return !q->ray->reaches || !is_beyond(q, &q->ray->end, -1, corner);
}

static int comes_first(double t, const struct hit *a, double u, const struct hit *b)
{
    if (t != u)
        return t < u;
    return a->instance != b->instance ? a->instance < b->instance : a->triangle < b->triangle;
}

static void keep_contact(struct query_context *q, const struct hit *face, double gap, int facing)
{
    struct contact *list = q->contacts;
    uint32_t at = q->contact_count < q->contact_capacity ? q->contact_count : q->contact_capacity;

    /* With spatial splits a triangle is in several leaves, and is met in each. */
    for (uint32_t i = 0; i < at; i++)
        if (list[i].hit.instance == face->instance && list[i].hit.triangle == face->triangle)
            return;
    q->contact_count++;
    while (at > 0 && comes_first(gap, face, list[at - 1].gap, &list[at - 1].hit)) {
        if (at < q->contact_capacity)
            list[at] = list[at - 1];
        at--;
    }
    if (at < q->contact_capacity)
        list[at] = (struct contact){*face, gap, facing, 0};
}

int accel_keep(struct query_context *q, const struct hit *face, double t, int facing)
{
    if (q->kind == QUERY_OCCLUDED)
        return 1;
    if (q->kind == QUERY_COINCIDENT) {
        keep_contact(q, face, t, facing);
    } else if (!q->met || comes_first(t, face, q->nearest_t, &q->nearest)) {
        q->met = 1;
        q->nearest = *face;
        q->nearest_t = t;
    }
    return 0;
}

/* The distance of a line through the origin from the edge between two corners, as seen along the line; positive on one
 * side. 0: the edge is a point. *magnified: by how much Embree's error grows where the edge is seen from its end. */
static double beside_edge(const double direction[3], const double from[3], const double to[3], double *magnified)
{
    double edge[3], across[3], width;

    exact_sub(to, from, edge);
    exact_cross(edge, direction, across);
    width = sqrt(exact_dot(across, across));
    *magnified = sqrt(exact_dot(edge, edge)) / width;
    return width > 0 ? exact_dot(across, from) / width : 0;
}

int accel_may_miss(const struct query_context *q, const struct hit *face)
{
    double corner[3][3], reach = 0, error;
    int left = 1, right = 1;

    if (!SAFEGUARD(LEAK_OUTLINE))
        return 1;
    q->accel->corners(q->accel->scene, face->instance, face->triangle, q->ray->time, corner);
    for (int k = 0; k < 3; k++) {
        exact_sub(corner[k], q->origin, corner[k]);
        reach = fmax(reach, exact_largest(corner[k]));
    }
    error = q->accel->error_origin * (q->largest + reach);
    for (int k = 0; k < 3; k++) {
        double magnified, aside = beside_edge(q->direction, corner[k], corner[(k + 1) % 3], &magnified);
        double slack = error * magnified + q->aside;

        left &= !(aside < -slack);
        right &= !(aside > slack);
    }
    return left || right; /* whichever side it turns to the line */
}

/* Do two faces of one instance lie side by side: with a shared corner and the same winding seen along `axis`? */
static int one_sheet(const struct query_context *q, const struct hit *a, const struct hit *b)
{
    double x[3][3], y[3][3], n[3], m[3];

    if (a->instance != b->instance)
        return 0;
    q->accel->corners(q->accel->scene, a->instance, a->triangle, q->ray->time, x);
    q->accel->corners(q->accel->scene, b->instance, b->triangle, q->ray->time, y);
    exact_normal(x, n);
    exact_normal(y, m);
    if ((exact_dot(n, q->direction) < 0) != (exact_dot(m, q->direction) < 0))
        return 0;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (memcmp(x[i], y[k], sizeof x[i]) == 0)
                return 1;
    return 0;
}

void accel_mark_repeats(const struct query_context *q)
{
    uint32_t count = q->contact_count < q->contact_capacity ? q->contact_count : q->contact_capacity;

    for (uint32_t i = 0; i < count; i++) {
        struct contact *contact = &q->contacts[i];

        contact->repeats = one_sheet(q, &contact->hit, q->about);
        for (uint32_t k = 0; k < i && !contact->repeats; k++)
            contact->repeats = one_sheet(q, &contact->hit, &q->contacts[k].hit);
    }
}
