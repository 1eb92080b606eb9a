/* pbrt_context: a pbrt file that is being read: its state, and what the importer's files do with it.
 *
 * The base of the importer, at the bottom: pbrt.h is its front. */
#pragma once

#include "client/import/builder/builder.h"
#include "client/import/builder/mesh.h"
#include "client/import/pbrt/read/pbrt_params.h"
#include "client/import/pbrt/read/pbrt_spectrum.h"
#include "client/import/pbrt/read/pbrt_token.h"
#include "common/image/image.h"

enum {
    PBRT_STACK_MAX = 1 << 14,       /* nested attributes */
    PBRT_TEXTURE_DEPTH_MAX = 32,
    PBRT_TEXTURE_COST_MAX = 256,    /* nodes evaluated for one texel */
    PBRT_MATERIAL_DEPTH_MAX = 16,   /* mixes of mixes */
    PBRT_BAKE_SIDE_MAX = 4096,      /* texels of a computed texture */
    PBRT_BAKE_TEXELS_MAX = 1 << 23,
    PBRT_IMAGES_BYTES_MAX = 1 << 30,   /* decoded for one computed texture */
    PBRT_IMAGES_BYTES_KEPT = 1 << 28,  /* afterwards */
    PBRT_OBJECT_SHAPES_MAX = 1 << 22,
    PBRT_MAX_DEPTH = 5,                /* pbrt's default */
};

/* ---- a table by name ---------------------------------------------------------------------- */

struct pbrt_entry {
    void *key;
    size_t key_bytes;
    void *value;
};
/* Open addressing; keys are copied into the arena. */
struct pbrt_table {
    struct pbrt_entry *entries;
    size_t count, size;
};
void *pbrt_table_find(const struct pbrt_table *t, const void *key, size_t key_bytes);
/* Replaces a former value. */
void pbrt_table_set(struct pbrt_table *t, struct arena *arena, const void *key, size_t key_bytes, void *value);
void *pbrt_name_find(const struct pbrt_table *t, const char *name);

/* What a name was before the attribute block at hand. */
struct pbrt_renamed {
    struct pbrt_table *table;
    const char *name;
    void *former;
};

/* ---- textures ----------------------------------------------------------------------------- */

enum pbrt_texture_op {
    TEXTURE_CONSTANT, /* value */
    TEXTURE_IMAGE,
    TEXTURE_SCALE,    /* child 0 times child 1 */
    TEXTURE_MIX,      /* child 0 to child 1 by child 2 */
    TEXTURE_CHECKER,  /* child 0 where floor(s) + floor(t) is even, else child 1 */
    TEXTURE_MASK,     /* 1 where child 0 is not 0 */
    TEXTURE_UV,       /* the fractions of s and t as red and green */
    TEXTURE_DOTS,     /* child 0 in random dots, child 1 around them */
    TEXTURE_BILERP,   /* corner[0] at (0, 0), [1] at (0, 1), [2] at (1, 0), [3] at (1, 1) */
    TEXTURE_DIRECTION_MIX /* child 0: pbrt would mix by direction */
};

/* A picture file that textures use, read once. */
struct pbrt_image {
    const char *name;
    struct pbrt_place at;
    int64_t row;         /* of the builder's images, BUILDER_NO_ROW: not yet */
    int is_float;        /* EXR, HDR, PFM: linear */
    int has_codes;       /* of 8 bits; known when it is decoded */
    struct buffer bytes; /* until it has a row */
    uint32_t width, height, channels;
    struct image pixels; /* as in the file, 8 and 16 bit as 0..1; empty until used */
};

struct pbrt_texture {
    enum pbrt_texture_op op;
    int is_color;
    double value[3];
    const struct pbrt_texture *child[3];
    double corner[4][3];
    struct pbrt_image *image;
    enum scene_wrap wrap;
    int nearest;
    double gamma; /* of 8 bit images: 0 sRGB, 1 linear, else the power */
    double scale;
    int invert;
    int by_luminance;     /* pbrt-v3's number of a colour; pbrt-v4's is the mean, or alpha */
    double mapping[2][3]; /* (s, t) from (u, v, 1); t runs upwards */
    unsigned depth, cost;
};

