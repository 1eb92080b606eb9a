/* blobs: scenes, meshes and images in the store, by the SHA-256 of their bytes.
 *
 *   upload_begin -> upload_add (in order, to the end) -> upload_finish: the blob is there
 *        anything else -> upload_free: nothing remains
 *
 * A blob counts only when its bytes were hashed, synced and renamed into place. The hash is
 * checked again when the coordinator itself reads a blob; workers check what they receive.
 */
#pragma once

#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/digest.h"
#include "common/base/status.h"

enum { BLOB_CHECKED_S = 3600, BLOBS_DROPPED_MAX = 256 };

/* `folder` is the store's folder throughout. */

/* Remove the files of unfinished uploads of an earlier run. */
void blobs_clean(const char *folder);
/* 1: the blob is there, and its size is set; 0: it is not; -1: not known, because the store cannot
 * be read at present (errno says why). */
int blobs_find(const char *folder, const struct digest *digest, uint64_t *size_bytes);
/* The same, and the blob's age is at least `since_ns` afterwards: blobs_remove_older with a cutoff until then leaves
 * it. A client that knows that a blob is there does not send it. [any thread] */
int blobs_hold(const char *folder, const struct digest *digest, int64_t since_ns, uint64_t *size_bytes);
/* The clock of blobs' ages, in nanoseconds since 1970: it never goes back while the program runs. [any thread] */
int64_t blobs_now(void);
/* Remove the blob if it was not sent or held since then. *bytes: its room on disk; 0: it stays. [any thread] */
int blobs_remove_older(const char *folder, const struct digest *digest, int64_t cutoff_ns, uint64_t *bytes);
void blobs_path(const char *folder, const struct digest *digest, struct buffer *path);

/* Append the blob's bytes to `out`, hash checked. ERR_NOT_FOUND, ERR_LIMIT, ERR_IO; ERR_CORRUPT:
 * the file was damaged and was removed, so that it can be sent again. */
status blobs_read(const char *folder, const struct digest *digest, size_t limit_bytes, struct buffer *out,
                  struct error *err) MUST_CHECK;

/* Do the file's bytes have that hash? 0: no; -1: it cannot be read, or there is no memory. */
int blobs_check(const char *folder, const struct digest *digest);
/* blobs_hold for a client that will not send what is there: the bytes are read, unless that was done in the last
 * BLOB_CHECKED_S. 0 also for a blob that was damaged, and is removed. [any thread] */
int blobs_vouch(const char *folder, const struct digest *digest, int64_t since_ns, uint64_t *size_bytes);
/* A blob's bytes were read, and have another hash: it is removed, so that it can be sent again. [any thread] */
void blobs_drop_damaged(const char *folder, const struct digest *digest);
/* One that was dropped since the process began, and was not taken yet: at most BLOBS_DROPPED_MAX wait for that. 0: none.
 * [any thread] */
int blobs_take_dropped(struct digest *out);

struct upload;

status upload_begin(struct upload **out, const char *folder, const struct digest *digest, uint64_t total_bytes,
                    struct error *err) MUST_CHECK;
const struct digest *upload_digest(const struct upload *upload);
uint64_t upload_total(const struct upload *upload);
uint64_t upload_size(const struct upload *upload); /* so far: the offset of the next piece */
/* ERR_IO (disk full, ...), ERR_PROTOCOL: more bytes than announced. */
status upload_add(struct upload *upload, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;
/* All bytes have arrived: check the hash, sync, rename. ERR_INPUT: another hash. May run in another
 * thread. The upload must still be freed. */
status upload_finish(struct upload *upload, struct error *err) MUST_CHECK;
void upload_free(struct upload *upload); /* NULL is fine */
