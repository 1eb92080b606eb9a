#include "client/import/builder/shapes.h"
#include "client/import/builder/try.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

void mesh_source_reverse(struct mesh_source *mesh)
{
    for (size_t t = 0; t < mesh->triangle_count; t++) {
        uint32_t swap = mesh->indices[3 * t + 1];
        mesh->indices[3 * t + 1] = mesh->indices[3 * t + 2];
        mesh->indices[3 * t + 2] = swap;
    }
    for (size_t i = 0; mesh->normals && i < 3 * mesh->vertex_count; i++)
        mesh->normals[i] = -mesh->normals[i] + 0.0f;
}

/* ---- what all have in common ---------------------------------------------------------------- */

static int is_coordinate(double x)
{
    return fabs(x) <= (double)SCENE_COORDINATE_MAX;
}

static status check_numbers(const float *values, size_t count, const char *what, struct error *err)
{
    for (size_t i = 0; i < count; i++)
        if (!is_coordinate((double)values[i]))
            return error_set(err, STATUS_ERR_INPUT,
                             "%s %zu is %g: only finite numbers up to 1e15 are taken", what, i,
                             (double)values[i]);
    return STATUS_OK;
}

/* Memory for vertices with normals and texture coordinates, and for triangles. */
static status mesh_reserve(struct mesh_source *mesh, uint64_t vertices, uint64_t triangles,
                           struct error *err)
{
    if (triangles > SHAPE_TRIANGLES_MAX || vertices > UINT32_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "the shape would have %llu triangles: at most %d are made",
                         (unsigned long long)triangles, SHAPE_TRIANGLES_MAX);
    mesh->positions = mem_alloc_array((size_t)vertices, 3 * sizeof *mesh->positions);
    mesh->normals = mem_alloc_array((size_t)vertices, 3 * sizeof *mesh->normals);
    mesh->uv[0] = mem_alloc_array((size_t)vertices, 2 * sizeof *mesh->uv[0]);
    mesh->indices = mem_alloc_array((size_t)triangles, 3 * sizeof *mesh->indices);
    if (!mesh->positions || !mesh->normals || !mesh->uv[0] || !mesh->indices)
        return error_no_memory(err, "a shape");
    return STATUS_OK;
}

/* Append a vertex to what mesh_reserve() made room for. + 0.0f: one zero only, so that equal
 * positions are equal in their bits. */
static void add_vertex(struct mesh_source *mesh, const double position[3], const double normal[3],
                       double u, double v)
{
    size_t at = mesh->vertex_count++;

    for (size_t c = 0; c < 3; c++) {
        mesh->positions[3 * at + c] = (float)position[c] + 0.0f;
        mesh->normals[3 * at + c] = (float)normal[c] + 0.0f;
    }
    mesh->uv[0][2 * at] = (float)u;
    mesh->uv[0][2 * at + 1] = (float)v;
}

static void add_triangle(struct mesh_source *mesh, size_t a, size_t b, size_t c)
{
    uint32_t *to = mesh->indices + 3 * mesh->triangle_count++;

    to[0] = (uint32_t)a;
    to[1] = (uint32_t)b;
    to[2] = (uint32_t)c;
}

/* Where a grid's first or last row is a single point: its triangles have one corner there. */
enum grid_poles { POLE_NONE = 0, POLE_FIRST = 1, POLE_LAST = 2 };

/* Triangles of a grid of (columns + 1)(rows + 1) vertices, row by row from `base` on; columns
 * run along u. */
static void add_grid(struct mesh_source *mesh, size_t base, size_t columns, size_t rows, int poles)
{
    for (size_t j = 0; j < rows; j++)
        for (size_t i = 0; i < columns; i++) {
            size_t a = base + j * (columns + 1) + i, b = a + 1;
            size_t d = a + columns + 1, c = d + 1;
            if (j > 0 || !(poles & POLE_FIRST))
                add_triangle(mesh, a, b, c);
            if (j + 1 < rows || !(poles & POLE_LAST))
                add_triangle(mesh, a, c, d);
        }
}

static double dot3(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross3(const double a[3], const double b[3], double out[3])
{
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];

    out[2] = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
}