/* ---- the graphics state ------------------------------------------------------------------- */

enum pbrt_color_space { SPACE_SRGB, SPACE_REC2020, SPACE_DCI_P3, SPACE_ACES, SPACE_COUNT };

struct pbrt_matrices {
    struct transform_d at[2]; /* at the start and the end of the animation; object to world */
};

/* A Material directive; it is resolved when a shape uses it. */
struct pbrt_material {
    const char *kind, *name; /* kind NULL: named by NamedMaterial at `at`, not defined yet */
    struct pbrt_place at;
    int known; /* all names in it are defined (pbrt_late.c) */
    struct pbrt_params *params;
    int is_derived; /* its params are a shape's, their defaults the material's (pbrt_override.c) */
    int resolved;
    int refused; /* not a supported surface: grey */
    struct scene_material base;
    const struct pbrt_texture *color;   /* of base.base_color, before it is put into a slot */
    int color_in_slot;                  /* base.base_color and its texture already contain it */
    const struct pbrt_texture *opacity; /* pbrt-v3's uber; NULL: opaque */
    struct pbrt_material *mix[2];
    int wants_tangents;
    struct pbrt_variant *variants;
};

struct pbrt_area_light {
    struct pbrt_place at;
    struct pbrt_params *params;
    int resolved;
    double radiance[3];    /* for a scale of 1 */
    double power;          /* <= 0: not given */
    double mean_luminance; /* of its image */
    struct pbrt_image *image;
    int two_sided;
    struct pbrt_variant *variants;
};

struct pbrt_state {
    struct pbrt_matrices ctm;
    unsigned active; /* bit 0: start, bit 1: end */
    int reversed;
    int color_space;
    struct pbrt_material *material;
    struct pbrt_area_light *area_light;
    const char *inside, *outside; /* media; "" none */
    /* Of Attribute "shape" and so on. */
    struct pbrt_params *shape_defaults, *light_defaults, *material_defaults, *medium_defaults, *texture_defaults;
    size_t renamed;   /* of struct pbrt: so many when the block began */
    int is_attribute; /* pushed by AttributeBegin (not TransformBegin, ObjectBegin, Import) */
};

/* One shape of an object definition. */
struct pbrt_part {
    const char *name, *asset; /* as in struct scene_instance */
    uint32_t mesh, material;
    struct pbrt_matrices ctm;
    struct pbrt_place at;
};
struct pbrt_object {
    const char *name; /* the scene's */
    struct pbrt_part *parts;
    size_t count, capacity;
    struct pbrt_object *former; /* defined before it */
    int waits;                  /* for definitions: not all of its shapes are parts yet */
};

struct pbrt_directive {
    const char *kind;
    struct pbrt_place at;
    struct pbrt_params *params;
    struct pbrt_matrices ctm;
};

struct pbrt {
    struct builder *b;
    struct error *err;
    struct arena arena;
    struct pbrt_reader reader;
    struct pbrt_params params; /* of the directive at hand */
    struct pbrt_state now;
    struct pbrt_state *stack;
    int *stack_kinds;
    size_t stack_count, stack_capacity, kinds_capacity;
    size_t import_depth[PBRT_INCLUDE_DEPTH_MAX]; /* reader depth of each Import under way */
    size_t import_count;
    int in_world;
    int version3;
    int mirrored;

    struct pbrt_directive camera, film;
    const char *camera_medium;
    double time_start, time_end; /* of the two matrices */
    double shutter_open, shutter_close;
    int is_animated;         /* something moves */
    long max_depth, samples; /* -1: not given */
    struct pbrt_place depth_at, samples_at;

