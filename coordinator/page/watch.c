/* The frame that a client watches: which one it is, and its tiles. */
#include <inttypes.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/net/session/session.h"
#include "coordinator/page/watch_parts.h"
#include "protocol/message.h"

/* ---- what is sent to the client ------------------------------------------------------------------ */

static void tell(struct watcher *client, Azulejo__Wire__Envelope *envelope)
{
    session_reply(client->session, client->watch.request, envelope);
}

static void tell_picture(struct watcher *client, const struct job *job, int complete)
{
    const struct tile_watch *w = &client->watch;
    const struct render_settings *s = &job->settings;
    Azulejo__Wire__TilesPicture picture = AZULEJO__WIRE__TILES_PICTURE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TILES_PICTURE, tiles_picture, &picture);
    char *layers[AOV_COUNT + 1];

    for (int layer = LINEAR_PICTURE; layer < AOV_COUNT; layer++)
        if (linear_has_layer(s->aovs, layer))
            layers[picture.n_layers++] = (char *)linear_layer_name(layer);
    picture.job = w->job;
    picture.frame = w->frame;
    picture.width = s->width;
    picture.height = s->height;
    picture.tiles_x = tiles_across(s->width);
    picture.tiles_y = tiles_across(s->height);
    picture.layer = (char *)linear_layer_name(w->layer);
    picture.layers = layers;
    picture.complete = complete;
    tell(client, &envelope);
}

void watch_done(struct watcher *client, const struct error *why)
{
    Azulejo__Wire__TilesDone done = AZULEJO__WIRE__TILES_DONE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TILES_DONE, tiles_done, &done);

    watch_flush(client);
    if (why)
        session_fail(client->session, client->watch.request, why);
    else
        tell(client, &envelope);
    client->watch.state = WATCH_DONE;
}

/* Nothing will come of this watch. */
static void give_up(struct watcher *client, const struct error *why)
{
    watch_done(client, why);
    watch_end(client);
}

/* ---- which frame ------------------------------------------------------------------------------ */

/* The newest frame that is done, from `from` on. */
static uint32_t newest_done(const struct job *job, uint32_t from)
{
    uint32_t number = job->last_frame;

    while (number > from && !job_frame_is_done(job, number))
        number--;
    return number;
}

/* The frame in work; else the newest that is done. One that is shown and not done stays: it goes on some time.
 * Frames may end between two looks, and in another order, so the one that is shown may not be the last. */
static uint32_t frame_to_follow(struct tile_watch *w, const struct job *job)
{
    uint32_t from = w->picture.tiles > 0 ? w->frame : job->first_frame;

    if (job->frames)
        return job->frames->number;
    if (w->picture.tiles > 0 && (!job_frame_is_done(job, from) || w->frames_done == job->frames_done_count))
        return from;
    w->frames_done = job->frames_done_count;
    return newest_done(job, from);
}

/* The client sees another frame, or this one from its beginning. */
static int begin_frame(struct watcher *client, const struct job *job, uint32_t number)
{
    struct tile_watch *w = &client->watch;

    stored_end(client);
    w->frame = number;
    w->epoch = job->epoch_floor;
    w->samples = 0;
    w->in_turn = w->is_final = w->is_read = 0;
    if (!picture_begin(&w->picture, job->settings.width, job->settings.height))
        return 0;
    tell_picture(client, job, !farm_frame_find(job, number) && job_frame_is_done(job, number));
    w->state = WATCH_FRAME;
    return 1;
}

void watch_follow(struct watcher *client, uint64_t now_ns)
{
    struct tile_watch *w = &client->watch;
    const struct job *job = queue_find(&client->all->server->farm.queue, w->job);
    struct error err = {0};
    uint32_t number;

    if (!job) {
        error_set(&err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ": there is none of that number", w->job);
        give_up(client, &err);
        return;
    }
    number = w->asked ? w->asked : frame_to_follow(w, job);
    if (w->picture.tiles == 0 || number != w->frame || w->epoch != job->epoch_floor) {
        if (w->picture.tiles > 0 && w->state != WATCH_DONE)
            watch_done(client, NULL);
        if (!begin_frame(client, job, number)) {
            error_no_memory(&err, "the live picture");
            give_up(client, &err);
            return;
        }
    }
    if (farm_frame_find(job, number)) {
        if (w->state == WATCH_STORED)
            stored_end(client);
        w->state = WATCH_FRAME;
        w->is_read = 0;
    } else if (w->state == WATCH_FRAME && job_frame_is_done(job, number)) {
        if (w->is_final)
            watch_done(client, NULL);
        else
            w->state = WATCH_STORED;
    } else if (w->state == WATCH_FRAME && !w->is_read) { /* its job is paused, or it had to leave */
        w->is_read = !store_film_exists(client->all->server->store, job->id, number);
        w->state = w->is_read ? WATCH_FRAME : WATCH_STORED;
    }
    if (w->state == WATCH_STORED)
        stored_turn(client, job, now_ns);
}

