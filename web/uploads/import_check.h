/* import_check: what an uploaded file may be called, with which options its scene may be submitted, and what
 * is shown of the importer's words. Functions of their arguments. */
#pragma once

#include <jansson.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

enum {
    IMPORT_PATH_MAX = 1024,      /* bytes of a path below the upload's folder, */
    IMPORT_NAME_MAX = 255,       /* of each of its names, */
    IMPORT_DEPTH_MAX = 32,       /* and how many these may be */
    IMPORT_OPTIONS_MAX = 64,
    IMPORT_VALUE_MAX = 1024,
};

/* Is this a plain relative path ("textures/wood.png")? ERR_USAGE names what is wrong with it. */
status import_path_check(const char *path, struct error *err) MUST_CHECK;

/* Words for the command line of `azulejo submit`. Zero-initialise. */
struct import_words {
    char *items[IMPORT_OPTIONS_MAX];
    size_t count;
};
/* Of a JSON array as ["--spp", "64", "--alpha"]: "--spp=64", "--alpha". Options that name files get paths
 * below the upload's folder. ERR_USAGE; release after a failure, too. */
status import_words_read(struct import_words *out, const json_t *options, struct error *err) MUST_CHECK;
void import_words_release(struct import_words *words);

/* The importer's error out of what it printed to its standard error: one sentence, without the folder where
 * the files are. "": it gave none. */
void import_sentence(char *out, size_t size, const char *printed, const char *folder);
/* Its warnings: a JSON array of texts, treated in the same way. NULL: out of memory. */
json_t *import_warnings(const char *printed, const char *folder);
