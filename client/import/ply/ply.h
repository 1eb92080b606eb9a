/* ply: a polygon file (PLY) becomes a mesh_source.
 *
 * Read: format ascii, binary_little_endian and binary_big_endian 1.0; of element `vertex` the properties x y z, nx ny
 * nz, a pair of texture coordinates (u v, s t, texture_u texture_v or texture_s texture_t), red green blue and alpha
 * (integers: 8 or 16 bit sRGB display colours, made linear; floating point: linear already); of element `face` the list
 * vertex_indices or vertex_index, polygons of any size (see polygon.h), the list texcoord (u and v of each corner) and a colour of
 * the whole face; of element `tristrips` the same list, in which a negative number ends a strip; of the comments
 * "TextureFile NAME". Every other element and property, lists included, is skipped, and named in the report. Any of the eight
 * scalar types, by either of their names.
 *
 * The file is hostile: counts are checked against the number of bytes.
 */
#pragma once

#include "client/import/builder/mesh.h"

enum {
    PLY_ELEMENTS_MAX = 64,    /* in one header */
    PLY_PROPERTIES_MAX = 256, /* of one element */
    PLY_HEADER_LINE_BYTES_MAX = 4096,
    PLY_TEXTURE_BYTES_MAX = 255, /* of a texture's name */
    PLY_UNREAD_BYTES_MAX = 240,
};

/* The picture that the file names, and counts of omissions, for warnings. */
struct ply_report {
    char texture[PLY_TEXTURE_BYTES_MAX + 1]; /* "": none */
    char unread[PLY_UNREAD_BYTES_MAX + 1];   /* "confidence of vertex, element edge"; "": all was read */
    size_t faces_elsewhere;                  /* show another than the first of several textures */
    size_t texcoords_odd;                    /* faces with a list of texture coordinates that does not fit */
    int face_colors_unread;                  /* beside colours of vertices */
    size_t faces_invalid;                    /* fewer than 3 corners, or a corner that is not a vertex: dropped */
    size_t faces_fanned;                     /* concave faces that could not be cut cleanly */
};

/* Chooses the origin of the positions from the first vertex (mesh.h). */
struct ply_origin {
    void (*choose)(void *user, const double first[3], double origin[3]);
    void *user;
    int vertices_only; /* leave out what faces say of their corners: texture coordinates, colours */
};

/* Does it begin like a PLY file? */
int ply_recognise(const void *data, size_t size_bytes);

/* `out` is initialised in every case, empty after a failure, and released by the caller. Indices are in range, all
 * numbers are finite and coordinates are within SCENE_COORDINATE_MAX; a mesh without faces is success with
 * triangle_count 0. Texture coordinates are as in the file, where v usually runs upwards: mesh_source_flip_v() turns
 * them into the scene's. `origin` (NULL: mesh_origin_choose) and `report` may be NULL. ERR_INPUT, ERR_LIMIT; the error
 * names the line or the byte, and not the file: prefix it. */
status ply_read(const void *data, size_t size_bytes, const struct ply_origin *origin, struct mesh_source *out,
                struct ply_report *report, struct error *err) MUST_CHECK;

/* v becomes 1 - v in both sets: files of PLY, OBJ and pbrt count it from the image's bottom. */
void mesh_source_flip_v(struct mesh_source *mesh);
