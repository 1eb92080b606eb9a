/* holders: what the tokens of the page, and the keys of names, hold of the farm. Each has ceilings by its role
 * (token_ceilings.h), so that none can fill the disk or the memory for all. A holder's number is that of its token, or
 * HOLDER_KEY and a hash of the key's name; 0: it is none.
 *
 *   a blob --begun--> counts --a job that needs it was accepted, or it is gone from the store--> does not
 *
 * The farm's key and keys that are shared have no ceilings. A restart forgets the counts: what was sent before is removed after
 * --keep-blobs. */
#pragma once

#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/schema/token_roles.h"

enum { HOLDERS_MAX = 1024, HOLDER_BLOBS_MAX = 8192, HOLDER_LOOK_MS = 1000, HOLDER_UPLOAD_S = 600 };

#define HOLDER_KEY ((uint64_t)1 << 63)

struct holder;

/* Of a key of this name; "": 0. */
uint64_t holder_of_key(const char *name);

struct holders {
    struct holder *first;
    uint64_t submit_blob_bytes; /* the ceiling of the role submit, if it is not the table's; 0: it is */
};

/* A holder of this role begins to send a blob to the store in `folder`. ERR_LIMIT: its ceiling; ERR_NO_MEMORY. */
status holders_blob_begin(struct holders *holders, uint64_t holder, enum web_role role, const char *folder,
                          const struct digest *digest, uint64_t bytes, uint64_t now_ns, struct error *err) MUST_CHECK;
/* It is in the store. */
void holders_blob_stored(struct holders *holders, uint64_t holder, const struct digest *digest);
/* Blobs were removed from the store. */
void holders_swept(struct holders *holders, const char *folder);
/* A job of this holder needs these. */
void holders_blobs_used(struct holders *holders, uint64_t holder, const struct digest *digests, size_t count);
/* A picture is to be made for it. ERR_LIMIT: it has as many as it may; ERR_NO_MEMORY. */
status holders_preview_begin(struct holders *holders, uint64_t holder, enum web_role role, struct error *err) MUST_CHECK;
void holders_preview_end(struct holders *holders, uint64_t holder);
void holders_release(struct holders *holders);
