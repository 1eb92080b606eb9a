#include "worker/render/accel.h"

#if AZULEJO_EMBREE >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/exact.h"
#include "worker/render/render.h"
#include "worker/render/sizes.h"

/* Embree's error in a ray's height over a triangle's plane, in 2^-24 of the largest coordinate of
 * its origin plus the longest edge: its own, and what a ray's way through an instance's matrix adds,
 * at rest and where Embree mixes two matrices and inverts the mix. docs/NUMERICS.md derives them. */
#define ERROR_TRIANGLE 8.0
#define ERROR_INSTANCE 16.0
#define ERROR_MOVING 32.0
/* So many such errors before its start a ray starts for Embree, or a triangle right before it
 * could seem to lie behind. */
#define BACK_ERRORS 64.0
/* Farther than this from the edges of the one face that it leaves, a ray may start off it. */
#define INSET_ERRORS 64.0
/* A face on which the ray ends is looked for up to this share of the length before and behind. */
#define END_SHARE 0x1p-18

/* One of the top BVH's geometries: an instance. */
struct accel_geometry {
    const uint8_t *slender;  /* of its triangles (sizes.h), NULL: all are ordinary */
    uint8_t slenderest;
    uint8_t filtered;        /* accept is to be asked */
    float least_stretch;     /* of its matrix; 1 in world space */
    uint32_t motion_steps;
    double error_origin, error_extent; /* as the accel's, for rays that meet its triangles */
};

struct accel {
    RTCDevice device;
    RTCScene top;
    RTCScene *mesh_scenes;        /* per mesh; NULL where it lies in the top BVH */
    uint8_t **mesh_slender, *mesh_slenderest; /* per mesh with a BVH of its own */
    uint32_t mesh_count, geometry_count;
    struct accel_geometry *geometries;
    struct sizes sizes;
    void **owned;                 /* [owned_count] indices without the huge triangles, and the like */
    size_t owned_count, owned_capacity;
    uint32_t huge_next;           /* while instances are attached: the next one's first */
    double error_origin, error_extent; /* error = these * (largest coordinate, 1 metre) */
    accel_accept *accept;
    accel_corners *corners;
    const void *scene;
    _Atomic(ptrdiff_t) bytes;
};

enum query_kind { QUERY_NEAREST, QUERY_OCCLUDED, QUERY_COINCIDENT };

/* Embree hands the context back to the callbacks; ours carries the query along. */
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
    double origin[3], direction[3];
    double error;                 /* metres: Embree's, in the height over a plane; */
    double error_left;            /* over those of the instance that the ray leaves */
    double start[3];              /* of Embree's ray */
    int at_edge;                  /* the ray starts so near to its face's edges that Embree's starts */
    double inside[3];             /* farther inside the face: here; */
    int doubt;                    /* then a neighbour was proposed that lies behind the ray */
    double back;                  /* metres: by which that starts before the ray */
    double t_max;                 /* metres: of Embree's ray */
    double near_start, near_end;  /* metres: so far from its ends double decides anyway */
    int reaches;                  /* what is near the ray's end is to be looked at, too */
    int met;                      /* of what double decided, the nearest: */
    struct hit nearest;
    double nearest_t;
    double gap_max;               /* QUERY_COINCIDENT: metres, */
    const struct hit *about;      /* the face that the others coincide with, */
    struct contact *contacts;     /* and what was found */
    uint32_t contact_count, contact_capacity;
};

const char *render_kernel_name(void)
{
    static const char name[] = "azulejo " AZULEJO_VERSION " embree " RTC_VERSION_STRING
#if defined(__x86_64__)
                               " x86_64";
#else
                               " other";
#endif
    return name;
}

static bool count_memory(void *user, ssize_t bytes, bool post)
{
    struct accel *accel = user;

    (void)post;
    atomic_fetch_add(&accel->bytes, bytes);
    return true;
}

/* ---- what double decides ------------------------------------------------------------------ */

static int same_face(const struct hit *a, const struct hit *b)
{
    return a->instance == b->instance && a->triangle == b->triangle;
}

/* The ray starts on the face, or ends on it. */
static int is_excepted(const struct ray *ray, const struct hit *face)
{
    for (uint32_t i = 0; i < ray->left_count; i++)
        if (same_face(&ray->left[i], face))
            return 1;
    return ray->reaches && same_face(&ray->end, face);
}

static double largest(const double a[3])
{
    return fmax(fabs(a[0]), fmax(fabs(a[1]), fabs(a[2])));
}

/* What rounding may make of a height over a plane through `from`, times the normal's length. */
static double height_noise(const double normal[3], const double to[3], const double from[3])
{
    return 0x1p-49 * (fabs(normal[0]) + fabs(normal[1]) + fabs(normal[2])) *
           (largest(to) + largest(from));
}

/* The corner's height over the plane that is farthest from it, times the normal's length. */
static double farthest(const double corner[3][3], const double plane[3][3], const double normal[3],
                       double sign)
{
    double most = -INFINITY, to_corner[3];

    for (int k = 0; k < 3; k++) {
        double height;

        exact_sub(corner[k], plane[0], to_corner);
        height = sign * exact_dot(normal, to_corner);
        if (height > height_noise(normal, to_corner, plane[0]))
            most = fmax(most, height);
    }
    return most;
}

