/* path_alpha: does a hit count? The traversal asks this about triangles that may be culled or partly transparent. */
#include <string.h>

#include "worker/render/path/path_parts.h"

/* A hash of the triangle's corner positions. It does not depend on where the mesh stores them, so
 * it stays the same when the mesh is split or its triangles are reordered. */
static uint32_t triangle_key(const struct render_mesh *mesh, const uint32_t vertex[3])
{
    uint32_t key = 0;

    for (int k = 0; k < 3; k++) {
        uint32_t bits[3];
        memcpy(bits, mesh->positions + 3 * (size_t)vertex[k], sizeof bits);
        for (int a = 0; a < 3; a++) {
            key = (key ^ bits[a]) * 0x9e3779b1u;
            key ^= key >> 15;
        }
    }
    return key;
}

/* Is the material present at this point of the triangle? Partial alpha decides at random. */
static int alpha_accepts(const struct render_material *material, const struct render_mesh *mesh,
                         const uint32_t vertex[3], real u, real v, const struct path_query *query, uint32_t alpha_key)
{
    real alpha;

    PROFILE_EFFECT(ALPHA);
    alpha = material_alpha(material, mesh, vertex, u, v);
    if (material->m.alpha_mode == ALPHA_MASK)
        return alpha >= material->m.alpha_cutoff;
    if (!query)
        return alpha >= 1;
    if (!SAFEGUARD(ALPHA_HASH)) /* one number for all veils that a path meets */
        return sampler_hash(query->sampler, 0, 0) < alpha;
    return sampler_hash(query->sampler, query->ray_number * 0x9e3779b9u + alpha_key, triangle_key(mesh, vertex)) <
           alpha;
}

int path_accept(const void *scene_, const void *query, uint32_t instance_index, uint32_t triangle, real u, real v,
                int facing)
{
    const struct render_scene *scene = scene_;
    const struct render_instance *instance = &scene->instances[instance_index];
    const struct render_material *material = &scene->materials[instance->material];
    const struct render_mesh *mesh = &scene->meshes[instance->mesh];
    int accepted;

    /* Baked triangles are in world space, where a mirroring transform reverses the winding. */
    if (instance->instance_positions && instance->flipped)
        facing = !facing;
    if (!facing && (material->flags & MATERIAL_CULLED))
        return 0;
    if (!(material->flags & MATERIAL_ALPHA))
        return 1;
    PROFILE_STAGE(SURFACE);
    accepted = alpha_accepts(material, mesh, triangle_vertices(mesh, triangle), u, v, query, instance->alpha_key);
    PROFILE_STAGE(TRACE);
    return accepted;
}
