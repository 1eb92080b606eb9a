#include "worker/render/shape/sphere.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/render_scene.h"

/* The vertices lie on the sphere to this share. */
#define FIT_SHARE 1e-5
/* Of the squared distance from the centre: far more than a double's rounding. */
#define CLEAR_SHARE 1e-9

/* ---- rays that start or end on it ------------------------------------------------------------- */

/* Where the line passes by, the point nearest to the centre. */
double sphere_end(const void *face, const double origin[3], const double direction[3], double t)
{
    struct sphere_chord chord;

    sphere_chord_find(face, origin, direction, &chord);
    return t < chord.middle ? chord.middle - chord.half : chord.middle + chord.half;
}

void sphere_plane(const void *face, const double origin[3], const double direction[3], double t, double point[3],
                  double normal[3])
{
    const struct sphere_shape *sphere = face;
    double end = t > 0 ? sphere_end(face, origin, direction, t) : 0;

    for (int k = 0; k < 3; k++)
        point[k] = origin[k] + end * direction[k];
    exact_sub(point, sphere->centre, normal);
}

/* The centre: most of the sphere lies where it does. */
void sphere_corners(const void *face, double corner[3][3])
{
    const struct sphere_shape *sphere = face;

    for (int k = 0; k < 3; k++)
        memcpy(corner[k], sphere->centre, sizeof corner[k]);
}

/* ---- rays that may meet it -------------------------------------------------------------------- */

void sphere_bounds(const struct shape *shape, double margin, double low[3], double high[3])
{
    const struct sphere_shape *sphere = sphere_of(shape);
    const double reach = sphere->radius + margin;

    for (int k = 0; k < 3; k++) {
        low[k] = sphere->centre[k] - reach;
        high[k] = sphere->centre[k] + reach;
    }
}

/* Most lines miss it by far, or have passed it: the discriminant says so up to its rounding, without a
 * division. */
static int is_clear_of(const struct sphere_shape *sphere, const double origin[3], const double direction[3])
{
    double to_origin[3], along, outside, distance2, length2 = exact_dot(direction, direction);

    exact_sub(origin, sphere->centre, to_origin);
    along = exact_dot(to_origin, direction);
    distance2 = exact_dot(to_origin, to_origin);
    outside = distance2 * (1 - CLEAR_SHARE) - sphere->radius * sphere->radius;
    return outside > 0 && (along > 0 || outside * length2 > along * along);
}

/* A line that leaves the sphere outwards never meets it again, and inwards meets its far side. */
int sphere_crossings(const struct shape *shape, const double origin[3], const double direction[3], const double *off,
                     struct shape_crossing out[SHAPE_CROSSINGS_MAX])
{
    const struct sphere_shape *sphere = sphere_of(shape);
    struct sphere_chord chord;
    double normal[3];

    if (!off && SAFEGUARD(SPHERE_NEAREST_POINT) && is_clear_of(sphere, origin, direction))
        return 0;
    sphere_chord_find(sphere, origin, direction, &chord);
    if (off) {
        exact_sub(origin, sphere->centre, normal);
        out[0] = (struct shape_crossing){fmax(chord.middle + chord.half, 0), 1};
        return exact_dot(off, normal) < 0;
    }
    out[0] = (struct shape_crossing){chord.middle - chord.half, 0};
    out[1] = (struct shape_crossing){chord.middle + chord.half, 1};
    return chord.meets ? 2 : 0;
}

int sphere_same(const struct shape *a_, const struct shape *b_)
{
    const struct sphere_shape *a = sphere_of(a_), *b = sphere_of(b_);

    return a->radius == b->radius && a->centre[0] == b->centre[0] && a->centre[1] == b->centre[1] &&
           a->centre[2] == b->centre[2];
}

/* A box around the ball, if it has a middle. */
static void ball_bounds(const double middle[3], double radius, double low[3], double high[3])
{
    for (int a = 0; a < 3 && isfinite(radius) && isfinite(exact_dot(middle, middle)); a++) {
        low[a] = middle[a] - radius;
        high[a] = middle[a] + radius;
    }
}

/* What is near lies in a slice of the ball of `radius + reach`, around the foot of the centre on the triangle's
 * plane. */
int sphere_near_triangle(const struct shape *shape, const double corner[3][3], double reach, double low[3],
                         double high[3])
{
    const struct sphere_shape *sphere = sphere_of(shape);
    double n[3], to[3], foot[3], height, left2, n2, farthest2 = 0, outer = sphere->radius + reach;

    exact_normal(corner, n);
    n2 = exact_dot(n, n);
    for (int k = 2; k >= 0; k--) {
        exact_sub(corner[k], sphere->centre, to);
        farthest2 = fmax(farthest2, exact_dot(to, to));
    }
    height = exact_dot(to, n); /* of corner 0, times the normal's length */
    left2 = outer * outer - height * height / n2;
    if (left2 < 0 || (reach < sphere->radius && farthest2 < (sphere->radius - reach) * (sphere->radius - reach)))
        return 0;
    for (int a = 0; a < 3; a++)
        foot[a] = sphere->centre[a] + height / n2 * n[a];
    ball_bounds(foot, sqrt(left2) + reach, low, high);
    return 1;
}

/* Around the circle in which they meet: x is its centre's distance from that of `a`, on the line between the two,
 * and what is near has at most x +- give. */