    struct pbrt_table float_textures, color_textures, materials, media, objects, systems, images, texture_rows, spectra;
    struct pbrt_renamed *renamed; /* pbrt-v3: textures and materials are names of their attribute block */
    size_t renamed_count, renamed_capacity;
    struct pbrt_table masks;         /* pbrt-v3: by the texture that they are made of */
    struct pbrt_table derived;       /* pbrt-v3: materials with a shape's own parameters */
    struct pbrt_table defined;       /* pbrt-v4: the place of each definition, by kind and name */
    struct pbrt_params **attributes; /* of all Attribute directives */
    size_t attribute_count, attribute_capacity;
    struct pbrt_late *late; /* pbrt-v4: what uses names that are defined later */
    size_t late_count, late_capacity;
    struct pbrt_material *default_material;
    struct pbrt_texture *white;
    struct pbrt_object *object; /* being defined, or NULL */
    struct pbrt_object *last_object;
    uint32_t shape_count; /* without a name of their own */
    size_t image_bytes;   /* decoded */

    int64_t last_node; /* of last_ctm, BUILDER_NO_ROW: none */
    struct pbrt_matrices last_ctm;
    int environments; /* infinite lights so far */
    int has_origin;   /* a shape with vertices has been read: */
    double origin[3]; /* the world's origin of positions (mesh_origin_choose) */
};

#define pbrt_warn(p, where, kind, ...) \
    builder_warn_at((p)->b, (where)->file, (where)->line, (kind), __VA_ARGS__)
/* An error at a place; tells the builder that it names its file. */
#define pbrt_fail(p, code, where, ...) \
    ((p)->b->error_is_placed = 1, pbrt_error((p)->err, (code), (where), __VA_ARGS__))

/* ---- pbrt_table.c, pbrt_arguments.c ------------------------------------------------------- */
void pbrt_name_set(struct pbrt *p, struct pbrt_table *t, const char *name, const void *value);
/* In pbrt-v3 until the attribute block ends. */
void pbrt_name_set_here(struct pbrt *p, struct pbrt_table *t, const char *name, const void *value);
void pbrt_names_restore(struct pbrt *p, size_t count);
char *pbrt_keep(struct pbrt *p, const char *text); /* NULL: out of memory */

/* ---- pbrt_late.c -------------------------------------------------------------------------- */
/* Note the definition of a "material", "medium" and so on: a second one is an error in pbrt-v4. */
status pbrt_define(struct pbrt *p, const char *kind, const char *name, const struct pbrt_place *at) MUST_CHECK;
/* Shape, Texture and ObjectInstance: run them, or keep them in pbrt-v4 until the names that they use are defined. `name`: of the
 * texture or the object; `type`: of the texture. */
enum pbrt_late_kind { LATE_SHAPE, LATE_TEXTURE, LATE_INSTANCE };
status pbrt_now_or_late(struct pbrt *p, enum pbrt_late_kind kind, const char *name, const char *type,
                        const struct pbrt_directive *d) MUST_CHECK;
/* The file has ended: run what was kept. `at`: the place of what fails. */
status pbrt_late_finish(struct pbrt *p, struct pbrt_place *at) MUST_CHECK;

/* ---- pbrt_matrix.c ------------------------------------------------------------------------ */
/* The world matrix of an object at `ctm` at the start, with mirroring. */
struct transform_d pbrt_to_world(const struct pbrt *p, const struct transform_d *ctm);
/* Normalise; 0: the vector is zero. */
int pbrt_unit(double v[3]);
int pbrt_is_moving(const struct pbrt_matrices *m);
/* Rotation by degrees about an axis; 0: the axis is zero. */
int pbrt_rotation(double angle, const double given[3], struct transform_d *out);
/* From the world to a camera that stands at n[0..2], looks at n[3..5] with n[6..8] upwards:
 * x to the right of that in a left-handed world. 0: there is none. */
int pbrt_look_at(const double n[9], struct transform_d *out);

