/* upload: blobs that the coordinator lacks, sent in pieces.
 *
 * Asks first (BlobQuery), then streams the missing ones: 256 KiB a piece, compressed if that helps,
 * with several blobs in flight before the first is acknowledged.
 */
#pragma once

#include "client/link/connection.h"
#include "common/base/digest.h"

struct upload_item {
    struct digest digest;
    const uint8_t *data;
    size_t size_bytes;
};

struct upload_progress {
    uint64_t missing_bytes; /* the blobs that the coordinator lacks */
    uint64_t sent_bytes;    /* handed to the connection so far; uncompressed */
    uint64_t wire_bytes;    /* bytes on the wire */
};

/* Called after every piece; may be NULL. */
typedef void (*upload_progress_fn)(const struct upload_progress *progress, void *user);

/* Returns when every blob is stored. `progress` is also set after a failure. */
status upload_blobs(struct connection *c, const struct upload_item *items, size_t count, upload_progress_fn report,
                    void *user, struct upload_progress *progress, struct error *err) MUST_CHECK;
