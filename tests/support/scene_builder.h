/* scene_builder: small scenes in memory for tests, with their blobs.
 *
 * Every function aborts the test program when memory runs out: tests have no use for more.
 */
#pragma once

#include "common/scene/scene.h"
#include "common/scene/settings.h"
#include "worker/render/render.h"

enum { BUILDER_MAX = 64 };

struct scene_builder {
    struct scene scene;
    struct { struct digest digest; uint8_t *data; size_t size_bytes; } blobs[BUILDER_MAX];
    size_t blob_count;
};

void builder_init(struct scene_builder *b);
void builder_release(struct scene_builder *b);

/* All return the row's index. A sphere of 2 * segments * segments triangles around the origin;
 * a unit quad in the xz plane, normal +y, from -1 to 1; any triangles (positions may be
 * followed by normals of the same count, NULL for none). */
uint32_t builder_sphere(struct scene_builder *b, uint32_t segments, int smooth);
uint32_t builder_quad(struct scene_builder *b);
/* Two quads that face away from each other at y = -1 and 1, without sides, from -1 to 1. */
uint32_t builder_slab(struct scene_builder *b);
uint32_t builder_mesh(struct scene_builder *b, const float *positions, const float *normals, uint32_t vertex_count,
                      const uint32_t *indices, uint32_t triangle_count, int closed);
/* Flat quads abcd, each as the triangles abc, acd with vertices of its own. */
uint32_t builder_quads(struct scene_builder *b, const float (*quads)[4][3], uint32_t count);
/* A mesh with all that textures need; what is NULL is left out. */
struct builder_mapped {
    const float *positions, *normals, *tangents, *uv0, *uv1, *colors; /* [vertices][3, 3, 4, 2, 2, 4] */
    uint32_t vertex_count;
    const uint32_t *indices;
    uint32_t triangle_count;
};
uint32_t builder_mesh_mapped(struct scene_builder *b, const struct builder_mapped *mesh);
/* A mesh that can be deformed: `influences` [vertices] or NULL; `morphs` [morph_count][vertices][3]
 * position offsets. The blob is the mesh's without them but for their arrays (no normals). */
uint32_t builder_mesh_deforming(struct scene_builder *b, const float *positions, uint32_t vertex_count,
                                const uint32_t *indices, uint32_t triangle_count,
                                const struct mesh_influence *influences, const float *morphs, uint32_t morph_count);
/* The same with normals, and their offsets [morph_count][vertices][3]. */
uint32_t builder_mesh_deforming_smooth(struct scene_builder *b, const float *positions, const float *normals,
                                       uint32_t vertex_count, const uint32_t *indices, uint32_t triangle_count,
                                       const struct mesh_influence *influences, const float *morphs,
                                       const float *morph_normals, uint32_t morph_count);

/* What moves. A node at rest in its parent (-1: the world); give it `weights` of morph targets.
 * Keys of one property of a node, linear; nodes and paths in ascending order. A skin of these
 * joints, bound where the mesh's space and the joints' agree. */
uint32_t builder_node(struct scene_builder *b, int32_t parent, uint32_t weight_count);
void builder_channel(struct scene_builder *b, uint32_t node, enum scene_channel_path path, uint32_t key_count,
                     const float *times, const float *values);
int32_t builder_skin(struct scene_builder *b, const uint32_t *joints, uint32_t joint_count);

/* glTF's defaults made into a white Lambert surface (double-sided); edit the returned row. */
struct scene_material *builder_lambert(struct scene_builder *b, float albedo);
uint32_t builder_last_material(const struct scene_builder *b);
/* Scale (per axis), then translate. */
struct scene_instance *builder_place(struct scene_builder *b, uint32_t mesh, uint32_t material, struct vec3 scale,
                                     struct vec3 translate);
struct scene_light *builder_light(struct scene_builder *b, enum scene_light_kind kind);
/* A camera at `eye` that looks at `target`, up +y (or +z when looking along y). */
void builder_camera(struct scene_builder *b, struct vec3 eye, struct vec3 target, float yfov_rad);
void builder_environment_constant(struct scene_builder *b, struct vec3 radiance);
/* A whole scene: a floor, a ball, a lamp and a sky, and a camera before them. `dress` (may be NULL)
 * changes the ball's material, which is Lambert's. Takes the place of builder_init. */
void builder_room(struct scene_builder *b, void (*dress)(struct scene_builder *b, struct scene_material *ball));
/* Four walls, floor and ceiling, a window of 1 x 1 m in the wall at x = -2, a ball, no lamp, and a camera inside. Give it an
 * environment. Takes the place of builder_init. */
void builder_windowed_room(struct scene_builder *b);
/* Three rooms in a row, with doors between them, lamps of every kind that has a place in each, and a camera in the first,
 * where they are dimmest: most of the light is hidden. Takes the place of builder_init. */
void builder_lamp_rooms(struct scene_builder *b);
/* A lat-long map of floats [height][width][3], stored as an EXR blob. */
void builder_environment_map(struct scene_builder *b, const float *rgb, uint32_t width, uint32_t height);

/* A medium that neither absorbs nor scatters; edit the returned row. A grid of densities
 * [z][y][x] makes it heterogeneous; it fills the box from `low` to `high`. */
struct scene_medium *builder_medium(struct scene_builder *b);
void builder_grid(struct scene_builder *b, struct scene_medium *medium, const float *density, const uint32_t size[3],
                  struct vec3 low, struct vec3 high);

/* A texture of floats [height][width][3], an EXR image of its own, repeated and filtered. */
uint32_t builder_texture(struct scene_builder *b, const float *rgb, uint32_t width, uint32_t height);

/* The scene made ready; aborts with the error's words if it is refused. */
struct render_scene *builder_build(struct scene_builder *b, const struct render_settings *settings);
struct blob_source builder_source(struct scene_builder *b);

/* Render the whole frame: mean of all samples, and the variance of that mean estimated from
 * the two replicates, both [height][width][3]; `variance` may be NULL. */
void builder_render(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                    double *mean, double *variance, struct render_stats *stats);

/* Settings of a small picture with this many samples. */
struct render_settings builder_settings(uint32_t width, uint32_t height, uint32_t spp);