void watch_begin(struct watcher *client, uint64_t request, uint64_t number, uint32_t frame, const char *layer)
{
    struct watching *all = client->all;
    const struct job *job = queue_find(&all->server->farm.queue, number);
    struct error err = {0};

    client->watch = (struct tile_watch){.state = WATCH_FRAME, .request = request, .job = number, .asked = frame,
                                        .layer = linear_layer_parse(layer[0] ? layer : linear_layer_name(LINEAR_PICTURE))};
    all->watching++;
    if (!all->cache)
        all->cache = mem_calloc(TILES_CACHE, sizeof *all->cache);
    if (job && frame && (frame < job->first_frame || frame > job->last_frame))
        error_set(&err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has frames %u to %u", number, job->first_frame,
                  job->last_frame);
    else if (job && !linear_has_layer(job->settings.aovs, client->watch.layer))
        error_set(&err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has no layer '%.40s'", number, layer);
    else if (!all->cache)
        error_no_memory(&err, "the live picture");
    if (err.code != STATUS_OK) {
        give_up(client, &err);
        return;
    }
    watch_follow(client, clock_monotonic_ns());
    watching_wake(all, 1);
}

void watch_end(struct watcher *client)
{
    struct tile_watch *w = &client->watch;
    struct watching *all = client->all;

    if (w->state == WATCH_NONE)
        return;
    stored_end(client);
    picture_end(&w->picture);
    buffer_release(&w->message);
    memset(w, 0, sizeof *w);
    if (--all->watching == 0) {
        mem_free(all->cache);
        all->cache = NULL;
    }
}

/* ---- tiles ------------------------------------------------------------------------------------ */

void watch_flush(struct watcher *client)
{
    struct tile_watch *w = &client->watch;
    Azulejo__Wire__Tiles tiles = AZULEJO__WIRE__TILES__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(TILES, tiles, &tiles);

    if (w->message_tiles == 0)
        return;
    if (buffer_ok(&w->message)) {
        tiles.count = w->message_tiles;
        tiles.records = (ProtobufCBinaryData){w->message.size, w->message.data};
        client->unread += w->message.size;
        tell(client, &envelope);
    }
    buffer_clear(&w->message);
    w->message_tiles = 0;
}

void watch_add(struct tile_watch *w, const uint8_t *record, size_t size)
{
    buffer_append(&w->message, record, size);
    w->message_tiles++;
}

/* The tile's record, made once for all who watch the same. */
static const struct tile_cache_entry *encode(struct watching *all, const struct tile_watch *w,
                                             const struct job_frame *frame, uint32_t tile)
{
    struct tile_cache_entry *e = &all->cache[tile % TILES_CACHE];
    uint32_t samples = frame->shown[tile];

    if (e->size > 0 && e->job == w->job && e->epoch == w->epoch && e->frame == frame->number && e->tile == tile &&
        e->samples == samples && e->layer == w->layer)
        return e;
    e->job = w->job;
    e->epoch = w->epoch;
    e->frame = frame->number;
    e->tile = tile;
    e->samples = samples;
    e->layer = w->layer;
    e->size = (uint32_t)linear_tile(frame->film, tile, w->layer, e->record);
    return e;
}

/* Has all of it been sent, as it is now? */
static int is_up_to_date(const struct tile_watch *w, const struct job_frame *frame)
{
    return w->samples == film_samples(frame->film) && !w->in_turn && w->picture.is_exact;
}

/* Send the next tiles. 1: there may be more for this turn. */
static int send_tiles(struct watcher *client, const struct job_frame *frame, int *again)
{
    struct watching *all = client->all;
    struct tile_watch *w = &client->watch;
    /* Its last tiles go out while its files are made: what is late is read from the disk, for each client again. */
    int ended = frame->end != FRAME_END_NONE;

    for (int i = 0; i < TILES_SLICE_TILES; i++) {
        const struct tile_cache_entry *e;
        int is_first;
        int64_t tile;
        if (!client_has_room(client) || (all->share_ns <= 0 && w->picture.fresh_left == 0 && !ended))
            return 0;
        tile = picture_next(&w->picture, frame->shown, &is_first);
        if (tile == PICTURE_NO_TILE) {
            w->in_turn = 0;
            return 0;
        }
        e = encode(all, w, frame, (uint32_t)tile);
        watch_add(w, e->record, e->size);
        *again += !is_first;
        if (w->message.size >= TILES_MESSAGE_BYTES)
            watch_flush(client);
    }
    return 1;
}

static int film_slice(struct watcher *client, const struct job_frame *frame, uint64_t now_ns, int begins_turn)
{
    struct tile_watch *w = &client->watch;
    uint64_t begin_ns;
    int again = 0, more;

    if (is_up_to_date(w, frame)) {
        w->is_final = frame->end != FRAME_END_NONE;
        return 0;
    }
    if (!w->in_turn && !begins_turn)
        return 0;
    if (w->in_turn) {
        if (begins_turn)
            picture_turn_on(&w->picture);
    } else {
        if (w->samples != film_samples(frame->film))
            w->changed_ns = now_ns;
        w->samples = film_samples(frame->film); /* what changes from here on is for the next turn */
        picture_turn(&w->picture, frame->end != FRAME_END_NONE || now_ns - w->changed_ns >= TILES_STILL_MS * NS_PER_MS);
        w->in_turn = 1;
    }
    begin_ns = clock_thread_cpu_ns(); /* on a busy machine much more time passes than is used */
    more = send_tiles(client, frame, &again);
    if (again > 0)
        client->all->share_ns -= (int64_t)(clock_thread_cpu_ns() - begin_ns);
    return more;
}

int watch_slice(struct watcher *client, uint64_t now_ns, int begins_turn)
{
    struct tile_watch *w = &client->watch;
    const struct job *job = queue_find(&client->all->server->farm.queue, w->job);
    const struct job_frame *frame = job ? farm_frame_find(job, w->frame) : NULL;

    if (w->state == WATCH_STORED && job && !begins_turn)
        stored_turn(client, job, now_ns);
    if (w->state != WATCH_FRAME || !frame || w->epoch != job->epoch_floor)
        return 0;
    return film_slice(client, frame, now_ns, begins_turn);
}
