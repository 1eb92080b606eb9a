/* gltf: internals of the glTF 2.0 importer; private to it (see import.h).
 *
 * One struct gltf lives for one import. Rows of the file's tables are read when something reachable
 * needs them, and only once: the *_row arrays hold the builder's rows.
 */
#pragma once

#include <stdint.h>

#include <jansson.h>

#include "client/import/builder/builder.h"
#include "client/import/builder/mesh.h"

enum {
    GLTF_DEPTH_MAX = 4096,             /* of the node hierarchy */
    GLTF_ZERO_ELEMENTS_MAX = 1 << 20,  /* of an accessor that no bytes back */
    GLTF_ROW_UNREAD = -2,              /* in a *_row array; BUILDER_NO_ROW: read, unusable */
    GLTF_KEY_MAX = 96,                 /* characters of a place in messages */
    GLTF_MORPHED_VERTICES_MAX = 1 << 26, /* of one primitive, all its morph targets together */
    GLTF_KEY_FLOATS_MAX = 1 << 27,     /* values of all animation channels together */
    GLTF_TIME_MAX_S = 1000000000,      /* of a key */
};

/* Return the failed status. */
/* "materials[3].pbrMetallicRoughness": the place of a value, for messages. */
struct gltf_place {
    const char *table; /* "": the file itself */
    size_t row;
    char part[GLTF_KEY_MAX]; /* "" or ".pbrMetallicRoughness" */
};

struct gltf_buffer {
    struct buffer owned;
    const uint8_t *data;
    size_t size_bytes;
    int loaded;
};

/* The result of one primitive. */
struct gltf_primitive {
    int64_t mesh; /* builder's row, BUILDER_NO_ROW: nothing to render */
    int64_t material;
    uint32_t joint_max; /* the highest joint that moves a vertex; 0 without a skin */
};

/* How a node uses its mesh. */
struct gltf_use {
    int skinned;          /* its vertices follow a skin */
    int morphing;         /* its morph targets are kept, because the weights change */
    const float *weights; /* [weight_count]: its static shape, unless morphing */
    size_t weight_count;
};

/* A mesh for one kind of use. */
struct gltf_mesh {
    struct gltf_mesh *next; /* the same mesh for another use */
    struct gltf_primitive *primitives;
    size_t count;
    int skinned, morphing;
    float *weights; /* [weight_count] */
    size_t weight_count;
};

/* One animated property of a node, read and checked. */
struct gltf_channel {
    struct scene_channel channel; /* its node is the file's; owns times and values */
    int still;                    /* every key is the same: the node's value, not a motion */
};

/* A profile of EXT_lights_ies. */
struct gltf_profile {
    int64_t image;  /* the builder's, GLTF_ROW_UNREAD, BUILDER_NO_ROW */
    double candela; /* of the picture's 1 */
};

/* Another animated value (gltf_pointers.c), read and checked. */
struct gltf_value;
struct gltf_track {
    const struct gltf_value *value;
    uint32_t row;              /* of the file */
    struct gltf_place at;      /* of the channel */
    struct scene_channel keys; /* owns times and values */
};

/* A row of the scene that a row of the file became: of a light, a camera or, of TRACK_INSTANCE, a node's mesh. */
struct gltf_placed {
    enum scene_track_target target;
    uint32_t file_row, node, row;
};

struct gltf_node {
    int64_t parent;               /* -1: none */
    int64_t row;                  /* the builder's, GLTF_ROW_UNREAD */
    uint32_t animated;            /* bit 1 << enum scene_channel_path: it changes */
    int32_t channels[PATH_COUNT]; /* rows of gltf.channels, -1 */
    int32_t visible;              /* row of gltf.tracks: when it is; -1: always */
};

/* A node's place in its parent. */
struct gltf_local {
    int has_matrix;
    struct transform_d matrix; /* of all three, or the file's matrix */
    double translation[3], rotation[4], scale[3];
};

