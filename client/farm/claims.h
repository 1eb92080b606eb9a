/* claims: which job the files of a folder were fetched from, so that no job overwrites another's.
 *
 * All of a job's files in a folder begin with one base name: NAME, or NAME-jobN where the files of
 * that name there are another job's, or of unknown origin. Who has which base name is kept in
 * FOLDER/.azulejo-fetched, a line a claim, of which the last one for a name counts:
 *
 *   JOB SUBMITTED SCENE NAME        number, seconds since 1970, digest in hexadecimal, base name
 *
 * Number, time and scene together tell the jobs of several farms apart. A claim without files in
 * the folder hinders no one. The file can be deleted: files whose claim is lost are of unknown
 * origin.
 */
#ifndef AZULEJO_CLIENT_CLAIMS_H
#define AZULEJO_CLIENT_CLAIMS_H

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

#define CLAIMS_FILE ".azulejo-fetched"

enum {
    CLAIMS_BYTES_MAX = 16 << 20, /* some 100,000 jobs fetched into one folder */
    /* With "-jobN-NN", a frame's number, the longest extension and a temporary file's suffix a
     * name stays below the 255 bytes that file systems take. */
    CLAIM_NAME_BYTES_MAX = 190,
};

/* What a job has in a folder. Zero-initialise; claim_release frees it. */
struct claim {
    struct buffer base; /* name of its files, without number and extension; empty: not taken yet */
    int locked, lock;   /* the folder's descriptor while it is locked */
};

/* Choose the base name of the job's files in the folder, and keep the choice. `force`: the plain
 * name, whatever is there. The folder stays locked until claim_unlock: a claim counts for others
 * once a file of its name is there. ERR_IO when the claim cannot be kept; ERR_LIMIT;
 * ERR_NO_MEMORY. */
status claim_take(struct claim *claim, const char *folder, const Azulejo__Wire__JobInfo *job,
                  int force, struct error *err) MUST_CHECK;
void claim_unlock(struct claim *claim);
void claim_release(struct claim *claim);

/* Append a job's name made fit for files: no folders, no control characters, nothing hidden, at
 * most CLAIM_NAME_BYTES_MAX bytes of whole characters; "job-N" where nothing is left. */
void claim_plain_name(const Azulejo__Wire__JobInfo *job, struct buffer *name);

#endif