/* Is all of the triangle behind the plane of a face that the ray leaves (`sign` 1), or beyond the
 * plane of the one that it ends on (-1)? Then the ray cannot meet it, whatever the rounding. */
static int is_beyond(const struct query_context *q, const struct hit *face, double sign,
                     const double corner[3][3])
{
    double plane[3][3], n[3], towards[3];

    /* A direction along the plane may be off by its rounding: the ray says to which side it goes. */
    exact_vec(sign > 0 ? q->ray->off : q->ray->direction, towards);

    q->accel->corners(q->accel->scene, face->instance, face->triangle, q->ray->time, plane);
    exact_normal(plane, n);
    if (exact_dot(n, n) == 0)
        return 0;
    if (exact_dot(n, towards) < 0)
        sign = -sign;
    return !(farthest(corner, plane, n, sign) > 0);
}

/* A ray that starts on a triangle's plane, as on an edge that it shares with the face it leaves,
 * starts on the side on which that face lies: does it go to the other? */
static int goes_through(const struct query_context *q, const double corner[3][3],
                        const double normal[3])
{
    double face[3][3], before, behind;

    q->accel->corners(q->accel->scene, q->ray->left[0].instance, q->ray->left[0].triangle,
                      q->ray->time, face);
    before = farthest(face, corner, normal, 1);
    behind = farthest(face, corner, normal, -1);
    return before > behind ? exact_dot(normal, q->direction) < 0
                           : exact_dot(normal, q->direction) > 0;
}

/* Where the ray ends, in metres. */
static double ray_end(const struct query_context *q)
{
    double corner[3][3], n[3], end;

    if (!q->ray->reaches)
        return (double)q->ray->t_max;
    q->accel->corners(q->accel->scene, q->ray->end.instance, q->ray->end.triangle, q->ray->time,
                      corner);
    exact_normal(corner, n);
    end = exact_crossing(corner, n, q->origin, q->direction);
    return end > 0 && end < INFINITY ? end : (double)q->ray->t_max;
}

/* Does the ray meet the triangle's plane between its ends, and the triangle not lie beyond them?
 * *t in metres. The plane alone counts: whoever proposed the triangle has seen to its edges. */
static int decide(struct query_context *q, const struct hit *face, double *t)
{
    double corner[3][3], n[3], to_corner[3], height;

    q->accel->corners(q->accel->scene, face->instance, face->triangle, q->ray->time, corner);
    exact_normal(corner, n);
    exact_sub(corner[0], q->origin, to_corner);
    height = exact_dot(n, to_corner);
    *t = height / exact_dot(n, q->direction);
    if (q->kind == QUERY_COINCIDENT)
        return fabs(*t) < q->gap_max;
    if (q->ray->left_count && fabs(height) <= height_noise(n, to_corner, q->origin)) {
        *t = goes_through(q, corner, n) ? 0 : -1;
    } else if (!(*t < ray_end(q))) {
        return 0;
    }
    for (uint32_t i = 0; i < q->ray->left_count; i++)
        if (is_beyond(q, &q->ray->left[i], 1, corner))
            return 0;
    if (!(*t >= 0)) {
        q->doubt = q->at_edge;
        return 0;
    }
    return !q->ray->reaches || !is_beyond(q, &q->ray->end, -1, corner);
}

static int comes_first(double t, const struct hit *a, double u, const struct hit *b)
{
    if (t != u)
        return t < u;
    return a->instance != b->instance ? a->instance < b->instance : a->triangle < b->triangle;
}

static void keep_contact(struct query_context *q, const struct hit *face, double gap, int facing)
{
    struct contact *list = q->contacts;
    uint32_t at = q->contact_count < q->contact_capacity ? q->contact_count : q->contact_capacity;

    q->contact_count++;
    while (at > 0 && comes_first(gap, face, list[at - 1].gap, &list[at - 1].hit)) {
        if (at < q->contact_capacity)
            list[at] = list[at - 1];
        at--;
    }
    if (at < q->contact_capacity)
        list[at] = (struct contact){*face, gap, facing, 0};
}

/* A triangle that double found to be met: 1 where the traversal may count it as Embree's hit. */
static int keep(struct query_context *q, const struct hit *face, double t, int facing)
{
    if (q->kind == QUERY_OCCLUDED)
        return 1;
    if (q->kind == QUERY_COINCIDENT) {
        keep_contact(q, face, t, facing);
    } else if (!q->met || comes_first(t, face, q->nearest_t, &q->nearest)) {
        q->met = 1;
        q->nearest = *face;
        q->nearest_t = t;
    }
    return 0;
}

/* ---- Embree's proposals ------------------------------------------------------------------- */

/* Is the plane so near to an end of the ray that float may be wrong about its side? `t`: metres by
 * Embree. The hit's normal and the ray are in the instance's space, where products are alike. */
