/* sweep: blobs that no job needs are removed.
 *
 * A blob is needed if it is a stored job's scene, one of that scene's blobs, or its tone mapping's file. It is kept,
 * too, if a client named or sent it at or after `cutoff_ns` (blobs_hold): that client may be about to submit a
 * job with it. The caller chooses a cutoff that is not after the first question of any client that is connected.
 * Looking at a blob's age and removing it exclude blobs_hold, so a blob that a client knows to be there
 * stays. If it is not known which blobs a job needs, none is removed.
 *
 * While a backup is made (store_hold.h) nothing is removed.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"

/* A job, as the owner of blobs. */
struct blob_user {
    uint64_t job;
    struct digest scene, file;
    int has_file;
    uint64_t bytes; /* result: of its scene, if no other job has it; else 0 */
};

struct sweep {
    struct blob_user *users;
    size_t count;
    int64_t cutoff_ns; /* blobs_now's clock */
    /* Results. */
    uint64_t removed, removed_bytes;
    uint64_t waiting, waiting_bytes; /* not needed, but named since the cutoff */
};

/* What the scenes and files of these users take together, in bytes, each blob once; what is not there takes nothing. Sorts
 * them. ERR_NO_MEMORY, ERR_IO. [any thread] */
status sweep_bytes(struct blob_user *users, size_t count, const char *folder, uint64_t *bytes, struct error *err) MUST_CHECK;
/* Fill the results and remove. ERR_NO_MEMORY, ERR_IO: not known what is needed, nothing was removed;
 * ERR_REFUSED: a backup is being made. [any thread] */
status sweep_run(struct sweep *sweep, const char *folder, struct error *err) MUST_CHECK;
