#include "worker/scene_cache.h"

#include <assert.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/scene/pose.h"
#include "common/scene/scene.h"

/* What the loop's thread knows about a slot's scene. */
enum motion { MOTION_UNKNOWN, MOTION_NONE, MOTION_SOME };

struct scene_slot {
    struct pool_task task; /* first: a task is its slot */
    struct scene_cache *cache;
    struct scene_slot *next;
    struct digest digest;
    struct render_settings settings;
    uint32_t frame;
    enum motion motion;
    enum scene_state state;
    unsigned references;
    uint64_t used;    /* the cache's tick of the last acquire */
    uint64_t evicted; /* the cache's count when the build was queued */

    /* Owned by the build, in a pool thread while WORKING. */
    struct scene scene;
    int unpacked;
    int moves;
    char name[SCENE_NAME_MAX + 1];
    struct render_scene *render;
    struct cached_blob **blobs; /* sorted by digest; as long as `render` */
    size_t blob_count;
    struct scene_blob *missing; /* sorted by digest */
    size_t missing_count;
    struct error error;

    /* While FETCHING. */
    struct cached_blob **arrived; /* room for missing_count */
    size_t arrived_count;
};

struct scene_cache {
    struct blob_cache *blobs;
    struct pool *pool;
    struct scene_cache_callbacks callbacks;
    struct scene_slot *slots;
    uint64_t tick;
    uint64_t evicted; /* scenes evicted so far to make room for others */
};

/* ---- in a pool thread ------------------------------------------------------------------ */

static int compare_digests(const struct digest *a, const struct digest *b)
{
    return memcmp(a->bytes, b->bytes, DIGEST_BYTES);
}

static int compare_blobs(const void *a, const void *b)
{
    return compare_digests(&((const struct scene_blob *)a)->digest, &((const struct scene_blob *)b)->digest);
}

static int compare_to_cached(const void *key, const void *element)
{
    return compare_digests(key, cached_blob_digest(*(struct cached_blob *const *)element));
}

static status source_get(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes,
                         struct error *err)
{
    struct scene_slot *slot = user;
    struct cached_blob **found = NULL;

    if (slot->blob_count)
        found = bsearch(digest, slot->blobs, slot->blob_count, sizeof *slot->blobs, compare_to_cached);
    if (!found) {
        char hex[DIGEST_HEX_SIZE];
        digest_to_hex(digest, hex);
        *data = NULL;
        *size_bytes = 0;
        return error_set(err, STATUS_ERR_INTERNAL, "blob %s is not among the scene's blobs", hex);
    }
    *data = cached_blob_data(*found);
    *size_bytes = cached_blob_size(*found);
    return STATUS_OK;
}

static void blobs_release(struct cached_blob ***blobs, size_t *count)
{
    for (size_t i = 0; i < *count; i++)
        cached_blob_release((*blobs)[i]);
    mem_free(*blobs);
    *blobs = NULL;
    *count = 0;
}

static status note_missing(struct scene_slot *slot, const struct scene_blob *blob, size_t room, struct error *err)
{
    if (!slot->missing) {
        slot->missing = mem_alloc_array(room, sizeof *slot->missing);
        NEED(slot->missing, err, "the list of missing blobs");
    }
    slot->missing[slot->missing_count++] = *blob;
    return STATUS_OK;
}

static status unpack_scene(struct scene_slot *slot, struct error *err)
{
    struct scene_blob packed = {slot->digest, 0};
    struct cached_blob *blob;
    status s = blob_cache_get(slot->cache->blobs, &slot->digest, &blob, err);

    if (s == STATUS_ERR_NOT_FOUND)
        return note_missing(slot, &packed, 1, err);
    if (s != STATUS_OK)
        return s;
    s = scene_unpack(&slot->scene, cached_blob_data(blob), cached_blob_size(blob), err);
    cached_blob_release(blob);
    if (s != STATUS_OK) {
        scene_release(&slot->scene);
        return s;
    }
    slot->unpacked = 1;
    snprintf(slot->name, sizeof slot->name, "%s", slot->scene.name ? slot->scene.name : "");
    s = render_settings_validate(&slot->settings, slot->scene.camera_count, err);
    if (s == STATUS_OK)
        slot->moves = scene_is_animated(&slot->scene, &slot->settings);
    return s;
}

