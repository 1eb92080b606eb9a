/* Curves: tubes and ribbons along Bezier and B-spline segments. */
#include <math.h>
#include <string.h>

#include "client/import/builder/shapes_parts.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

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

static void curve_point(const struct shape_curve *curve, size_t segment, double t, double position[3],
                        double tangent[3])
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

/* The state carried along a curve. */
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

/* Move the frame along the curve without twisting it: the double reflection method (Wang et al.
 * 2008, "Computation of Rotation Minimizing Frames"). */
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
    /* Remove the rounding error along the tangent. */
    scale = dot3(walk->across, tangent);
    for (int c = 0; c < 3; c++)
        walk->across[c] -= scale * tangent[c];
    if (!normalize3(walk->across))
        any_perpendicular(tangent, walk->across);
    memcpy(walk->position, position, sizeof walk->position);
    memcpy(walk->tangent, tangent, sizeof walk->tangent);
}

/* Unit tangent of step `k` of a segment: the derivative, or if that vanishes the direction to the
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

/* The ribbon's normal at t of a segment, on the great circle between those of its joints. */
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

static void add_ribbon_step(const struct shape_curve *curve, size_t segment, double t, const struct curve_walk *walk,
                            double width, double u, struct mesh_source *out)
{
    double normal[3], across[3], position[3];

    /* Perpendicular to the curve, as near as possible to the wanted normal. */
    ribbon_normal(curve, segment, t, normal);
    cross3(normal, walk->tangent, across);
    if (!normalize3(across))
        memcpy(across, walk->across, sizeof across);
    cross3(walk->tangent, across, normal);
    for (int side = 0; side < 2; side++) {
        for (int c = 0; c < 3; c++)
            position[c] = walk->position[c] + (side ? 0.5 : -0.5) * width * across[c];
        shape_add_vertex(out, position, normal, u, side);
    }
}

static void add_tube_step(const struct curve_walk *walk, double width, double u, uint32_t sides,
                          struct mesh_source *out)
{
    double other[3];
    /* Cauchy: the mean width of a convex outline is its length over pi. */
    double radius = 0.5 * width * PI_D / (sides * (double)det_sin((float)(PI_D / sides)));

    /* Clockwise about the tangent, so that (dp/du, dp/dv) faces outwards. */
    cross3(walk->across, walk->tangent, other);
    for (uint32_t k = 0; k <= sides; k++) {
        double normal[3], position[3];
        float sine, cosine;
        det_sincos((float)(2 * PI_D * (k % sides) / sides), &sine, &cosine);
        for (int c = 0; c < 3; c++) {
            normal[c] = (double)cosine * walk->across[c] + (double)sine * other[c];
            position[c] = walk->position[c] + radius * normal[c];
        }
        shape_add_vertex(out, position, normal, u, (double)k / sides);
    }
}

static void add_curve(const struct shape_curve *curve, uint32_t pieces, uint32_t sides, struct mesh_source *out)
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
            shape_add_triangle(out, a, b, b + 1);
            shape_add_triangle(out, a, b + 1, a + 1);
        }
}

static status check_curve(const struct shape_curve *curve, size_t row, struct error *err)
{
    size_t segments = shape_curve_segments(curve);

    if (segments == 0)
        return error_set(err, STATUS_ERR_INPUT, "curve %zu: %zu control points make no chain of %s of degree %u", row,
                         curve->point_count, curve->basis == CURVE_BEZIER ? "Bezier segments" : "B-spline segments",
                         curve->degree);
    if (!(curve->width_start >= 0 && curve->width_end >= 0) || !shape_is_coordinate((double)curve->width_start) ||
        !shape_is_coordinate((double)curve->width_end))
        return error_set(err, STATUS_ERR_INPUT, "curve %zu: the widths %g and %g must be 0 or more", row,
                         (double)curve->width_start, (double)curve->width_end);
    TRY(shape_check_numbers(curve->points, 3 * curve->point_count, "curve coordinate", err));
    if (curve->kind == CURVE_RIBBON && !curve->normals)
        return error_set(err, STATUS_ERR_INPUT, "curve %zu: a ribbon needs normals", row);
    if (curve->kind == CURVE_RIBBON)
        TRY(shape_check_numbers(curve->normals, 3 * (segments + 1), "curve normal component", err));
    return STATUS_OK;
}

static status curves_all(const struct shape_curve *curves, size_t count, uint32_t pieces, uint32_t sides,
                         struct mesh_source *out, struct error *err)
{
    uint64_t vertices = 0, triangles = 0;

    if (pieces < 1 || pieces > SHAPE_SEGMENTS_MAX || sides < 3 || sides > SHAPE_CURVE_SIDES_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%u pieces and %u sides of a curve: 1 to %d and 3 to %d are made",
                         pieces, sides, SHAPE_SEGMENTS_MAX, SHAPE_CURVE_SIDES_MAX);
    for (size_t i = 0; i < count; i++) {
        uint64_t steps, across = curves[i].kind == CURVE_RIBBON ? 2 : sides + 1;
        TRY(check_curve(&curves[i], i, err));
        steps = (uint64_t)shape_curve_segments(&curves[i]) * pieces;
        vertices += (steps + 1) * across;
        triangles += 2 * steps * (across - 1);
        if (triangles > SHAPE_TRIANGLES_MAX)
            break; /* shape_reserve() says so */
    }
    TRY(shape_reserve(out, vertices, triangles, err));
    for (size_t i = 0; i < count; i++)
        add_curve(&curves[i], pieces, sides, out);
    return STATUS_OK;
}

status shape_curves(const struct shape_curve *curves, size_t count, uint32_t pieces, uint32_t sides,
                    struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return shape_finish(curves_all(curves, count, pieces, sides, out, err), out);
}
