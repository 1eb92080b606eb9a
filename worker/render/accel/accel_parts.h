/* accel_parts: what accel.c (builds), accel_query.c (asks), accel_huge.c (huge triangles) and
 * accel_decide.c (checks in double) share. Private to them.
 */
#pragma once

#if AZULEJO_EMBREE >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <stdatomic.h>

#include "common/base/safeguard.h"
#include "worker/render/base/exact.h"
#include "worker/render/accel/sizes.h"
#include "worker/render/shape/shape.h"

/* A face on which the ray ends is searched up to this share of the length before and behind. */
#define ACCEL_END_SHARE 0x1p-18

/* One of the top BVH's geometries: an instance. (128 bytes: found by a shift.) */
struct accel_geometry {
    const uint8_t *slender; /* of its triangles (sizes.h), NULL: all are ordinary */
    double slenderest;      /* at most: the square of longest edge / height */
    uint8_t filtered;       /* accept is to be asked */
    uint8_t in_world;       /* its triangles lie in the top BVH */
    real shape_margin;      /* metres (struct accel_instance) */
    double to_object[3][3]; /* else, of what stands still: the inverse matrix's part for directions */
    real least_stretch;     /* of its matrix; 1 in world space */
    uint32_t motion_steps;
    const struct shape *shape;         /* NULL: triangles */
    double error_origin, error_extent; /* as the accel's, for rays that meet its triangles */
};

/* Up to so many shapes are looked at before Embree, one by one: it goes no farther than the nearest, and has
 * no second tree to go through. */
enum { ACCEL_FEW_SHAPES = 2 };

struct accel {
    RTCDevice device;
    RTCScene top;
    RTCScene *mesh_scenes;  /* per mesh; NULL where it lies in the top BVH */
    uint8_t **mesh_slender; /* per mesh with a BVH of its own */
    double *mesh_slenderest;
    uint8_t *mesh_filtered; /* per mesh: accept is to be called for an instance of it */
    uint32_t mesh_count, geometry_count;
    struct accel_geometry *geometries;
    struct {
        int are_few; /* else Embree has them */
        uint32_t count, geometry[ACCEL_FEW_SHAPES];
    } few_shapes;
    struct sizes sizes;
    void **owned; /* [owned_count] indices without the huge triangles, and the like */
    size_t owned_count, owned_capacity;
    uint32_t huge_next;                /* while instances are attached: the first of the next one */
    double error_origin, error_extent; /* error = these * (largest coordinate, 1 metre) */
    accel_accept *accept;
    accel_corners *corners;
    const void *scene;
    struct accel_digits digits;
    _Atomic(ptrdiff_t) bytes;
};

enum query_kind { QUERY_NEAREST, QUERY_OCCLUDED, QUERY_COINCIDENT };

/* Embree passes the context back to the callbacks; ours carries the query along. */
struct query_context {
#if AZULEJO_EMBREE >= 4
    struct RTCRayQueryContext embree;
#else
    struct RTCIntersectContext embree;
#endif
    const struct accel *accel;
    const void *query;
    const struct ray *ray;
    enum query_kind kind;
    int careful; /* Embree hands every proposal to accel_filter */
    double origin[3], direction[3];
    double largest;              /* coordinate of the origin */
    double error;                /* metres: Embree's error in the height over a plane, */
    double error_left;           /* and over planes of the instance that the ray leaves */
    double start[3];             /* of Embree's ray */
    int at_edge;                 /* so near to its face's edges that Embree's ray starts */
    double inside[3];            /* farther inside the face, here; */
    struct vec3 aim;             /* unit: Embree's direction, and */
    double length;               /* metres: how far from there the ray's end is */
    double blur;                 /* metres: Embree's error when the face that is left was met */
    double aside;                /* metres: how far Embree's ray is beside the ray */
    int doubt;                   /* then: a proposed neighbour lies behind the ray */
    double back;                 /* metres by which Embree's ray starts before the ray */
    double t_max;                /* metres: of Embree's ray */
    double near_start, near_end; /* metres: this close to its ends double always decides, */
    double off_cosine, clear;    /* and until it is this far off the plane that it leaves, to which
                                     this is its cosine */
    int reaches;                 /* faces near the ray's end are checked, too */
    int met;                     /* the nearest hit that double decided: */
    struct hit nearest;
    double nearest_t;
    uint32_t attempt;         /* how often Embree found nothing for a ray that cannot escape */
    double gap_max;           /* QUERY_COINCIDENT: metres, */
    const struct hit *about;  /* the face that the others coincide with, */
    struct contact *contacts; /* and the faces found */
    uint32_t contact_count, contact_capacity;
};

/* ---- what Embree calls -------------------------------------------------------------------- */

/* accel_query.c. For careful queries, and for queries that any hit ends; the third only calls
 * `accept`. */
void accel_filter(const struct RTCFilterFunctionNArguments *args);
void accel_filter_accepted(const struct RTCFilterFunctionNArguments *args);

/* accel_huge.c: triangles that are always intersected in double. */
void accel_huge_bounds(const struct RTCBoundsFunctionArguments *args);
void accel_huge_intersect(const struct RTCIntersectFunctionNArguments *args);
void accel_huge_occluded(const struct RTCOccludedFunctionNArguments *args);

/* accel_shape.c: give Embree the shape of an instance. */
RTCGeometry accel_shape_geometry(RTCDevice device, struct accel_geometry *g);
/* The few shapes: end the ray behind the nearest that it meets; does it meet any? */
void accel_shapes_intersect(struct query_context *q, struct RTCRay *ray);
int accel_shapes_occlude(struct query_context *q);

/* ---- accel_decide.c ----------------------------------------------------------------------- */

static inline int accel_same_face(const struct hit *a, const struct hit *b)
{
    return a->instance == b->instance && a->triangle == b->triangle;
}

/* The face is one on which the ray starts or ends, or the one that others are compared with. */
static inline int accel_is_excepted(const struct query_context *q, const struct hit *face)
{
    const struct ray *ray = q->ray;

    if (!SAFEGUARD(LEFT_BY_NAME))
        return 0;
    for (uint32_t i = 0; i < ray->left_count; i++)
        if (accel_same_face(&ray->left[i], face))
            return 1;
    return (ray->reaches && accel_same_face(&ray->end, face)) || (q->about && accel_same_face(q->about, face));
}

/* Does the ray meet the triangle's plane between its ends, with the triangle not beyond them?
 * *t in metres. Only the plane counts: the caller has checked the triangle's edges. */
int accel_decide(struct query_context *q, const struct hit *face, double *t);

/* Where the ray ends, in metres. */
double accel_ray_end(const struct query_context *q);

/* A triangle that is met in double: 1 if the traversal may take it as Embree's hit. */
int accel_keep(struct query_context *q, const struct hit *face, double t, int facing);

/* Does the triangle contain the point where the line meets its plane? Weights of corners 1 and 2. The test extends past
 * the edges by the possible error of Embree's triangles beside it, so that no ray slips through between. */
int accel_covers(const struct query_context *q, const struct hit *face, double *u, double *v, int *facing);

/* Does the line pass the triangle's outline, as seen along the line, within Embree's error? Where not,
 * Embree was right if it did not propose the triangle. */
int accel_may_miss(const struct query_context *q, const struct hit *face);

/* QUERY_COINCIDENT: mark the contacts found that are one sheet with another. */
void accel_mark_repeats(const struct query_context *q);
