/* accel: which triangle a ray meets, using Embree. Only accel*.c use Embree.
 *
 * A mesh that occurs once (or is small) is given in world space and lies in one BVH with all others of its kind. A
 * shared mesh gets its own BVH and instances of it. Each BVH is built by one thread: so the tree, and with it the
 * answer on exact ties, does not depend on the machine's number of cores. The ISA is pinned when the device is made.
 * What moves while the shutter is open is given at several moments, evenly spaced from its opening to its closing; in
 * between the vertices move along straight lines. The BVH of a scene without motion has no motion data.
 * Embree proposes, double decides (docs/NUMERICS.md). Where float could be wrong about whether a triangle is met (near
 * either end of the ray), the triangle is intersected again in double. Huge triangles, beside which the others are
 * tiny, always are.
 * Immutable after accel_new; any number of threads may query.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/math/transform.h"
#include "common/math/vec.h"
#include "common/scene/settings.h"

struct accel;
struct shape;

/* What was met: a mesh's triangle, or of a shape (shape/shape.h) the side. Embree's own t, u, v are not handed on: they depend on the ISA; the caller
 * computes them again from the triangle (surface_from_hit). */
struct hit {
    uint32_t instance, triangle;
};

enum { RAY_LEFT_MAX = 8 };

/* A ray starts exactly at its origin: there is no offset. It does not meet the faces that it
 * leaves, which it names, nor anything behind them as seen along the ray. If it ends on a face, it
 * does not meet that face nor anything behind it. */
struct ray {
    struct vec3 origin;                 /* metres, rounded to float */
    struct vec3 direction;              /* unit */
    real t_max;                         /* metres; INFINITY for none */
    real time;                          /* 0..1: from the shutter's opening to its closing */
    double rest[3];                     /* metres: the rounding error; the exact origin is origin + rest */
    uint32_t left_count;                /* 0: it starts in mid-air */
    int reaches;                        /* it ends on the face `end`; t_max is then only approximate */
    struct hit left[RAY_LEFT_MAX], end; /* the faces on which it starts, first the one it met */
    int contacts;                       /* also meet faces closer to left[0] than Embree's error, even
                              those that share no corner with it; slower */
    real inset;                         /* metres from the start to the edges of left[0]; a lower bound */
    real edge;                          /* metres: the longest edge of left[0]; 0: not known */
    struct vec3 off;                    /* unit: the normal of left[0], on the side to which the ray goes */
    struct vec3 came;                   /* unit: the direction of the ray that met left[0], and */
    real came_t;     /* metres: its length; Embree may have swapped what it met at its end. 0: what it
                              passed there counts (accel_decide.c) */
    real end_inset;  /* the same from the end to the edges of `end`; 0: none */
    real end_cosine; /* between the ray and the normal of `end`, positive */
};

/* A face that coincides with one that was met. */
struct contact {
    struct hit hit;
    double gap;  /* metres along the ray, from the face that was met; may be negative */
    int facing;  /* the ray meets the side of counter-clockwise winding (accel_accept) */
    int repeats; /* the same sheet as the face met or an earlier contact, at a shared
                              edge or vertex: to be left, but not crossed a second time */
};

/* How fine coordinates are: as floats are at a place, but no finer than at the same place in the scene's own
 * coordinates, which lie `origin` apart and in which its vertices were given. Where those are very coarse, because
 * of something far from all that is seen, they count only up to `reach` metres. 0 0 0 and 0: both are the same. */
struct accel_digits {
    double origin[3], reach;
};

struct accel_mesh {
    const float32 *positions; /* float[3], 16 readable bytes after the last */
    const uint32_t *indices;  /* uint32[3] */
    uint32_t vertex_count, triangle_count;
};

enum { ACCEL_STEPS_MAX = 129 /* Embree's own limit */ };

