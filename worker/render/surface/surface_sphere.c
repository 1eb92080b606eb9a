#include "worker/render/surface/surface_sphere.h"

#include <math.h>
#include <string.h>

#include "common/math/elementary.h"
#include "worker/render/base/sphere.h"
#include "worker/render/surface/world_motion.h"

/* ---- the mesh's triangles --------------------------------------------------------------------- */

uint32_t surface_sphere_rows(uint32_t triangles)
{
    uint32_t rows = (uint32_t)(0.5 * (1 + sqrt(1 + (double)triangles)) + 0.5);

    return rows > 1 && (uint64_t)rows * (rows - 1) * 4 == triangles ? rows : 0;
}

/* Number of the cell's first triangle; *count: 1 or 2. */
static uint32_t cell_triangle(uint32_t rows, uint32_t row, uint32_t column, uint32_t *count)
{
    uint32_t columns = 2 * rows;

    *count = row == 0 || row == rows - 1 ? 1 : 2;
    return row == 0 ? column : columns * (2 * row - 1) + *count * column;
}

/* The cell in this direction from the centre. */
static uint32_t cell_towards(uint32_t rows, const double p[3], uint32_t *count)
{
    float across = (float)sqrt(p[0] * p[0] + p[1] * p[1]);
    float up = det_atan2(across, -(float)p[2]) / PI_F;
    float round = det_atan2((float)p[1], (float)p[0]) / (2 * PI_F);
    uint32_t row = (uint32_t)(up * (float)rows), column;

    round += round < 0 ? 1.0f : 0.0f;
    column = (uint32_t)(round * (float)(2 * rows));
    return cell_triangle(rows, row < rows ? row : rows - 1,
                         column < 2 * rows ? column : 2 * rows - 1, count);
}

static double determinant(const double a[3], const double b[3], const double c[3])
{
    double n[3];

    exact_cross(b, c, n);
    return exact_dot(a, n);
}

/* Barycentric weights where the line from the centre meets the triangle; the smallest of them. */
static double weights_towards(const struct world_mesh *mesh, uint32_t triangle, const double p[3],
                              double weight[3])
{
    const uint32_t *vertex = world_vertices(mesh, triangle);
    double corner[3][3], sum;

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            corner[k][a] = (double)mesh->positions[3 * (size_t)vertex[k] + (size_t)a];
    for (int k = 0; k < 3; k++)
        weight[k] = determinant(p, corner[(k + 1) % 3], corner[(k + 2) % 3]);
    sum = weight[0] + weight[1] + weight[2];
    for (int k = 0; k < 3; k++)
        weight[k] /= sum;
    return fmin(weight[0], fmin(weight[1], weight[2]));
}

uint32_t surface_sphere_triangle(const struct world_mesh *mesh, const double p[3],
                                 double weight[3])
{
    uint32_t count, first = cell_towards(surface_sphere_rows(mesh->triangle_count), p, &count);
    double other[3];

    if (count < 2)
        (void)weights_towards(mesh, first, p, weight);
    else if (weights_towards(mesh, first, p, weight) < weights_towards(mesh, first + 1, p, other)) {
        memcpy(weight, other, sizeof other);
        return first + 1;
    }
    return first;
}

/* ---- hits ------------------------------------------------------------------------------------- */

uint32_t surface_locate(const struct render_scene *scene, struct surface *s)
{
    struct vec3 local = transform_point(&s->instance->to_object, s->p);
    double p[3] = {(double)local.x, (double)local.y, (double)local.z}, weight[3], sum = 0;
    double corner[3][3], n[3];
    uint32_t triangle = surface_sphere_triangle(s->mesh, p, weight);

    for (int k = 0; k < 3; k++) {
        weight[k] = fmax(weight[k], 0);
        sum += weight[k];
    }
    s->vertex = world_vertices(s->mesh, triangle);
    s->b1 = (float)(weight[1] / sum);
    s->b2 = (float)(weight[2] / sum);
    world_corners(scene, s->instance, s->vertex, s->time, corner);
    exact_normal(corner, n);
    s->area = (float)(0.5 * sqrt(exact_dot(n, n)));
    return triangle;
}

void surface_on_sphere(const struct render_scene *scene, const struct ray *ray,
                       const struct hit *hit, struct surface *s)
{
    const struct world_sphere *sphere = s->instance->sphere;
    const struct accel_sphere *shape = &sphere->shape;
    int inside = hit->triangle != 0;
    double o[3], d[3], p[3], n[3], length, sign;
    struct sphere_chord chord;

    exact_vec(ray->direction, d);
    exact_origin(ray, o);
    sphere_chord_find(shape, o, d, &chord);
    for (int a = 0; a < 3; a++)
        n[a] = chord.foot[a] + (inside ? chord.half : -chord.half) * d[a];
    length = sqrt(exact_dot(n, n));
    for (int a = 0; a < 3; a++) {
        n[a] /= length;
        p[a] = shape->centre[a] + shape->radius * n[a];
    }
    s->triangle = 0;
    s->vertex = world_vertices(s->mesh, 0);
    s->b1 = s->b2 = 1.0f / 3;
    s->t = (float)((p[0] - o[0]) * d[0] + (p[1] - o[1]) * d[1] + (p[2] - o[2]) * d[2]);
    s->p = exact_round(p, s->rest);
    s->area = 1;
    s->contacts = world_near_boundary(scene, s->p);
    s->inset = INFINITY; /* there are no edges */
    s->front = inside == sphere->inward;
    sign = inside ? -1 : 1;
    s->ng = vec3_make((float)(sign * n[0]), (float)(sign * n[1]), (float)(sign * n[2]));
    if (sphere->located)
        (void)surface_locate(scene, s);
}
