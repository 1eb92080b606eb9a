/* import: a scene file becomes the one scene description plus its blobs.
 *
 * Formats: glTF 2.0, as .gltf or .glb, and the others of the table in import.c, recognised by their
 * content first, their name second. Files are hostile: a bad one gives an error that names file,
 * place and remedy. An unsupported feature is a warning, once per kind, with a count. Only what the
 * chosen scene reaches is read and kept. Same file, same result, to the bit.
 */
#pragma once

#include <stddef.h>
#include <stdio.h>

#include <jansson.h>

#include "client/import/builder/result.h"
#include "common/base/status.h"

/* Read the file at `path`. ERR_INPUT, ERR_UNSUPPORTED, ERR_LIMIT, ERR_NO_MEMORY. `out` is
 * initialised in every case, and empty after a failure. */
status import_scene(const char *path, const struct import_options *options, struct import_result *out,
                    struct error *err) MUST_CHECK;

/* The same from memory. `name` is the file's name in messages; other files that it names are
 * searched for in `folder`, or refused if that is NULL. */
status import_scene_memory(const void *data, size_t size_bytes, const char *name, const char *folder,
                           const struct import_options *options, struct import_result *out,
                           struct error *err) MUST_CHECK;

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
    {"studio", 0, OPTION_CHOICE, &(o).studio, "on|off",                                         \
     "whether a scene without lights gets a soft studio light, and without a camera a ground, too (default on; off: an even white environment)", 0, 0,      \
     "on|off"},                                                                                 \
    {"allow-outside", 0, OPTION_LIST, &(o).outside, "DIR",                                      \
     "let the scene read files below this folder, too (default: below its own folder only)", 0, \
     0, NULL},                                                                                  \
    {"only-below", 0, OPTION_STRING, &(o).only_below, "DIR",                                    \
     "let the scene read files below this folder only, and learn of no others: for scenes of "  \
     "strangers", 0, 0, NULL},                                                                  \
    {"strict", 0, OPTION_FLAG, &(o).strict, NULL,                                               \
     "refuse a scene that names a picture which is missing, damaged or in a form that is not "  \
     "read (default: a warning, and the surface without it)", 0, 0, NULL},                      \
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