struct accel_instance {
    uint32_t mesh;
    const float32 *instance_positions; /* not NULL: the mesh's vertices in world space, placed in the
                                     top BVH; NULL: an instance of the mesh's BVH */
    struct transform to_world;
    int filtered;                            /* ask `accept` about every hit */
    uint32_t motion_steps;                   /* 0: no motion; else 2..ACCEL_STEPS_MAX, and one of the next two
                                     replaces the static field above: */
    const float32 *const *motion_positions;  /* with instance_positions: [motion_steps] of them, each
                                                with 16 readable bytes after the last */
    const struct transform *motion_to_world; /* without: [motion_steps] */
    const struct shape *shape;               /* not NULL: in place of the mesh, which has no triangles; coincides
                                     with no other face; outlives the accel */
    real shape_margin;                       /* metres: what Embree may be wrong about a ray's place near it */
};

/* Does the hit count? Called during traversal, possibly several times for one triangle: it must be
 * a pure function of its arguments. `query` NULL: would it count for every ray? `facing`: the ray meets
 * the side from which the (object-space) winding is counter-clockwise. */
typedef int accel_accept(const void *scene, const void *query, uint32_t instance, uint32_t triangle, real u, real v,
                         int facing);

/* The corners in world space at `time`. A corner shared by triangles is the same for all. */
typedef void accel_corners(const void *scene, uint32_t instance, uint32_t triangle, real time, double corner[3][3]);

struct accel_input {
    const struct accel_mesh *meshes;
    const struct accel_instance *instances;
    uint32_t mesh_count, instance_count;
    enum isa isa;
    accel_accept *accept;
    accel_corners *corners;
    const void *scene; /* passed to both callbacks */
    enum bvh_quality quality;
    int not_robust; /* 1: a ray may slip between triangles that share an edge */
    struct accel_digits digits;
    unsigned threads; /* may build; 0 is 1. Embree's trees are the same for any number */
};

/* The input's arrays of positions and indices must outlive the accel; the tables need not.
 * ERR_UNSUPPORTED: the CPU lacks the ISA. ERR_NO_MEMORY. ERR_INTERNAL with Embree's message. */
status accel_new(struct accel **out, const struct accel_input *input, struct error *err) MUST_CHECK;
void accel_free(struct accel *accel);
size_t accel_bytes(const struct accel *accel); /* memory that Embree holds */
/* Metres: Embree's error in the height over a plane, for a ray whose origin's largest coordinate and whose length
 * add up to `reach` metres. */
double accel_error(const struct accel *accel, double reach);

/* The nearest accepted hit; 0 if the ray escapes. `query` is passed to accept. */
int accel_intersect(const struct accel *accel, const struct ray *ray, const void *query, struct hit *hit);

/* Embree may swap faces that are closer together than its error. Find the first, in double, of the faces around the hit
 * that the ray met after `t` metres. 1: that is another face. `in_contact`: faces that coincide with the hit are
 * crossed together with it (accel_coincident), so they keep their order. */
int accel_refine(const struct accel *accel, const struct ray *ray, const void *query, double t, int in_contact,
                 struct hit *hit);

/* Is anything accepted between the origin and t_max? */
int accel_occluded(const struct accel *accel, const struct ray *ray, const void *query);

/* accel_intersect and accel_occluded for a ray that starts inside a closed mesh and for which those
 * found nothing. It slipped through at a vertex, where rounding can leave a gap that no triangle
 * covers. These search close beside the ray, and believe only what Embree may have missed: a ray
 * through a small hole still escapes. The result depends only on the ray. */
int accel_intersect_enclosed(const struct accel *accel, const struct ray *ray, const void *query, struct hit *hit);
int accel_occluded_enclosed(const struct accel *accel, const struct ray *ray, const void *query);

/* A ray crosses faces closer than this as one event: floats cannot separate them. In units of 2^-23
 * of the position's largest coordinate (struct accel_digits). */
enum { ACCEL_COINCIDENT_ULPS = 8 };

/* The distance, along their normal, below which faces at `place` coincide, metres. */
double accel_gap(const struct accel_digits *digits, const double place[3]);

/* Every accepted face within this distance of the face `hit` at `place` (double, on that face), measured along its
 * normal. Only direction and time of `ray` count. Sorted by the gap along the ray, equal gaps by name; `hit` itself is
 * left out. Returns how many were found; the first `capacity` of them are in `out`. */
uint32_t accel_coincident(const struct accel *accel, const struct ray *ray, const struct hit *hit,
                          const double place[3], const void *query, struct contact *out, uint32_t capacity);
