/* imported: scene files and texts, imported and rendered as a user would have them: for tests of
 * the whole way from a file to radiance. Every function aborts the test program when something
 * goes wrong that the test is not about. */
#pragma once

#include "client/import/import.h"
#include "common/scene/settings.h"
#include "common/film/film.h"
#include "worker/render/render.h"

/* The blobs of an import; `import` must outlive it. */
struct blob_source imported_source(struct import_result *import);

/* A scene file, by the default options and without any warning. */
void imported_file(const char *path, struct import_result *import);
/* With this environment map, or its own lights (NULL); warnings may be. */
void imported_file_under(const char *path, const char *env, struct import_result *import);

/* A text whose other files are looked for in `folder` (may be NULL); `name` tells the format. */
void imported_text(const char *text, const char *name, const char *folder, struct import_result *import);

/* The scene made ready for `frame`, edits of import->scene included. */
struct render_scene *imported_build(struct import_result *import, const struct render_settings *settings,
                                    uint32_t frame);

/* Settings of a small picture with this many samples. */
struct render_settings imported_settings(uint32_t width, uint32_t height, uint32_t spp);

/* Merge every unit that the film's cap allows; counts are added to *stats. */
void imported_render_film(const struct render_scene *scene, uint32_t frame, struct film *film,
                          struct render_stats *stats);
/* The same in steps: everything is wanted; a tile's units. */
void imported_want_film(struct film *film);
void imported_render_tile(const struct render_scene *scene, uint32_t frame, uint32_t tile, struct film *film,
                          struct render_stats *stats);
/* The mean picture [height][width][3] of one frame. */
void imported_render_scene(const struct render_scene *scene, const struct render_settings *settings, uint32_t frame,
                           float *picture);
void imported_render(struct import_result *import, const struct render_settings *settings, uint32_t frame,
                     float *picture);