struct gltf {
    struct builder *b;
    struct error *err;
    const char *name;   /* of the file, for messages */
    const char *folder; /* of the file; NULL: no other files */
    json_t *root;
    const uint8_t *bin; /* the GLB's binary chunk, not owned */
    size_t bin_bytes;

    /* the file's tables; NULL when absent */
    json_t *accessors, *buffers, *views, *images, *samplers, *textures, *materials, *meshes, *nodes, *scenes, *cameras,
        *lights, *animations, *skins, *profile_table;
    struct gltf_buffer *buffer_data;
    size_t decompressed_bytes;    /* of all views */
    struct buffer *view_data;     /* of views: what their compressed form holds, once it was read */
    uint8_t **accessor_data;      /* of accessors: elements that come of a Draco stream, NULL: those of their view */
    struct gltf_mesh **mesh_data; /* a mesh: the uses that were read, NULL: none yet */
    struct gltf_node *node_data;
    struct gltf_channel *channels;
    size_t channel_count, channel_capacity, key_floats;
    struct gltf_track *tracks;
    size_t track_count, track_capacity;
    struct gltf_placed *placed;
    size_t placed_count, placed_capacity;
    int64_t *skin_rows;
    int64_t *image_rows, *texture_rows;
    struct gltf_profile *profiles;
    int variant;                               /* -1: none chosen */
    double light_scale[LIGHT_DIRECTIONAL + 1]; /* of intensities, by kind */
    int64_t *material_rows;                    /* one more than the file has: the last is the default material */
};

/* ---- gltf_lights.c ------------------------------------------------------------------------ */

/* Determine the units of the file's lights from `units` (the option's value) and from the file's
 * exporter, warn if that matters, and set light_scale. */
void gltf_light_units(struct gltf *g, const char *units);

/* The scene's light for row `index` of the file's, placed by `to_world`. */
status gltf_light(struct gltf *g, size_t index, const char *node_name, const struct transform_d *to_world,
                  struct scene_light *out) MUST_CHECK;

/* ---- gltf_ies.c ----------------------------------------------------------------------------- */

/* Add the light of a node's EXT_lights_ies; `node`: the builder's to follow, -1: none. *added is 0 where the profile cannot
 * be used, with a warning. */
status gltf_ies_light(struct gltf *g, json_t *extension, const struct gltf_place *at_node, const char *node_name,
                      const struct transform_d *to_world, int32_t node, int *added) MUST_CHECK;

/* ---- gltf_json.c: typed reading, with errors that name the place -------------------------- */

