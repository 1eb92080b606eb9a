/* accel: which triangle a ray meets, by Embree. The only file that speaks Embree.
 *
 * A mesh that occurs once (or is small) is given in world space and lies in one BVH with
 * all others of its kind; a shared mesh gets a BVH of its own and instances of it. Each
 * BVH is built by one thread: that keeps the tree, and so the answer on exact ties, the
 * same whatever the machine's number of cores. The ISA is pinned when the device is made.
 * What moves while the shutter is open is given for several moments, evenly from its opening to
 * its closing; in between the vertices move along straight lines. A scene in which nothing moves
 * gets a BVH without a trace of motion.
 * Immutable after accel_new; any number of threads may query.
 */
#ifndef AZULEJO_RENDER_ACCEL_H
#define AZULEJO_RENDER_ACCEL_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/math/transform.h"
#include "common/math/vec.h"
#include "common/scene/settings.h"

struct accel;

struct ray {
    struct vec3 origin;
    struct vec3 direction; /* unit */
    float t_max;           /* metres; INFINITY for none */
    float time;            /* 0..1: from the shutter's opening to its closing */
};

/* What was met. Embree's own t, u, v are not handed on: they depend on the ISA; the caller
 * computes them again from the triangle (surface_from_hit). */
struct hit {
    uint32_t instance, triangle;
};

struct accel_mesh {
    const float *positions;   /* float[3], 16 readable bytes after the last */
    const uint32_t *indices;  /* uint32[3] */
    uint32_t vertex_count, triangle_count;
};

enum { ACCEL_STEPS_MAX = 129 /* Embree's own limit */ };

struct accel_instance {
    uint32_t mesh;
    const float *world_positions; /* not NULL: the mesh's vertices in world space, put straight
                                     into the top BVH; NULL: an instance of the mesh's BVH */
    struct transform to_world;
    int filtered;                 /* ask `accept` about every hit */
    uint32_t motion_steps;        /* 0: it stands still; else 2..ACCEL_STEPS_MAX, and one of these
                                     takes the place of the static field above: */
    const float *const *motion_positions;    /* with world_positions: [motion_steps] of them, each
                                                with 16 readable bytes after the last */
    const struct transform *motion_to_world; /* without: [motion_steps] */
};

/* Does the hit count? Called inside a traversal, possibly several times for one triangle:
 * must be a pure function of its arguments. `facing`: the ray meets the side from which the
 * (object-space) winding is counter-clockwise. */
typedef int accel_accept(const void *scene, const void *query, uint32_t instance,
                         uint32_t triangle, float u, float v, int facing);

struct accel_input {
    const struct accel_mesh *meshes;
    const struct accel_instance *instances;
    uint32_t mesh_count, instance_count;
    enum isa isa;
    accel_accept *accept;
    const void *scene;            /* handed to accept */
};

/* The input's arrays of positions and indices must outlive the accel; the tables need not.
 * ERR_UNSUPPORTED: the CPU lacks the ISA. ERR_NO_MEMORY. ERR_INTERNAL with Embree's words. */
status accel_new(struct accel **out, const struct accel_input *input, struct error *err) MUST_CHECK;
void accel_free(struct accel *accel);
size_t accel_bytes(const struct accel *accel); /* memory that Embree holds */

/* The nearest accepted hit; 0 when the ray escapes. `query` is handed to accept. */
int accel_intersect(const struct accel *accel, const struct ray *ray, const void *query,
                    struct hit *hit);

/* Is anything accepted between the origin and t_max? */
int accel_occluded(const struct accel *accel, const struct ray *ray, const void *query);

#endif
