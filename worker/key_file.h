/* key_file: the key with which the worker proves its role, and the file it was read from.
 *
 * A farm's key may be replaced while workers run. A worker reads the file again before each attempt to connect that
 * follows a failed one, so a new key takes effect without a restart. If the file cannot be used then (missing, half
 * written, another role's), this is logged once and the previous key stays in use.
 */
#pragma once

#include <sys/stat.h>

#include "common/base/status.h"
#include "protocol/key.h"

struct key_file {
    const char *path;
    struct farm_key key;
    struct stat seen; /* the file when it was last read; all 0 if it was not found */
};

/* Read it. ERR_INPUT or ERR_IO: not a key file; ERR_REFUSED: a key that cannot act as worker.
 * `path` must outlive the key_file. */
status key_file_load(struct key_file *file, const char *path, struct error *err) MUST_CHECK;

/* Read it again if it has changed. 1: `key` is now another one. */
int key_file_refresh(struct key_file *file);