/* 0, and (0, 0, 0), when it has no direction. */
static int normalize3(double a[3])
{
    double most = fmax(fabs(a[0]), fmax(fabs(a[1]), fabs(a[2])));
    double length;

    if (!(most > 1e-150 && most < 1e150)) {
        a[0] = a[1] = a[2] = 0;
        return 0;
    }
    length = sqrt(dot3(a, a));
    for (int c = 0; c < 3; c++)
        a[c] /= length;
    return 1;
}

/* ---- quadrics ------------------------------------------------------------------------------- */

/* The columns of a surface of revolution. */
struct sweep {
    double phi_max;
    int full; /* the last column is the first */
    uint32_t columns;
};

static status sweep_init(struct sweep *sweep, double radius, double phi_max_rad, uint32_t segments,
                         struct error *err)
{
    if (!(radius > 0) || !is_coordinate(radius))
        return error_set(err, STATUS_ERR_INPUT, "the radius is %g: it must be above 0", radius);
    if (!(phi_max_rad > 0))
        return error_set(err, STATUS_ERR_INPUT, "phimax is %g radians: it must be above 0",
                         phi_max_rad);
    if (segments < 3 || segments > SHAPE_SEGMENTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%u segments: 3 to %d are made", segments,
                         SHAPE_SEGMENTS_MAX);
    /* A full turn that was given in degrees and came through float is one. */
    sweep->full = phi_max_rad >= 2 * PI_D * (1 - 1e-6);
    sweep->phi_max = sweep->full ? 2 * PI_D : phi_max_rad;
    sweep->columns = (uint32_t)ceil(segments * sweep->phi_max / (2 * PI_D) - 1e-6);
    sweep->columns = sweep->columns ? sweep->columns : 1;
    return STATUS_OK;
}

static void sweep_column(const struct sweep *sweep, uint32_t column, double *cosine, double *sine)
{
    float s, c;

    if (sweep->full && column == sweep->columns)
        column = 0;
    det_sincos((float)(sweep->phi_max * column / sweep->columns), &s, &c);
    *sine = (double)s;
    *cosine = (double)c;
}

/* One row of vertices: a circle of radius r at height z, whose normal is (across outwards,
 * along z). A pole's vertices take the u of the middle of their triangle: `shift`. */
static void sweep_row(const struct sweep *sweep, struct mesh_source *mesh, double r, double z,
                      double across, double along, double v, double shift)
{
    for (uint32_t i = 0; i <= sweep->columns; i++) {
        double cosine, sine, position[3], normal[3];
        sweep_column(sweep, i, &cosine, &sine);
        position[0] = r * cosine;
        position[1] = r * sine;
        position[2] = z;
        normal[0] = across * cosine;
        normal[1] = across * sine;
        normal[2] = along;
        add_vertex(mesh, position, normal, fmin(fmax((i + shift) / sweep->columns, 0), 1), v);
    }
}

static status sphere(double radius, double z_min, double z_max, double phi_max_rad,
                     uint32_t segments, struct mesh_source *out, struct error *err)
{
    struct sweep sweep;
    double low = fmax(-1, fmin(z_min, z_max) / radius), high = fmin(1, fmax(z_min, z_max) / radius);
    double theta_low, theta_high;
    uint32_t rows;
    int poles;

    TRY(sweep_init(&sweep, radius, phi_max_rad, segments, err));
    if (!(low < high))
        return error_set(err, STATUS_ERR_INPUT,
                         "zmin %g and zmax %g leave nothing of a sphere of radius %g", z_min, z_max,
                         radius);
    poles = (low == -1 ? POLE_FIRST : 0) | (high == 1 ? POLE_LAST : 0);
    theta_low = low == -1 ? PI_D : (double)det_acos((float)low);
    theta_high = high == 1 ? 0 : (double)det_acos((float)high);
    rows = (uint32_t)ceil(segments * (theta_low - theta_high) / (2 * PI_D) - 1e-6);
    rows = rows > 2 ? rows : 2;
    TRY(mesh_reserve(out, (uint64_t)(sweep.columns + 1) * (rows + 1),
                     (uint64_t)sweep.columns * rows * 2, err));
    for (uint32_t j = 0; j <= rows; j++) {
        double theta = theta_low + (theta_high - theta_low) * j / rows, shift = 0;
        float s, c;
        det_sincos((float)theta, &s, &c);
        if (j == 0 && (poles & POLE_FIRST))
            s = 0, c = -1, shift = 0.5;
        if (j == rows && (poles & POLE_LAST))
            s = 0, c = 1, shift = -0.5;
        sweep_row(&sweep, out, radius * (double)s, radius * (double)c, (double)s, (double)c,
                  (double)j / rows, shift);
    }
    add_grid(out, 0, sweep.columns, rows, poles);
    if (sweep.full && poles == (POLE_FIRST | POLE_LAST)) {
        const double r = (double)(float)radius; /* as the vertices have it */
        out->stands_in = MESH_SPHERE;
        out->true_area = 4 * PI_D * r * r;
    }
    return STATUS_OK;
}

