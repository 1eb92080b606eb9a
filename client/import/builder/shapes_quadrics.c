/* Spheres, cylinders, disks and lines that turn: surfaces of revolution. */
#include <math.h>
#include <string.h>

#include "client/import/builder/shapes_parts.h"
#include "common/math/elementary.h"

/* The columns of a surface of revolution. */
struct sweep {
    double phi_max;
    int full; /* the last column is the first */
    uint32_t columns;
};

static status sweep_init(struct sweep *sweep, double radius, double phi_max_rad, uint32_t segments, struct error *err)
{
    if (!(radius > 0) || !shape_is_coordinate(radius))
        return error_set(err, STATUS_ERR_INPUT, "the radius is %g: it must be above 0", radius);
    if (!(phi_max_rad > 0))
        return error_set(err, STATUS_ERR_INPUT, "phimax is %g radians: it must be above 0", phi_max_rad);
    if (segments < 3 || segments > SHAPE_SEGMENTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%u segments: 3 to %d are made", segments, SHAPE_SEGMENTS_MAX);
    /* A full turn in degrees may be slightly smaller after rounding to float. */
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
static void sweep_row(const struct sweep *sweep, struct mesh_source *mesh, double r, double z, double across,
                      double along, double v, double shift)
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
        shape_add_vertex(mesh, position, normal, fmin(fmax((i + shift) / sweep->columns, 0), 1), v);
    }
}

static status sphere(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                     struct mesh_source *out, struct error *err)
{
    struct sweep sweep;
    double low = fmax(-1, fmin(z_min, z_max) / radius), high = fmin(1, fmax(z_min, z_max) / radius);
    double theta_low, theta_high;
    uint32_t rows;
    int poles;

    TRY(sweep_init(&sweep, radius, phi_max_rad, segments, err));
    if (!(low < high))
        return error_set(err, STATUS_ERR_INPUT, "zmin %g and zmax %g leave nothing of a sphere of radius %g", z_min,
                         z_max, radius);
    poles = (low == -1 ? POLE_FIRST : 0) | (high == 1 ? POLE_LAST : 0);
    theta_low = low == -1 ? PI_D : (double)det_acos((float)low);
    theta_high = high == 1 ? 0 : (double)det_acos((float)high);
    rows = (uint32_t)ceil(segments * (theta_low - theta_high) / (2 * PI_D) - 1e-6);
    rows = rows > 2 ? rows : 2;
    TRY(shape_reserve(out, (uint64_t)(sweep.columns + 1) * (rows + 1), (uint64_t)sweep.columns * rows * 2, err));
    for (uint32_t j = 0; j <= rows; j++) {
        double theta = theta_low + (theta_high - theta_low) * j / rows, shift = 0;
        float s, c;
        det_sincos((float)theta, &s, &c);
        if (j == 0 && (poles & POLE_FIRST))
            s = 0, c = -1, shift = 0.5;
        if (j == rows && (poles & POLE_LAST))
            s = 0, c = 1, shift = -0.5;
        sweep_row(&sweep, out, radius * (double)s, radius * (double)c, (double)s, (double)c, (double)j / rows, shift);
    }
    shape_add_grid(out, 0, sweep.columns, rows, poles);
    if (sweep.full && poles == (POLE_FIRST | POLE_LAST)) {
        const double r = (double)(float)radius; /* as the vertices have it */
        out->stands_in = MESH_SPHERE;
        out->true_area = 4 * PI_D * r * r;
    }
    return STATUS_OK;
}

status shape_sphere(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                    struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return shape_finish(sphere(radius, z_min, z_max, phi_max_rad, segments, out, err), out);
}

static status cylinder(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                       struct mesh_source *out, struct error *err)
{
    struct sweep sweep;
    double low = fmin(z_min, z_max), high = fmax(z_min, z_max);

    TRY(sweep_init(&sweep, radius, phi_max_rad, segments, err));
    if (!(low < high) || !shape_is_coordinate(low) || !shape_is_coordinate(high))
        return error_set(err, STATUS_ERR_INPUT, "zmin %g and zmax %g make no cylinder", z_min, z_max);
    TRY(shape_reserve(out, 2 * ((uint64_t)sweep.columns + 1), 2 * (uint64_t)sweep.columns, err));
    sweep_row(&sweep, out, radius, low, 1, 0, 0, 0);
    sweep_row(&sweep, out, radius, high, 1, 0, 1, 0);
    shape_add_grid(out, 0, sweep.columns, 1, POLE_NONE);
    return STATUS_OK;
}

status shape_cylinder(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                      struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return shape_finish(cylinder(radius, z_min, z_max, phi_max_rad, segments, out, err), out);
}

static status disk(double height, double radius, double inner_radius, double phi_max_rad, uint32_t segments,
                   struct mesh_source *out, struct error *err)
{
    struct sweep sweep;

