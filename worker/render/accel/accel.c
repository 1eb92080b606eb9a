#include "worker/render/accel/accel_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/render.h"

/* Embree's error in a ray's height over a triangle's plane, in units of 2^-24 of (the largest
 * coordinate of its origin plus the longest edge): its own, and the additional error of
 * transforming the ray by an instance's matrix, at rest and where Embree interpolates two matrices
 * and inverts the result. docs/NUMERICS.md derives it; tests/bench/bench_error measures it. */
#define ERROR_TRIANGLE 8.0
#define ERROR_INSTANCE 16.0
#define ERROR_MOVING 32.0

/* A query may have its own filter. */
#if AZULEJO_EMBREE >= 4
#define SCENE_FLAG_QUERY_FILTER RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS
#else
#define SCENE_FLAG_QUERY_FILTER RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION
#endif

const char *render_ray_tracer_name(void)
{
    static const char name[] = "azulejo " AZULEJO_VERSION " embree " RTC_VERSION_STRING
#if defined(__x86_64__)
                               " x86_64"
#else
                               " other"
#endif
#ifdef AZULEJO_DOUBLE
                               " " REAL_NAME
#endif
        ;
    return name;
}

const char *render_precision(void) { return REAL_NAME; }

static bool count_memory(void *user, ssize_t bytes, bool post)
{
    struct accel *accel = user;

    (void)post;
    atomic_fetch_add(&accel->bytes, bytes);
    return true;
}

static status embree_failed(RTCDevice device, const char *what, struct error *err)
{
    enum RTCError code = rtcGetDeviceError(device);

    if (code == RTC_ERROR_OUT_OF_MEMORY)
        return error_no_memory(err, what);
    if (code == RTC_ERROR_UNSUPPORTED_CPU)
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "%s: Embree does not run on this CPU with the instruction set asked for", what);
    return error_set(err, STATUS_ERR_INTERNAL, "%s: Embree error %d", what, (int)code);
}

/* `positions` has one entry for each moment; a single one does not move. */
static void set_triangles(RTCGeometry geometry, const float32 *const *positions, uint32_t steps,
                          const struct accel_mesh *mesh, const uint32_t *indices, int filtered)
{
    if (steps > 1)
        rtcSetGeometryTimeStepCount(geometry, steps);
    for (uint32_t i = 0; i < steps; i++)
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, i, RTC_FORMAT_FLOAT3, positions[i], 0,
                                   3 * sizeof(float32), mesh->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, indices, 0, 3 * sizeof(uint32_t),
                               mesh->triangle_count);
    if (filtered)
        rtcSetGeometryIntersectFilterFunction(geometry, accel_filter_accepted);
    rtcSetGeometryOccludedFilterFunction(geometry, accel_filter);
    rtcCommitGeometry(geometry);
}

static RTCScene new_scene(RTCDevice device, const struct accel_input *in)
{
    static const enum RTCBuildQuality qualities[BVH_QUALITY_COUNT] = {
        [BVH_QUALITY_MEDIUM] = RTC_BUILD_QUALITY_MEDIUM,
        [BVH_QUALITY_LOW] = RTC_BUILD_QUALITY_LOW,
        [BVH_QUALITY_HIGH] = RTC_BUILD_QUALITY_HIGH,
    };
    RTCScene scene = rtcNewScene(device);
    /* Embree has no robust trees of high quality. */
    const int robust = !in->not_robust && SAFEGUARD(EMBREE_ROBUST) && SAFEGUARD(BVH_HIGH);
    const enum bvh_quality quality = !SAFEGUARD(BVH_LOW)    ? BVH_QUALITY_LOW
                                     : !SAFEGUARD(BVH_HIGH) ? BVH_QUALITY_HIGH
                                                            : in->quality;

    if (scene) {
        rtcSetSceneFlags(scene, (robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE) | SCENE_FLAG_QUERY_FILTER);
        rtcSetSceneBuildQuality(scene, qualities[quality]);
    }
    return scene;
}

static status build_shared_mesh(struct accel *accel, const struct accel_input *in, uint32_t mesh, struct error *err)
{
    RTCGeometry geometry;
    status s = sizes_slender(in->meshes[mesh].positions, &in->meshes[mesh], &accel->mesh_slender[mesh],
                             &accel->mesh_slenderest[mesh], err);

    if (s != STATUS_OK)
        return s;
    accel->mesh_scenes[mesh] = new_scene(accel->device, in);
    geometry = rtcNewGeometry(accel->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!accel->mesh_scenes[mesh] || !geometry) {
        if (geometry)
            rtcReleaseGeometry(geometry);
        return embree_failed(accel->device, "a mesh's geometry", err);
    }
    set_triangles(geometry, &in->meshes[mesh].positions, 1, &in->meshes[mesh], in->meshes[mesh].indices,
                  accel->mesh_filtered[mesh]);
    rtcAttachGeometryByID(accel->mesh_scenes[mesh], geometry, 0);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(accel->mesh_scenes[mesh]);
    if (rtcGetDeviceError(accel->device) != RTC_ERROR_NONE)
        return error_no_memory(err, "the BVH of a mesh");
    return STATUS_OK;
}

