/* A frame that is not open, sent from what the store kept: read in the thread pool, a piece at a time. */
#include "common/base/bytes.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/net/base/task.h"
#include "coordinator/page/watch_parts.h"

/* The client's, until it goes while a piece is being read: then the task's. */
struct stored_watch {
    struct watching *all;
    struct watcher *client; /* NULL: it went */
    struct stored_tiles *tiles;
    struct buffer bytes; /* records, */
    size_t at;           /* of which these were sent */
    int is_reading, end;
    int is_picture;    /* it has no film, as far as is known */
    uint64_t moved_ns; /* when the client took something last */
};

struct stored_task {
    struct task task;
    struct stored_watch *stored;
};

static void stored_free(struct stored_watch *s)
{
    s->all->stored--;
    s->all->stored_pictures -= (uint32_t)s->is_picture;
    stored_tiles_free(s->tiles);
    buffer_release(&s->bytes);
    mem_free(s);
}

static void task_run(struct task *task)
{
    struct stored_watch *s = ((struct stored_task *)task)->stored;

    task->result = stored_tiles_read(s->tiles, task->server->store, TILES_STORED_BYTES, &s->bytes, &s->end, &task->error);
}

void stored_end(struct watcher *client)
{
    struct stored_watch *s = client->watch.stored;

    client->watch.stored = NULL;
    if (!s)
        return;
    s->client = NULL;
    if (!s->is_reading)
        stored_free(s);
}

/* Or, with `why`, all that can be. A frame that is not done goes on some time. */
static void all_sent(struct watcher *client, const struct error *why)
{
    struct tile_watch *w = &client->watch;
    const struct job *job = queue_find(&client->all->server->farm.queue, w->job);

    stored_end(client);
    if (!job || job_frame_is_done(job, w->frame)) {
        watch_done(client, why);
        return;
    }
    w->is_read = 1;
    w->state = WATCH_FRAME;
}

static void task_end(struct task *task)
{
    struct stored_watch *s = ((struct stored_task *)task)->stored;

    s->is_reading = 0;
    if (s->is_picture && stored_tiles_are_exact(s->tiles)) {
        s->is_picture = 0;
        s->all->stored_pictures--;
    }
    if (!s->client) {
        stored_free(s);
    } else if (task->result != STATUS_OK) {
        all_sent(s->client, &task->error);
    } else {
        watching_wake(s->all, 1);
    }
}

static const struct task_kind stored_kind = {"a picture's tiles", sizeof(struct stored_task), task_run, task_end, NULL, 0};

/* 1: the open ones leave no place. A film that is open leaves one for another film. */
static int is_full(const struct watching *all)
{
    return all->stored >= STORED_TILES_OPEN || all->stored_pictures >= STORED_PICTURES_OPEN;
}

/* Is there a place? A client that takes nothing gives up its own; it goes on later. */
static int make_room(struct watching *all, uint64_t now_ns)
{
    for (struct watcher *c = all->clients; c && is_full(all); c = c->next) {
        struct stored_watch *s = c->watch.stored;
        if (s && !s->is_reading && now_ns - s->moved_ns > TILES_STORED_STALL_MS * NS_PER_MS &&
            (s->is_picture || all->stored >= STORED_TILES_OPEN))
            stored_end(c);
    }
    return !is_full(all);
}

static void begin(struct watcher *client, const struct job *job, uint64_t now_ns)
{
    struct watching *all = client->all;
    struct tile_watch *w = &client->watch;
    struct error err = {0};
    struct stored_watch *s;

    if (!client_has_room(client) || !make_room(all, now_ns))
        return;
    s = mem_calloc(1, sizeof *s);
    if (!s || stored_tiles_new(&s->tiles, job, w->frame, w->layer, &err) != STATUS_OK) {
        mem_free(s);
        return; /* it is tried again */
    }
    s->all = all;
    s->client = client;
    s->moved_ns = now_ns;
    s->is_picture = 1;
    all->stored++;
    all->stored_pictures++;
    w->stored = s;
}

static void read_more(struct stored_watch *s)
{
    struct stored_task *t = task_new(s->all->server, &stored_kind, NULL);

    if (!t)
        return;
    buffer_clear(&s->bytes);
    s->at = 0;
    t->stored = s;
    s->is_reading = 1;
    task_start(&t->task);
}

/* The records that were read and that the client has not seen. */
static void send_some(struct watcher *client, struct stored_watch *s, uint64_t now_ns)
{
    struct tile_watch *w = &client->watch;

    while (s->at < s->bytes.size && client_has_room(client)) {
        const uint8_t *record = s->bytes.data + s->at;
        size_t pixels = (size_t)bytes_get16(record + 4) * bytes_get16(record + 6);
        size_t size = LINEAR_HEADER_BYTES + pixels * LINEAR_PIXEL_BYTES;
        uint32_t samples = stored_tiles_are_exact(s->tiles) ? bytes_get32(record + 8) / LINEAR_SAMPLES_ONE : UINT32_MAX;
        if (picture_wants(&w->picture, bytes_get32(record), samples))
            watch_add(w, record, size);
        s->at += size;
        s->moved_ns = now_ns;
        if (w->message.size >= TILES_MESSAGE_BYTES)
            watch_flush(client);
    }
}

void stored_turn(struct watcher *client, const struct job *job, uint64_t now_ns)
{
    struct tile_watch *w = &client->watch;

    if (!w->stored)
        begin(client, job, now_ns);
    if (!w->stored || w->stored->is_reading)
        return;
    send_some(client, w->stored, now_ns);
    if (w->stored->at < w->stored->bytes.size)
        return;
    if (w->stored->end) {
        all_sent(client, NULL);
    } else {
        read_more(w->stored);
    }
}