struct gltf_place gltf_at(const char *table, size_t row, const char *part);
/* `place` with more text appended. */
struct gltf_place gltf_within(const struct gltf_place *place, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

status gltf_fail(struct gltf *g, status code, const struct gltf_place *place, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* Each leaves *out untouched when the key is absent, and fails on a value of another kind. */
status gltf_object(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, json_t **out) MUST_CHECK;
status gltf_array(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, json_t **out) MUST_CHECK;
status gltf_text(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, const char **out) MUST_CHECK;
status gltf_flag(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, int *out) MUST_CHECK;
status gltf_number(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, double *out) MUST_CHECK;
status gltf_numbers(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, size_t count,
                    double *out) MUST_CHECK;
status gltf_size(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, uint64_t *out) MUST_CHECK;
/* An index into a table; ERR_INPUT if the table has fewer rows. */
status gltf_index(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, json_t *table,
                  int64_t *out) MUST_CHECK;
/* A row of a table; ERR_INPUT unless it is an object. */
status gltf_row(struct gltf *g, json_t *table, const struct gltf_place *at, json_t **out) MUST_CHECK;
/* in.extensions.NAME, or NULL. */
json_t *gltf_extension(json_t *in, const char *name);

/* ---- gltf_buffers.c ----------------------------------------------------------------------- */

/* The bytes of a buffer view; valid while the gltf lives. */
status gltf_view(struct gltf *g, size_t view, const uint8_t **data, size_t *size_bytes,
                 size_t *stride_bytes) MUST_CHECK;
/* Append the bytes of a URI (data or file). */
status gltf_read_uri(struct gltf *g, const char *uri, const struct gltf_place *at, struct buffer *out) MUST_CHECK;
/* Append the bytes of an image or the like: of its `uri`, or, where that is NULL, of its buffer view. */
status gltf_read_bytes(struct gltf *g, json_t *row, const struct gltf_place *at, const char *uri,
                       struct buffer *out) MUST_CHECK;

/* ---- gltf_accessors.c --------------------------------------------------------------------- */

struct gltf_accessor {
    size_t count;
    int components;     /* 1..4, or 16: MAT4 */
    int component_type; /* 5120 ... 5126 */
    int normalized;
    const uint8_t *data; /* NULL: zeros */
    size_t stride_bytes;
    size_t sparse_count;
    const uint8_t *sparse_indices, *sparse_values;
    int sparse_index_type;
};

/* What the accessor says of itself, but for where its elements are. */
status gltf_accessor_shape(struct gltf *g, size_t index, struct gltf_accessor *out) MUST_CHECK;
/* Check everything about the accessor but its values. */
status gltf_accessor_open(struct gltf *g, size_t index, struct gltf_accessor *out) MUST_CHECK;
/* All elements as floats, [count][components], mem_alloc'd; integers become numbers, or
 * 0..1 and -1..1 where normalized. Values that are not finite are an error, unless `any`. */
status gltf_accessor_floats(struct gltf *g, size_t index, const struct gltf_accessor *a, int any,
                            float **out) MUST_CHECK;
/* All elements as unsigned integers (a scalar accessor of an unsigned type), mem_alloc'd. */
status gltf_accessor_indices(struct gltf *g, size_t index, const struct gltf_accessor *a, uint32_t **out) MUST_CHECK;

/* A vertex attribute as floats, [vertices][components]; *out stays NULL when absent. `most` above
 * `components` allows that many (COLOR_0); *found, if not NULL, is set to the number there is. */
status gltf_attribute(struct gltf *g, json_t *attributes, const struct gltf_place *at, const char *key, int components,
                      int most, int any, size_t vertices, float **out, int *found) MUST_CHECK;

/* ---- gltf_textures.c ---------------------------------------------------------------------- */

/* A textureInfo; `info_out` (may be NULL) gets the JSON object, for its other members. */
status gltf_slot(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                 struct scene_texture_slot *slot, json_t **info_out) MUST_CHECK;

/* ---- gltf_extensions.c: material extensions ------------------------------------------------ */

/* A number from 0 to `high`, and `count` of them; values outside are clamped with a warning. *out holds the default. */
status gltf_factor(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, double high,
                   float *out) MUST_CHECK;
status gltf_color(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, size_t count, double high,
                  float *out) MUST_CHECK;
/* normalTexture and its like: the texture and its scale. */
status gltf_normal_slot(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                        struct scene_texture_slot *slot, float *scale) MUST_CHECK;
/* Warn of keys that are not read, of every object in the file (gltf_keys.c). */
void gltf_check_keys(struct gltf *g);
/* Is something known of this extension, if only that no picture shows it? If not, warn. */
int gltf_knows_extension(struct gltf *g, const char *name);
/* Does gltf_material_extensions read this extension? */
int gltf_reads_material_extension(const char *name);
/* All extensions that change a lit surface. */
status gltf_material_extensions(struct gltf *g, json_t *material, const struct gltf_place *at,
                                struct scene_material *m) MUST_CHECK;
/* KHR_materials_pbrSpecularGlossiness in place of pbrMetallicRoughness. */
status gltf_specular_glossiness(struct gltf *g, json_t *extension, const struct gltf_place *at,
                                struct scene_material *m) MUST_CHECK;

/* ---- gltf_materials.c, gltf_meshes.c, gltf_nodes.c ---------------------------------------- */

/* The builder's row for a material; index -1: the default material. */
status gltf_material(struct gltf *g, int64_t index, uint32_t *row) MUST_CHECK;
/* Read the primitives of a mesh for a use, if that was not done before. */
status gltf_mesh(struct gltf *g, size_t index, const struct gltf_use *use, const struct gltf_mesh **out) MUST_CHECK;
void gltf_mesh_free(struct gltf_mesh *mesh);
/* The number of the mesh's morph targets. */
size_t gltf_target_count(const struct gltf *g, size_t mesh);
/* Walk the chosen scene: instances, lights, cameras. *title may be set to its name. */
status gltf_walk(struct gltf *g, int64_t scene_index, const char **title) MUST_CHECK;

/* ---- gltf_animations.c -------------------------------------------------------------------- */

/* List the animations and read the wanted ones (NULL: all) into g->channels. */
status gltf_animations(struct gltf *g, const char *wanted) MUST_CHECK;
/* Add the channels of the scene's nodes to the scene. */
status gltf_add_channels(struct gltf *g) MUST_CHECK;

/* ---- gltf_samplers.c ---------------------------------------------------------------------- */

/* The keys of a sampler into *out, whose path and components are set; `what` is animated by them. The caller releases
 * it, also after a failure. */
status gltf_keys(struct gltf *g, json_t *sampler, const struct gltf_place *at, const char *what,
                 struct scene_channel *out) MUST_CHECK;
void gltf_keys_release(struct scene_channel *keys);
int gltf_keys_are_still(const struct scene_channel *keys);

/* ---- gltf_pointers.c ---------------------------------------------------------------------- */

/* What a pointer of KHR_animation_pointer animates besides nodes' transforms and weights, and the row of the file's
 * table; NULL: nothing that can be animated. */
const struct gltf_value *gltf_value_find(const char *pointer, uint32_t *row);
/* Can a picture show it? */
int gltf_value_is_seen(const struct gltf_value *value);
/* Read a channel's keys, and write the largest into the file's own objects. `at`: of the channel. */
status gltf_track(struct gltf *g, const struct gltf_value *value, uint32_t row, json_t *sampler,
                  const struct gltf_place *at_sampler, const struct gltf_place *at, double *duration_s) MUST_CHECK;
/* A light, a camera, or an instance of the node's mesh, was added to the scene as its row `row`. */
void gltf_note_placed(struct gltf *g, enum scene_track_target target, size_t file_row, size_t node, size_t row);
/* Add what changes to the scene. */
status gltf_add_tracks(struct gltf *g) MUST_CHECK;
void gltf_tracks_free(struct gltf *g);

/* ---- gltf_skeleton.c: nodes that move, and skins -------------------------------------------- */

/* Set the parents in node_data. */
void gltf_open_nodes(struct gltf *g);
status gltf_node_local(struct gltf *g, size_t node, struct gltf_local *out) MUST_CHECK;
/* At rest. */
status gltf_node_world(struct gltf *g, size_t node, struct transform_d *out) MUST_CHECK;
/* The weights of the node's mesh at rest: [targets], mem_alloc'd. */
status gltf_node_weights(struct gltf *g, size_t node, size_t mesh, float **out, size_t *count) MUST_CHECK;
/* The builder's row for a node, made with all its parents if need be. */
status gltf_node_row(struct gltf *g, size_t node, uint32_t *row) MUST_CHECK;
/* The builder's row for a skin, and a transform that places its mesh approximately. */
status gltf_skin(struct gltf *g, size_t index, uint32_t *row, struct transform_d *about) MUST_CHECK;

/* gltf.c */
/* The row of the name `wanted`, or the row of that number; -1: none. */
int gltf_choice(const char *wanted, const char *const *names, size_t count);
extern const struct import_format format_gltf;
