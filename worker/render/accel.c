#include "worker/render/accel.h"

#if AZULEJO_EMBREE >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/render.h"

struct accel {
    RTCDevice device;
    RTCScene top;
    RTCScene *mesh_scenes;        /* per mesh; NULL where it lies in the top BVH */
    uint32_t mesh_count;
    uint32_t *geometry_instance;  /* top-level geometry number -> instance */
    accel_accept *accept;
    const void *scene;
    _Atomic(ptrdiff_t) bytes;
};

/* Embree hands the context back to the filter; ours carries the query along. */
struct query_context {
#if AZULEJO_EMBREE >= 4
    struct RTCRayQueryContext embree;
#else
    struct RTCIntersectContext embree;
#endif
    const struct accel *accel;
    const void *query;
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

static void filter(const struct RTCFilterFunctionNArguments *args)
{
    const struct query_context *context = (const struct query_context *)args->context;
    const struct accel *accel = context->accel;
    const struct RTCRay *ray = (const struct RTCRay *)args->ray; /* N is 1: single rays only */
    const struct RTCHit *hit = (const struct RTCHit *)args->hit;
    uint32_t geometry = hit->instID[0] != RTC_INVALID_GEOMETRY_ID ? hit->instID[0] : hit->geomID;
    float facing = ray->dir_x * hit->Ng_x + ray->dir_y * hit->Ng_y + ray->dir_z * hit->Ng_z;

    if (args->valid[0] != -1)
        return;
    if (!accel->accept(accel->scene, context->query, accel->geometry_instance[geometry],
                       hit->primID, hit->u, hit->v, facing < 0))
        args->valid[0] = 0;
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
                          const struct accel_mesh *mesh, int filtered)
{
    if (steps > 1)
        rtcSetGeometryTimeStepCount(geometry, steps);
    for (uint32_t i = 0; i < steps; i++)
        rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, i, RTC_FORMAT_FLOAT3,
                                   positions[i], 0, 3 * sizeof(float), mesh->vertex_count);
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh->indices,
                               0, 3 * sizeof(uint32_t), mesh->triangle_count);
    if (filtered) {
        rtcSetGeometryIntersectFilterFunction(geometry, filter);
        rtcSetGeometryOccludedFilterFunction(geometry, filter);
    }
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
    int filtered = 0;

    /* One instance that wants to be asked makes all of the mesh's instances be asked. */
    for (uint32_t i = 0; i < in->instance_count; i++)
        if (in->instances[i].mesh == mesh && !in->instances[i].world_positions)
            filtered |= in->instances[i].filtered;
    accel->mesh_scenes[mesh] = new_scene(accel->device);
    geometry = rtcNewGeometry(accel->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!accel->mesh_scenes[mesh] || !geometry) {
        if (geometry)
            rtcReleaseGeometry(geometry);
        return embree_failed(accel->device, "a mesh's geometry", err);
    }
    set_triangles(geometry, &in->meshes[mesh].positions, 1, &in->meshes[mesh], filtered);
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

static status attach_instance(struct accel *accel, const struct accel_input *in, uint32_t index,
                              struct error *err)
{
    const struct accel_instance *instance = &in->instances[index];
    int in_world = instance->world_positions != NULL;
    RTCGeometry geometry = rtcNewGeometry(
        accel->device, in_world ? RTC_GEOMETRY_TYPE_TRIANGLE : RTC_GEOMETRY_TYPE_INSTANCE);

    if (!geometry)
        return embree_failed(accel->device, "an instance", err);
    if (in_world) {
        set_triangles(geometry,
                      instance->motion_steps ? instance->motion_positions
                                             : &instance->world_positions,
                      instance->motion_steps ? instance->motion_steps : 1,
                      &in->meshes[instance->mesh], instance->filtered);
    } else {
        rtcSetGeometryInstancedScene(geometry, accel->mesh_scenes[instance->mesh]);
        set_transforms(geometry, instance);
        rtcCommitGeometry(geometry);
    }
    rtcAttachGeometryByID(accel->top, geometry, index);
    rtcReleaseGeometry(geometry);
    accel->geometry_instance[index] = index;
    return STATUS_OK;
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
    accel->scene = in->scene;
    accel->mesh_count = in->mesh_count;
    snprintf(config, sizeof config, "isa=%s,threads=1,set_affinity=0",
             in->isa == ISA_AVX512 ? "avx512" : in->isa == ISA_AVX2 ? "avx2" : "sse2");
    accel->device = rtcNewDevice(config);
    if (!accel->device) {
        result = embree_failed(NULL, "Embree's device", err);
        goto failed;
    }
    rtcSetDeviceMemoryMonitorFunction(accel->device, count_memory, accel);
    accel->mesh_scenes = mem_calloc(in->mesh_count, sizeof *accel->mesh_scenes);
    accel->geometry_instance = mem_calloc(in->instance_count, sizeof *accel->geometry_instance);
    if (!accel->mesh_scenes || !accel->geometry_instance) {
        result = error_no_memory(err, "the ray accelerator");
        goto failed;
    }
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
    mem_free(accel->mesh_scenes);
    mem_free(accel->geometry_instance);
    mem_free(accel);
}

size_t accel_bytes(const struct accel *accel)
{
    ptrdiff_t bytes = atomic_load(&((struct accel *)accel)->bytes);

    return bytes > 0 ? (size_t)bytes : 0;
}

static void context_init(struct query_context *context, const struct accel *accel,
                         const void *query)
{
#if AZULEJO_EMBREE >= 4
    rtcInitRayQueryContext(&context->embree);
#else
    rtcInitIntersectContext(&context->embree);
#endif
    context->accel = accel;
    context->query = query;
}

static void ray_init(struct RTCRay *out, const struct ray *ray)
{
    out->org_x = ray->origin.x;
    out->org_y = ray->origin.y;
    out->org_z = ray->origin.z;
    out->tnear = 0;
    out->dir_x = ray->direction.x;
    out->dir_y = ray->direction.y;
    out->dir_z = ray->direction.z;
    out->time = ray->time;
    out->tfar = ray->t_max;
    out->mask = ~0u;
    out->id = 0;
    out->flags = 0;
}

int accel_intersect(const struct accel *accel, const struct ray *ray, const void *query,
                    struct hit *hit)
{
    struct query_context context;
    struct RTCRayHit shot;

    context_init(&context, accel, query);
    ray_init(&shot.ray, ray);
    shot.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    shot.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
#if AZULEJO_EMBREE >= 4
    struct RTCIntersectArguments args;
    rtcInitIntersectArguments(&args);
    args.context = &context.embree;
    rtcIntersect1(accel->top, &shot, &args);
#else
    rtcIntersect1(accel->top, &context.embree, &shot);
#endif
    if (shot.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return 0;
    hit->instance = accel->geometry_instance[shot.hit.instID[0] != RTC_INVALID_GEOMETRY_ID
                                                 ? shot.hit.instID[0]
                                                 : shot.hit.geomID];
    hit->triangle = shot.hit.primID;
    return 1;
}

int accel_occluded(const struct accel *accel, const struct ray *ray, const void *query)
{
    struct query_context context;
    struct RTCRay shot;

    context_init(&context, accel, query);
    ray_init(&shot, ray);
#if AZULEJO_EMBREE >= 4
    struct RTCOccludedArguments args;
    rtcInitOccludedArguments(&args);
    args.context = &context.embree;
    rtcOccluded1(accel->top, &shot, &args);
#else
    rtcOccluded1(accel->top, &context.embree, &shot);
#endif
    return shot.tfar < 0;
}