static int is_near(const struct query_context *q, const struct RTCRay *ray,
                   const struct RTCHit *hit, const struct accel_geometry *g, double t)
{
    double reach = t, product, area2, height2, error2;

    if (!(t > q->near_start))
        return 1;
    if (q->reaches) {
        reach = fmin(t, (double)q->ray->t_max - t);
        if (!(reach > q->near_end))
            return 1;
    }
    product = (double)ray->dir_x * (double)hit->Ng_x + (double)ray->dir_y * (double)hit->Ng_y +
              (double)ray->dir_z * (double)hit->Ng_z;
    area2 = (double)hit->Ng_x * (double)hit->Ng_x + (double)hit->Ng_y * (double)hit->Ng_y +
            (double)hit->Ng_z * (double)hit->Ng_z;
    height2 = reach * product * (double)g->least_stretch;
    height2 *= height2;
    error2 = q->error * q->error * area2;
    if (height2 > error2 * (double)(UINT64_C(1) << 2 * g->slenderest))
        return 0;
    return !g->slender || g->slender[hit->primID] == SIZES_SLENDER_MAX ||
           !(height2 > error2 * (double)(UINT64_C(1) << 2 * g->slender[hit->primID]));
}

static void filter(const struct RTCFilterFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    const struct RTCRay *ray = (const struct RTCRay *)args->ray; /* N is 1: single rays only */
    const struct RTCHit *hit = (const struct RTCHit *)args->hit;
    struct hit face = {hit->instID[0] != RTC_INVALID_GEOMETRY_ID ? hit->instID[0] : hit->geomID,
                       hit->primID};
    const struct accel_geometry *g = &q->accel->geometries[face.instance];
    double t = (double)ray->tfar - q->back;
    int near, facing;

    if (args->valid[0] != -1)
        return;
    args->valid[0] = 0;
    if (is_excepted(q->ray, &face) || (q->about && same_face(q->about, &face)))
        return;
    near = q->kind == QUERY_COINCIDENT || is_near(q, ray, hit, g, t);
    if (near && !decide(q, &face, &t))
        return;
    facing = ray->dir_x * hit->Ng_x + ray->dir_y * hit->Ng_y + ray->dir_z * hit->Ng_z < 0;
    if (g->filtered && !q->accel->accept(q->accel->scene, q->query, face.instance, face.triangle,
                                         hit->u, hit->v, facing))
        return;
    if (!near || keep(q, &face, t, facing))
        args->valid[0] = -1;
}

/* ---- huge triangles ----------------------------------------------------------------------- */

static void huge_bounds(const struct RTCBoundsFunctionArguments *args)
{
    const struct accel *accel = args->geometryUserPtr;
    const struct hit *face = &accel->sizes.huge[args->primID];
    uint32_t steps = accel->geometries[face->instance].motion_steps;
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    for (uint32_t i = 0; i < (steps ? steps : 1); i++) {
        double corner[3][3];

        accel->corners(accel->scene, face->instance, face->triangle,
                       steps ? (float)i / (float)(steps - 1) : 0, corner);
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++) {
                low[a] = fminf(low[a], nextafterf((float)corner[k][a], -INFINITY));
                high[a] = fmaxf(high[a], nextafterf((float)corner[k][a], INFINITY));
            }
    }
    *args->bounds_o = (struct RTCBounds){.lower_x = low[0], .lower_y = low[1], .lower_z = low[2],
                                         .upper_x = high[0], .upper_y = high[1],
                                         .upper_z = high[2]};
}

/* Weights of corners 1 and 2 where the line meets the triangle. It reaches over its edges by as
 * much as Embree's triangles beside it may be off, so that no ray slips through between. */
static int huge_covers(const struct query_context *q, const struct hit *face, double *u, double *v,
                       int *facing)
{
    double corner[3][3], e1[3], e2[3], e3[3], n[3], p[3], s[3], m[3], determinant, size, slack;

    q->accel->corners(q->accel->scene, face->instance, face->triangle, q->ray->time, corner);
    exact_sub(corner[1], corner[0], e1);
    exact_sub(corner[2], corner[0], e2);
    exact_sub(corner[2], corner[1], e3);
    exact_sub(q->origin, corner[0], s);
    exact_cross(e1, e2, n);
    exact_cross(q->direction, e2, p);
    exact_cross(s, e1, m);
    determinant = exact_dot(e1, p);
    size = sqrt(exact_dot(n, n));
    if (determinant == 0 || !(size > 0))
        return 0;
    *u = exact_dot(s, p) / determinant;
    *v = exact_dot(q->direction, m) / determinant;
    *facing = determinant > 0;
    slack = q->error + 0x1p-22 * fabs(exact_dot(e2, m) / determinant);
    return *u >= -slack * sqrt(exact_dot(e2, e2)) / size &&
           *v >= -slack * sqrt(exact_dot(e1, e1)) / size &&
           1 - *u - *v >= -slack * sqrt(exact_dot(e3, e3)) / size;
}

