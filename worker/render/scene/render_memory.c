#include "worker/render/scene/render_memory.h"

#include <stdatomic.h>

#include "common/system/machine.h"
#include "common/image/image_size.h"
#include "common/scene/pose.h"
#include "worker/render/caustic/casters.h"
#include "worker/render/scene/image_share.h"
#include "worker/render/render.h"
#include "worker/render/scene/render_place.h"

/* Embree 3.13, robust, medium quality, on meshes of 10^3 to 10^6 triangles: it keeps 70 bytes per
 * triangle (60 with two moments, 235 with five), and its builder temporarily takes more. */
#define BVH_BYTES_TRIANGLE 110
#define BVH_BYTES_MOVING_TRIANGLE 260
#define BVH_BYTES_INSTANCE 700
/* The map's three floats, and the tables for sampling directions. */
#define ENVIRONMENT_BYTES_TEXEL 32

static _Atomic(uint64_t) memory_limit;

void render_memory_limit(uint64_t bytes) { atomic_store(&memory_limit, bytes); }

/* `texel_bytes` 0: as the decoder makes it. */
static status image_need(uint64_t *bytes, const struct scene_image *image, uint32_t texel_bytes,
                         struct blob_source blobs, struct error *err)
{
    const uint8_t *data;
    size_t size_bytes;
    struct image_size size;
    status s = blobs.get(blobs.user, &image->blob.digest, &data, &size_bytes, err);

    *bytes = 0;
    if (s == STATUS_OK && image_size_of(data, size_bytes, &size))
        *bytes = (uint64_t)size.width * size.height * (texel_bytes ? texel_bytes : size.pixel_bytes);
    return s;
}

/* A third more for each pyramid; nothing for images that another scene holds. */
static status textures_need(struct render_need *need, const struct scene *scene, const struct render_used *used,
                            struct blob_source blobs, struct error *err)
{
    for (uint32_t i = 0; i < scene->image_count; i++) {
        unsigned uses = image_uses(used, i), pyramids = (uses & 1) + (uses >> 1 & 1);
        uint64_t bytes;
        if (!used->images[i] || image_share_has(&scene->images[i].blob.digest, uses))
            continue;
        TRY(image_need(&bytes, &scene->images[i], 0, blobs, err));
        need->textures += bytes + bytes * pyramids / 3;
    }
    return STATUS_OK;
}

static uint64_t mesh_bytes(const struct scene_mesh *mesh)
{
    struct scene_mesh_layout layout;

    scene_mesh_layout(mesh, &layout);
    return layout.total_bytes;
}

/* How often each mesh occurs does not matter: a mesh that many instances share is small compared
 * with the copies that are saved, and one that is not shared is baked. */
static void geometry_need(struct render_need *need, const struct scene *scene, const struct render_settings *settings)
{
    const int casts = !(settings->without & EFFECT_CAUSTICS);
    double open_s, close_s;
    uint64_t baked = 0;
    int blurs, has_casters = 0;

    scene_shutter(scene, settings, 0, &open_s, &close_s);
    blurs = close_s > open_s && scene->channel_count > 0 && !(settings->without & EFFECT_MOTION_BLUR);
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        need->meshes += mesh_bytes(&scene->meshes[i]);
        need->bvh += (uint64_t)scene->meshes[i].triangle_count * BVH_BYTES_TRIANGLE;
        baked += (uint64_t)scene->meshes[i].vertex_count * 3 * sizeof(float32);
    }
    need->meshes += baked;
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_mesh *mesh = &scene->meshes[scene->instances[i].mesh];
        uint64_t vertices = mesh->vertex_count, triangles = mesh->triangle_count;
        need->bvh += BVH_BYTES_INSTANCE;
        if (casts && casters_may_be(&scene->materials[scene->instances[i].material])) {
            need->bvh += triangles * CASTERS_BYTES_TRIANGLE;
            has_casters = 1;
        }
        need->meshes += sizeof(struct render_instance);
        if (!scene_instance_deforms(scene, i))
            continue;
        need->meshes += vertices * 3 * sizeof(float32) * (blurs ? RENDER_STEPS_MAX : 1);
        need->meshes += vertices * ((mesh->arrays & MESH_NORMALS ? 3 : 0) + (mesh->arrays & MESH_TANGENTS ? 4u : 0)) *
                        sizeof(float32) * (blurs ? RENDER_STEPS_MAX : 1);
        need->bvh += triangles * (blurs ? BVH_BYTES_MOVING_TRIANGLE : BVH_BYTES_TRIANGLE);
    }
    need->bvh += has_casters ? CASTER_CELLS_BYTES : 0;
}

status need_of(struct render_need *need, const struct scene *scene, const struct render_settings *settings,
               const struct render_used *used, struct blob_source blobs, struct error *err)
{
    const struct scene_environment *e = &scene->environment;
    uint64_t bytes = 0;
    status s;

    *need = (struct render_need){0, 0, 0};
    geometry_need(need, scene, settings);
    s = textures_need(need, scene, used, blobs, err);
    if (s == STATUS_OK && e->present && !e->constant && !(settings->without & EFFECT_ENVIRONMENT))
        s = image_need(&bytes, &e->image, ENVIRONMENT_BYTES_TEXEL, blobs, err);
    need->textures += bytes;
    for (uint32_t i = 0; i < scene->medium_count; i++)
        if (used->media[i] && scene->media[i].has_grid)
            need->textures += scene->media[i].grid.size_bytes;
    return s;
}

static double gib(uint64_t bytes) { return (double)bytes / (1u << 30); }

status need_check(const struct render_need *need, struct error *err)
{
    uint64_t limit = atomic_load(&memory_limit), total = need->meshes + need->textures + need->bvh;

    if (!limit)
        limit = machine_memory_available();
    if (total <= limit)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_NO_MEMORY,
                     "the scene needs about %.3g GiB (meshes %.3g, textures %.3g, ray accelerator "
                     "%.3g), this worker has %.3g GiB: use a machine with more memory, smaller "
                     "textures or fewer triangles",
                     gib(total), gib(need->meshes), gib(need->textures), gib(need->bvh), gib(limit));
}