/* Collect the scene's blobs, or note which ones are missing. */
static status collect_blobs(struct scene_slot *slot, struct error *err)
{
    /* Keep the blobs of the round before the fetch until this round holds them too: they may have
     * been removed from the disk since. */
    struct cached_blob **before = slot->blobs;
    size_t before_count = slot->blob_count;
    struct scene_blob *list = NULL;
    size_t count = 0;
    status s = scene_blobs(&slot->scene, &list, &count, err);

    if (s != STATUS_OK)
        return s;
    if (count)
        qsort(list, count, sizeof *list, compare_blobs);
    slot->blob_count = 0;
    slot->blobs = mem_alloc_array(count, sizeof *slot->blobs);
    if (!slot->blobs)
        s = error_no_memory(err, "the scene's blobs");
    for (size_t i = 0; i < count && s == STATUS_OK; i++) {
        struct cached_blob *blob;
        s = blob_cache_get(slot->cache->blobs, &list[i].digest, &blob, err);
        if (s == STATUS_ERR_NOT_FOUND) {
            s = note_missing(slot, &list[i], count, err);
        } else if (s == STATUS_OK) {
            slot->blobs[slot->blob_count++] = blob;
            if (cached_blob_size(blob) != list[i].size_bytes)
                s = error_set(err, STATUS_ERR_INPUT, "the scene says that a blob has %llu bytes, but it has %zu",
                              (unsigned long long)list[i].size_bytes, cached_blob_size(blob));
        }
    }
    mem_free(list);
    blobs_release(&before, &before_count);
    return s;
}

static status start_builders(struct error *err)
{
    static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    status s;

    pthread_mutex_lock(&lock);
    s = render_start_builders(err);
    pthread_mutex_unlock(&lock);
    return s;
}

static void scene_build(struct pool_task *task)
{
    struct scene_slot *slot = (struct scene_slot *)task;
    struct blob_source source = {source_get, slot};
    status s = STATUS_OK;

    memset(&slot->error, 0, sizeof slot->error);
    if (!slot->unpacked)
        s = unpack_scene(slot, &slot->error);
    if (s == STATUS_OK && slot->missing_count == 0)
        s = collect_blobs(slot, &slot->error);
    render_build_threads(1 + pool_idle(slot->cache->pool));
    if (s == STATUS_OK && slot->missing_count == 0)
        s = start_builders(&slot->error);
    if (s == STATUS_OK && slot->missing_count == 0)
        s = render_scene_new(&slot->render, &slot->scene, &slot->settings, slot->frame, source, &slot->error);
    if (s != STATUS_OK) {
        slot->error.code = s;
        mem_free(slot->missing);
        slot->missing = NULL;
        slot->missing_count = 0;
    } else {
        /* A missing blob set an error text; it is fetched, so this is no failure. */
        memset(&slot->error, 0, sizeof slot->error);
    }
    if (slot->render || s != STATUS_OK) {
        if (slot->unpacked)
            scene_release(&slot->scene);
        slot->unpacked = 0;
    }
}

/* ---- in the loop's thread -------------------------------------------------------------- */

static void push_build(struct scene_slot *slot)
{
    slot->evicted = slot->cache->evicted;
    pool_push(slot->cache->pool, &slot->task, 1);
}

static void slot_set_state(struct scene_slot *slot, enum scene_state state)
{
    assert(slot->state < SCENE_READY);
    slot->state = state;
    if (state == SCENE_WORKING)
        push_build(slot);
    else if (state >= SCENE_READY)
        slot->cache->callbacks.settled(slot->cache->callbacks.user, slot);
}

static void slot_free(struct scene_slot *slot)
{
    render_scene_free(slot->render);
    if (slot->unpacked)
        scene_release(&slot->scene);
    blobs_release(&slot->blobs, &slot->blob_count);
    blobs_release(&slot->arrived, &slot->arrived_count);
    mem_free(slot->missing);
    mem_free(slot);
}

static int same_scene(const struct scene_slot *slot, const struct digest *scene, const struct render_settings *settings)
{
    return digest_equal(&slot->digest, scene) && render_settings_equal(&slot->settings, settings);
}

/* Is this a frame of a moving scene of which a later used frame is idle too? */
static int is_passed(const struct scene_cache *cache, const struct scene_slot *slot)
{
    if (slot->motion != MOTION_SOME)
        return 0;
    for (const struct scene_slot *other = cache->slots; other; other = other->next)
        if (other->used > slot->used && other->state == SCENE_READY && !other->references &&
            same_scene(other, &slot->digest, &slot->settings))
            return 1;
    return 0;
}

