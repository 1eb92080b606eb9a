/* key_file: the key by which the worker proves its role, and the file that it was read from.
 *
 * A farm's key may be replaced while workers run. Each of them reads its file again before an
 * attempt to connect that follows a failed one, so that a new key takes effect without a
 * restart. A file that cannot be used then (missing, half written, another role's) is logged
 * once and the key that was read before stays in use.
 */
#ifndef AZULEJO_WORKER_KEY_FILE_H
#define AZULEJO_WORKER_KEY_FILE_H

#include <sys/stat.h>

#include "common/base/status.h"
#include "protocol/key.h"

struct key_file {
    const char *path;
    struct farm_key key;
    struct stat seen; /* the file when it was last read; all zero when it could not be found */
};

/* Read it. ERR_INPUT or ERR_IO: no key file; ERR_REFUSED: a key that cannot act as worker.
 * `path` must outlive the key_file. */
status key_file_load(struct key_file *file, const char *path, struct error *err) MUST_CHECK;

/* Read it again if it changed since. 1: `key` is another one now. */
int key_file_refresh(struct key_file *file);

#endif
