/* obj: internals of the Wavefront OBJ + MTL importer; private to it (see import.h).
 *
 * The OBJ file is read once into tables (obj.c); then each part (the faces of one group with one material) becomes a
 * mesh and an instance (obj_mesh.c). Materials are read from the .mtl files and made when a part needs them (obj_mtl.c,
 * obj_image.c). A file or texture that is missing or broken is a warning; so is a face that cannot be drawn.
 */
#pragma once

#include <stdint.h>

#include "client/import/builder/builder.h"
#include "client/import/builder/mesh.h"

enum {
    OBJ_LIBRARIES_MAX = 256,        /* mtllib files */
    OBJ_NAME_BYTES_MAX = 1 << 12,
    OBJ_MTL_BYTES_MAX = 1 << 28,
    OBJ_SMOOTH_VALENCE_MAX = 1024,  /* a vertex of more faces than this is shaded flat */
};
#define OBJ_NONE UINT32_MAX         /* no such index */
#define OBJ_BAD (UINT32_MAX - 1)    /* an invalid index */

/* Distinct texts, numbered in the order of their first use. */
struct obj_names {
    char **texts;
    size_t count, capacity;
    uint32_t *index;   /* open addressing: number + 1, 0 is free */
    size_t index_size; /* a power of two */
};
/* OBJ_NONE: out of memory. */
uint32_t obj_intern(struct obj_names *names, const char *text, size_t length);
void obj_names_release(struct obj_names *names);

struct obj_corner {
    uint32_t v, t, n; /* 0..; t and n may be OBJ_NONE */
};

struct obj_face {
    size_t first;                 /* corner */
    uint32_t count, part, smooth; /* smooth: group, 0: flat */
    uint32_t line;
};

/* The faces of one group with one material. */
struct obj_part {
    uint32_t name;     /* in `words` */
    uint32_t material; /* in `materials`, OBJ_NONE: none was named */
    uint32_t line;     /* of its first face */
};

enum obj_map { OBJ_MAP_KD, OBJ_MAP_KS, OBJ_MAP_KE, OBJ_MAP_D, OBJ_MAP_BUMP, OBJ_MAP_NORMAL,
               OBJ_MAP_PR, OBJ_MAP_PM, OBJ_MAP_COUNT };

/* A texture statement of a material. */
struct obj_texture {
    char *file; /* mem_alloc'd, NULL: none */
    uint32_t line;
    float scale[2], offset[2]; /* of the texture coordinates, v upwards */
    float bump;                /* -bm */
    char channel;              /* -imfchan: r, g, b, m (alpha) or l (luminance); 0: not given */
    int clamp;
};

/* A newmtl as written; NAN: not given. */
struct obj_material {
    uint32_t name;       /* in `materials` */
    uint32_t file, line; /* its place: in `files` */
    int illum;           /* -1: not given */
    float kd[3], ks[3], ke[3], tf[3], ns, ni, d, tr, pr, pm, pc, pcr, ps, aniso, anisor;
    struct obj_texture maps[OBJ_MAP_COUNT];
    int64_t row; /* of the builder, BUILDER_NO_ROW: not made yet */
};

/* A picture file, read once; or a combination of pictures, named by all of their files. */
struct obj_image {
    char *key;
    int64_t row; /* BUILDER_NO_ROW: unusable */
    int is_grey;
};

struct obj {
    struct builder *b;
    struct error *err;
    const char *name;   /* of the file, for messages */
    const char *folder; /* NULL: no other files */

    double origin[3]; /* shared by the meshes near it: chosen by the first vertex */
    int has_origin;
    double *v;               /* [3]; one that cannot be read: NAN */
    float *colors, *vt, *vn; /* [4] or NULL, [2], [3] */
    size_t v_count, vt_count, vn_count, v_capacity, color_capacity, vt_capacity, vn_capacity;
    struct obj_corner *corners;
    size_t corner_count, corner_capacity;
    struct obj_face *faces;
    size_t face_count, face_capacity;
    int says_smooth; /* there is an s statement: faces without one are flat */

    struct obj_names words, materials, part_keys;
    struct obj_part *parts;
    size_t part_count, part_capacity;

    struct obj_names libraries;
    uint32_t library_lines[OBJ_LIBRARIES_MAX];
    struct obj_names files; /* of libraries, as found */
    struct obj_material *defined;
    size_t defined_count, defined_capacity;
    uint32_t *definition; /* [materials.count] row of `defined`, OBJ_NONE: nowhere */
    struct obj_image *images;
    size_t image_count, image_capacity;
    int64_t plain_row, plain_colored_row; /* materials of parts without one */

    float *face_normals;    /* [3] a face */
    size_t *around;         /* [v_count + 1] where a vertex's corners begin in `around` */
    size_t *around_corners; /* ... the corners, by vertex */
    uint32_t *corner_face;  /* [corner_count] */
};

/* One statement: words of a line. Continued lines count as one. */
struct obj_word {
    const char *text;
    size_t length;
};
struct obj_line {
    const char *at, *end;
    uint32_t number;     /* 1.. */
    struct obj_word odd; /* a number of it that goes on as none does; length 0: there is none */
};
struct obj_text {
    const char *at, *end;
    uint32_t line; /* of the next */
};
/* The next line that is not empty; 0 at the end. */
int obj_next_line(struct obj_text *text, struct obj_line *line);
/* Take the next word; length 0 at the end of the line or at a comment. */
struct obj_word obj_next_word(struct obj_line *line);
/* The rest of the line, without spaces around it; '#' begins no comment here. */
struct obj_word obj_rest(struct obj_line *line);
int obj_word_is(struct obj_word word, const char *text);
/* Read up to `most` numbers; returns their count. 1,5 is 1.5. */
size_t obj_numbers(struct obj_line *line, size_t most, double *out);
/* Warn of the line's odd number, if it has one. */
void obj_warn_of_odd(struct obj *o, const char *file, const struct obj_line *line);

/* The bytes of a file that `file` names, as it is written in the file `within` (NULL: the OBJ file): beside that one,
 * or else beside the OBJ file. ERR_INPUT in `err`; the caller turns it into a warning. */
status obj_read_file(struct obj *o, const char *within, const char *file, size_t limit, struct buffer *out,
                     struct error *err) MUST_CHECK;

/* obj_mtl.c: read all libraries; then the builder's row of a material. `colored`: the mesh
 * has vertex colours. */
status obj_read_libraries(struct obj *o) MUST_CHECK;
status obj_material_row(struct obj *o, uint32_t material, uint32_t line, int colored, uint32_t *row) MUST_CHECK;
void obj_material_release(struct obj_material *material);

/* obj_image.c: fill the slots of `out` from the maps of `in`. */
status obj_textures(struct obj *o, const struct obj_material *in, struct scene_material *out) MUST_CHECK;

/* obj_mesh.c: every part becomes a mesh and an instance. */
status obj_make_meshes(struct obj *o) MUST_CHECK;

extern const struct import_format format_obj;
