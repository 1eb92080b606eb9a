/* gltf: the inside of the glTF 2.0 importer. Not for others: see import.h.
 *
 * One struct gltf lives for one import. What the file's tables hold is read when something
 * that is reached needs it, and only once: the *_row arrays remember the builder's rows.
 */
#ifndef AZULEJO_IMPORT_GLTF_H
#define AZULEJO_IMPORT_GLTF_H

#include <stdint.h>

#include <jansson.h>

#include "client/import/builder.h"
#include "client/import/mesh.h"

enum {
    GLTF_DEPTH_MAX = 4096,             /* of the node hierarchy */
    GLTF_ZERO_ELEMENTS_MAX = 1 << 20,  /* of an accessor that no bytes back */
    GLTF_ROW_UNREAD = -2,              /* in a *_row array; BUILDER_NO_ROW: read, unusable */
    GLTF_KEY_MAX = 96,                 /* characters of a place in messages */
};

/* "materials[3].pbrMetallicRoughness": where a value stands, for messages. */
struct gltf_place {
    const char *table;       /* "": the file itself */
    size_t row;
    char part[GLTF_KEY_MAX]; /* "" or ".pbrMetallicRoughness" */
};

struct gltf_buffer {
    struct buffer owned;
    const uint8_t *data;
    size_t size_bytes;
    int loaded;
};

/* What one primitive became. */
struct gltf_primitive {
    int64_t mesh;       /* builder's row, BUILDER_NO_ROW: nothing to render */
    int64_t material;
};

struct gltf_mesh {
    struct gltf_primitive *primitives; /* NULL: not read yet */
    size_t count;
};

struct gltf {
    struct builder *b;
    struct error *err;
    const char *name;       /* of the file, for messages */
    const char *folder;     /* of the file; NULL: no other files */
    json_t *root;
    const uint8_t *bin;     /* the GLB's binary chunk, not owned */
    size_t bin_bytes;

    /* the file's tables; NULL when absent */
    json_t *accessors, *buffers, *views, *images, *samplers, *textures, *materials, *meshes,
        *nodes, *scenes, *cameras, *lights;
    struct gltf_buffer *buffer_data;
    struct gltf_mesh *mesh_data;
    int64_t *image_rows, *texture_rows;
    int64_t *material_rows; /* one more than the file has: the last is the default material */
};

/* ---- gltf_json.c: typed reading, with errors that name the place -------------------------- */

struct gltf_place gltf_at(const char *table, size_t row, const char *part);
/* `place` with more text appended. */
struct gltf_place gltf_within(const struct gltf_place *place, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

status gltf_fail(struct gltf *g, status code, const struct gltf_place *place, const char *format,
                 ...) __attribute__((format(printf, 4, 5)));

/* Each leaves *out untouched when the key is absent, and fails on a value of another kind. */
status gltf_object(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                   json_t **out) MUST_CHECK;
status gltf_array(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                  json_t **out) MUST_CHECK;
status gltf_text(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                 const char **out) MUST_CHECK;
status gltf_flag(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                 int *out) MUST_CHECK;
status gltf_number(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                   double *out) MUST_CHECK;
status gltf_numbers(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                    size_t count, double *out) MUST_CHECK;
status gltf_size(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                 uint64_t *out) MUST_CHECK;
/* An index into a table; ERR_INPUT when the table has not that many rows. */
status gltf_index(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                  json_t *table, int64_t *out) MUST_CHECK;
/* A row of a table; ERR_INPUT unless it is an object. */
status gltf_row(struct gltf *g, json_t *table, const struct gltf_place *at, json_t **out)
    MUST_CHECK;
/* in.extensions.NAME, or NULL. */
json_t *gltf_extension(json_t *in, const char *name);

/* ---- gltf_buffers.c ----------------------------------------------------------------------- */

/* The bytes of a buffer view; valid while the gltf lives. */
status gltf_view(struct gltf *g, size_t view, const uint8_t **data, size_t *size_bytes,
                 size_t *stride_bytes) MUST_CHECK;
/* Append the bytes of a URI (data or file). */
status gltf_read_uri(struct gltf *g, const char *uri, const struct gltf_place *at,
                     struct buffer *out) MUST_CHECK;

/* ---- gltf_accessors.c --------------------------------------------------------------------- */

struct gltf_accessor {
    size_t count;
    int components;         /* 1..4; 0: a matrix */
    int component_type;     /* 5120 ... 5126 */
    int normalized;
    const uint8_t *data;    /* NULL: zeros */
    size_t stride_bytes;
    size_t sparse_count;
    const uint8_t *sparse_indices, *sparse_values;
    int sparse_index_type;
};

/* Check everything about the accessor but its values. */
status gltf_accessor_open(struct gltf *g, size_t index, struct gltf_accessor *out) MUST_CHECK;
/* All elements as floats, [count][components], mem_alloc'd; integers become numbers, or
 * 0..1 and -1..1 where normalized. Values that are not finite are an error, unless `any`. */
status gltf_accessor_floats(struct gltf *g, size_t index, const struct gltf_accessor *a, int any,
                            float **out) MUST_CHECK;
/* All elements as unsigned integers (a scalar accessor of an unsigned type), mem_alloc'd. */
status gltf_accessor_indices(struct gltf *g, size_t index, const struct gltf_accessor *a,
                             uint32_t **out) MUST_CHECK;

/* ---- gltf_materials.c, gltf_meshes.c, gltf_nodes.c ---------------------------------------- */

/* The builder's row for a material; index -1: the default material. */
status gltf_material(struct gltf *g, int64_t index, uint32_t *row) MUST_CHECK;
/* Read the primitives of a mesh, if that was not done before. */
status gltf_mesh(struct gltf *g, size_t index, const struct gltf_mesh **out) MUST_CHECK;
/* Walk the chosen scene: instances, lights, cameras. *title may be set to its name. */
status gltf_walk(struct gltf *g, int scene_index, const char **title) MUST_CHECK;

/* gltf.c */
extern const struct import_format format_gltf;

#endif
