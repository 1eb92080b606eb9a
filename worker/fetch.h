/* fetch: getting blobs from the coordinator into the cache.
 *
 *   QUEUED --BlobGet--> RECEIVING --last piece, digest right--> arrived (freed)
 *      ^  <--connection lost, damaged, temporary failure--/ \--not found, too often--> failed
 *
 * At most FETCHES_AT_ONCE are RECEIVING. A fetch begins again after a lost connection.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/scene/scene.h"
#include "protocol/channel.h"
#include "worker/cache/blob_cache.h"

enum {
    FETCHES_AT_ONCE = 16,
    FETCH_ATTEMPTS_MAX = 3, /* of one blob that arrives damaged or fails */
    FETCH_BUCKETS = 1024,
};

struct fetch;

struct fetcher {
    struct blob_cache *cache;
    /* Both may call fetcher_want. `arrived` lends the blob. */
    void (*arrived)(void *user, struct cached_blob *blob);
    void (*failed)(void *user, const struct digest *digest, const struct error *why);
    void *user;
    uint64_t last_request;
    struct fetch *buckets[FETCH_BUCKETS]; /* all, by digest */
    struct fetch *first, *last;           /* QUEUED, in order */
    struct fetch *receiving[FETCHES_AT_ONCE];
    uint64_t bytes; /* received, counted uncompressed, for the log */
};

void fetcher_init(struct fetcher *f, struct blob_cache *cache);
void fetcher_release(struct fetcher *f);

/* Ask for a blob unless a fetch of it is in progress. `limit_bytes`: upper limit of its size;
 * `size_bytes` 0: not known. ERR_NO_MEMORY. */
status fetcher_want(struct fetcher *f, const struct scene_blob *blob, uint64_t limit_bytes,
                    struct error *err) MUST_CHECK;
/* Send as many BlobGets as are allowed at once. */
void fetcher_pump(struct fetcher *f, struct channel *channel);
/* A piece arrived. ERR_PROTOCOL: it was not requested or does not follow the one before. */
status fetcher_data(struct fetcher *f, uint64_t request, const Azulejo__Wire__BlobData *data,
                    struct error *err) MUST_CHECK;
/* A Failure arrived. 0: it does not answer a fetch. */
int fetcher_failure(struct fetcher *f, uint64_t request, const Azulejo__Wire__Failure *failure);
/* The connection is lost: start again on the next one. */
void fetcher_reset(struct fetcher *f);
