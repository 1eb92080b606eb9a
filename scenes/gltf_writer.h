/* gltf_writer: builds a small glTF 2.0 file for the scene generators. Materials, images and
 * nodes are given as JSON text by the caller; the writer owns buffers, accessors and meshes.
 * Running out of memory shows at gltf_writer_save().
 */
#pragma once

#include "common/base/buffer.h"
#include "common/base/status.h"

enum { SHAPE_VERTICES_MAX = 4096, SHAPE_TRIANGLES_MAX = 8192 };

/* Triangles, counter-clockwise seen from outside. Arrays whose flag is 0 are left out: without
 * normals a shape is flat-shaded (glTF 2.0, 3.7.2.1). */
struct shape {
    float positions[SHAPE_VERTICES_MAX][3];
    float normals[SHAPE_VERTICES_MAX][3];
    float tangents[SHAPE_VERTICES_MAX][4];
    float uvs[SHAPE_VERTICES_MAX][2];
    uint16_t triangles[SHAPE_TRIANGLES_MAX][3];
    unsigned vertex_count, triangle_count;
    int has_normals, has_tangents, has_uvs;
};

/* The vertex's index. The caller stays below SHAPE_VERTICES_MAX (asserted). */
unsigned shape_add_vertex(struct shape *shape, double x, double y, double z);
void shape_add_triangle(struct shape *shape, unsigned a, unsigned b, unsigned c);
/* Four corners, counter-clockwise from outside: two triangles. */
void shape_add_quad(struct shape *shape, const double corners[4][3]);

struct gltf_writer {
    struct buffer bin, views, accessors, materials, meshes, nodes, textures, images, extensions;
    unsigned view_count, accessor_count, material_count, mesh_count, node_count, image_count;
    unsigned cameras;
    double camera_yfov_rad;
};

void gltf_writer_init(struct gltf_writer *w);
void gltf_writer_release(struct gltf_writer *w);

/* Say that an extension is used (once each). */
void gltf_writer_use_extension(struct gltf_writer *w, const char *name);
/* `json`: a material object. Returns its index. */
unsigned gltf_writer_add_material(struct gltf_writer *w, const char *json);
/* An image by file name, with a texture of the same index that repeats it. */
unsigned gltf_writer_add_image(struct gltf_writer *w, const char *uri);
/* What a shape's attributes are called in a primitive; returns text for
 * gltf_writer_add_mesh, so that several meshes may share one shape. */
void gltf_writer_add_shape(struct gltf_writer *w, const struct shape *shape, struct buffer *primitive);
unsigned gltf_writer_add_mesh(struct gltf_writer *w, const char *name, const char *primitive, unsigned material);
void gltf_writer_add_node(struct gltf_writer *w, const char *name, unsigned mesh, double x, double y, double z);
/* One perspective camera of square aspect at `eye` that looks at `target`, +Y up. */
void gltf_writer_add_camera(struct gltf_writer *w, double yfov_rad, const double eye[3], const double target[3]);

/* Write FOLDER/NAME.gltf; the binary part goes into it as a data URI, or with `bin_name` into
 * FOLDER/bin_name. */
status gltf_writer_save(struct gltf_writer *w, const char *folder, const char *name, const char *bin_name,
                        struct error *err) MUST_CHECK;