static status finish(status result, struct mesh_source *out)
{
    if (result != STATUS_OK)
        mesh_source_release(out);
    return result;
}

status shape_sphere(double radius, double z_min, double z_max, double phi_max_rad,
                    uint32_t segments, struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return finish(sphere(radius, z_min, z_max, phi_max_rad, segments, out, err), out);
}

static status cylinder(double radius, double z_min, double z_max, double phi_max_rad,
                       uint32_t segments, struct mesh_source *out, struct error *err)
{
    struct sweep sweep;
    double low = fmin(z_min, z_max), high = fmax(z_min, z_max);

    TRY(sweep_init(&sweep, radius, phi_max_rad, segments, err));
    if (!(low < high) || !is_coordinate(low) || !is_coordinate(high))
        return error_set(err, STATUS_ERR_INPUT, "zmin %g and zmax %g make no cylinder", z_min,
                         z_max);
    TRY(mesh_reserve(out, 2 * ((uint64_t)sweep.columns + 1), 2 * (uint64_t)sweep.columns, err));
    sweep_row(&sweep, out, radius, low, 1, 0, 0, 0);
    sweep_row(&sweep, out, radius, high, 1, 0, 1, 0);
    add_grid(out, 0, sweep.columns, 1, POLE_NONE);
    return STATUS_OK;
}

status shape_cylinder(double radius, double z_min, double z_max, double phi_max_rad,
                      uint32_t segments, struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return finish(cylinder(radius, z_min, z_max, phi_max_rad, segments, out, err), out);
}

static status disk(double height, double radius, double inner_radius, double phi_max_rad,
                   uint32_t segments, struct mesh_source *out, struct error *err)
{
    struct sweep sweep;

    TRY(sweep_init(&sweep, radius, phi_max_rad, segments, err));
    if (!(inner_radius >= 0 && inner_radius < radius) || !is_coordinate(height))
        return error_set(err, STATUS_ERR_INPUT,
                         "height %g, radius %g and inner radius %g make no disk", height, radius,
                         inner_radius);
    TRY(mesh_reserve(out, 2 * ((uint64_t)sweep.columns + 1), 2 * (uint64_t)sweep.columns, err));
    sweep_row(&sweep, out, radius, height, 0, 1, 0, 0);
    sweep_row(&sweep, out, inner_radius, height, 0, 1, 1, inner_radius > 0 ? 0 : -0.5);
    add_grid(out, 0, sweep.columns, 1, inner_radius > 0 ? POLE_NONE : POLE_LAST);
    return STATUS_OK;
}

status shape_disk(double height, double radius, double inner_radius, double phi_max_rad,
                  uint32_t segments, struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return finish(disk(height, radius, inner_radius, phi_max_rad, segments, out, err), out);
}

/* ---- bilinear patches ----------------------------------------------------------------------- */

/* From a (k = 0) to b (k = n); the same bits from either end, so that neighbours fit. */
static double mix(double a, double b, uint32_t k, uint32_t n)
{
    return k == 0 ? a : k == n ? b : (a * (n - k) + b * k) / n;
}

/* Value `c` of a table of `width` at (i, j) / n of the patch. */
static double patch_value(const float *table, size_t width, const uint32_t corners[4], size_t c,
                          uint32_t i, uint32_t j, uint32_t n)
{
    double v[4];

    for (int k = 0; k < 4; k++)
        v[k] = (double)table[(size_t)corners[k] * width + c];
    return mix(mix(v[0], v[1], i, n), mix(v[2], v[3], i, n), j, n);
}

