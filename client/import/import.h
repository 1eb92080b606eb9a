/* import: a scene file becomes the one scene description plus its blobs.
 *
 * Formats: glTF 2.0, as .gltf or .glb, and the others of the table in import.c, recognised by their
 * content first, their name second. Files are hostile: a bad one gives an error that names file,
 * place and remedy. An unsupported feature is a warning, once per kind, with a count. Only what the
 * chosen scene reaches is read and kept. Same file, same result, to the bit.
 */
#ifndef AZULEJO_IMPORT_IMPORT_H
#define AZULEJO_IMPORT_IMPORT_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <jansson.h>

#include "client/import/builder/input_files.h"
#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/scene/scene.h"
#include "common/scene/simplify.h"

enum {
    IMPORT_WARNINGS_MAX = 40,
    IMPORT_IMAGE_MEGAPIXELS = 270,          /* 16384 x 16384 fits */
    IMPORT_IMAGE_MEGAPIXELS_MAX = 17180,    /* IMAGE_SIDE_MAX squared */
};
#define LIGHT_UNITS_WORDS "auto|photometric|radiometric|watts"
#define IMPORT_FILE_BYTES_MAX ((size_t)8 << 30)
#define IMPORT_IMAGES_BYTES ((uint64_t)16 << 30)

struct import_options {
    const char *env_path;   /* EXR or Radiance HDR environment map; NULL: none */
    int64_t scene_index;    /* -1: the file's default scene */
    const char *variant;    /* of the materials, by name or number from 0; NULL: the default */
    const char *animation;  /* by name or number from 0, "none"; NULL: all of the file's */
    const char *light_units;        /* of glTF's lights: a word of LIGHT_UNITS_WORDS */
    struct option_list outside;     /* folders beside the scene's own that it may read from */
    const char *only_below;         /* in place of the scene's own; other files are reported as missing; NULL: no */
    int64_t image_megapixels;       /* one image has at most this many 10^6 pixels */
    uint64_t images_bytes;          /* all images have at most this many bytes once decoded */
};
#define IMPORT_OPTIONS_DEFAULT                                                       \
    {.env_path = NULL, .scene_index = -1, .variant = NULL, .animation = NULL,        \
     .light_units = "auto", .image_megapixels = IMPORT_IMAGE_MEGAPIXELS,             \
     .images_bytes = IMPORT_IMAGES_BYTES}

struct import_blob {
    struct digest digest;
    uint8_t *data;          /* owned by the result */
    size_t size_bytes;
};

/* An animation that the file has. */
struct import_animation {
    const char *name;
    double duration_s;
    int taken;              /* into the scene */
};

/* The file's own render settings; 0: not given. */
struct import_hints {
    uint32_t width, height;         /* pixels */
    uint32_t spp;
    int has_max_depth;
    uint32_t max_depth;             /* as in struct render_settings */
};

struct import_result {
    struct scene scene;
    struct import_blob *blobs;      /* distinct: exactly those of scene_blobs() */
    size_t blob_count;
    uint8_t *packed;                /* scene_pack()'s bytes, themselves a blob to submit */
    size_t packed_bytes;
    struct digest scene_digest;     /* of `packed`: the scene's name */
    char **warnings;
    size_t warning_count;

    struct import_hints hints;

    /* for the report */
    char *source;                   /* the path as given */
    struct input_files files;       /* that were read, sorted by name */
    uint64_t file_bytes;
    uint64_t triangles;             /* in meshes, each mesh once */
    uint64_t triangles_placed;      /* in instances */
    uint64_t vertices;
    uint64_t degenerate_triangles;  /* dropped */
    uint64_t blob_bytes;
    double position_spacing_m;      /* of the AOV position at the far end of the scene: floats' spacing */
    struct scene_simplify_report simplified;
    struct import_animation *animations; /* in the scene's arena, like the variants' names */
    size_t animation_count;
    const char **variants;
    size_t variant_count;
    int variant_taken;                   /* -1: the default materials */
};

/* Read the file at `path`. ERR_INPUT, ERR_UNSUPPORTED, ERR_LIMIT, ERR_NO_MEMORY. `out` is
 * initialised in every case, and empty after a failure. */
status import_scene(const char *path, const struct import_options *options,
                    struct import_result *out, struct error *err) MUST_CHECK;

/* The same from memory. `name` is the file's name in messages; other files that it names are
 * searched for in `folder`, or refused if that is NULL. */
status import_scene_memory(const void *data, size_t size_bytes, const char *name,
                           const char *folder, const struct import_options *options,
                           struct import_result *out, struct error *err) MUST_CHECK;

void import_result_release(struct import_result *result);

/* The rows of a command's table that fill in the struct import_options `o`. */
#define IMPORT_OPTION_ROWS(o)                                                                   \
    {"env", 'e', OPTION_STRING, &(o).env_path, "FILE",                                          \
     "light the scene with this lat-long environment map (EXR or Radiance HDR)", 0, 0, NULL},   \
    {"scene", 0, OPTION_INT, &(o).scene_index, "N",                                             \
     "which of the file's scenes, from 0 (default: the one that the file names)", -1, 1e6,      \
     NULL},                                                                                     \
    {"variant", 0, OPTION_STRING, &(o).variant, "NAME|N",                                       \
     "which of the file's material variants, by name or number from 0 (default: none)", 0, 0,   \
     NULL},                                                                                     \
    {"animation", 0, OPTION_STRING, &(o).animation, "NAME|N|none",                              \
     "which of the file's animations, by name or number from 0 (default: all)", 0, 0, NULL},    \
    {"light-units", 0, OPTION_CHOICE, &(o).light_units, "UNITS",                                \
     "units of a glTF file's light intensities: candela and lux, W/sr and W/m^2, or Blender's watts (default auto: by the exporter's version, else radiometric)", 0, 0,      \
     LIGHT_UNITS_WORDS},                                                                        \
    {"allow-outside", 0, OPTION_LIST, &(o).outside, "DIR",                                      \
     "let the scene read files below this folder, too (default: below its own folder only)", 0, \
     0, NULL},                                                                                  \
    {"only-below", 0, OPTION_STRING, &(o).only_below, "DIR",                                    \
     "let the scene read files below this folder only, and learn of no others: for scenes of "  \
     "strangers", 0, 0, NULL},                                                                  \
    {"max-image", 0, OPTION_INT, &(o).image_megapixels, "MEGAPIXELS",                           \
     "refuse larger images (default 270, which 16384x16384 fits)", 1,                           \
     IMPORT_IMAGE_MEGAPIXELS_MAX, NULL},                                                        \
    {"max-image-memory", 0, OPTION_SIZE, &(o).images_bytes, "SIZE",                             \
     "refuse scenes whose images need more memory when decoded (default 16G)", 0, 0, NULL}

/* A report of the import, for people. */
void import_report_print(const struct import_result *result, FILE *out);

/* The same for programs; a new reference, or NULL when out of memory. */
json_t *import_report_json(const struct import_result *result);

/* The files that it was read from, [{"name", "bytes"}]; a new reference, or NULL. */
json_t *import_inputs_json(const struct import_result *result);

#endif