/* Met? Then *t in metres. */
static int huge_meets(struct query_context *q, const struct hit *face, double *t)
{
    double u, v;
    int facing;

    if (is_excepted(q->ray, face) || (q->about && same_face(q->about, face)) || !huge_covers(q, face, &u, &v, &facing) || !decide(q, face, t))
        return 0;
    if (q->accel->geometries[face->instance].filtered &&
        !q->accel->accept(q->accel->scene, q->query, face->instance, face->triangle, (float)u,
                          (float)v, facing))
        return 0;
    if (q->kind != QUERY_OCCLUDED)
        keep(q, face, *t, facing);
    return 1;
}

static void huge_intersect(const struct RTCIntersectFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    struct RTCRay *ray = &((struct RTCRayHit *)args->rayhit)->ray;
    double t;

    if (args->valid[0] != -1 || !huge_meets(q, &q->accel->sizes.huge[args->primID], &t) ||
        q->kind == QUERY_COINCIDENT)
        return;
    /* What lies behind need not be looked at. */
    ray->tfar = fminf(ray->tfar, (float)((t + q->back) * (1 + END_SHARE)));
}

static void huge_occluded(const struct RTCOccludedFunctionNArguments *args)
{
    struct query_context *q = (struct query_context *)args->context;
    struct RTCRay *ray = (struct RTCRay *)args->ray;
    double t;

    if (args->valid[0] == -1 && huge_meets(q, &q->accel->sizes.huge[args->primID], &t))
        ray->tfar = -INFINITY;
}

static status embree_failed(RTCDevice device, const char *what, struct error *err)
{
    enum RTCError code = rtcGetDeviceError(device);

    if (code == RTC_ERROR_OUT_OF_MEMORY)
        return error_no_memory(err, what);
    if (code == RTC_ERROR_UNSUPPORTED_CPU)
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "%s: Embree does not run on this CPU with the instruction set asked for",
                         what);
    return error_set(err, STATUS_ERR_INTERNAL, "%s: Embree error %d", what, (int)code);
}

/* `positions` has one entry for each moment; one alone stands still. */
static void set_triangles(RTCGeometry geometry, const float *const *positions, uint32_t steps,
                          const struct accel_mesh *mesh, const uint32_t *indices)
{
    if (steps > 1)
        rtcSetGeometryTimeStepCount(geometry, steps);
    for (uint32_t i = 0; i < steps; i++)
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, i, RTC_FORMAT_FLOAT3,
                                   positions[i], 0, 3 * sizeof(float), mesh->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, indices, 0,
                               3 * sizeof(uint32_t), mesh->triangle_count);
    rtcSetGeometryIntersectFilterFunction(geometry, filter);
    rtcSetGeometryOccludedFilterFunction(geometry, filter);
    rtcCommitGeometry(geometry);
}

static RTCScene new_scene(RTCDevice device)
{
    RTCScene scene = rtcNewScene(device);

    if (scene) {
        rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    }
    return scene;
}

static status build_shared_mesh(struct accel *accel, const struct accel_input *in, uint32_t mesh,
                                struct error *err)
{
    RTCGeometry geometry;
    status s = sizes_slender(in->meshes[mesh].positions, &in->meshes[mesh],
                             &accel->mesh_slender[mesh], &accel->mesh_slenderest[mesh], err);

    if (s != STATUS_OK)
        return s;
    accel->mesh_scenes[mesh] = new_scene(accel->device);
    geometry = rtcNewGeometry(accel->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!accel->mesh_scenes[mesh] || !geometry) {
        if (geometry)
            rtcReleaseGeometry(geometry);
        return embree_failed(accel->device, "a mesh's geometry", err);
    }
    set_triangles(geometry, &in->meshes[mesh].positions, 1, &in->meshes[mesh],
                  in->meshes[mesh].indices);
    rtcAttachGeometryByID(accel->mesh_scenes[mesh], geometry, 0);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(accel->mesh_scenes[mesh]);
    if (rtcGetDeviceError(accel->device) != RTC_ERROR_NONE)
        return error_no_memory(err, "the BVH of a mesh");
    return STATUS_OK;
}

static void set_transforms(RTCGeometry geometry, const struct accel_instance *instance)
{
    if (instance->motion_steps == 0) {
        rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, instance->to_world.m);
        return;
    }
    rtcSetGeometryTimeStepCount(geometry, instance->motion_steps);
    for (uint32_t i = 0; i < instance->motion_steps; i++)
        rtcSetGeometryTransform(geometry, i, RTC_FORMAT_FLOAT3X4_ROW_MAJOR,
                                instance->motion_to_world[i].m);
}

static status own(struct accel *accel, void *block, struct error *err)
{
    if (!block || !MEM_GROW(accel->owned, accel->owned_capacity, accel->owned_count + 1)) {
        mem_free(block);
        return error_no_memory(err, "the ray accelerator");
    }
    accel->owned[accel->owned_count++] = block;
    return STATUS_OK;
}

/* The mesh's triangles, of which Embree gets those of `instance` that are not huge: the others
 * become points. */