/* ---- pbrt_hints.c ------------------------------------------------------------------------- */
void pbrt_option(struct pbrt *p, const struct pbrt_directive *d);
void pbrt_sampler(struct pbrt *p, const struct pbrt_directive *d);
void pbrt_integrator(struct pbrt *p, const struct pbrt_directive *d);
void pbrt_filter(struct pbrt *p, const struct pbrt_directive *d);
/* The film's size and aspect, and the camera's exposure. */
void pbrt_film_hints(struct pbrt *p, struct scene_camera *camera, double *aspect);
/* Without an Integrator pbrt goes PBRT_MAX_DEPTH deep, as with one that names no depth. */
void pbrt_integrator_hints(struct pbrt *p);

/* ---- pbrt_camera.c, pbrt_motion.c --------------------------------------------------------- */
/* WorldBegin: the camera and the film are complete. */
status pbrt_camera(struct pbrt *p) MUST_CHECK;
/* A node that follows both matrices; BUILDER_NO_ROW in *row when they are equal. */
status pbrt_node(struct pbrt *p, const struct pbrt_matrices *ctm, const struct pbrt_place *at, int32_t *row) MUST_CHECK;

/* ---- pbrt_color.c ------------------------------------------------------------------------- */
enum pbrt_use { USE_REFLECTANCE, USE_UNBOUNDED, USE_LIGHT };
/* A colour parameter; *given is 0 (and `out` untouched) if there is none of that name. */
status pbrt_color(struct pbrt *p, struct pbrt_params *params, const char *name, enum pbrt_use use, double out[3],
                  int *given) MUST_CHECK;
/* Its spectrum, for metals and glasses; *given is 0 if it is not a spectrum. */
status pbrt_spectrum(struct pbrt *p, const struct pbrt_param *param, struct spectrum *out, int *given) MUST_CHECK;
status pbrt_color_of(struct pbrt *p, const struct pbrt_param *param, int color_space, enum pbrt_use use,
                     double out[3]) MUST_CHECK;
/* The file's colour space by its name; -1: unknown. */
int pbrt_space_of(const char *name);

/* ---- pbrt_texture.c ----------------------------------------------------------------------- */
/* Texture "name" "type" "kind" ... */
status pbrt_texture(struct pbrt *p, const char *name, const char *type, const struct pbrt_directive *d) MUST_CHECK;
/* Let the parameters' texture names mean what they mean now. */
void pbrt_textures_bind(const struct pbrt *p, struct pbrt_params *params);
/* A parameter that may be a number or a texture; NULL in *out when it is not given. */
status pbrt_float_texture(struct pbrt *p, struct pbrt_params *params, const char *name,
                          const struct pbrt_texture **out) MUST_CHECK;
status pbrt_color_texture(struct pbrt *p, struct pbrt_params *params, const char *name, enum pbrt_use use,
                          const struct pbrt_texture **out) MUST_CHECK;
const struct pbrt_texture *pbrt_constant(struct pbrt *p, double r, double g, double b);
/* a * b; NULL: out of memory. */
const struct pbrt_texture *pbrt_product(struct pbrt *p, const struct pbrt_texture *a, const struct pbrt_texture *b);

/* pbrt-v3's alpha: nothing where the texture is 0, opaque elsewhere. One for each texture. */
const struct pbrt_texture *pbrt_mask(struct pbrt *p, const struct pbrt_texture *t);

/* ---- pbrt_texture_slot.c ------------------------------------------------------------------ */
/* factor * slot = the colour, the factor within 0..limit (1, or more for light). `alpha`, not
 * constant or NULL, goes into the slot's alpha. */
status pbrt_color_slot(struct pbrt *p, const struct pbrt_texture *color, const struct pbrt_texture *alpha, float limit,
                       float factor[3], struct scene_texture_slot *slot) MUST_CHECK;
/* factor * slot (all four channels of it) = change(value), within 0..1. */
typedef double pbrt_change(double value, double parameter);
status pbrt_scalar_slot(struct pbrt *p, const struct pbrt_texture *value, pbrt_change *change, double parameter,
                        float *factor, struct scene_texture_slot *slot) MUST_CHECK;
/* An image without uv mapping except the flip of v. */
status pbrt_image_slot(struct pbrt *p, struct pbrt_image *image, enum scene_encoding encoding, enum scene_wrap wrap,
                       int nearest, struct scene_texture_slot *slot) MUST_CHECK;