/* Free slots without references that are not worth keeping. A slot in work waits for its task. */
static void cache_trim(struct scene_cache *cache)
{
    for (;;) {
        struct scene_slot **oldest = NULL;
        unsigned idle = 0;
        for (struct scene_slot **at = &cache->slots; *at; at = &(*at)->next) {
            struct scene_slot *slot = *at;
            if (slot->references || slot->state == SCENE_WORKING)
                continue;
            if (slot->state != SCENE_READY || is_passed(cache, slot)) {
                oldest = at;
                idle = SCENES_KEPT + 1;
                break;
            }
            idle++;
            if (!oldest || slot->used < (*oldest)->used)
                oldest = at;
        }
        if (idle <= SCENES_KEPT)
            return;
        struct scene_slot *gone = *oldest;
        *oldest = gone->next;
        slot_free(gone);
    }
}

/* Free all READY scenes without references. */
static void evict_idle(struct scene_cache *cache)
{
    struct scene_slot **at = &cache->slots;

    while (*at) {
        struct scene_slot *slot = *at;
        if (slot->references || slot->state != SCENE_READY) {
            at = &slot->next;
            continue;
        }
        *at = slot->next;
        slot_free(slot);
        cache->evicted++;
    }
    mem_trim();
}

/* The build found no memory: has any been freed since it began, or can some be freed now? Each
 * eviction allows one more build of each slot, so this terminates. */
static int make_room(struct scene_slot *slot)
{
    struct scene_cache *cache = slot->cache;
    char hex[DIGEST_HEX_SIZE];

    if (slot->references == 0)
        return 0;
    evict_idle(cache);
    if (cache->evicted == slot->evicted)
        return 0;
    digest_to_hex(&slot->digest, hex);
    log_info("scene %.12s: %s; %llu idle scenes were freed, trying again", hex, slot->error.text,
             (unsigned long long)(cache->evicted - slot->evicted));
    return 1;
}

status scene_cache_new(struct scene_cache **out, struct blob_cache *blobs, struct pool *pool,
                       struct scene_cache_callbacks callbacks, struct error *err)
{
    *out = mem_calloc(1, sizeof **out);
    NEED(*out, err, "the scene cache");
    (*out)->blobs = blobs;
    (*out)->pool = pool;
    (*out)->callbacks = callbacks;
    return STATUS_OK;
}

void scene_cache_free(struct scene_cache *cache)
{
    if (!cache)
        return;
    while (cache->slots) {
        struct scene_slot *slot = cache->slots;
        cache->slots = slot->next;
        slot_free(slot);
    }
    mem_free(cache);
}

/* The slot for a frame; NULL: create a new one. *motion: what is known of the scene. */
static struct scene_slot *slot_find(struct scene_cache *cache, const struct digest *scene,
                                    const struct render_settings *settings, uint32_t frame, enum motion *motion)
{
    struct scene_slot *waits = NULL;

    *motion = MOTION_UNKNOWN;
    for (struct scene_slot *slot = cache->slots; slot; slot = slot->next) {
        if (slot->state == SCENE_BROKEN || !same_scene(slot, scene, settings))
            continue;
        if (slot->frame == frame || slot->motion == MOTION_NONE)
            return slot;
        if (slot->motion == MOTION_SOME)
            *motion = MOTION_SOME;
        else
            waits = slot;
    }
    return *motion == MOTION_SOME ? NULL : waits;
}

status scene_cache_acquire(struct scene_cache *cache, const struct digest *scene,
                           const struct render_settings *settings, uint32_t frame, struct scene_slot **out,
                           struct error *err)
{
    enum motion motion;
    struct scene_slot *slot = slot_find(cache, scene, settings, frame, &motion);

    if (!slot) {
        slot = mem_calloc(1, sizeof *slot);
        *out = NULL;
        NEED(slot, err, "a scene");
        slot->cache = cache;
        slot->digest = *scene;
        slot->settings = *settings;
        slot->frame = frame;
        slot->motion = motion;
        slot->task.run = scene_build;
        slot->state = SCENE_WORKING;
        slot->next = cache->slots;
        cache->slots = slot;
        push_build(slot);
    }
    slot->references++;
    slot->used = ++cache->tick;
    *out = slot;
    return STATUS_OK;
}

int scene_slot_shows(const struct scene_slot *slot, uint32_t frame)
{
    return slot->state == SCENE_READY && (slot->frame == frame || slot->motion == MOTION_NONE);
}

status scene_slot_change(struct scene_slot **slot, uint32_t frame, struct error *err)
{
    struct scene_slot *before = *slot, *after;
    /* `before` still exists and knows that its scene moves: it cannot be returned again. */

    TRY(scene_cache_acquire(before->cache, &before->digest, &before->settings, frame, &after, err));
    *slot = after;
    scene_slot_release(before);
    return STATUS_OK;
}

