/* requests: pieces of a frame that the coordinator asks for by name (RenderRequest).
 *
 *   taken --scene READY--> in the pool --> rendered --> RenderResult sent --> freed
 *      \--scene BROKEN--> Failure sent --> freed       \--connection lost meanwhile--> freed
 *
 * Nothing of a request is merged into a film, so a lost one costs nothing: the coordinator asks another
 * worker. Requests go before leased units, and are few. Everything here runs in the loop's thread; only
 * the tasks run in the pool.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "protocol/channel.h"
#include "worker/cache/blob_cache.h"
#include "worker/pool.h"
#include "worker/scene_cache.h"

enum { REQUESTS_HELD_MAX = 64 };

struct request;

struct requests {
    struct pool *pool;
    struct scene_cache *scenes;
    struct blob_cache *blobs;
    struct request *first;
    uint32_t isa_mask;
    size_t count;
};

void requests_init(struct requests *r, struct pool *pool, struct scene_cache *scenes, struct blob_cache *blobs,
                   uint32_t isa_mask);
void requests_release(struct requests *r); /* after the pool has ended */

/* Take a request; what is wrong with it is answered by a Failure on `channel`. */
void requests_take(struct requests *r, uint64_t number, const Azulejo__Wire__RenderRequest *message,
                   struct channel *channel);
/* The scene became READY or BROKEN. `channel` NULL: not connected. */
void requests_scene_settled(struct requests *r, struct scene_slot *slot, struct channel *channel);
/* Is this finished pool task a request's? If so, its result is sent and it is freed. */
int requests_task_done(struct requests *r, struct pool_task *task, struct channel *channel);
/* The connection is lost: no answer is expected any more. Drops what has not begun. */
void requests_forget(struct requests *r);
