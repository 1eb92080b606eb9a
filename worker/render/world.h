/* world: the scene in the form that the path loop reads. Private to worker/render.
 *
 * Everything is immutable once render_scene_new returned. The mesh pointers look straight
 * into the blobs, which the caller of render_scene_new keeps alive.
 */
#ifndef AZULEJO_RENDER_WORLD_H
#define AZULEJO_RENDER_WORLD_H

#include <stdint.h>

#include "common/scene/effects.h"
#include "common/scene/scene.h"
#include "worker/render/accel.h"
#include "worker/render/camera.h"
#include "worker/render/light/emitters.h"
#include "worker/render/light/environment.h"
#include "worker/render/render.h"
#include "worker/render/texture.h"

struct world_mesh {
    const float *positions, *normals, *tangents, *uv[2], *colors;
    const uint32_t *indices;
    uint32_t vertex_count, triangle_count;
};

/* A texture slot made ready: NULL image where the factor alone counts. */
struct world_slot {
    const struct texture_image *image;
    struct scene_texture texture;
    uint32_t uv_set;
    int transformed;
    float m[2][3];
};

enum world_material_flags {
    MATERIAL_TEXTURED = 1,    /* any slot has an image */
    MATERIAL_EMISSIVE = 2,
    MATERIAL_ALPHA = 4,       /* some point may be less than opaque */
    MATERIAL_NORMAL_MAP = 8,
    MATERIAL_CULLED = 16,     /* rays pass its back faces */
};

struct world_material {
    struct scene_material m; /* name points into the scene and is not used here */
    struct world_slot base_color, metallic_roughness, normal, emission, specular, specular_color,
        transmission;
    unsigned flags;
    struct vec3 absorption;  /* 1/metre */
};

struct world_instance {
    uint32_t mesh, material;
    const float *world_positions; /* vertices in world space, or NULL: transform the mesh's */
    struct transform to_world, to_object;
    int flipped;                  /* negative determinant: world winding is clockwise */
    float position_error;         /* metres: bound on the rounding of a transformed position */
    int32_t light_base;           /* first of its triangles in the emitters, -1: dark */
};

struct render_scene {
    struct render_settings settings;
    uint32_t effects;
    struct world_mesh *meshes;
    struct world_material *materials;
    struct world_instance *instances;
    struct texture_image **images;
    float **baked;                /* world positions, owned, per instance or NULL */
    uint32_t mesh_count, material_count, instance_count, image_count;
    struct camera camera;
    struct environment *environment; /* NULL: none */
    struct emitters emitters;
    struct accel *accel;
    struct vec3 bounds_centre;
    float bounds_radius;          /* Ritter's bounding sphere of the geometry, metres */
    struct render_scene_info info;
};

/* One slot's texel at a triangle's barycentrics (weights of vertices 1 and 2). */
struct texel world_slot_lookup(const struct world_slot *slot, const struct world_mesh *mesh,
                               const uint32_t vertex[3], float b1, float b2, int srgb);

/* Alpha of the material at a point of a triangle, 0..1, before the alpha mode is applied. */
float world_alpha(const struct world_material *material, const struct world_mesh *mesh,
                  const uint32_t vertex[3], float b1, float b2);

/* Emitted radiance at a point of a triangle. */
struct vec3 world_emission(const struct world_material *material, const struct world_mesh *mesh,
                           const uint32_t vertex[3], float b1, float b2);

/* The three corners of a triangle in world space. */
void world_triangle(const struct render_scene *scene, const struct world_instance *instance,
                    uint32_t triangle, struct vec3 corner[3]);

static inline const uint32_t *world_vertices(const struct world_mesh *mesh, uint32_t triangle)
{
    return mesh->indices + 3 * (size_t)triangle;
}

#endif
