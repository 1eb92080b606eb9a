/* builder: collects an importer's output: growing tables, blobs by digest, warnings.
 *
 * An importer adds rows in any order that depends only on the file, and ends with builder_finish(),
 * which adds a camera and a light if the file has none, reads the environment map, validates and
 * packs. The builder owns everything until then; builder_end() frees what was not handed over.
 */
#pragma once

#include "client/import/builder/result.h"
#include "common/base/buffer.h"

enum { BUILDER_NO_ROW = -1 };

struct builder_warning {
    const char *kind; /* warnings of one kind are reported once, with a count */
    char *owned_kind; /* a copy, if the kind is not a literal */
    char *text;       /* of the first; starts with its place if that is known */
    uint64_t count;
};

struct builder {
    struct import_result *out;
    struct input_files *files; /* of the result */
    const struct import_options *options;
    struct error *err;
    int error_is_placed;  /* the error names another file already */
    int decodes_pictures; /* builder_check_picture decodes: in the import before this one a picture was damaged */
    int has_damage;       /* a picture that is in the scene already cannot be decoded */

    struct scene_mesh *meshes;
    struct scene_image *images;
    struct scene_texture *textures;
    struct scene_material *materials;
    struct scene_instance *instances;
    struct scene_light *lights;
    struct scene_camera *cameras;
    struct scene_node *nodes;
    struct scene_channel *channels;
    struct scene_track *tracks;
    struct scene_skin *skins;
    struct scene_medium *media;
    struct scene_portal *portals;
    size_t mesh_count, image_count, texture_count, material_count, instance_count, light_count, camera_count,
        node_count, channel_count, track_count, skin_count, medium_count, portal_count;
    size_t mesh_capacity, image_capacity, texture_capacity, material_capacity, instance_capacity, light_capacity,
        camera_capacity, node_capacity, channel_capacity, track_capacity, skin_capacity, medium_capacity, portal_capacity;
    /* The importer fills this in (radiance, to_map, constant; builder_set_environment_map for an
     * image), but not its portals. options->env_path replaces it entirely. */
    struct scene_environment environment;
    int has_light;                              /* the file has a light, perhaps of no power; builder_add_light and an
                             * environment say so, too */
    const char *no_camera_hint, *no_light_hint; /* advice about the file's exporter */
    /* What a camera was aimed at, by scene_place(). */
    double framed_center[3], framed_low_y, framed_distance;
    int32_t fog; /* a row of media, BUILDER_NO_ROW: none */
    enum scene_volume_rule volume_rule;

    size_t blob_capacity;
    uint32_t *blob_index; /* open addressing by digest: row + 1, 0 is free */
    uint32_t *blob_mesh;  /* per blob: row + 1 of the first mesh that uses it */
    size_t blob_mesh_capacity;
    size_t blob_index_size; /* a power of two */

    struct builder_warning warnings[IMPORT_WARNINGS_MAX];
    size_t warning_count;
    uint64_t warnings_dropped;
    uint64_t images_bytes; /* of all images, decoded */
};

/* The builder borrows all three until it is released. */
void builder_begin(struct builder *b, struct import_result *out, const struct import_options *options,
                   struct error *err);
void builder_end(struct builder *b);

/* Remember a warning; control characters in it become '?'. */
void builder_warn(struct builder *b, const char *kind, const char *format, ...) __attribute__((format(printf, 3, 4)));

/* The same with its place: "file:line: " (line 0: "file: "). `kind` may be any text (it is copied),
 * for kinds that contain text of the file: "shape \"cone\"". */
void builder_warn_at(struct builder *b, const char *file, uint64_t line, const char *kind, const char *format, ...)
    __attribute__((format(printf, 5, 6)));

/* ERR_INPUT: there is nothing to render, in the words of `why` and of the first warning that something was left out. */
status builder_nothing(struct builder *b, const char *why) MUST_CHECK;

/* A clean copy for the scene: valid UTF-8, no control characters, at most SCENE_NAME_MAX bytes. Never NULL. */
const char *builder_name(struct builder *b, const char *name);

/* Take over `data` (also when it fails: it is freed). */
status builder_add_blob(struct builder *b, uint8_t *data, size_t size_bytes, struct scene_blob *out) MUST_CHECK;

/* May an image of this size, in pixels, be decoded? ERR_LIMIT names the option that would allow it. builder_add_image
 * and builder_set_environment_map call it themselves; importers that decode a file call it first. */
status builder_check_pixels(struct builder *b, const char *name, uint64_t width, uint64_t height) MUST_CHECK;
/* The same for a file, by its header. A damaged header passes: its decoder reports the fault. */
status builder_check_image(struct builder *b, const char *name, const uint8_t *data, size_t size_bytes) MUST_CHECK;
/* The same, and where b->decodes_pictures, can it be decoded? For builder_leave_out. */
status builder_check_picture(struct builder *b, const char *name, const uint8_t *data, size_t size_bytes) MUST_CHECK;
/* Returns `decoded`, of a picture's decoder; if the file is at fault, sets b->has_damage. */
static inline status builder_damage(struct builder *b, status decoded)
{
    b->has_damage |= decoded == STATUS_ERR_INPUT || decoded == STATUS_ERR_UNSUPPORTED;
    return decoded;
}
/* Add the row, or find the mesh that has the same blob and arrays. `mesh->blob` comes from
 * `data`, which is taken over. */