/* Is the value at p11 what the other three make it, for an affine map? */
static int is_affine(const float *table, size_t width, const uint32_t corners[4])
{
    double size = 0, off = 0;

    for (size_t c = 0; c < width; c++) {
        double v[4];
        for (int k = 0; k < 4; k++)
            v[k] = (double)table[(size_t)corners[k] * width + c];
        size = fmax(size, fmax(fabs(v[1] - v[0]), fabs(v[2] - v[0])));
        off = fmax(off, fabs(v[0] - v[1] - v[2] + v[3]));
    }
    return off <= 1e-5 * size;
}

/* The normal of the surface itself; where it has none (a corner that two points share), that of
 * a place a little inside. */
static void patch_normal(const struct shape_patches *patches, const uint32_t corners[4], double u,
                         double v, double out[3])
{
    for (int attempt = 0; attempt < 2; attempt++) {
        double du[3], dv[3];
        for (size_t c = 0; c < 3; c++) {
            double p[4];
            for (int k = 0; k < 4; k++)
                p[k] = (double)patches->positions[3 * (size_t)corners[k] + c];
            du[c] = (p[1] - p[0]) * (1 - v) + (p[3] - p[2]) * v;
            dv[c] = (p[2] - p[0]) * (1 - u) + (p[3] - p[1]) * u;
        }
        normalize3(du);
        normalize3(dv);
        cross3(du, dv, out);
        if (normalize3(out))
            return;
        u = fmin(fmax(u, 1e-3), 1 - 1e-3);
        v = fmin(fmax(v, 1e-3), 1 - 1e-3);
    }
}

static void add_patch(const struct shape_patches *patches, const uint32_t corners[4], uint32_t n,
                      struct mesh_source *out)
{
    size_t base = out->vertex_count;

    for (uint32_t j = 0; j <= n; j++)
        for (uint32_t i = 0; i <= n; i++) {
            double position[3], normal[3], uv[2] = {(double)i / n, (double)j / n};
            int given = 0;
            for (size_t c = 0; c < 3; c++)
                position[c] = patch_value(patches->positions, 3, corners, c, i, j, n);
            for (size_t c = 0; patches->normals && c < 3; c++)
                normal[c] = patch_value(patches->normals, 3, corners, c, i, j, n);
            given = patches->normals && normalize3(normal);
            if (!given)
                patch_normal(patches, corners, uv[0], uv[1], normal);
            for (size_t c = 0; patches->uv && c < 2; c++)
                uv[c] = patch_value(patches->uv, 2, corners, c, i, j, n);
            add_vertex(out, position, normal, uv[0], uv[1]);
        }
    add_grid(out, base, n, n, POLE_NONE);
}

static status bilinear(const struct shape_patches *patches, struct mesh_source *out,
                       struct error *err)
{
    uint64_t n = patches->divisions, count = patches->patch_count;
    int affine = 1;

    if (n < 1 || n > SHAPE_SEGMENTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%u divisions of a patch: 1 to %d are made",
                         patches->divisions, SHAPE_SEGMENTS_MAX);
    TRY(check_numbers(patches->positions, 3 * patches->vertex_count, "coordinate", err));
    if (patches->normals)
        TRY(check_numbers(patches->normals, 3 * patches->vertex_count, "normal component", err));
    if (patches->uv)
        TRY(check_numbers(patches->uv, 2 * patches->vertex_count, "texture coordinate", err));
    for (size_t i = 0; i < 4 * patches->patch_count; i++)
        if (patches->corners[i] >= patches->vertex_count)
            return error_set(err, STATUS_ERR_INPUT, "index %zu is %u, but there are %zu vertices",
                             i, patches->corners[i], patches->vertex_count);
    for (size_t i = 0; affine && i < patches->patch_count; i++)
        affine = is_affine(patches->positions, 3, patches->corners + 4 * i) &&
                 (!patches->uv || is_affine(patches->uv, 2, patches->corners + 4 * i));
    n = affine ? 1 : n;
    if (count > SHAPE_TRIANGLES_MAX / (2 * n * n))
        return error_set(err, STATUS_ERR_LIMIT,
                         "%llu patches in %llu divisions: more than %d triangles",
                         (unsigned long long)count, (unsigned long long)n, SHAPE_TRIANGLES_MAX);
    TRY(mesh_reserve(out, count * (n + 1) * (n + 1), count * 2 * n * n, err));
    for (size_t i = 0; i < patches->patch_count; i++)
        add_patch(patches, patches->corners + 4 * i, (uint32_t)n, out);
    return STATUS_OK;
}

