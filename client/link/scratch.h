/* scratch: a temporary folder that does not stay behind, even after SIGKILL.
 *
 * The folder is TMPDIR/azulejo-render-XXXXXX. Its owner holds a lock (flock) on the file `owner` in
 * it for as long as it lives, and a coordinator that uses it as its store holds a lock on `lock`. A
 * folder of ours without a held lock is stale: creating the next scratch folder removes it first.
 */
#pragma once

#include "common/base/status.h"

enum { SCRATCH_PATH_SIZE = 4096 };

struct scratch {
    char path[SCRATCH_PATH_SIZE]; /* "": there is none */
    int owner_fd;
};

/* Remove stale ones and make a new one. ERR_IO. After a failure scratch_remove is still fine. */
status scratch_make(struct scratch *scratch, struct error *err) MUST_CHECK;
/* Remove it with its contents, and release the lock. Calling it twice is fine. */
void scratch_remove(struct scratch *scratch);
