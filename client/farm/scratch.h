/* scratch: a temporary folder that nothing leaves behind, not even SIGKILL.
 *
 * The folder is TMPDIR/azulejo-render-XXXXXX. Its owner holds a lock (flock) on the file `owner` in it for
 * as long as it lives, and a coordinator whose store it is one on `lock`. A folder of ours that
 * neither holds is stale: the next scratch folder that is made removes it first.
 */
#ifndef AZULEJO_CLIENT_SCRATCH_H
#define AZULEJO_CLIENT_SCRATCH_H

#include "common/base/status.h"

enum { SCRATCH_PATH_SIZE = 4096 };

struct scratch {
    char path[SCRATCH_PATH_SIZE]; /* "": there is none */
    int owner_fd;
};

/* Remove stale ones and make a new one. ERR_IO. After a failure scratch_remove is still fine. */
status scratch_make(struct scratch *scratch, struct error *err) MUST_CHECK;
/* Remove it with all that it holds, and let go of the lock. Twice is fine. */
void scratch_remove(struct scratch *scratch);

#endif
