/* result: what an import is asked for, and what it gives. What all readers of files share; import.h is their front. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "client/import/builder/input_files.h"
#include "common/base/digest.h"
#include "common/scene/scene.h"
#include "common/schema/choices.h"
#include "common/scene/simplify/simplify.h"

enum {
    IMPORT_WARNINGS_MAX = 40,
    IMPORT_IMAGE_MEGAPIXELS = 270,          /* 16384 x 16384 fits */
    IMPORT_IMAGE_MEGAPIXELS_MAX = 17180,    /* IMAGE_SIDE_MAX squared */
};
#define LIGHT_UNITS_WORDS "auto|photometric|radiometric|watts"
#define IMPORT_FILE_BYTES_MAX ((size_t)8 << 30)
#define IMPORT_IMAGES_BYTES ((uint64_t)16 << 30)

struct import_options {
    const char *env_path;    /* EXR or Radiance HDR environment map; NULL: none */
    int64_t scene_index;     /* -1: the file's default scene */
    const char *variant;     /* of the materials, by name or number from 0; NULL: the default */
    const char *animation;   /* by name or number from 0, "none"; NULL: all of the file's */
    const char *light_units; /* of glTF's lights: a word of LIGHT_UNITS_WORDS */
    const char *studio; /* "on": a file without lights gets a studio's, and without a camera its ground, too; "off" */
    struct option_list outside; /* folders beside the scene's own that it may read from */
    const char *only_below;     /* in place of the scene's own; other files are reported as missing; NULL: no */
    int strict;                 /* refuse a scene of whose pictures one cannot be used */
    int64_t image_megapixels;   /* one image has at most this many 10^6 pixels */
    uint64_t images_bytes;      /* all images have at most this many bytes once decoded */
};
#define IMPORT_OPTIONS(studio_)                                                      \
    {.env_path = NULL, .scene_index = -1, .variant = NULL, .animation = NULL,        \
     .light_units = "auto", .studio = (studio_), .image_megapixels = IMPORT_IMAGE_MEGAPIXELS,             \
     .images_bytes = IMPORT_IMAGES_BYTES}
#define IMPORT_OPTIONS_DEFAULT IMPORT_OPTIONS("off")
#define IMPORT_OPTIONS_OF_COMMANDS IMPORT_OPTIONS("on")

struct import_blob {
    struct digest digest;
    uint8_t *data; /* owned by the result */
    size_t size_bytes;
};

/* An animation that the file has. */
struct import_animation {
    const char *name;
    double duration_s;
    int taken; /* into the scene */
};

/* The file's own render settings; 0: not given. */
struct import_hints {
    uint32_t width, height;                           /* pixels */
    uint32_t crop_x, crop_y, crop_width, crop_height; /* the part that is wanted; no width: all */
    int has_max_depth, has_filter;
    uint32_t spp, max_depth; /* as in struct render_settings, these */
    enum pixel_filter pixel_filter;
    float filter_width;
};

struct import_result {
    struct scene scene;
    struct import_blob *blobs; /* distinct: exactly those of scene_blobs() */
    size_t blob_count;
    uint8_t *packed; /* scene_pack()'s bytes, themselves a blob to submit */
    size_t packed_bytes;
    struct digest scene_digest; /* of `packed`: the scene's name */
    char **warnings;
    size_t warning_count;

    struct import_hints hints;

    /* for the report */
    char *source;             /* the path as given */
    struct input_files files; /* that were read, sorted by name */
    uint64_t file_bytes;
    uint64_t triangles;        /* in meshes, each mesh once */
    uint64_t triangles_placed; /* in instances */
    uint64_t vertices;
    uint64_t degenerate_triangles; /* dropped */
    uint64_t blob_bytes;
    double position_spacing_m; /* of the AOV position at the far end of the scene: floats' spacing */
    struct scene_simplify_report simplified;
    struct import_animation *animations; /* in the scene's arena, like the variants' names */
    size_t animation_count;
    const char **variants;
    size_t variant_count;
    int variant_taken; /* -1: the default materials */
};