    TRY(sweep_init(&sweep, radius, phi_max_rad, segments, err));
    if (!(inner_radius >= 0 && inner_radius < radius) || !shape_is_coordinate(height))
        return error_set(err, STATUS_ERR_INPUT, "height %g, radius %g and inner radius %g make no disk", height, radius,
                         inner_radius);
    TRY(shape_reserve(out, 2 * ((uint64_t)sweep.columns + 1), 2 * (uint64_t)sweep.columns, err));
    sweep_row(&sweep, out, radius, height, 0, 1, 0, 0);
    sweep_row(&sweep, out, inner_radius, height, 0, 1, 1, inner_radius > 0 ? 0 : -0.5);
    shape_add_grid(out, 0, sweep.columns, 1, inner_radius > 0 ? POLE_NONE : POLE_LAST);
    return STATUS_OK;
}

status shape_disk(double height, double radius, double inner_radius, double phi_max_rad, uint32_t segments,
                  struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return shape_finish(disk(height, radius, inner_radius, phi_max_rad, segments, out, err), out);
}

/* ---- pbrt-v3's others ------------------------------------------------------------------------- */

static status paraboloid(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                         struct mesh_source *out, struct error *err)
{
    struct sweep sweep;
    uint32_t rows = segments / 4;
    int pole = z_min == 0;

    TRY(sweep_init(&sweep, radius, phi_max_rad, segments, err));
    if (!(z_min >= 0 && z_min < z_max) || !shape_is_coordinate(z_max))
        return error_set(err, STATUS_ERR_INPUT, "zmin %g and zmax %g make no paraboloid", z_min, z_max);
    rows = rows > 2 ? rows : 2;
    TRY(shape_reserve(out, (uint64_t)(sweep.columns + 1) * (rows + 1), (uint64_t)sweep.columns * rows * 2, err));
    for (uint32_t j = 0; j <= rows; j++) {
        double v = (double)j / rows * j / rows; /* radii in equal steps from a pole */
        double z = z_min + (z_max - z_min) * v, r = radius * sqrt(z / z_max);
        double slope = 2 * z_max * r / (radius * radius), length = sqrt(slope * slope + 1);
        sweep_row(&sweep, out, r, z, slope / length, -1 / length, v, pole && j == 0 ? 0.5 : 0);
    }
    shape_add_grid(out, 0, sweep.columns, rows, pole ? POLE_FIRST : POLE_NONE);
    return STATUS_OK;
}

status shape_paraboloid(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                        struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return shape_finish(paraboloid(radius, z_min, z_max, phi_max_rad, segments, out, err), out);
}

static void turn(const double p[3], double cosine, double sine, double out[3])
{
    out[0] = p[0] * cosine - p[1] * sine;
    out[1] = p[0] * sine + p[1] * cosine;
    out[2] = p[2];
}

static status turned_line(const double a[3], const double b[3], double phi_max_rad, uint32_t segments,
                          struct mesh_source *out, struct error *err)
{
    const double along[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    double ra = a[0] * a[0] + a[1] * a[1], rb = b[0] * b[0] + b[1] * b[1];
    int pole_a = ra == 0, pole_b = rb == 0;
    /* A cone or cylinder has one; other lines, and those that cross the axis, bend. */
    int straight = a[0] * b[1] == a[1] * b[0] && a[0] * b[0] + a[1] * b[1] >= 0;
    uint32_t rows = straight ? 1 : segments / 4 | 1; /* odd: no row is a point of the axis */
    struct sweep sweep;

    TRY(sweep_init(&sweep, sqrt(fmax(ra, rb)), phi_max_rad, segments, err));
    if (!shape_is_coordinate(a[2]) || !shape_is_coordinate(b[2]) || a[2] == b[2])
        return error_set(err, STATUS_ERR_INPUT, "a line from z %g to %g makes no surface by turning", a[2], b[2]);
    TRY(shape_reserve(out, (uint64_t)(sweep.columns + 1) * (rows + 1), (uint64_t)sweep.columns * rows * 2, err));
    for (uint32_t j = 0; j <= rows; j++) {
        double v = (double)j / rows, shift = j == 0 && pole_a ? 0.5 : j == rows && pole_b ? -0.5 : 0;
        const double p[3] = {a[0] + along[0] * v, a[1] + along[1] * v, a[2] + along[2] * v};
        /* (dp/du, dp/dv): a pole has the normal of its line, beside it. */
        const double *q = shift > 0 ? b : shift < 0 ? a : p;
        double normal[3] = {q[0] * along[2], q[1] * along[2], -(q[0] * along[0] + q[1] * along[1])};
        if (!normalize3(normal))
            normal[2] = 1;
        for (uint32_t i = 0; i <= sweep.columns; i++) {
            double cosine, sine, position[3], facing[3];
            sweep_column(&sweep, i, &cosine, &sine);
            turn(p, cosine, sine, position);
            turn(normal, cosine, sine, facing);
            shape_add_vertex(out, position, facing, fmin(fmax((i + shift) / sweep.columns, 0), 1), v);
        }
    }
    shape_add_grid(out, 0, sweep.columns, rows, (pole_a ? POLE_FIRST : 0) | (pole_b ? POLE_LAST : 0));
    return STATUS_OK;
}

status shape_turned_line(const double a[3], const double b[3], double phi_max_rad, uint32_t segments,
                         struct mesh_source *out, struct error *err)
{
    memset(out, 0, sizeof *out);
    return shape_finish(turned_line(a, b, phi_max_rad, segments, out, err), out);
}
