/* gltf_maker: small glTF files for tests of the importer, and questions about what it made.
 * Every function fails the running test when something goes wrong. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "client/import/import.h"
#include "common/base/buffer.h"

/* A glTF with one buffer, whose bytes are appended with put_*(). */
struct maker {
    struct buffer bytes;
    struct buffer views, accessors;
    int accessor_count, view_count;
};

void maker_release(struct maker *m);

/* Append bytes; returns the number of the buffer view. stride 0: tightly packed. */
int put_view(struct maker *m, const void *data, size_t size, int stride);
/* view -1: no bytes. `more` is JSON appended to the accessor, as ",\"normalized\":true". */
int put_accessor(struct maker *m, int view, const char *type, int component_type, size_t count, const char *more);
int put_floats(struct maker *m, const char *type, const float *data, size_t floats, size_t count);

/* The whole file; `rest` holds the other tables. */
void maker_write(struct maker *m, const char *rest, struct buffer *out);

extern const struct import_options defaults;
extern const float corner_positions[9];

/* What most tests need around their mesh 0. */
#define ONE_NODE "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]"
#define ONE_TRIANGLE "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]"

/* A texture, and a mesh 0 with a normal map over what put_mirrored_quads makes. */
/* A PNG of two pixels that differ in every channel, so that no texture of it is a constant:
 * (255, 0, 10, 64) and (0, 255, 200, 192). */
#define TWO_PIXELS                                                                              \
    "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR42mP4z8DlwPD/xAEADsoD0TtCbTEAAAAA"  \
    "SUVORK5CYII="
#define PNG_IMAGE                                                                               \
    "\"images\":[{\"uri\":\"data:image/png;base64," TWO_PIXELS                                   \
    "\"}],\"textures\":[{\"source\":0}]"
#define NORMAL_MAPPED(more)                                                                     \
    "\"materials\":[{\"normalTexture\":{\"index\":0" more "}}]," PNG_IMAGE ","                  \
    "\"meshes\":[{\"primitives\":[{\"material\":0,\"indices\":3,\"attributes\":{"                \
    "\"POSITION\":0,\"NORMAL\":1,\"TEXCOORD_0\":2}}]}]"

/* The unit box: accessor 0 positions, 1 indices (SCALAR, 5123). */
void put_box(struct maker *m, int inside_out);
/* Two quads side by side in the plane z = 0 that share the edge x = 1; v runs downwards.
 * The right one shows the texture mirrored. */
void put_mirrored_quads(struct maker *m);

/* A maker whose accessor 0 holds corner_positions. */
struct maker triangle_maker(void);

void import_ok_with(const void *data, size_t size, const char *name, const struct import_options *options,
                    struct import_result *out);
/* Write, import, release the maker. */
void maker_import(struct maker *m, const char *rest, struct import_result *out);
/* The import must fail and the message hold all of `words` ("a|b"). */
void maker_refuse(struct maker *m, const char *rest, const char *words);
/* Import it with each of our allocations failing in turn (starve.h); what is read nevertheless must be the same scene.
 * jansson's own are not counted: it reports them as errors of syntax. */
void maker_starve(struct maker *m, const char *rest, long survivors);
void refuse_text(const char *text, const char *words);
void assert_says(const struct error *err, const char *words);

/* The arrays of a mesh in the result. */
struct mesh_view {
    const struct scene_mesh *mesh;
    const float *positions, *normals, *tangents, *uv0, *uv1, *colors;
    const uint32_t *indices;
    const struct mesh_influence *skin;
    const float *morphs; /* of target i from i * morph_floats on: positions, then normals */
    size_t morph_floats;
};

struct mesh_view view_mesh(const struct import_result *result, uint32_t index);
void assert_floats(const float *got, const float *wanted, size_t count, float tolerance);
void assert_doubles(const double *got, const double *wanted, size_t count, double tolerance);
/* Places in the coordinates of the file, which the scene's origin was taken from. */
struct vec3 in_file(const struct scene *scene, const struct transform_d *to_world, struct vec3 p);
void assert_in_file(const struct scene *scene, const double at[3], const double wanted[3], double tolerance);
void assert_matrix_in_file(const struct scene *scene, const struct transform_d *to_world, const double wanted[12],
                           double tolerance);
int warned(const struct import_result *result, const char *words);
void assert_warned(const struct import_result *result, const char *words);