static status choose_indices(struct accel *accel, const struct accel_mesh *mesh, uint32_t instance,
                             const uint32_t **indices, struct error *err)
{
    uint32_t *chosen = NULL;
    status s;

    *indices = mesh->indices;
    for (; accel->huge_next < accel->sizes.huge_count; accel->huge_next++) {
        const struct hit *huge = &accel->sizes.huge[accel->huge_next];

        if (huge->instance != instance)
            break;
        if (!chosen) {
            chosen = mem_memdup(mesh->indices, 3 * (size_t)mesh->triangle_count * sizeof *chosen);
            s = own(accel, chosen, err);
            if (s != STATUS_OK)
                return s;
            *indices = chosen;
        }
        chosen[3 * (size_t)huge->triangle + 1] = chosen[3 * (size_t)huge->triangle + 2] =
            chosen[3 * (size_t)huge->triangle];
    }
    return STATUS_OK;
}

/* Where two matrices are mixed, the mix is at most half their difference from one of them. */
static float least_stretch(const struct accel_instance *instance)
{
    double least, difference = 0;

    if (!instance->motion_steps)
        return (float)sizes_least_stretch(&instance->to_world);
    least = sizes_least_stretch(&instance->motion_to_world[0]);
    for (uint32_t i = 1; i < instance->motion_steps; i++) {
        const struct transform *a = &instance->motion_to_world[i - 1], *b = a + 1;
        double square = 0;

        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {
                double d = (double)b->m[r][c] - (double)a->m[r][c];
                square += d * d;
            }
        difference = fmax(difference, sqrt(square));
        least = fmin(least, sizes_least_stretch(b));
    }
    return (float)fmax(least - 0.5 * difference, 0);
}

static status set_world_triangles(struct accel *accel, const struct accel_input *in, uint32_t index,
                                  RTCGeometry geometry, struct error *err)
{
    const struct accel_instance *instance = &in->instances[index];
    const struct accel_mesh *mesh = &in->meshes[instance->mesh];
    struct accel_geometry *g = &accel->geometries[index];
    const uint32_t *indices;
    uint8_t *slender;
    status s = sizes_slender(instance->world_positions, mesh, &slender, &g->slenderest, err);

    g->slender = slender;
    if (s == STATUS_OK && slender)
        s = own(accel, slender, err);
    if (s == STATUS_OK)
        s = choose_indices(accel, mesh, index, &indices, err);
    if (s == STATUS_OK)
        set_triangles(geometry,
                      instance->motion_steps ? instance->motion_positions
                                             : &instance->world_positions,
                      instance->motion_steps ? instance->motion_steps : 1, mesh, indices);
    return s;
}

static status attach_instance(struct accel *accel, const struct accel_input *in, uint32_t index,
                              struct error *err)
{
    const struct accel_instance *instance = &in->instances[index];
    struct accel_geometry *g = &accel->geometries[index];
    int in_world = instance->world_positions != NULL;
    RTCGeometry geometry = rtcNewGeometry(
        accel->device, in_world ? RTC_GEOMETRY_TYPE_TRIANGLE : RTC_GEOMETRY_TYPE_INSTANCE);
    status s = STATUS_OK;

    if (!geometry)
        return embree_failed(accel->device, "an instance", err);
    g->filtered = instance->filtered != 0;
    g->least_stretch = 1;
    g->motion_steps = instance->motion_steps;
    if (in_world) {
        s = set_world_triangles(accel, in, index, geometry, err);
    } else {
        g->slender = accel->mesh_slender[instance->mesh];
        g->slenderest = accel->mesh_slenderest[instance->mesh];
        g->least_stretch = least_stretch(instance);
        rtcSetGeometryInstancedScene(geometry, accel->mesh_scenes[instance->mesh]);
        set_transforms(geometry, instance);
        rtcCommitGeometry(geometry);
    }
    if (s == STATUS_OK)
        rtcAttachGeometryByID(accel->top, geometry, index);
    rtcReleaseGeometry(geometry);
    return s;
}

/* The huge triangles, behind the instances. */
static status attach_huge(struct accel *accel, struct error *err)
{
    RTCGeometry geometry;

    if (accel->sizes.huge_count == 0)
        return STATUS_OK;
    geometry = rtcNewGeometry(accel->device, RTC_GEOMETRY_TYPE_USER);
    if (!geometry)
        return embree_failed(accel->device, "the huge triangles", err);
    rtcSetGeometryUserPrimitiveCount(geometry, accel->sizes.huge_count);
    rtcSetGeometryUserData(geometry, accel);
    rtcSetGeometryBoundsFunction(geometry, huge_bounds, NULL);
    rtcSetGeometryIntersectFunction(geometry, huge_intersect);
    rtcSetGeometryOccludedFunction(geometry, huge_occluded);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(accel->top, geometry, accel->geometry_count);
    rtcReleaseGeometry(geometry);
    return STATUS_OK;
}