/* Embree copies it, in its own four bytes a number. */
static void set_transform(RTCGeometry geometry, uint32_t step, const struct transform *to_world)
{
    float32 m[3][4];

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            m[r][c] = (float32)to_world->m[r][c];
    rtcSetGeometryTransform(geometry, step, RTC_FORMAT_FLOAT3X4_ROW_MAJOR, m);
}

static void set_transforms(RTCGeometry geometry, const struct accel_instance *instance)
{
    if (instance->motion_steps == 0) {
        set_transform(geometry, 0, &instance->to_world);
        return;
    }
    rtcSetGeometryTimeStepCount(geometry, instance->motion_steps);
    for (uint32_t i = 0; i < instance->motion_steps; i++)
        set_transform(geometry, i, &instance->motion_to_world[i]);
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

/* The mesh's triangles. Embree gets those of `instance` that are not huge; the others become points. */
static status choose_indices(struct accel *accel, const struct accel_mesh *mesh, uint32_t instance,
                             const uint32_t **indices, struct error *err)
{
    uint32_t *chosen = NULL;

    *indices = mesh->indices;
    for (; accel->huge_next < accel->sizes.huge_count; accel->huge_next++) {
        const struct hit *huge = &accel->sizes.huge[accel->huge_next];

        if (huge->instance != instance)
            break;
        if (!chosen) {
            chosen = mem_memdup(mesh->indices, 3 * (size_t)mesh->triangle_count * sizeof *chosen);
            TRY(own(accel, chosen, err));
            *indices = chosen;
        }
        chosen[3 * (size_t)huge->triangle + 1] = chosen[3 * (size_t)huge->triangle + 2] =
            chosen[3 * (size_t)huge->triangle];
    }
    return STATUS_OK;
}

/* An interpolated matrix differs from one of its ends by at most half their difference. */
static real least_stretch(const struct accel_instance *instance)
{
    double least, difference = 0;

    if (!instance->motion_steps)
        return (real)sizes_least_stretch(&instance->to_world);
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
    return (real)fmax(least - 0.5 * difference, 0);
}

static status set_world_triangles(struct accel *accel, const struct accel_input *in, uint32_t index,
                                  RTCGeometry geometry, struct error *err)
{
    const struct accel_instance *instance = &in->instances[index];
    const struct accel_mesh *mesh = &in->meshes[instance->mesh];
    struct accel_geometry *g = &accel->geometries[index];
    const uint32_t *indices;
    uint8_t *slender;
    status s = sizes_slender(instance->instance_positions, mesh, &slender, &g->slenderest, err);

    g->slender = slender;
    if (s == STATUS_OK && slender)
        s = own(accel, slender, err);
    if (s == STATUS_OK)
        s = choose_indices(accel, mesh, index, &indices, err);
    if (s == STATUS_OK)
        set_triangles(geometry, instance->motion_steps ? instance->motion_positions : &instance->instance_positions,
                      instance->motion_steps ? instance->motion_steps : 1, mesh, indices, g->filtered);
    return s;
}

/* All 0 if the matrix is flat: then double decides. */
static void set_to_object(struct accel_geometry *g, const struct transform *to_world)
{
    struct transform_d forward = transform_to_d(to_world), inverse;

    if (transform_d_invert(&forward, &inverse))
        for (int r = 0; r < 3; r++)
            memcpy(g->to_object[r], inverse.m[r], sizeof g->to_object[r]);
}

static int has_few_shapes(const struct accel_input *in)
{
    uint32_t count = 0;

    for (uint32_t i = 0; i < in->instance_count; i++)
        count += in->instances[i].shape != NULL;
    return count <= ACCEL_FEW_SHAPES;
}

static status attach_instance(struct accel *accel, const struct accel_input *in, uint32_t index, struct error *err)
{
    const struct accel_instance *instance = &in->instances[index];
    struct accel_geometry *g = &accel->geometries[index];
    RTCGeometry geometry;
    status s = STATUS_OK;

    g->filtered = instance->filtered != 0;
    g->shape = instance->shape;
    g->shape_margin = instance->shape_margin;
    g->least_stretch = 1;
    g->motion_steps = instance->motion_steps;
    g->in_world = instance->instance_positions || g->shape;
    if (g->shape && accel->few_shapes.are_few) {
        accel->few_shapes.geometry[accel->few_shapes.count++] = index;
        return STATUS_OK;
    }
    geometry = g->shape ? accel_shape_geometry(accel->device, g)
                        : rtcNewGeometry(accel->device, instance->instance_positions ? RTC_GEOMETRY_TYPE_TRIANGLE
                                                                                     : RTC_GEOMETRY_TYPE_INSTANCE);
    if (!geometry)
        return embree_failed(accel->device, "an instance", err);
    if (g->in_world && !g->shape) {
        s = set_world_triangles(accel, in, index, geometry, err);
    } else if (!g->shape) {
        g->slender = accel->mesh_slender[instance->mesh];
        g->slenderest = accel->mesh_slenderest[instance->mesh];
        g->least_stretch = least_stretch(instance);
        if (!instance->motion_steps)
            set_to_object(g, &instance->to_world);
        rtcSetGeometryInstancedScene(geometry, accel->mesh_scenes[instance->mesh]);
        set_transforms(geometry, instance);
        rtcCommitGeometry(geometry);
    }
    if (s == STATUS_OK)
        rtcAttachGeometryByID(accel->top, geometry, index);
    rtcReleaseGeometry(geometry);
    return s;
}

/* The huge triangles, after the instances. */
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
    rtcSetGeometryBoundsFunction(geometry, accel_huge_bounds, NULL);
    rtcSetGeometryIntersectFunction(geometry, accel_huge_intersect);
    rtcSetGeometryOccludedFunction(geometry, accel_huge_occluded);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(accel->top, geometry, accel->geometry_count);
    rtcReleaseGeometry(geometry);
    return STATUS_OK;
}

