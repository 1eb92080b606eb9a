/* scene_cache: scenes ready to render, a few of which are kept for the next lease.
 *
 *   new --> WORKING --all blobs here, scene built--> READY
 *              |  ^--the last missing blob arrived-- FETCHING
 *              |--some blobs are missing--^
 *              |--no memory, but idle scenes were evicted: WORKING again
 *              \--damaged, does not fit, no memory--> BROKEN
 * slot_set_state is the only function that changes a slot's state.
 *
 * A slot is one (scene digest, render settings, frame); if nothing moves it serves every frame. Whether something moves
 * is known once the scene has been unpacked. Until then other frames of it wait for the same slot, and ask
 * scene_slot_shows() when it is READY.
 * Reading, hashing, unpacking and building run in a pool thread (scene_build, which starts again after a fetch; nothing
 * is hashed twice); everything else is called from the loop's thread. A slot with references is kept. Of the READY
 * slots without references, the SCENES_KEPT most recently used stay, but only one frame of each scene that moves:
 * rendering has gone on to the next frame and rarely returns. If a build finds no memory, all slots without references
 * are freed and the build is repeated. A BROKEN slot is freed with its last reference, so the next lease tries again.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/scene/settings.h"
#include "worker/cache/blob_cache.h"
#include "worker/pool.h"
#include "worker/render/render.h"

enum {
    SCENES_KEPT = 3,
    SCENE_PACKED_MAX = 1 << 30, /* bytes of a packed scene */
};

enum scene_state { SCENE_WORKING, SCENE_FETCHING, SCENE_READY, SCENE_BROKEN };

struct scene_cache;
struct scene_slot;

struct scene_cache_callbacks {
    /* Blobs to fetch; answer each with scene_cache_blob_arrived or _failed. */
    void (*missing)(void *user, const struct scene_blob *blobs, size_t count);
    /* The slot became READY or BROKEN. */
    void (*settled)(void *user, struct scene_slot *slot);
    void *user;
};

status scene_cache_new(struct scene_cache **out, struct blob_cache *blobs, struct pool *pool,
                       struct scene_cache_callbacks callbacks, struct error *err) MUST_CHECK;
/* After the pool has ended; remaining references become invalid. */
void scene_cache_free(struct scene_cache *cache);

/* Take a reference to the slot; create it if needed. A READY slot shows the frame; one that becomes
 * READY later may turn out not to. `settled` is not called before this returns. ERR_NO_MEMORY. */
status scene_cache_acquire(struct scene_cache *cache, const struct digest *scene,
                           const struct render_settings *settings, uint32_t frame, struct scene_slot **out,
                           struct error *err) MUST_CHECK;
void scene_slot_release(struct scene_slot *slot);

enum scene_state scene_slot_state(const struct scene_slot *slot);
const struct render_scene *scene_slot_render(const struct scene_slot *slot); /* when READY */
const struct error *scene_slot_error(const struct scene_slot *slot);         /* when BROKEN */
/* Does a READY slot show this frame? */
int scene_slot_shows(const struct scene_slot *slot, uint32_t frame);
/* Exchange a reference to a READY slot that does not show the frame for one to the slot that does
 * or will. ERR_NO_MEMORY: *slot is unchanged. */
status scene_slot_change(struct scene_slot **slot, uint32_t frame, struct error *err) MUST_CHECK;

/* Give a fetched blob to every slot that waits for it. */
void scene_cache_blob_arrived(struct scene_cache *cache, struct cached_blob *blob);
void scene_cache_blob_failed(struct scene_cache *cache, const struct digest *digest, const struct error *why);

/* Does this finished pool task belong to a scene? If so, take the next step. */
int scene_cache_task_done(struct scene_cache *cache, struct pool_task *task);
