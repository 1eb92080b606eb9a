/* lend: a blob that the coordinator has lost is sent to it from this machine's cache.
 *
 *   IDLE --BlobGet--> READING (a pool thread finds it and checks its digest) --there--> SENDING --last piece--> IDLE
 *                        \--it is not: Failure--> IDLE        any --connection lost--> IDLE
 *
 * One at a time; the coordinator asks for no second one before. Everything but the reading runs in the loop's thread. */
#pragma once

#include <stdint.h>

#include "protocol/channel.h"
#include "worker/cache/blob_cache.h"
#include "worker/pool.h"

enum lend_state { LEND_IDLE, LEND_READING, LEND_SENDING };

struct lend {
    struct pool_task task; /* first: the task is its lend */
    struct pool *pool;
    struct blob_cache *blobs;
    enum lend_state state;
    int forgotten; /* READING for a connection that is lost */
    uint64_t request, offset;
    struct digest digest;
    struct cached_blob *blob;
    struct error error;
};

void lend_init(struct lend *lend, struct pool *pool, struct blob_cache *blobs);
/* After the pool has ended. */
void lend_release(struct lend *lend);

void lend_take(struct lend *lend, uint64_t request, const Azulejo__Wire__BlobGet *get, struct channel *channel);
/* Is this finished pool task the lend's? `channel` NULL: not connected. */
int lend_task_done(struct lend *lend, const struct pool_task *task, struct channel *channel);
/* Send as much as the channel takes. */
void lend_pump(struct lend *lend, struct channel *channel);
/* The connection is lost. */
void lend_forget(struct lend *lend);
