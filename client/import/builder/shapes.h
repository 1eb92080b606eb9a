/* shapes: exact surfaces become triangle meshes.
 *
 * Each function initialises `out` first and leaves it empty after a failure; the caller releases it, or hands it to
 * mesh_finish(). Sizes are finite and within SCENE_COORDINATE_MAX, or the result is ERR_INPUT; more triangles than
 * SHAPE_TRIANGLES_MAX are ERR_LIMIT. Vertices lie on the true surface and carry its normals; the front face is that of
 * the right-handed (dp/du, dp/dv), for quadrics the outside. Texture coordinates are pbrt's (v upwards). Closed shapes
 * (a full sphere, a closed control mesh) give closed meshes: seam and pole vertices have bit-identical positions. Same
 * arguments, same bits on every machine.
 */
#pragma once

#include "client/import/builder/mesh.h"

enum {
    SHAPE_TRIANGLES_MAX = 1 << 26,
    SHAPE_SEGMENTS_MAX = 1 << 12,
    SHAPE_SEGMENTS_DEFAULT = 128,   /* around a full circle: chords sag by 0.03 % of the radius */
    SHAPE_LOOP_LEVELS_MAX = 10,
    SHAPE_CURVE_SIDES_MAX = 64,
};

/* Turn the surface inside out: winding and normals. */
void mesh_source_reverse(struct mesh_source *mesh);

/* Around the z axis, u from phi = 0 to phi_max_rad counter-clockwise seen from +z, v from z_min
 * to z_max; cut off below z_min and above z_max, open there. `segments`: 3 or more around a full
 * circle. radius > 0, 0 < phi_max_rad (more than 2 pi counts as 2 pi). */
status shape_sphere(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                    struct mesh_source *out, struct error *err) MUST_CHECK;
status shape_cylinder(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                      struct mesh_source *out, struct error *err) MUST_CHECK;
/* z = z_max (r / radius)^2, from z_min >= 0 to z_max. */
status shape_paraboloid(double radius, double z_min, double z_max, double phi_max_rad, uint32_t segments,
                        struct mesh_source *out, struct error *err) MUST_CHECK;
/* The line from a (v = 0) to b turns around the z axis: a cone or hyperboloid. a and b differ in z. */
status shape_turned_line(const double a[3], const double b[3], double phi_max_rad, uint32_t segments,
                         struct mesh_source *out, struct error *err) MUST_CHECK;
/* At z = height, facing +z; v from the rim (0) to the inner radius (1). inner_radius >= 0. */
status shape_disk(double height, double radius, double inner_radius, double phi_max_rad, uint32_t segments,
                  struct mesh_source *out, struct error *err) MUST_CHECK;

/* Bilinear patches: corners in the order p00 p10 p01 p11 of (u, v). Each patch becomes divisions^2 quads, or a single
 * one if all of them are parallelograms. Edges that patches share fit together to the bit. */
struct shape_patches {
    const float *positions; /* [vertex_count][3] */
    const float *normals;   /* [vertex_count][3], or NULL: of the surface */
    const float *uv;        /* [vertex_count][2], or NULL: 0..1 in each patch */
    size_t vertex_count;
    const uint32_t *corners; /* [patch_count][4], in range or ERR_INPUT */
    size_t patch_count;
    uint32_t divisions; /* 1..SHAPE_SEGMENTS_MAX */
};
status shape_bilinear(const struct shape_patches *patches, struct mesh_source *out, struct error *err) MUST_CHECK;

/* Loop subdivision (Loop 1987, with Warren's weights; tangent masks of Hoppe et al. 1994; the
 * boundary is a cubic B-spline): `levels` times, then every vertex goes to its limit position with
 * its limit normal. Boundary edges are those of one triangle only; edges of more than two
 * triangles, or of two that are wound against each other, count as boundaries too, and a vertex
 * where several parts meet is split. uv of the control mesh, or NULL, are subdivided linearly. */
struct shape_control {
    const float *positions; /* [vertex_count][3] */
    const float *uv;        /* [vertex_count][2], or NULL */
    size_t vertex_count;
    const uint32_t *indices; /* [triangle_count][3], in range or ERR_INPUT */
    size_t triangle_count;
};
status shape_loop(const struct shape_control *control, uint32_t levels, struct mesh_source *out,
                  struct error *err) MUST_CHECK;

enum shape_curve_basis { CURVE_BEZIER, CURVE_BSPLINE };
/* In pbrt a flat curve turns towards every ray. A mesh cannot, and a tube has the same width from
 * all sides: both become tubes. Only shading differs: a tube has round normals. */
enum shape_curve_kind { CURVE_FLAT, CURVE_CYLINDER, CURVE_RIBBON };

/* One curve: a chain of Bezier or uniform B-spline segments of degree 2 or 3 that share
 * control points (Bezier: `degree` more points a segment; B-spline: one more). */
struct shape_curve {
    enum shape_curve_basis basis;
    enum shape_curve_kind kind;
    uint32_t degree;     /* 2 or 3 */
    const float *points; /* [point_count][3] */
    size_t point_count;
    const float *normals;         /* ribbons: [segments + 1][3], the ribbon's normals at the joints of
                                   its segments (interpolated along a great circle) */
    float width_start, width_end; /* full widths, linear between; >= 0 */
};
/* The number of segments of these control points; 0 if they do not fit the basis and degree. */
size_t shape_curve_segments(const struct shape_curve *curve);

/* All curves in one mesh: each segment in `pieces` steps along, tubes with `sides` corners around
 * (3..SHAPE_CURVE_SIDES_MAX) and open ends. u is along the curve (0 at its start, 1 at its end), v around or across it.
 * A tube's corners lie on the circle whose mean projected width is that of the curve. */
status shape_curves(const struct shape_curve *curves, size_t count, uint32_t pieces, uint32_t sides,
                    struct mesh_source *out, struct error *err) MUST_CHECK;
