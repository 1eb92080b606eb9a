/* pbrt_text: small pbrt scenes for tests of the importer. Every function fails the running test
 * when something goes wrong. */
#pragma once

#include "client/import/import.h"

/* A camera at (0, 0, 5) of a right-handed world (Scale -1 1 1 turns pbrt's into one). */
#define EYE "Scale -1 1 1 LookAt 0 0 5 0 0 0 0 1 0 Camera \"perspective\"\n"
#define RIGHT_HANDED "Film \"rgb\" " EYE
#define TRIANGLE                                                                \
    "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2]\n"
/* A light that changes nothing else: a scene without any is given one. */
#define LAMP "LightSource \"point\"\n"

/* Import RIGHT_HANDED, WorldBegin and `world`. */
void pbrt_world(const char *world, struct import_result *out);
/* The whole text; other files are looked for in `folder` (may be NULL). */
void pbrt_whole(const char *text, const char *folder, struct import_result *out);
/* It must fail, and the message hold all of `words` ("a|b"). */
void pbrt_refused(const char *text, const char *words);
/* Read it, and forget what came of it: for starve_each. */
status pbrt_read_only(const char *text);
/* One warning holds all of `words` ("a|b"). */
int pbrt_has_warned(const struct import_result *r, const char *words);
void pbrt_warned(const struct import_result *r, const char *words);
/* The material of a triangle with this Material directive. */
struct scene_material pbrt_material_of(const char *directive, struct import_result *out);

/* A folder for the files of a test; pbrt_folder_remove() takes all of it away. */
char *pbrt_folder_make(void);
void pbrt_folder_put(const char *folder, const char *name, const void *data, size_t size_bytes);
void pbrt_folder_remove(char *folder);
