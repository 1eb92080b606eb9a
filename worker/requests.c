#include "worker/requests.h"

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "protocol/message.h"
#include "worker/path_message.h"
#include "worker/render/record.h"

struct request {
    struct pool_task task; /* first: a task is its request */
    struct request *next;
    struct requests *owner;
    uint64_t number; /* the envelope's */
    int forgotten;   /* the connection that asked is lost */
    int started;     /* it was given to the pool */
    struct scene_slot *slot;
    struct digest scene_digest;
    struct render_settings settings;
    uint32_t frame;
    int is_unit, wants_sums, wants_path;
    uint32_t x, y, first, count;

    /* The result, the pool's until the task is done. */
    struct error error;
    struct render_stats stats;
    struct unit_result unit; /* of a unit, with the floats below */
    struct digest digest;
    uint64_t hash;
    uint64_t cpu_ns;
    struct sample_record *record;
    struct scene scene; /* for its names */
    int has_scene;
    float *floats; /* a unit's sums, or what the samples add [count][3] */
    size_t float_count;
};

/* ---- in a pool thread ------------------------------------------------------------------------- */

static status render_unit(struct request *q, const struct render_scene *scene)
{
    struct unit_result *u = &q->unit;

    q->floats = mem_alloc_array(TILE_FLOATS_MAX, sizeof *q->floats);
    if (!q->floats)
        return error_no_memory(&q->error, "a unit");
    u->count = q->float_count = render_tile(scene, q->frame, u->tile, u->group, u->pass, q->floats, &u->tail, &q->stats);
    u->sums = q->floats;
    u->work = q->stats.work;
    q->hash = unit_hash(u);
    return wire_unit_digest(&q->digest, u, &q->error);
}

/* The scene's names. Without them (its file has left the cache) the path has numbers only. */
static void read_names(struct request *q)
{
    struct cached_blob *blob;
    struct error ignored = {0};

    scene_init(&q->scene);
    if (blob_cache_get(q->owner->blobs, &q->scene_digest, &blob, &ignored) != STATUS_OK)
        return;
    q->has_scene = scene_unpack(&q->scene, cached_blob_data(blob), cached_blob_size(blob), &ignored) == STATUS_OK;
    if (!q->has_scene)
        scene_release(&q->scene);
    cached_blob_release(blob);
}

static status render_samples(struct request *q, const struct render_scene *scene)
{
    q->float_count = 3 * (size_t)q->count;
    q->floats = mem_alloc_array(q->float_count, sizeof *q->floats);
    if (q->wants_path)
        q->record = mem_alloc(sizeof *q->record);
    if (!q->floats || (q->wants_path && !q->record))
        return error_no_memory(&q->error, "samples");
    for (uint32_t i = 0; i < q->count; i++)
        render_sample(scene, q->frame, q->x, q->y, q->first + i, q->floats + 3 * (size_t)i, q->record, &q->stats);
    if (q->wants_path)
        read_names(q);
    return STATUS_OK;
}

static void request_run(struct pool_task *task)
{
    struct request *q = (struct request *)task;
    const struct render_scene *scene = scene_slot_render(q->slot);
    uint64_t begun_ns = clock_thread_cpu_ns();

    q->error.code = q->is_unit ? render_unit(q, scene) : render_samples(q, scene);
    q->cpu_ns = clock_thread_cpu_ns() - begun_ns;
}

/* ---- in the loop's thread --------------------------------------------------------------------- */

void requests_init(struct requests *r, struct pool *pool, struct scene_cache *scenes, struct blob_cache *blobs,
                   uint32_t isa_mask)
{
    *r = (struct requests){.pool = pool, .scenes = scenes, .blobs = blobs, .isa_mask = isa_mask};
}

static void request_free(struct request *q)
{
    struct requests *r = q->owner;
    struct request **at = &r->first;

    while (*at && *at != q)
        at = &(*at)->next;
    if (*at) {
        *at = q->next;
        r->count--;
    }
    if (q->slot)
        scene_slot_release(q->slot);
    if (q->has_scene)
        scene_release(&q->scene);
    mem_free(q->record);
    mem_free(q->floats);
    mem_free(q);
}

void requests_release(struct requests *r)
{
    while (r->first)
        request_free(r->first);
}

static void say_failure(const struct request *q, struct channel *channel, const struct error *why)
{
    log_warn("request %llu: %s", (unsigned long long)q->number, why->text);
    if (channel && !q->forgotten)
        (void)!message_send_failure(channel, q->number, why); /* fails only when the connection does */
}

static void request_start(struct request *q)
{
    q->started = 1;
    q->task.run = request_run;
    pool_push(q->owner->pool, &q->task, 1);
}