status builder_add_mesh(struct builder *b, const struct scene_mesh *mesh, uint8_t *data, size_t size_bytes,
                        uint32_t *row) MUST_CHECK;
status builder_add_image(struct builder *b, const char *name, uint8_t *data, size_t size_bytes,
                         uint32_t *row) MUST_CHECK;
/* For builder_add_image. */
status builder_add_image_row(struct builder *b, const struct scene_image *image, uint32_t *row) MUST_CHECK;
status builder_add_texture(struct builder *b, const struct scene_texture *texture, uint32_t *row) MUST_CHECK;
status builder_add_material(struct builder *b, const struct scene_material *material, uint32_t *row) MUST_CHECK;
status builder_add_instance(struct builder *b, const struct scene_instance *instance) MUST_CHECK;
status builder_add_light(struct builder *b, const struct scene_light *light) MUST_CHECK;
status builder_add_camera(struct builder *b, const struct scene_camera *camera) MUST_CHECK;

/* The data that rows point to (weights, times, values, joints, inverse_bind) is copied. A node's
 * parent must already exist. */
status builder_add_node(struct builder *b, const struct scene_node *node, uint32_t *row) MUST_CHECK;
/* In any order; builder_finish sorts. A second channel for the same node and path is left out with a warning. */
status builder_add_channel(struct builder *b, const struct scene_channel *channel) MUST_CHECK;
/* In any order, each value once. */
status builder_add_track(struct builder *b, const struct scene_track *track) MUST_CHECK;
status builder_add_skin(struct builder *b, const struct scene_skin *skin, uint32_t *row) MUST_CHECK;
/* `grid` (mem_alloc'd float32, size[0] * size[1] * size[2]; taken over, also when it fails) is
 * NULL for a homogeneous medium; medium->grid comes from it, has_grid too. */
status builder_add_medium(struct builder *b, const struct scene_medium *medium, float *grid, uint32_t *row) MUST_CHECK;
status builder_add_portal(struct builder *b, const struct scene_portal *portal) MUST_CHECK;

/* The picture `name`, of a `kind` ("texture"), that a scene names at file:line (line 0: none) cannot be used, for the reason
 * `why` with the words in b->err: a warning, and the scene does without it. The error stays where options->strict, and where it is one of place,
 * size or memory. */
status builder_leave_out(struct builder *b, const char *file, uint64_t line, const char *kind, const char *name,
                         status why) MUST_CHECK;

/* Let the environment be this lat-long EXR or Radiance HDR file (taken over, also when it fails). It is decoded to find
 * its faults; `name` is the file's, for messages. radiance and to_map are not changed. */
status builder_set_environment_map(struct builder *b, const char *name, uint8_t *data, size_t size_bytes) MUST_CHECK;

/* The user's map, in place of the file's. */
status builder_read_environment(struct builder *b, const char *path) MUST_CHECK;

/* Hand everything over to the result. `title` names the scene. */
status builder_finish(struct builder *b, const char *title, const struct import_options *options) MUST_CHECK;

/* One scene format. import.c has the table of all; the first one that recognises a file reads it. */
struct import_format {
    const char *name; /* "glTF 2.0 (.gltf, .glb)": for the error that no format fits */
    int (*recognise)(const void *data, size_t size_bytes, const char *name);
    /* Read it into the builder and end with builder_finish. Other files are looked for in `folder`,
     * NULL: nowhere. An error that names another file sets b->error_is_placed. */
    status (*import)(const void *data, size_t size_bytes, const char *name, const char *folder,
                     const struct import_options *options, struct builder *b);
};

/* rebase.c: choose the scene's origin, the centre of all static objects (or of everything at rest
 * if there are none), and make all positions except the nodes' relative to it. Warns of visible
 * rounding. Once, before scene_place(). */
void scene_rebase(struct builder *b);
/* rebase.c: warn of cameras that see so near and so far that floats cannot hold both (scene_sight). Once, when
 * everything has its place. ERR_NO_MEMORY. */
status scene_report_views(struct builder *b) MUST_CHECK;

/* framing.c: put everything that follows a node to its place at time 0, and aim `framed` (may be
 * NULL) at the whole scene from the front, right and above, considering several moments if it
 * moves. The scene must have been validated. ERR_INPUT when something moves out of the range of
 * numbers. */
status scene_place(struct builder *b, struct scene_camera *framed) MUST_CHECK;

/* The bytes of a blob that was added; NULL: there is none. */
const struct import_blob *builder_blob(const struct builder *b, const struct scene_blob *blob);
/* The blobs for what reads them; `b` must outlive it. */
struct scene_blob_reader builder_reader(struct builder *b);