void scene_slot_release(struct scene_slot *slot)
{
    assert(slot->references > 0);
    if (--slot->references == 0)
        cache_trim(slot->cache);
}

enum scene_state scene_slot_state(const struct scene_slot *slot) { return slot->state; }

const struct render_scene *scene_slot_render(const struct scene_slot *slot)
{
    return slot->state == SCENE_READY ? slot->render : NULL;
}

const struct error *scene_slot_error(const struct scene_slot *slot) { return &slot->error; }

static void log_built(const struct scene_slot *slot)
{
    struct render_scene_info info = {0};
    char hex[DIGEST_HEX_SIZE];

    render_scene_info(slot->render, &info);
    digest_to_hex(&slot->digest, hex);
    log_info("scene %.12s '%s': %llu triangles, %llu instances, %.1f MiB of textures, meshes and "
             "BVH, built in %.2f s",
             hex, slot->name, (unsigned long long)info.triangles, (unsigned long long)info.instances,
             (double)(info.texture_bytes + info.mesh_bytes + info.bvh_bytes) / 1048576,
             (double)info.build_ns / (double)NS_PER_SECOND);
}

/* Ask for the missing blobs, with a place for each, so that it stays once it has arrived. */
static void begin_fetch(struct scene_slot *slot)
{
    size_t count = slot->missing_count;
    struct scene_blob *wanted;

    slot->arrived = mem_calloc(count, sizeof *slot->arrived);
    wanted = mem_memdup(slot->missing, count * sizeof *wanted);
    if (!slot->arrived || !wanted) {
        mem_free(wanted);
        (void)error_no_memory(&slot->error, "blobs to be fetched");
        slot_set_state(slot, SCENE_BROKEN);
        return;
    }
    slot_set_state(slot, SCENE_FETCHING);
    /* A fetch that fails at once breaks the slot and frees slot->missing, hence the copy. */
    slot->cache->callbacks.missing(slot->cache->callbacks.user, wanted, count);
    mem_free(wanted);
}

int scene_cache_task_done(struct scene_cache *cache, struct pool_task *task)
{
    struct scene_slot *slot = (struct scene_slot *)task;

    if (task->run != scene_build)
        return 0;
    blobs_release(&slot->arrived, &slot->arrived_count);
    if (slot->error.code == STATUS_ERR_NO_MEMORY && make_room(slot)) {
        slot_set_state(slot, SCENE_WORKING);
    } else if (slot->error.code != STATUS_OK) {
        blobs_release(&slot->blobs, &slot->blob_count);
        slot_set_state(slot, SCENE_BROKEN);
    } else if (slot->missing_count > 0) {
        /* Blobs that are here stay referenced in `blobs` while the rest is fetched. */
        slot->references++;
        begin_fetch(slot);
        slot->references--;
    } else {
        log_built(slot);
        slot->motion = slot->moves ? MOTION_SOME : MOTION_NONE;
        slot_set_state(slot, SCENE_READY);
    }
    cache_trim(cache);
    return 1;
}

static struct scene_blob *missing_find(struct scene_slot *slot, const struct digest *digest)
{
    struct scene_blob key = {*digest, 0};

    if (slot->state != SCENE_FETCHING || slot->missing_count == 0)
        return NULL;
    return bsearch(&key, slot->missing, slot->missing_count, sizeof *slot->missing, compare_blobs);
}

void scene_cache_blob_arrived(struct scene_cache *cache, struct cached_blob *blob)
{
    for (struct scene_slot *slot = cache->slots; slot; slot = slot->next) {
        struct scene_blob *found = missing_find(slot, cached_blob_digest(blob));
        if (!found)
            continue;
        slot->arrived[slot->arrived_count++] = cached_blob_retain(blob);
        if (slot->arrived_count < slot->missing_count)
            continue;
        /* All have arrived. The build collects its blobs again; they are held until it is done. */
        mem_free(slot->missing);
        slot->missing = NULL;
        slot->missing_count = 0;
        slot_set_state(slot, SCENE_WORKING);
    }
}

void scene_cache_blob_failed(struct scene_cache *cache, const struct digest *digest, const struct error *why)
{
    for (;;) {
        /* Start from the front each time: the callback may have freed other slots. */
        struct scene_slot *slot = cache->slots;
        while (slot && !missing_find(slot, digest))
            slot = slot->next;
        if (!slot)
            break;
        slot->error = *why;
        mem_free(slot->missing);
        slot->missing = NULL;
        slot->missing_count = 0;
        slot->references++;
        slot_set_state(slot, SCENE_BROKEN);
        slot->references--;
    }
    cache_trim(cache);
}