/* Embree's largest error, for each instance and for all of them. */
static void bound_errors(struct accel *accel, const struct accel_input *in)
{
    for (uint32_t i = 0; i < in->instance_count; i++) {
        const struct accel_instance *instance = &in->instances[i];
        struct accel_geometry *g = &accel->geometries[i];
        double condition = 1, origin = ERROR_TRIANGLE;

        if (!instance->instance_positions && !instance->shape) {
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

double accel_error(const struct accel *accel, double reach)
{
    return accel->error_origin * reach + accel->error_extent;
}

status accel_new(struct accel **out, const struct accel_input *in, struct error *err)
{
    struct accel *accel;
    char config[96];
    status result = STATUS_OK;

    *out = NULL;
    if (!(isa_supported_mask() >> in->isa & 1))
        return error_set(err, STATUS_ERR_UNSUPPORTED, "this CPU lacks the instruction set %s that the job pins",
                         isa_name(in->isa));
    accel = mem_calloc(1, sizeof *accel);
    NEED(accel, err, "the ray accelerator");
    accel->accept = in->accept;
    accel->corners = in->corners;
    accel->scene = in->scene;
    accel->digits = in->digits;
    accel->mesh_count = in->mesh_count;
    accel->geometry_count = in->instance_count;
    accel->few_shapes.are_few = has_few_shapes(in);
    snprintf(config, sizeof config, "isa=%s,threads=%u,set_affinity=0",
             in->isa == ISA_AVX512 ? "avx512" : in->isa == ISA_AVX2 ? "avx2" : "sse2",
             in->threads ? in->threads : 1);
    accel->device = rtcNewDevice(config);
    if (!accel->device) {
        result = embree_failed(NULL, "Embree's device", err);
        goto failed;
    }
    rtcSetDeviceMemoryMonitorFunction(accel->device, count_memory, accel);
    accel->mesh_scenes = mem_calloc(in->mesh_count, sizeof *accel->mesh_scenes);
    accel->mesh_slender = mem_calloc(in->mesh_count, sizeof *accel->mesh_slender);
    accel->mesh_slenderest = mem_calloc(in->mesh_count, sizeof *accel->mesh_slenderest);
    accel->mesh_filtered = mem_calloc(in->mesh_count, 1);
    accel->geometries = mem_calloc(in->instance_count, sizeof *accel->geometries);
    if (!accel->mesh_scenes || !accel->mesh_slender || !accel->mesh_slenderest || !accel->mesh_filtered ||
        !accel->geometries) {
        result = error_no_memory(err, "the ray accelerator");
        goto failed;
    }
    for (uint32_t i = 0; i < in->instance_count; i++)
        accel->mesh_filtered[in->instances[i].mesh] |= in->instances[i].filtered != 0;
    result = sizes_init(&accel->sizes, in, err);
    if (result != STATUS_OK)
        goto failed;
    bound_errors(accel, in);
    accel->top = new_scene(accel->device, in);
    if (!accel->top) {
        result = embree_failed(accel->device, "Embree's scene", err);
        goto failed;
    }
    for (uint32_t i = 0; i < in->instance_count; i++) {
        uint32_t mesh = in->instances[i].mesh;
        if (!in->instances[i].shape && !in->instances[i].instance_positions && !accel->mesh_scenes[mesh]) {
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
    mem_free(accel->mesh_filtered);
    mem_free(accel->geometries);
    mem_free(accel->owned);
    mem_free(accel);
}

size_t accel_bytes(const struct accel *accel)
{
    ptrdiff_t bytes = atomic_load(&((struct accel *)accel)->bytes);

    return bytes > 0 ? (size_t)bytes : 0;
}