status shape_bilinear(const struct shape_patches *patches, struct mesh_source *out,
                      struct error *err)
{
    memset(out, 0, sizeof *out);
    return finish(bilinear(patches, out, err), out);
}

/* ---- curves --------------------------------------------------------------------------------- */

size_t shape_curve_segments(const struct shape_curve *curve)
{
    size_t degree = curve->degree;

    if ((degree != 2 && degree != 3) || curve->point_count < degree + 1)
        return 0;
    if (curve->basis == CURVE_BSPLINE)
        return curve->point_count - degree;
    return (curve->point_count - 1) % degree ? 0 : (curve->point_count - 1) / degree;
}

/* Weights of a segment's control points at t, and of its derivative. */
static void basis_weights(const struct shape_curve *curve, double t, double w[4], double d[4])
{
    double s = 1 - t;

    w[3] = d[3] = 0;
    if (curve->basis == CURVE_BEZIER && curve->degree == 3) {
        w[0] = s * s * s, w[1] = 3 * s * s * t, w[2] = 3 * s * t * t, w[3] = t * t * t;
        d[0] = -3 * s * s, d[1] = 3 * s * (s - 2 * t), d[2] = 3 * t * (2 * s - t), d[3] = 3 * t * t;
    } else if (curve->basis == CURVE_BEZIER) {
        w[0] = s * s, w[1] = 2 * s * t, w[2] = t * t;
        d[0] = -2 * s, d[1] = 2 * (s - t), d[2] = 2 * t;
    } else if (curve->degree == 3) {
        w[0] = s * s * s / 6, w[1] = (3 * t * t * t - 6 * t * t + 4) / 6;
        w[2] = (3 * s * s * s - 6 * s * s + 4) / 6, w[3] = t * t * t / 6;
        d[0] = -s * s / 2, d[1] = (3 * t * t - 4 * t) / 2, d[2] = -(3 * s * s - 4 * s) / 2;
        d[3] = t * t / 2;
    } else {
        w[0] = s * s / 2, w[1] = s * t + 0.5, w[2] = t * t / 2;
        d[0] = -s, d[1] = s - t, d[2] = t;
    }
}

static void curve_point(const struct shape_curve *curve, size_t segment, double t,
                        double position[3], double tangent[3])
{
    size_t first = segment * (curve->basis == CURVE_BEZIER ? curve->degree : 1);
    double w[4], d[4];

    basis_weights(curve, t, w, d);
    for (size_t c = 0; c < 3; c++) {
        position[c] = tangent[c] = 0;
        for (size_t k = 0; k <= curve->degree; k++) {
            double p = (double)curve->points[3 * (first + k) + c];
            position[c] += w[k] * p;
            tangent[c] += d[k] * p;
        }
    }
}

/* What is carried from one step along a curve to the next. */
struct curve_walk {
    double position[3], tangent[3];
    double across[3]; /* unit, at a right angle to the tangent */
    int begun;
};

static void any_perpendicular(const double a[3], double out[3])
{
    double axis[3] = {0, 0, 0};
    int least = 0;

    for (int c = 1; c < 3; c++)
        if (fabs(a[c]) < fabs(a[least]))
            least = c;
    axis[least] = 1;
    cross3(a, axis, out);
    normalize3(out);
}

/* v mirrored in the plane at a right angle to `normal`. */
static void reflect3(double v[3], const double normal[3])
{
    double scale = 2 * dot3(v, normal) / dot3(normal, normal);

    for (int c = 0; c < 3; c++)
        v[c] -= scale * normal[c];
}

/* Take the frame along without turning it about the curve: the double reflection method (Wang
 * et al. 2008, "Computation of Rotation Minimizing Frames"). */
