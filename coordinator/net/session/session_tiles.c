/* Answers questions about a frame's tiles. */
#include <inttypes.h>

#include "common/base/memory.h"
#include "coordinator/pictures/tile_map.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_messages.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"
#include "protocol/message.h"

/* ---- the answer ------------------------------------------------------------------------------ */

struct answer {
    Azulejo__Wire__FrameTile *tiles, **tile_pointers;
    Azulejo__Wire__FrameWorker *workers, **worker_pointers;
    Azulejo__Wire__FrameShare *shares, **share_pointers;
};

static status answer_init(struct answer *a, const struct tile_map *map, struct error *err)
{
    *a = (struct answer){
        mem_alloc_array(map->count, sizeof *a->tiles), mem_alloc_array(map->count, sizeof *a->tile_pointers),
        mem_alloc_array(map->worker_count, sizeof *a->workers),
        mem_alloc_array(map->worker_count, sizeof *a->worker_pointers),
        mem_alloc_array(map->share_count, sizeof *a->shares),
        mem_alloc_array(map->share_count, sizeof *a->share_pointers)};
    return a->tiles && a->tile_pointers && a->workers && a->worker_pointers && a->shares && a->share_pointers
               ? STATUS_OK : error_no_memory(err, "a frame's tiles");
}

static void answer_release(struct answer *a)
{
    mem_free(a->tiles);
    mem_free(a->tile_pointers);
    mem_free(a->workers);
    mem_free(a->worker_pointers);
    mem_free(a->shares);
    mem_free(a->share_pointers);
}

static void fill_tile(Azulejo__Wire__FrameTile *out, const struct tile_cell *cell)
{
    azulejo__wire__frame_tile__init(out);
    out->samples = cell->samples;
    out->error = (double)cell->error;
    out->cpu_ns = cell->cpu_ns;
    out->units = cell->units;
    out->worker = cell->worker;
    out->thread = cell->thread;
    out->passes = cell->passes;
}

static void fill_share(Azulejo__Wire__FrameShare *out, const struct tile_share *share)
{
    azulejo__wire__frame_share__init(out);
    out->worker = share->worker;
    out->thread = share->thread;
    out->units = share->units;
    out->samples = share->samples;
}

static void fill_worker(Azulejo__Wire__FrameWorker *out, struct deliverer *worker)
{
    azulejo__wire__frame_worker__init(out);
    out->name = worker->label;
    out->host = worker->host;
    out->process = worker->process;
}

static void send_map(struct session *session, uint64_t request, uint64_t job, uint32_t frame, struct tile_map *map)
{
    Azulejo__Wire__FrameTiles message = AZULEJO__WIRE__FRAME_TILES__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(FRAME_TILES, frame_tiles, &message);
    struct error err = {0};
    struct answer a;

    if (answer_init(&a, map, &err) == STATUS_OK) {
        for (size_t i = 0; i < map->share_count; i++)
            fill_share(a.share_pointers[i] = &a.shares[i], &map->shares[i]);
        for (uint32_t i = 0; i < map->count; i++) {
            fill_tile(a.tile_pointers[i] = &a.tiles[i], &map->cells[i]);
            a.tiles[i].n_shares = map->cells[i].share_count;
            a.tiles[i].shares = a.share_pointers + map->cells[i].first_share;
            a.tiles[i].group_passes = map->cells[i].group_passes;
            a.tiles[i].n_group_passes = map->with_shares ? GROUPS : 0;
        }
        for (uint32_t i = 0; i < map->worker_count; i++)
            fill_worker(a.worker_pointers[i] = &a.workers[i], &map->workers[i]);
        message.job = job;
        message.frame = frame;
        message.width = map->width;
        message.height = map->height;
        message.tiles_x = tiles_across(map->width);
        message.tiles_y = tiles_across(map->height);
        message.n_tiles = map->count;
        message.tiles = a.tile_pointers;
        message.n_workers = map->worker_count;
        message.workers = a.worker_pointers;
        session_reply(session, request, &envelope);
    } else {
        session_fail(session, request, &err);
    }
    answer_release(&a);
}

