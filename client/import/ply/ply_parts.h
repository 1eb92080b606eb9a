/* ply_parts: shared by the parts of the PLY reader; private to them. */
#pragma once

#include "client/import/ply/ply.h"

enum ply_format { FORMAT_NONE, FORMAT_ASCII, FORMAT_LITTLE, FORMAT_BIG };
enum ply_type {
    TYPE_NONE,
    TYPE_I8,
    TYPE_U8,
    TYPE_I16,
    TYPE_U16,
    TYPE_I32,
    TYPE_U32,
    TYPE_F32,
    TYPE_F64
};

/* What a property means here. */
enum ply_role {
    ROLE_X,
    ROLE_Y,
    ROLE_Z,
    ROLE_NX,
    ROLE_NY,
    ROLE_NZ,
    ROLE_U,
    ROLE_V,
    ROLE_RED,
    ROLE_GREEN,
    ROLE_BLUE,
    ROLE_ALPHA,
    ROLE_COUNT,
    ROLE_CORNERS,
    ROLE_TEXCOORDS, /* u and v of each corner of a face */
    ROLE_TEXNUMBER, /* which of the textures a face shows */
    ROLE_NONE
};

struct property {
    enum ply_type type;
    enum ply_type count_type; /* TYPE_NONE: not a list */
    enum ply_role role;
};

enum element_kind { ELEMENT_VERTEX, ELEMENT_FACE, ELEMENT_STRIPS, ELEMENT_OTHER };

struct element {
    enum element_kind kind;
    uint64_t count;
    uint32_t first_property, property_count;
};

struct ply_list {
    float *values;
    size_t count, capacity;
};

struct ply {
    const uint8_t *at, *start, *end;
    struct error *err;
    enum ply_format format;
    struct element elements[PLY_ELEMENTS_MAX];
    size_t element_count;
    struct property *properties; /* of all elements */
    size_t property_count, property_capacity;
    size_t line; /* 1..: of the header, then of ascii data */

    struct mesh_source *out;
    const struct ply_origin *origin; /* NULL: mesh_origin_choose */
    struct ply_report report;
    int has_vertices, has_faces, has_strips;
    uint32_t *corners; /* of all faces */
    size_t corner_count, corner_capacity;
    uint32_t *sizes; /* corners of each face */
    size_t face_count, face_capacity;
    struct ply_list corner_uv;   /* [2] a corner, or empty */
    struct ply_list face_colors; /* [4] a face, or empty */
};

float ply_finite(double value); /* 0 for what is not finite */

/* ply_corners.c: the list of a face whose corners begin, or will begin, at `first_corner`. */
status ply_texcoords_read(struct ply *p, const struct property *property, size_t first_corner) MUST_CHECK;
/* The face is read: as many values as corners. */
void ply_texcoords_end(struct ply *p);
/* For the last face. */
void ply_face_color_add(struct ply *p, const float color[4]);
/* Make a vertex of each distinct corner, if corners have more than their vertex. */
status ply_corners_split(struct ply *p) MUST_CHECK;

/* ply_header.c: fill format, elements and properties; `at` ends behind end_header. */
status ply_header_read(struct ply *p) MUST_CHECK;

/* ply_values.c: the data at p->at, as p->format and a property's types say. */
status ply_value_read(struct ply *p, enum ply_type type, double *out) MUST_CHECK;
/* The number of values in a list: no more than the bytes that are left can hold. */
status ply_list_size(struct ply *p, const struct property *property, size_t *out) MUST_CHECK;
status ply_property_skip(struct ply *p, const struct property *property) MUST_CHECK;
/* Are there enough bytes for the elements, if each is as short as possible? */
status ply_check_room(struct ply *p, const struct element *element) MUST_CHECK;