static void walk_to(struct curve_walk *walk, const double position[3], const double tangent[3])
{
    double between[3], turned[3], back[3], scale;

    for (int c = 0; c < 3; c++)
        between[c] = position[c] - walk->position[c];
    if (!walk->begun) {
        any_perpendicular(tangent, walk->across);
        walk->begun = 1;
    } else if (dot3(between, between) > 1e-280) {
        memcpy(turned, walk->tangent, sizeof turned);
        reflect3(turned, between);
        reflect3(walk->across, between);
        for (int c = 0; c < 3; c++)
            back[c] = tangent[c] - turned[c];
        if (dot3(back, back) > 1e-24)
            reflect3(walk->across, back);
    }
    /* What rounding left along the tangent. */
    scale = dot3(walk->across, tangent);
    for (int c = 0; c < 3; c++)
        walk->across[c] -= scale * tangent[c];
    if (!normalize3(walk->across))
        any_perpendicular(tangent, walk->across);
    memcpy(walk->position, position, sizeof walk->position);
    memcpy(walk->tangent, tangent, sizeof walk->tangent);
}

/* Unit tangent of step `k` of a segment: the derivative, or where that vanishes the way to the
 * next step, or the last tangent. */
static void step_tangent(const struct shape_curve *curve, size_t segment, double t, double step,
                         const struct curve_walk *walk, double position[3], double tangent[3])
{
    double other[3], unused[3];
    double away = t + step <= 1 ? step : -step;

    curve_point(curve, segment, t, position, tangent);
    if (normalize3(tangent))
        return;
    curve_point(curve, segment, t + away, other, unused);
    for (int c = 0; c < 3; c++)
        tangent[c] = away > 0 ? other[c] - position[c] : position[c] - other[c];
    if (normalize3(tangent))
        return;
    if (walk->begun)
        memcpy(tangent, walk->tangent, sizeof walk->tangent);
    else
        tangent[2] = 1;
}

/* Where the ribbon faces at t of a segment: along the great circle between its joints'. */
static void ribbon_normal(const struct shape_curve *curve, size_t segment, double t, double out[3])
{
    double a[3], b[3], angle, wa = 1 - t, wb = t;

    for (size_t c = 0; c < 3; c++) {
        a[c] = (double)curve->normals[3 * segment + c];
        b[c] = (double)curve->normals[3 * segment + 3 + c];
    }
    normalize3(a);
    normalize3(b);
    angle = (double)det_acos((float)dot3(a, b));
    if (angle > 1e-3 && angle < PI_D - 1e-3) {
        double sine = (double)det_sin((float)angle);
        wa = (double)det_sin((float)((1 - t) * angle)) / sine;
        wb = (double)det_sin((float)(t * angle)) / sine;
    }
    for (int c = 0; c < 3; c++)
        out[c] = wa * a[c] + wb * b[c];
}

static void add_ribbon_step(const struct shape_curve *curve, size_t segment, double t,
                            const struct curve_walk *walk, double width, double u,
                            struct mesh_source *out)
{
    double normal[3], across[3], position[3];

    /* At a right angle to the curve, as near to the wanted normal as can be. */
    ribbon_normal(curve, segment, t, normal);
    cross3(normal, walk->tangent, across);
    if (!normalize3(across))
        memcpy(across, walk->across, sizeof across);
    cross3(walk->tangent, across, normal);
    for (int side = 0; side < 2; side++) {
        for (int c = 0; c < 3; c++)
            position[c] = walk->position[c] + (side ? 0.5 : -0.5) * width * across[c];
        add_vertex(out, position, normal, u, side);
    }
}

static void add_tube_step(const struct curve_walk *walk, double width, double u, uint32_t sides,
                          struct mesh_source *out)
{
    double other[3];
    /* Cauchy: a convex outline is as wide on average as its length over pi. */
    double radius = 0.5 * width * PI_D / (sides * (double)det_sin((float)(PI_D / sides)));

    /* Around against the tangent's right hand, so that (dp/du, dp/dv) faces outwards. */
    cross3(walk->across, walk->tangent, other);
    for (uint32_t k = 0; k <= sides; k++) {
        double normal[3], position[3];
        float sine, cosine;
        det_sincos((float)(2 * PI_D * (k % sides) / sides), &sine, &cosine);
        for (int c = 0; c < 3; c++) {
            normal[c] = (double)cosine * walk->across[c] + (double)sine * other[c];
            position[c] = walk->position[c] + radius * normal[c];
        }
        add_vertex(out, position, normal, u, (double)k / sides);
    }
}