/* ---- a frame that is not in work ------------------------------------------------------------------ */

struct tiles_task {
    struct task task;
    uint32_t session, frame;
    uint64_t request, job;
    struct render_settings settings;
    struct tile_map map;
};

static void tiles_run(struct task *task)
{
    struct tiles_task *t = (struct tiles_task *)task;
    struct film_reader *reader;
    struct error *err = &task->error;
    uint32_t tile;
    status s = store_film_reader(task->server->store, t->job, t->frame, &t->settings, &reader, err);

    if (s == STATUS_ERR_NOT_FOUND)
        s = error_set(err, s, "job %" PRIu64 ", frame %u: its film was not kept, so its tiles are not known", t->job,
                      t->frame);
    task->result = s;
    while (s == STATUS_OK) {
        s = film_reader_next(reader, &tile, err);
        THEN(s, tile_map_take(&t->map, film_reader_film(reader), tile, err));
        if (s != STATUS_OK && s != STATUS_ERR_NOT_FOUND)
            task->result = s;
    }
    film_reader_close(reader);
}

static void tiles_end(struct task *task)
{
    struct tiles_task *t = (struct tiles_task *)task;
    struct session *session = session_find(task->server, t->session);

    if (!session || session->state != SESSION_OPEN)
        return;
    if (task->result == STATUS_OK)
        task->result = tile_map_name(&t->map, &task->server->farm, &task->error);
    if (task->result != STATUS_OK) {
        session_fail(session, t->request, &task->error);
        return;
    }
    send_map(session, t->request, t->job, t->frame, &t->map);
}

static void tiles_release(struct task *task) { tile_map_release(&((struct tiles_task *)task)->map); }

static const struct task_kind tiles_kind = {"a frame's tiles", sizeof(struct tiles_task), tiles_run, tiles_end,
                                            tiles_release, 0};

static status begin_stored(struct session *session, uint64_t request, const struct job *job,
                           const Azulejo__Wire__FrameTilesGet *get, struct error *err)
{
    struct tiles_task *t = task_new(session->server, &tiles_kind, err);
    status s =
        t ? tile_map_new(&t->map, job->settings.width, job->settings.height, get->shares, err) : STATUS_ERR_NO_MEMORY;

    if (s != STATUS_OK) {
        task_drop(t ? &t->task : NULL);
        return s;
    }
    t->session = session->id;
    t->request = request;
    t->job = job->id;
    t->frame = get->frame;
    t->settings = job->settings;
    task_start(&t->task);
    return STATUS_OK;
}

/* ---- a frame in work ------------------------------------------------------------------------- */

static status send_open(struct session *session, uint64_t request, const struct job_frame *frame, int with_shares,
                        struct error *err)
{
    struct tile_map map;
    status s = tile_map_new(&map, film_width(frame->film), film_height(frame->film), with_shares, err);

    for (uint32_t i = 0; i < map.count && s == STATUS_OK; i++)
        s = tile_map_take(&map, frame->film, i, err);
    THEN(s, tile_map_name(&map, &session->server->farm, err));
    if (s == STATUS_OK)
        send_map(session, request, frame->job->id, frame->number, &map);
    tile_map_release(&map);
    return s;
}

status session_frame_tiles(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                           struct error *err)
{
    const Azulejo__Wire__FrameTilesGet *get = message->frame_tiles_get;
    const struct job *job = session_job(session, get->job, err);
    uint32_t number = get->frame;
    const struct job_frame *frame;

    if (!job)
        return STATUS_ERR_NOT_FOUND;
    frame = farm_frame_find(job, number);
    if (frame)
        return send_open(session, message->request, frame, get->shares, err);
    if (number < job->first_frame || number > job->last_frame)
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has frames %u to %u", job->id, job->first_frame,
                         job->last_frame);
    if (!job_frame_is_done(job, number) && !store_film_exists(session->server->store, job->id, number))
        return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 ", frame %u has no samples yet", job->id, number);
    return begin_stored(session, message->request, job, get, err);
}