/* How wrong Embree can be, at each instance and at all of them. */
static void bound_errors(struct accel *accel, const struct accel_input *in)
{
    for (uint32_t i = 0; i < in->instance_count; i++) {
        const struct accel_instance *instance = &in->instances[i];
        struct accel_geometry *g = &accel->geometries[i];
        double condition = 1, origin = ERROR_TRIANGLE;

        if (!instance->world_positions) {
            condition = instance->motion_steps ? 1 : sizes_condition(&instance->to_world);
            for (uint32_t k = 0; k < instance->motion_steps; k++)
                condition = fmax(condition, sizes_condition(&instance->motion_to_world[k]));
            origin += condition * (instance->motion_steps ? ERROR_MOVING : ERROR_INSTANCE);
        }
        g->error_origin = 0x1p-24 * origin;
        g->error_extent = g->error_origin * accel->sizes.longest[i];
        accel->error_origin = fmax(accel->error_origin, g->error_origin);
        accel->error_extent = fmax(accel->error_extent, g->error_extent);
    }
}

status accel_new(struct accel **out, const struct accel_input *in, struct error *err)
{
    struct accel *accel;
    char config[96];
    status result = STATUS_OK;

    *out = NULL;
    if (!(isa_supported_mask() >> in->isa & 1))
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "this CPU lacks the instruction set %s that the job pins",
                         isa_name(in->isa));
    accel = mem_calloc(1, sizeof *accel);
    if (!accel)
        return error_no_memory(err, "the ray accelerator");
    accel->accept = in->accept;
    accel->corners = in->corners;
    accel->scene = in->scene;
    accel->mesh_count = in->mesh_count;
    accel->geometry_count = in->instance_count;
    snprintf(config, sizeof config, "isa=%s,threads=1,set_affinity=0",
             in->isa == ISA_AVX512 ? "avx512" : in->isa == ISA_AVX2 ? "avx2" : "sse2");
    accel->device = rtcNewDevice(config);
    if (!accel->device) {
        result = embree_failed(NULL, "Embree's device", err);
        goto failed;
    }
    rtcSetDeviceMemoryMonitorFunction(accel->device, count_memory, accel);
    accel->mesh_scenes = mem_calloc(in->mesh_count, sizeof *accel->mesh_scenes);
    accel->mesh_slender = mem_calloc(in->mesh_count, sizeof *accel->mesh_slender);
    accel->mesh_slenderest = mem_calloc(in->mesh_count, 1);
    accel->geometries = mem_calloc(in->instance_count, sizeof *accel->geometries);
    if (!accel->mesh_scenes || !accel->mesh_slender || !accel->mesh_slenderest ||
        !accel->geometries) {
        result = error_no_memory(err, "the ray accelerator");
        goto failed;
    }
    result = sizes_init(&accel->sizes, in, err);
    if (result != STATUS_OK)
        goto failed;
    bound_errors(accel, in);
    accel->top = new_scene(accel->device);
    if (!accel->top) {
        result = embree_failed(accel->device, "Embree's scene", err);
        goto failed;
    }
    for (uint32_t i = 0; i < in->instance_count; i++) {
        uint32_t mesh = in->instances[i].mesh;
        if (!in->instances[i].world_positions && !accel->mesh_scenes[mesh]) {
            result = build_shared_mesh(accel, in, mesh, err);
            if (result != STATUS_OK)
                goto failed;
        }
        result = attach_instance(accel, in, i, err);
        if (result != STATUS_OK)
            goto failed;
    }
    result = attach_huge(accel, err);
    if (result != STATUS_OK)
        goto failed;
    rtcCommitScene(accel->top);
    if (rtcGetDeviceError(accel->device) != RTC_ERROR_NONE) {
        result = error_no_memory(err, "the BVH of the scene");
        goto failed;
    }
    *out = accel;
    return STATUS_OK;
failed:
    accel_free(accel);
    return result;
}

void accel_free(struct accel *accel)
{
    if (!accel)
        return;
    if (accel->top)
        rtcReleaseScene(accel->top);
    if (accel->mesh_scenes)
        for (uint32_t i = 0; i < accel->mesh_count; i++)
            if (accel->mesh_scenes[i])
                rtcReleaseScene(accel->mesh_scenes[i]);
    if (accel->device)
        rtcReleaseDevice(accel->device);
    if (accel->mesh_slender)
        for (uint32_t i = 0; i < accel->mesh_count; i++)
            mem_free(accel->mesh_slender[i]);
    for (size_t i = 0; i < accel->owned_count; i++)
        mem_free(accel->owned[i]);
    sizes_release(&accel->sizes);
    mem_free(accel->mesh_scenes);
    mem_free(accel->mesh_slender);
    mem_free(accel->mesh_slenderest);
    mem_free(accel->geometries);
    mem_free(accel->owned);
    mem_free(accel);
}

size_t accel_bytes(const struct accel *accel)
{
    ptrdiff_t bytes = atomic_load(&((struct accel *)accel)->bytes);

    return bytes > 0 ? (size_t)bytes : 0;
}

/* ---- queries ------------------------------------------------------------------------------ */

static void move(double place[3], const double direction[3], double by)
{
    for (int k = 0; k < 3; k++)
        place[k] += by * direction[k];
}