int sphere_near_same(const struct shape *a_, const struct shape *b_, double reach, double low[3], double high[3])
{
    const struct sphere_shape *a = sphere_of(a_), *b = sphere_of(b_);
    const double outer = a->radius + reach;
    double to[3], middle[3], apart, x, give;

    exact_sub(b->centre, a->centre, to);
    apart = sqrt(exact_dot(to, to));
    if (apart > a->radius + b->radius + reach || apart < fabs(a->radius - b->radius) - reach)
        return 0;
    x = (apart * apart + a->radius * a->radius - b->radius * b->radius) / (2 * apart);
    give = reach * (outer + b->radius) / apart;
    for (int k = 0; k < 3; k++)
        middle[k] = a->centre[k] + x / apart * to[k];
    ball_bounds(middle, sqrt(fmax(outer * outer - x * x + 2 * fabs(x) * give, 0)), low, high);
    return 1;
}

void sphere_place(const struct shape *shape, const double origin[3], const double direction[3], uint32_t side,
                  double place[3], double normal[3])
{
    const struct sphere_shape *sphere = sphere_of(shape);
    struct sphere_chord chord;
    double length;

    sphere_chord_find(sphere, origin, direction, &chord);
    for (int a = 0; a < 3; a++)
        normal[a] = chord.foot[a] + (side ? chord.half : -chord.half) * direction[a];
    length = sqrt(exact_dot(normal, normal));
    for (int a = 0; a < 3; a++) {
        normal[a] /= length;
        place[a] = sphere->centre[a] + sphere->radius * normal[a];
    }
}

/* ---- the mesh's triangles --------------------------------------------------------------------- */

/* Rows of the grid that shape_sphere makes: twice as many columns, from the pole at -z on, two
 * triangles a cell but one at the poles. 0: no such grid has this count. */
static uint32_t mesh_rows(uint32_t triangles)
{
    uint32_t rows = (uint32_t)(0.5 * (1 + sqrt(1 + (double)triangles)) + 0.5);

    return rows > 1 && (uint64_t)rows * (rows - 1) * 4 == triangles ? rows : 0;
}

/* The first of the cell's triangles; *count: 1 or 2. */
static uint32_t cell_triangle(uint32_t rows, uint32_t row, uint32_t column, uint32_t *count)
{
    uint32_t columns = 2 * rows;

    *count = row == 0 || row == rows - 1 ? 1 : 2;
    return row == 0 ? column : columns * (2 * row - 1) + *count * column;
}

/* The cell in this direction from the centre. */
static uint32_t cell_towards(uint32_t rows, const double p[3], uint32_t *count)
{
    real across = (real)sqrt(p[0] * p[0] + p[1] * p[1]);
    real up = real_atan2(across, -(real)p[2]) / REAL_PI;
    real round = real_atan2((real)p[1], (real)p[0]) / (2 * REAL_PI);
    uint32_t row = (uint32_t)(up * (real)rows), column;

    round += round < 0 ? 1.0f : 0.0f;
    column = (uint32_t)(round * (real)(2 * rows));
    return cell_triangle(rows, row < rows ? row : rows - 1, column < 2 * rows ? column : 2 * rows - 1, count);
}

static double determinant(const double a[3], const double b[3], const double c[3])
{
    double n[3];

    exact_cross(b, c, n);
    return exact_dot(a, n);
}

/* Weights of the corners where the line from the centre meets the triangle; the least of them. */
static double weights_towards(const struct render_mesh *mesh, uint32_t triangle, const double p[3], double weight[3])
{
    const uint32_t *vertex = triangle_vertices(mesh, triangle);
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

uint32_t sphere_cover(const struct render_mesh *mesh, const double p[3], double weight[3])
{
    uint32_t count, first = cell_towards(mesh_rows(mesh->triangle_count), p, &count);
    double other[3];

    if (count < 2)
        (void)weights_towards(mesh, first, p, weight);
    else if (weights_towards(mesh, first, p, weight) < weights_towards(mesh, first + 1, p, other)) {
        memcpy(weight, other, sizeof other);
        return first + 1;
    }
    return first;
}

/* ---- which meshes stand in for one ------------------------------------------------------------ */

int sphere_fits(const struct render_mesh *mesh, const struct scene_mesh *description)
{
    double radius = (double)description->bounds_max[2];

    if (!mesh_rows(mesh->triangle_count) || !(radius > 0))
        return 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        double middle[3] = {0, 0, 0}, weight[3];

        for (int k = 0; k < 3; k++) {
            const float32 *p = mesh->positions + 3 * (size_t)triangle_vertices(mesh, t)[k];
            double square = 0;
            for (int a = 0; a < 3; a++) {
                square += (double)p[a] * (double)p[a];
                middle[a] += (double)p[a] / 3;
            }
            if (!(fabs(sqrt(square) - radius) <= FIT_SHARE * radius))
                return 0;
        }
        if (sphere_cover(mesh, middle, weight) != t)
            return 0;
    }
    return 1;
}

/* Does its winding face the centre? */
static int winds_inwards(const struct render_mesh *mesh)
{
    const uint32_t *vertex = triangle_vertices(mesh, 0);
    double corner[3][3], n[3];

    for (int k = 0; k < 3; k++)
        for (int a = 0; a < 3; a++)
            corner[k][a] = (double)mesh->positions[3 * (size_t)vertex[k] + (size_t)a];
    exact_cross(corner[1], corner[2], n);
    return exact_dot(corner[0], n) < 0;
}

struct shape *sphere_new(const struct render_mesh *mesh, const struct scene_mesh *description,
                         const struct transform_d *to_world, double scale)
{
    struct sphere_shape *sphere = mem_calloc(1, sizeof *sphere);

    if (!sphere)
        return NULL;
    for (int a = 0; a < 3; a++)
        sphere->centre[a] = to_world->m[a][3];
    sphere->radius = scale * (double)description->bounds_max[2];
    sphere->shape.front = (uint32_t)winds_inwards(mesh);
    return &sphere->shape;
}