static status request_fill(struct request *q, const Azulejo__Wire__RenderRequest *m, struct error *err)
{
    status s = wire_digest_get(&q->scene_digest, &m->scene, "the scene", err);

    THEN(s, wire_settings_get(&q->settings, m->settings, UINT32_MAX, err));
    if (s != STATUS_OK)
        return s;
    q->frame = m->frame;
    if (!(q->owner->isa_mask >> q->settings.isa & 1))
        return error_set(err, STATUS_ERR_UNSUPPORTED, "it needs %s, which this worker does not offer",
                         isa_name(q->settings.isa));
    TRY(wire_piece_check(m, &q->settings, err));
    if (m->unit) {
        q->is_unit = 1;
        q->wants_sums = m->sums;
        q->unit.name = (struct unit_name){m->unit->tile, m->unit->group, m->unit->pass};
    } else {
        q->x = m->pixel->x;
        q->y = m->pixel->y;
        q->first = m->pixel->first;
        q->count = m->pixel->count;
        q->wants_path = m->pixel->path;
    }
    return STATUS_OK;
}

void requests_take(struct requests *r, uint64_t number, const Azulejo__Wire__RenderRequest *message,
                   struct channel *channel)
{
    struct request *q = mem_calloc(1, sizeof *q);
    struct error err = {0};
    status s;

    if (!q) {
        error_no_memory(&err, "a request");
        (void)!message_send_failure(channel, number, &err);
        return;
    }
    q->owner = r;
    q->number = number;
    s = request_fill(q, message, &err);
    if (s == STATUS_OK && r->count >= REQUESTS_HELD_MAX)
        s = error_set(&err, STATUS_ERR_LIMIT, "more than %d requests at once", REQUESTS_HELD_MAX);
    THEN(s, scene_cache_acquire(r->scenes, &q->scene_digest, &q->settings, q->frame, &q->slot, &err));
    if (s != STATUS_OK) {
        err.code = s;
        say_failure(q, channel, &err);
        request_free(q);
        return;
    }
    q->next = r->first;
    r->first = q;
    r->count++;
    if (scene_slot_state(q->slot) == SCENE_READY)
        request_start(q);
}

/* Its slot is READY or BROKEN. 0: there will be none for the request. */
static int request_settle(struct request *q, struct error *why)
{
    if (scene_slot_state(q->slot) != SCENE_READY) {
        *why = *scene_slot_error(q->slot);
        return 0;
    }
    return scene_slot_shows(q->slot, q->frame) || scene_slot_change(&q->slot, q->frame, why) == STATUS_OK;
}

void requests_scene_settled(struct requests *r, struct scene_slot *slot, struct channel *channel)
{
    struct request *next;

    for (struct request *q = r->first; q; q = next) {
        struct error why = {0};
        next = q->next;
        if (q->slot != slot || q->started)
            continue;
        if (!request_settle(q, &why)) {
            say_failure(q, channel, &why);
            request_free(q);
        } else if (scene_slot_state(q->slot) == SCENE_READY) {
            request_start(q);
        }
    }
}

static void send_result(struct request *q, struct channel *channel)
{
    Azulejo__Wire__RenderResult result = AZULEJO__WIRE__RENDER_RESULT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(RENDER_RESULT, render_result, &result);
    struct path_message *path = NULL;
    struct wire_work work;
    struct error err = {0};

    result.work = wire_work_set(&work, &q->stats.work);
    result.cpu_ns = q->cpu_ns;
    if (q->is_unit) {
        wire_digest_set(&result.digest, &q->digest);
        result.hash = q->hash;
        if (q->wants_sums)
            wire_sums_set(&result.sums, q->floats, q->float_count);
    } else {
        wire_sums_set(&result.added, q->floats, q->float_count);
    }
    if (q->record) {
        path = path_message_new(q->record, q->has_scene ? &q->scene : NULL);
        if (!path) {
            error_no_memory(&err, "a path");
            say_failure(q, channel, &err);
            return;
        }
        result.path = path_message_body(path);
    }
    e.request = q->number;
    if (azulejo__wire__envelope__get_packed_size(&e) > CHANNEL_FRAME_MAX) {
        error_set(&err, STATUS_ERR_LIMIT, "the path's %u vertices and their names are too much for "
                  "one message", q->record ? q->record->count : 0);
        say_failure(q, channel, &err);
    } else {
        (void)!channel_send(channel, &e); /* fails only when the connection does */
    }
    mem_free(path);
}

int requests_task_done(struct requests *r UNUSED, struct pool_task *task, struct channel *channel)
{
    struct request *q = (struct request *)task;

    if (task->run != request_run)
        return 0;
    if (q->error.code != STATUS_OK)
        say_failure(q, channel, &q->error);
    else if (channel && !q->forgotten)
        send_result(q, channel);
    request_free(q);
    return 1;
}

void requests_forget(struct requests *r)
{
    struct request *next;

    for (struct request *q = r->first; q; q = next) {
        next = q->next;
        q->forgotten = 1;
        if (!q->started || pool_cancel(r->pool, &q->task))
            request_free(q);
    }
}