/* To the middle of the face as far as it takes to be clear of its edges: there an error to the side
 * could take the ray past a neighbour that stands up. */
static void move_inwards(struct query_context *q)
{
    double corner[3][3], e[3], way[3], n[3], longest = 0, middle, wanted, inset, part;

    q->accel->corners(q->accel->scene, q->ray->left[0].instance, q->ray->left[0].triangle,
                      q->ray->time, corner);
    exact_normal(corner, n);
    for (int k = 0; k < 3; k++) {
        way[k] = (corner[0][k] + corner[1][k] + corner[2][k]) / 3 - q->origin[k];
        exact_sub(corner[(k + 1) % 3], corner[k], e);
        longest = fmax(longest, exact_dot(e, e));
    }
    middle = longest > 0 ? sqrt(exact_dot(n, n) / longest) / 3 : 0;
    inset = fmax((double)q->ray->inset, 0);
    wanted = 2 * INSET_ERRORS * q->error_left;
    part = middle > wanted ? (wanted - inset) / (middle - inset) : 1;
    move(q->start, way, part);
    q->error += part * sqrt(exact_dot(way, way));
}

/* Without contacts a start just off the face spares Embree the face itself. */
static void start_on_face(struct query_context *q)
{
    const struct accel_geometry *g = &q->accel->geometries[q->ray->left[0].instance];
    double off[3];

    q->error_left = g->error_origin * largest(q->origin) + g->error_extent;
    q->at_edge = (double)q->ray->inset < INSET_ERRORS * q->error_left;
    if (q->at_edge)
        move_inwards(q);
    memcpy(q->inside, q->start, sizeof q->inside);
    /* Until the ray is clear of the plane that it leaves, an error to the side, or the direction's
     * own, may seem to take it below. */
    q->near_start = fmax(q->back, 2 * q->error / (double)vec3_dot(q->ray->off, q->ray->direction));
    if (q->at_edge || q->ray->contacts) {
        move(q->start, q->direction, -q->back);
        return;
    }
    exact_vec(q->ray->off, off);
    move(q->start, off, q->error_left);
    q->t_max -= q->back;
    q->back = 0;
    q->error += q->error_left;
}

/* Where the end is clear of the face's edges nothing can be right before it but the face. */
static void end_on_face(struct query_context *q)
{
    double cosine = (double)q->ray->end_cosine, t_max = (double)q->ray->t_max;

    if ((double)q->ray->end_inset > INSET_ERRORS * q->error && q->back < 0.5 * t_max * cosine) {
        q->t_max -= q->error / cosine + END_SHARE * t_max;
        return;
    }
    q->reaches = 1;
    q->near_end = fmax(q->back + END_SHARE * t_max, 2 * q->error / cosine);
    q->t_max += q->back + END_SHARE * t_max;
}

static void query_start(struct query_context *q, const struct accel *accel, const struct ray *ray,
                        const void *query, enum query_kind kind)
{
#if AZULEJO_EMBREE >= 4
    rtcInitRayQueryContext(&q->embree);
#else
    rtcInitIntersectContext(&q->embree);
#endif
    q->accel = accel;
    q->query = query;
    q->ray = ray;
    q->kind = kind;
    exact_origin(ray, q->origin);
    exact_vec(ray->direction, q->direction);
    q->error = accel->error_origin * largest(q->origin) + accel->error_extent;
    memcpy(q->start, q->origin, sizeof q->start);
    q->met = q->reaches = q->at_edge = q->doubt = 0;
    q->about = NULL;
    if (ray->reaches)
        q->error += accel->error_origin * (double)ray->t_max;
    q->back = BACK_ERRORS * q->error;
    q->t_max = (double)ray->t_max + q->back;
    q->near_start = q->near_end = q->back;
    if (ray->reaches)
        end_on_face(q);
    if (ray->left_count)
        start_on_face(q);
    else
        move(q->start, q->direction, -q->back);
}

/* For Embree the ray starts earlier, and where it ends on a face it ends later. */
static void ray_init(struct RTCRay *out, const struct query_context *q)
{
    const struct ray *ray = q->ray;

    out->org_x = (float)q->start[0];
    out->org_y = (float)q->start[1];
    out->org_z = (float)q->start[2];
    out->tnear = 0;
    out->dir_x = ray->direction.x;
    out->dir_y = ray->direction.y;
    out->dir_z = ray->direction.z;
    out->time = ray->time;
    out->tfar = (float)q->t_max;
    out->mask = ~0u;
    out->id = 0;
    out->flags = 0;
}

