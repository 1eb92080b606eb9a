/* builder: what every importer fills: growing tables, blobs by digest, warnings.
 *
 * An importer adds rows in any order it likes as long as the order depends on the file
 * alone, and ends with builder_finish(), which frames a camera and adds a light if the
 * file has none, reads the environment map, validates and packs. The builder owns all
 * until then; builder_release() frees what was not handed over.
 */
#ifndef AZULEJO_IMPORT_BUILDER_H
#define AZULEJO_IMPORT_BUILDER_H

#include "client/import/import.h"
#include "common/base/buffer.h"

enum { BUILDER_NO_ROW = -1 };

struct builder_warning {
    const char *kind;       /* a literal: warnings of one kind are told once, with a count */
    char *text;             /* of the first */
    uint64_t count;
};

struct builder {
    struct import_result *out;
    struct error *err;
    int error_is_placed;    /* the error names another file already */
    int no_memory;          /* a warning or name could not be kept: reported by builder_finish */

    struct scene_mesh *meshes;
    struct scene_image *images;
    struct scene_texture *textures;
    struct scene_material *materials;
    struct scene_instance *instances;
    struct scene_light *lights;
    struct scene_camera *cameras;
    size_t mesh_count, image_count, texture_count, material_count, instance_count, light_count,
        camera_count;
    size_t mesh_capacity, image_capacity, texture_capacity, material_capacity, instance_capacity,
        light_capacity, camera_capacity;
    struct scene_environment environment;

    size_t blob_capacity;
    uint32_t *blob_index;   /* open addressing by digest: row + 1, 0 is free */
    uint32_t *blob_mesh;    /* per blob: row + 1 of the first mesh that uses it */
    size_t blob_mesh_capacity;
    size_t blob_index_size; /* a power of two */

    struct builder_warning warnings[IMPORT_WARNINGS_MAX];
    size_t warning_count;
    uint64_t warnings_dropped;
};

void builder_init(struct builder *b, struct import_result *out, struct error *err);
void builder_release(struct builder *b);

/* Remember a warning; control characters in it become '?'. */
void builder_warn(struct builder *b, const char *kind, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* A copy for the scene, made clean: valid UTF-8, no control characters, at most
 * SCENE_NAME_MAX bytes. Never NULL. */
const char *builder_name(struct builder *b, const char *name);

/* Take over `data` (also when it fails: it is freed). */
status builder_add_blob(struct builder *b, uint8_t *data, size_t size_bytes,
                        struct scene_blob *out) MUST_CHECK;

/* Add the row, or find the mesh that has the same blob and arrays. `mesh->blob` comes from
 * `data`, which is taken over. */
status builder_add_mesh(struct builder *b, const struct scene_mesh *mesh, uint8_t *data,
                        size_t size_bytes, uint32_t *row) MUST_CHECK;
status builder_add_image(struct builder *b, const char *name, uint8_t *data, size_t size_bytes,
                         uint32_t *row) MUST_CHECK;
status builder_add_texture(struct builder *b, const struct scene_texture *texture, uint32_t *row)
    MUST_CHECK;
status builder_add_material(struct builder *b, const struct scene_material *material,
                            uint32_t *row) MUST_CHECK;
status builder_add_instance(struct builder *b, const struct scene_instance *instance) MUST_CHECK;
status builder_add_light(struct builder *b, const struct scene_light *light) MUST_CHECK;
status builder_add_camera(struct builder *b, const struct scene_camera *camera) MUST_CHECK;

/* Hand everything over to the result. `title` names the scene. */
status builder_finish(struct builder *b, const char *title, const struct import_options *options)
    MUST_CHECK;

/* Replace control characters, so that hostile text cannot speak to a terminal. */
void text_disarm(char *text);

/* framing.c: a camera that looks at the whole scene from the front, the right and above. */
void camera_frame_scene(const struct scene *scene, struct scene_camera *out);

/* framing.c: `m` reduced to a rotation and a translation that looks the same way; 0 when
 * its axes vanish. */
int transform_d_to_rigid(const struct transform_d *m, struct transform *out);

#endif