/* ---- pbrt_image.c ------------------------------------------------------------------------- */
/* The picture of that file name, from the cache; NULL in *out, after a warning, when its form is not read. */
status pbrt_image(struct pbrt *p, const char *name, const struct pbrt_place *at, struct pbrt_image **out) MUST_CHECK;
status pbrt_image_decode(struct pbrt *p, struct pbrt_image *image) MUST_CHECK;
status pbrt_image_row(struct pbrt *p, struct pbrt_image *image, uint32_t *row) MUST_CHECK;
void pbrt_image_forget(struct pbrt_image *image);
/* Free decoded pictures if they take much memory. */
void pbrt_images_trim(struct pbrt *p);
/* pbrt-v4's square map of equal areas (Clarberg 2008) to lat-long. The map's axes are x, z and
 * y_sign (1 or -1) times y of the light's space. */
status pbrt_octahedral_to_latlong(const struct image *square, double y_sign, struct image *out,
                                  struct error *err) MUST_CHECK;

/* ---- pbrt_material.c ---------------------------------------------------------------------- */
/* The material as a shape needs it. */
struct pbrt_surface {
    const char *name; /* the shape's, for which this is; no part of the material */
    struct pbrt_material *material;
    struct pbrt_area_light *light;    /* NULL: does not shine */
    const struct pbrt_texture *alpha; /* NULL: opaque */
    int32_t medium, medium_outside;   /* BUILDER_NO_ROW: none; the same: no change */
    double area;                      /* m^2 in the world, for lights with a power */
    int one_sided;                    /* only its front exists */
};
status pbrt_material_resolve(struct pbrt *p, struct pbrt_material *m, unsigned depth) MUST_CHECK;
/* The names of a mix's two parts; 0: it does not give them. */
int pbrt_mix_parts(const struct pbrt_material *m, const char *part[2]);
status pbrt_material_row(struct pbrt *p, const struct pbrt_surface *s, uint32_t *row) MUST_CHECK;
/* pbrt-v3: the material with those of the shape's parameters that the shape has not used itself. */
status pbrt_override(struct pbrt *p, struct pbrt_params *shape, struct pbrt_material **m) MUST_CHECK;
/* Does any of its parts, or `alpha`, use texture coordinates or tangents? */
int pbrt_material_uses_uv(const struct pbrt_material *m);
int pbrt_material_wants_tangents(const struct pbrt_material *m);
/* The mean luminance of a picture used for a light. */
status pbrt_image_luminance(struct pbrt *p, struct pbrt_image *image, double *out) MUST_CHECK;

/* ---- pbrt_light.c, pbrt_medium.c, pbrt_shape.c, pbrt_shape_kinds.c --------------------------- */
status pbrt_light(struct pbrt *p, const struct pbrt_directive *d) MUST_CHECK;
status pbrt_area_light_resolve(struct pbrt *p, struct pbrt_area_light *light) MUST_CHECK;
void pbrt_medium(struct pbrt *p, const char *name, const struct pbrt_directive *d);
/* The row of a medium by name, BUILDER_NO_ROW: none or unknown (warned about). */
status pbrt_medium_row(struct pbrt *p, const char *name, const struct pbrt_place *at, int32_t *row) MUST_CHECK;
status pbrt_shape(struct pbrt *p, const struct pbrt_directive *d) MUST_CHECK;
/* Makes the mesh of one kind of shape; `out` is zeroed by the caller, and released. */
typedef status pbrt_shape_make(struct pbrt *p, const struct pbrt_directive *d, struct mesh_source *out);
/* NULL: the kind is not supported. */
pbrt_shape_make *pbrt_shape_kind(const char *kind);
status pbrt_instance(struct pbrt *p, const struct pbrt_part *part) MUST_CHECK;
/* ObjectInstance "name" */
status pbrt_object_place(struct pbrt *p, const char *name, const struct pbrt_place *at) MUST_CHECK;