/* Embree's nearest of what float decides; 0: none. */
static int trace(struct query_context *q, struct hit *hit)
{
    struct RTCRayHit shot;

    ray_init(&shot.ray, q);
    shot.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    shot.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if AZULEJO_EMBREE >= 4
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.context = &q->embree;
    rtcIntersect1(q->accel->top, &shot, &args);
#else
    rtcIntersect1(q->accel->top, &q->embree, &shot);
#endif
    if (shot.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return 0;
    hit->instance = shot.hit.instID[0] != RTC_INVALID_GEOMETRY_ID ? shot.hit.instID[0]
                                                                  : shot.hit.geomID;
    hit->triangle = shot.hit.primID;
    return 1;
}

/* Where three faces meet, the ray from farther inside the face may pass by the neighbour that the
 * ray itself meets. Then that ray is what counts: it starts on the same face, some 2^-14 away. */
static void start_inside(struct ray *moved, const struct query_context *q)
{
    *moved = *q->ray;
    moved->origin = exact_round(q->inside, moved->rest);
    moved->inset = INFINITY;
    moved->contacts = 1;
}

int accel_intersect(const struct accel *accel, const struct ray *ray, const void *query,
                    struct hit *hit)
{
    struct query_context q;
    struct ray moved;
    int met;

    query_start(&q, accel, ray, query, QUERY_NEAREST);
    met = trace(&q, hit);
    if (!met && !q.met && q.doubt) {
        start_inside(&moved, &q);
        query_start(&q, accel, &moved, query, QUERY_NEAREST);
        met = trace(&q, hit);
    }
    if (q.met) {
        double corner[3][3], n[3];

        if (met) {
            accel->corners(accel->scene, hit->instance, hit->triangle, ray->time, corner);
            exact_normal(corner, n);
            met = exact_crossing(corner, n, q.origin, q.direction) < q.nearest_t;
        }
        if (!met)
            *hit = q.nearest;
        met = 1;
    }
    return met;
}

static int is_blocked(struct query_context *q)
{
    struct RTCRay shot;

    ray_init(&shot, q);
#if AZULEJO_EMBREE >= 4
    struct RTCOccludedArguments args;
    rtcInitOccludedArguments(&args);
    args.context = &q->embree;
    rtcOccluded1(q->accel->top, &shot, &args);
#else
    rtcOccluded1(q->accel->top, &q->embree, &shot);
#endif
    return shot.tfar < 0;
}

int accel_occluded(const struct accel *accel, const struct ray *ray, const void *query)
{
    struct query_context q;
    struct ray moved;
    int blocked;

    query_start(&q, accel, ray, query, QUERY_OCCLUDED);
    blocked = is_blocked(&q);
    if (!blocked && q.doubt) {
        start_inside(&moved, &q);
        query_start(&q, accel, &moved, query, QUERY_OCCLUDED);
        blocked = is_blocked(&q);
    }
    return blocked;
}

/* Do two faces of one instance lie side by side: a corner in common, and wound alike as `axis`
 * sees them? */
static int one_sheet(const struct query_context *q, const struct hit *a, const struct hit *b)
{
    double x[3][3], y[3][3], n[3], m[3];

    if (a->instance != b->instance)
        return 0;
    q->accel->corners(q->accel->scene, a->instance, a->triangle, q->ray->time, x);
    q->accel->corners(q->accel->scene, b->instance, b->triangle, q->ray->time, y);
    exact_normal(x, n);
    exact_normal(y, m);
    if ((exact_dot(n, q->direction) < 0) != (exact_dot(m, q->direction) < 0))
        return 0;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (memcmp(x[i], y[k], sizeof x[i]) == 0)
                return 1;
    return 0;
}

static void mark_repeats(const struct query_context *q)
{
    uint32_t count = q->contact_count < q->contact_capacity ? q->contact_count
                                                            : q->contact_capacity;

    for (uint32_t i = 0; i < count; i++) {
        struct contact *contact = &q->contacts[i];

        contact->repeats = one_sheet(q, &contact->hit, q->about);
        for (uint32_t k = 0; k < i && !contact->repeats; k++)
            contact->repeats = one_sheet(q, &contact->hit, &q->contacts[k].hit);
    }
}

uint32_t accel_coincident(const struct accel *accel, const struct ray *ray, const struct hit *hit,
                          const double place[3], const void *query, struct contact *out,
                          uint32_t capacity)
{
    struct ray line = {.t_max = INFINITY, .time = ray->time};
    double corner[3][3], n[3], along[3], length;
    struct query_context q;
    struct hit unused;
    int exponent;

    accel->corners(accel->scene, hit->instance, hit->triangle, ray->time, corner);
    exact_normal(corner, n);
    exact_vec(ray->direction, along);
    length = sqrt(exact_dot(n, n));
    if (exact_dot(n, along) < 0)
        length = -length;
    if (!(length != 0))
        return 0;
    for (int k = 0; k < 3; k++)
        along[k] = n[k] / length;
    line.origin = exact_round(place, line.rest);
    line.direction = vec3_make((float)along[0], (float)along[1], (float)along[2]);
    frexp(largest(place), &exponent);
    query_start(&q, accel, &line, query, QUERY_COINCIDENT);
    memcpy(q.direction, along, sizeof along);
    q.gap_max = ldexp(ACCEL_COINCIDENT_ULPS, exponent - 24);
    q.about = hit;
    q.contacts = out;
    q.contact_count = 0;
    q.contact_capacity = capacity;
    q.t_max = q.gap_max + 2 * q.back;
    trace(&q, &unused);
    mark_repeats(&q);
    return q.contact_count;
}
