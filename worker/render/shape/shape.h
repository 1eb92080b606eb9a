/* shape: what the faces of an instance are, and the table of the kinds. Private to worker/render.
 *
 * An instance is the triangles of its mesh, unless it has a shape: a surface that is intersected in double, with one
 * face and two sides, 0 and 1. Its hits have the side from which the ray came for the triangle; a ray leaves it by
 * {instance, 0}, to either side. Its mesh stands in for it: the mesh travels with the scene, has texture coordinates
 * and tangents, and serves where the shape cannot (scene/render_shape.c).
 *
 * A kind is one file, a row of SHAPE_KINDS, and a row of LIGHT_KINDS of the same KIND (light/light.h) with a file of
 * its own. Who asks what of it:
 *
 *   prefix_end, prefix_plane, prefix_corners     accel_decide.c: rays that start or end on a face
 *   prefix_bounds, prefix_crossings, prefix_same accel_shape.c: rays that may meet it
 *   prefix_place, prefix_cover                   surface_shape.c: a hit made into a place to shade
 *   prefix_bounds, prefix_near_*                 render_touch.c: where other faces are near it
 *   prefix_fits, prefix_new                      render_shape.c: which meshes stand in for one
 *
 * docs/EXTENDING.md lists the files of a new shape.
 */
#pragma once

#include <stdint.h>

#include "common/math/transform.h"
#include "common/scene/scene.h"

struct render_mesh;

/* X(KIND, prefix, STANDS_IN, FACES). STANDS_IN: the bit of scene_mesh.arrays of a mesh that stands in
 * for one. FACES: WHOLE, one face as above; MESH, the mesh's triangles, which Embree intersects and
 * surface.c evaluates: only the first three functions exist, and their face is `double corner[3][3]`. */
#define SHAPE_KINDS(X)             \
    X(TRIANGLE, triangle, 0, MESH) \
    X(SPHERE, sphere, MESH_SPHERE, WHOLE)

enum shape_kind {
#define SHAPE_ENUM(KIND, ...) SHAPE_##KIND,
    SHAPE_KINDS(SHAPE_ENUM)
#undef SHAPE_ENUM
    SHAPE_KIND_COUNT
};

/* Each WHOLE kind's struct begins with this. */
struct shape {
    enum shape_kind kind;
    uint32_t front;   /* the side of the mesh's counter-clockwise winding: a lamp shines from there */
    uint32_t winding; /* the same, as `accept` gets it (accel.h) */
    int located;      /* what is shaded depends on the place: find the mesh's triangle at every hit */
};

struct shape_crossing {
    double t;      /* lengths of the direction */
    uint32_t side; /* from which the line comes */
};
enum { SHAPE_CROSSINGS_MAX = 2 };

/* ---- of every kind; `face`: the shape, or a triangle's corners -------------------------------- */

/* Where the line meets the face, in lengths of the direction: of several places that nearest to `t`,
 * near which it does. */
typedef double shape_end_function(const void *face, const double origin[3], const double direction[3], double t);
/* A point and a normal, of any length and sense, of the plane that touches the face where the line
 * starts (`t` is 0: it starts on the face), or where it meets it near `t`. */
typedef void shape_plane_function(const void *face, const double origin[3], const double direction[3], double t,
                                  double point[3], double normal[3]);
/* Three points: of a plane that holds a place of the face, the face is on the side where the one lies
 * that is farthest from it. */
typedef void shape_corners_function(const void *face, double corner[3][3]);

/* ---- of WHOLE ones ---------------------------------------------------------------------------- */

/* A box around it, `margin` metres larger. */
typedef void shape_bounds_function(const struct shape *shape, double margin, double low[3], double high[3]);
/* The line's crossings in order; how many. Those of a shape that lies wholly behind the origin may be left out. `off` not NULL:
 * the line starts on the shape and leaves it to the side where `off` points; then only what it meets
 * after that, whatever rounding says. */
typedef int shape_crossings_function(const struct shape *shape, const double origin[3], const double direction[3],
                                     const double *off, struct shape_crossing out[SHAPE_CROSSINGS_MAX]);
/* Are both, of this kind, the same place for place? */
typedef int shape_same_function(const struct shape *a, const struct shape *b);
/* Where do a triangle and the shape come within `reach` metres of each other? A box around these places of both, of
 * which some sides may be infinite; 0: nowhere. The same of two of this kind. */
typedef int shape_near_triangle_function(const struct shape *shape, const double corner[3][3], double reach,
                                         double low[3], double high[3]);
typedef int shape_near_same_function(const struct shape *a, const struct shape *b, double reach, double low[3],
                                     double high[3]);
/* Of a crossing that was found, from its side: the place, put back onto the shape, and the unit normal
 * that points to side 0. */
typedef void shape_place_function(const struct shape *shape, const double origin[3], const double direction[3],
                                  uint32_t side, double place[3], double normal[3]);
/* The triangle of the mesh that covers a place of the shape, in the mesh's coordinates, and the weights
 * of its corners there; they add up to 1, and may be a little below 0. */
typedef uint32_t shape_cover_function(const struct render_mesh *mesh, const double place[3], double weight[3]);
/* Is the mesh what it says it stands in for, so that prefix_cover finds each of its triangles? */
typedef int shape_fits_function(const struct render_mesh *mesh, const struct scene_mesh *description);
/* The kind's struct, its `front` set, for a mesh that fits, placed by a matrix that scales all lengths
 * by `scale`. Freed by mem_free; NULL: out of memory. */
typedef struct shape *shape_new_function(const struct render_mesh *mesh, const struct scene_mesh *description,
                                         const struct transform_d *to_world, double scale);

#define SHAPE_DECLARE_WHOLE(prefix)              \
    shape_bounds_function prefix##_bounds;       \
    shape_crossings_function prefix##_crossings; \
    shape_same_function prefix##_same;           \
    shape_near_triangle_function prefix##_near_triangle; \
    shape_near_same_function prefix##_near_same; \
    shape_place_function prefix##_place;         \
    shape_cover_function prefix##_cover;         \
    shape_fits_function prefix##_fits;           \
    shape_new_function prefix##_new;
#define SHAPE_DECLARE_MESH(prefix)
#define SHAPE_DECLARE(KIND, prefix, STANDS_IN, FACES) \
    shape_end_function prefix##_end;                  \
    shape_plane_function prefix##_plane;              \
    shape_corners_function prefix##_corners;          \
    SHAPE_DECLARE_##FACES(prefix)
SHAPE_KINDS(SHAPE_DECLARE)
#undef SHAPE_DECLARE
#undef SHAPE_DECLARE_MESH
#undef SHAPE_DECLARE_WHOLE

/* A row; what its FACES lack is NULL. */
struct shape_row {
    unsigned stands_in;
    shape_end_function *end;
    shape_plane_function *plane;
    shape_corners_function *corners;
    shape_bounds_function *bounds;
    shape_crossings_function *crossings;
    shape_same_function *same;
    shape_near_triangle_function *near_triangle;
    shape_near_same_function *near_same;
    shape_place_function *place;
    shape_cover_function *cover;
    shape_fits_function *fits;
    shape_new_function *create;
};
extern const struct shape_row shape_rows[SHAPE_KIND_COUNT];

/* Of an instance: NULL is its mesh's triangles. */
static inline enum shape_kind shape_kind_of(const struct shape *shape) { return shape ? shape->kind : SHAPE_TRIANGLE; }

static inline int shape_same(const struct shape *a, const struct shape *b)
{
    return a == b || (a->kind == b->kind && shape_rows[a->kind].same(a, b));
}
