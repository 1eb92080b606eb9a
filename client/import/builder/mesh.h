/* mesh: converts a file's triangles to a mesh blob.
 *
 * A mesh_source owns its arrays (mem_alloc). Its indices are in range; mesh_finish() does the rest, in this order: drop
 * triangles without area, drop vertices that no triangle uses, repair normals, make tangents (splitting vertices where
 * they must differ), find bounds and whether the mesh is closed, write the blob. A mesh that deforms (influences or
 * morphs) keeps its triangles without area, which may open later, and is never closed: its shape at rest says little.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "client/import/builder/builder.h"

/* One morph target: offsets from the rest shape. */
struct mesh_morph {
    float *positions; /* [3], required */
    float *normals;   /* [3] or NULL: none; ignored without normals */
};

struct mesh_source {
    size_t vertex_count, triangle_count;
    double origin[3];                  /* the positions' origin in the file's coordinates */
    float *positions;                  /* [3], required; relative to `origin` */
    float *normals;                    /* [3] or NULL: flat shading */
    float *tangents;                   /* [4] or NULL */
    float *uv[2];                      /* [2] or NULL */
    float *colors;                     /* [4] or NULL */
    uint32_t *indices;                 /* [3] a triangle */
    struct mesh_influence *influences; /* a vertex, or NULL: no skin */
    struct mesh_morph *morphs;         /* [morph_count] */
    size_t morph_count;
    unsigned stands_in; /* for a shape: MESH_SPHERE as shape_sphere makes it, or 0 */
    double true_area;   /* m^2, of that shape; 0 where it stands in for none */
};

void mesh_source_release(struct mesh_source *mesh);

/* Choose the origin of positions that need more digits than float has: the file's first vertex if that is far away,
 * else 0. Meshes that may touch must share one, so that equal vertices stay equal. */
void mesh_origin_choose(const double first[3], double origin[3]);

/* The origin of one mesh of a file whose meshes share `shared`: that one, or if most of the mesh lies far from
 * it one of its own. points [count][3], and all lengths, in units of which `metre` are a metre. Near meshes
 * that touch get the same origin or one that mesh_place puts their equal vertices at equal places from. */
struct mesh_origin {
    double at[3];
    double step; /* positions are multiples of it, 0: as exact as floats are */
};
void mesh_origin_near(const double *points, size_t count, const double shared[3], double metre,
                      struct mesh_origin *out);

/* Coordinate `axis` of a position, relative to the origin. */
float mesh_place(const struct mesh_origin *origin, double value, int axis);

/* What vertex colours (not numbers: none) are to be divided by: 1, or 255 or 65535 if they are such whole numbers without
 * being marked as that. Bright ones, up to 4, are no such numbers. */
float mesh_color_range(const float *values, size_t count);

/* Replace the vertices by copies: new vertex i is old vertex from[i]. */
void mesh_source_gather(struct mesh_source *mesh, const uint32_t *from, size_t count);

/* Which tangents the mesh needs. */
struct mesh_tangents {
    int wanted;      /* a normal map acts on this mesh */
    uint32_t uv_set; /* the set that the normal map uses */
    float uv_transform[2][3];
};

/* Sets *row to -1 when no triangle is left. Consumes the arrays of `mesh`. */
status mesh_finish(struct builder *b, struct mesh_source *mesh, const char *name, const struct mesh_tangents *tangents,
                   int64_t *row) MUST_CHECK;

/* tangents.c: tangents after MikkTSpace. Vertices whose triangles have different tangents are
 * split. Needs unit normals, or none (flat shading: every triangle gets its own vertices). */
void tangents_generate(struct mesh_source *mesh, const struct mesh_tangents *wanted);

/* closed.c: every edge joins exactly two triangles in opposite directions and each
 * connected part has a positive volume; -1: a negative one, it is inside out. 0 when in doubt. */
int mesh_is_closed(const struct mesh_source *mesh);

/* closed.c: number vertices so that equal keys (`key_bytes` at `keys`, a row a vertex) get
 * the same, lowest vertex. out[count]. */
void vertices_weld(const void *keys, size_t key_bytes, size_t count, uint32_t *out);
