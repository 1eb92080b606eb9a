/* claims: records from which job a folder's files were fetched, so that no job overwrites another's.
 *
 * All of a job's files in a folder begin with one base name: NAME, or NAME-jobN if files of that name belong to another
 * job or are of unknown origin. The base names are recorded in FOLDER/.azulejo-fetched, one claim per line; the last
 * one for a name counts:
 *
 *   JOB SUBMITTED SCENE NAME        number, seconds since 1970, digest in hexadecimal, base name
 *
 * Number, time and scene together tell the jobs of several farms apart. A claim without files in the folder has no
 * effect on others. The file can be deleted: files whose claim is lost are of unknown origin.
 */
#pragma once

#include "common/base/buffer.h"
#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

#define CLAIMS_FILE ".azulejo-fetched"

enum {
    CLAIMS_BYTES_MAX = 16 << 20, /* about 100,000 jobs fetched into one folder */
    /* With "-jobN-NN", a frame's number, the longest extension and a temporary file's suffix a
     * name stays below the 255 bytes that file systems take. */
    CLAIM_NAME_BYTES_MAX = 190,
};

/* A job's claim in a folder. Zero-initialise; claim_release frees it. */
struct claim {
    struct buffer base; /* name of its files, without number and extension; empty: not taken yet */
    int locked, lock;   /* the folder's descriptor while it is locked */
};

/* Choose the base name of the job's files in the folder, and record the choice. `force`: the plain
 * name, even if it is taken. The folder stays locked until claim_unlock: a claim counts for others
 * once a file of its name is there. ERR_IO when the claim cannot be recorded; ERR_LIMIT. */
status claim_take(struct claim *claim, const char *folder, const Azulejo__Wire__JobInfo *job, int force,
                  struct error *err) MUST_CHECK;
/* The base name that the job has in the folder already, if it has one. Takes nothing and locks nothing. */
status claim_find(const char *folder, const Azulejo__Wire__JobInfo *job, struct buffer *base,
                  struct error *err) MUST_CHECK;
void claim_unlock(struct claim *claim);
void claim_release(struct claim *claim);

/* Append a job's name, made suitable for files: no folders, no control characters, not hidden, at
 * most CLAIM_NAME_BYTES_MAX bytes of whole characters; "job-N" if nothing is left. */
void claim_plain_name(const Azulejo__Wire__JobInfo *job, struct buffer *name);