static void add_curve(const struct shape_curve *curve, uint32_t pieces, uint32_t sides,
                      struct mesh_source *out)
{
    size_t segments = shape_curve_segments(curve), steps = segments * pieces;
    size_t across = curve->kind == CURVE_RIBBON ? 2 : sides + 1, base = out->vertex_count;
    struct curve_walk walk = {0};

    for (size_t k = 0; k <= steps; k++) {
        size_t segment = k < steps ? k / pieces : segments - 1;
        double t = (double)(k - segment * pieces) / pieces, u = (double)k / (double)steps;
        double width = (double)curve->width_start * (1 - u) + (double)curve->width_end * u;
        double position[3], tangent[3];
        step_tangent(curve, segment, t, 1.0 / pieces, &walk, position, tangent);
        walk_to(&walk, position, tangent);
        if (curve->kind == CURVE_RIBBON)
            add_ribbon_step(curve, segment, t, &walk, width, u, out);
        else
            add_tube_step(&walk, width, u, sides, out);
    }
    for (size_t k = 0; k < steps; k++)
        for (size_t i = 0; i + 1 < across; i++) {
            size_t a = base + k * across + i, b = a + across;
            add_triangle(out, a, b, b + 1);
            add_triangle(out, a, b + 1, a + 1);
        }
}

static status check_curve(const struct shape_curve *curve, size_t row, struct error *err)
{
    size_t segments = shape_curve_segments(curve);

    if (segments == 0)
        return error_set(
            err, STATUS_ERR_INPUT, "curve %zu: %zu control points make no chain of %s of degree %u",
            row, curve->point_count,
            curve->basis == CURVE_BEZIER ? "Bezier segments" : "B-spline segments", curve->degree);
    if (!(curve->width_start >= 0 && curve->width_end >= 0) ||
        !is_coordinate((double)curve->width_start) || !is_coordinate((double)curve->width_end))
        return error_set(err, STATUS_ERR_INPUT, "curve %zu: the widths %g and %g must be 0 or more",
                         row, (double)curve->width_start, (double)curve->width_end);
    TRY(check_numbers(curve->points, 3 * curve->point_count, "curve coordinate", err));
    if (curve->kind == CURVE_RIBBON && !curve->normals)
        return error_set(err, STATUS_ERR_INPUT, "curve %zu: a ribbon needs normals", row);
    if (curve->kind == CURVE_RIBBON)
        TRY(check_numbers(curve->normals, 3 * (segments + 1), "curve normal component", err));
    return STATUS_OK;
}

static status curves_all(const struct shape_curve *curves, size_t count, uint32_t pieces,
                         uint32_t sides, struct mesh_source *out, struct error *err)
{
    uint64_t vertices = 0, triangles = 0;

    if (pieces < 1 || pieces > SHAPE_SEGMENTS_MAX || sides < 3 || sides > SHAPE_CURVE_SIDES_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "%u pieces and %u sides of a curve: 1 to %d and 3 to %d are made", pieces,
                         sides, SHAPE_SEGMENTS_MAX, SHAPE_CURVE_SIDES_MAX);
    for (size_t i = 0; i < count; i++) {
        uint64_t steps, across = curves[i].kind == CURVE_RIBBON ? 2 : sides + 1;
        TRY(check_curve(&curves[i], i, err));
        steps = (uint64_t)shape_curve_segments(&curves[i]) * pieces;
        vertices += (steps + 1) * across;
        triangles += 2 * steps * (across - 1);
        if (triangles > SHAPE_TRIANGLES_MAX)
            break; /* mesh_reserve() says so */
    }
    TRY(mesh_reserve(out, vertices, triangles, err));
    for (size_t i = 0; i < count; i++)
        add_curve(&curves[i], pieces, sides, out);
    return STATUS_OK;
}

status shape_curves(const struct shape_curve *curves, size_t count, uint32_t pieces, uint32_t sides,
                    struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return finish(curves_all(curves, count, pieces, sides, out, err), out);
}
