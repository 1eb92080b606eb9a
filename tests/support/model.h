/* model: a small scene in double precision, and the many ways to write it into a file that must all
 * give the same picture: scaled, moved, turned, mirrored, cut into other triangles, renamed,
 * reordered, as glTF, pbrt or OBJ.
 *
 * Lengths are metres before the way's scale. Coordinates that are sums of powers of two survive
 * moves and scalings by powers of two to the bit. A model owns everything in its arena. Every
 * function aborts the test program when memory runs out.
 */
#pragma once

#include <stdint.h>

#include "common/base/arena.h"
#include "common/base/buffer.h"

enum { MODEL_MESHES_MAX = 64, MODEL_MATERIALS_MAX = 64, MODEL_LIGHTS_MAX = 4, MODEL_MEDIA_MAX = 4 };

enum model_format { MODEL_GLTF, MODEL_PBRT, MODEL_OBJ };

/* What goes with a mesh that moves (glTF): all of it within the first twenty-fourth of a second. */
struct model_motion {
    int moves;
    double travel[3];
    double axis[3], turn_rad; /* about the mesh's pivot, or about its second joint */
};

struct model_mesh {
    const char *name;
    uint32_t material;
    uint32_t vertex_count, triangle_count;
    double (*at)[3];
    double (*normal)[3], (*uv)[2], (*morph)[3]; /* or NULL; v runs downwards */
    double *bend;                               /* or NULL: the share that the skin's second joint has of a vertex */
    double tip[3];                              /* of the second joint, from the pivot */
    uint32_t (*triangles)[3];
    int quads;       /* triangles 2k and 2k + 1 are flat quads abc, acd */
    double radius;   /* above 0: as pbrt, the sphere around the pivot */
    double pivot[3]; /* the node's place; what moves has one */
    struct model_motion motion;
};

struct model_material {
    const char *name;
    double color[3];
    int metallic, glossy; /* neither: Lambert's */
    double roughness;     /* perceptual */
    double emission[3];
    int one_sided;
    double ior;                                        /* 0: opaque */
    double attenuation_color[3], attenuation_distance; /* 0: clear */
    const char *color_image, *normal_image;
    double alpha_cutoff; /* of the colour image; 0: opaque, below 0: blended */
    int medium;          /* of what it bounds (pbrt), -1: none; without ior: nothing else */
};

struct model_light {
    double at[3], direction[3];
    double intensity[3];         /* W/sr */
    double inner_rad, outer_rad; /* of a spot; outer 0: a point light */
};

struct model_medium {
    double absorption[3], scattering[3], g;
    int grid; /* cells a side, 0: homogeneous */
    const double *density;
    double low[3], high[3];
};

struct model {
    struct arena arena;
    uint32_t mesh_count, material_count, light_count, medium_count;
    struct model_mesh meshes[MODEL_MESHES_MAX];
    struct model_material materials[MODEL_MATERIALS_MAX];
    struct model_light lights[MODEL_LIGHTS_MAX];
    struct model_medium media[MODEL_MEDIA_MAX];
    int fog; /* 0: the first medium is around the camera, -1: none is */
    double eye[3], target[3], up[3], yfov_rad;
    double lens_radius, focus_distance;
    double camera_travel[3];
    double sky[3];       /* the environment's radiance, or its factor */
    const char *sky_map; /* or NULL: the same from everywhere */
};

enum model_way_flags {
    WAY_FLIP_QUADS = 1 << 0,    /* the other diagonal */
    WAY_SPLIT_FOUR = 1 << 1,    /* each triangle by its edges' midpoints */
    WAY_TURN_CORNERS = 1 << 2,  /* each triangle begins with another corner */
    WAY_SHUFFLE_TRIANGLES = 1 << 3,
    WAY_SHUFFLE_VERTICES = 1 << 4,
    WAY_UNINDEXED = 1 << 5,     /* each triangle has vertices of its own */
    WAY_PIECES = 1 << 6,        /* each mesh as three */
    WAY_RENAMED = 1 << 7,
    WAY_REORDERED = 1 << 8,     /* meshes, nodes, materials; what shines keeps its order */
    WAY_LIGHTS_TOO = 1 << 11,   /* with it: what shines is reordered as well */
    WAY_OWN_MATERIALS = 1 << 10, /* each mesh, or piece of one, has a material of its own */
    WAY_IN_MATRIX = 1 << 9,     /* scale, turn and shift stand in one matrix above everything */
};

struct model_way {
    enum model_format format;
    unsigned flags;
    double scale;
    double turn[3][3]; /* orthonormal; mirrors if its determinant is negative */
    double shift[3];   /* after scale and turn */
};

#define MODEL_AS_IT_IS {MODEL_GLTF, 0, 1, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {0, 0, 0}}

void model_init(struct model *m);
void model_release(struct model *m);

/* Lambert, white; edit the returned row. */
struct model_material *model_material(struct model *m, const char *name);
/* Meshes of the last material. All return the row. A quad a, a + u, a + u + v, a + v, whose normal is
 * u x v, with texture coordinates from 0 to `tiles`; a box without shared vertices at its edges;
 * a prism with `sides` around +y between two heights, closed by fans; a smooth ball; several quads
 * [count][4] that share `vertex_count` vertices. */
struct model_mesh *model_quad(struct model *m, const char *name, const double a[3], const double u[3],
                              const double v[3], double tiles);
struct model_mesh *model_box(struct model *m, const char *name, const double low[3], const double high[3]);
struct model_mesh *model_ball(struct model *m, const char *name, const double centre[3], double radius, int segments);
struct model_mesh *model_quads(struct model *m, const char *name, const double (*at)[3], uint32_t vertex_count,
                               const uint32_t (*quads)[4], uint32_t count);

/* The model as `way` wants it, ready to be written: places are in the file's coordinates unless
 * WAY_IN_MATRIX is set. Release it. */
void model_vary(const struct model *m, const struct model_way *way, struct model *out);
/* A place of the model in the world of `way`. */
void model_place(const struct model_way *way, const double p[3], double out[3]);
/* The columns of a matrix (glTF's order) that looks along `forward` from `at`. */
void model_looking(const double at[3], const double forward[3], const double up[3], double out[16]);

/* The file's text. An OBJ's materials are another file: its text goes to `mtl`. What the format
 * cannot say fails the running test. */
void model_write_gltf(const struct model *varied, const struct model_way *way, struct buffer *out);
void model_write_pbrt(const struct model *varied, const struct model_way *way, struct buffer *out);
void model_write_obj(const struct model *varied, struct buffer *out, struct buffer *mtl);
