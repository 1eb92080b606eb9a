#include "coordinator/net/base/recalls.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "coordinator/farm/roster.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/task.h"
#include "coordinator/net/server.h"
#include "coordinator/store/files/blobs.h"
#include "protocol/message.h"

static const char *hex_of(const struct recall *recall, char hex[DIGEST_HEX_SIZE])
{
    digest_to_hex(&recall->digest, hex);
    return hex;
}

void recalls_want(struct server *server, const struct digest *digest, uint64_t limit_bytes)
{
    struct recalls *r = &server->recalls;

    for (uint32_t i = 0; i < r->count; i++)
        if (digest_equal(&r->line[i].digest, digest)) {
            if (r->line[i].limit_bytes < limit_bytes)
                r->line[i].limit_bytes = limit_bytes;
            return;
        }
    if (r->count < RECALLS_MAX)
        r->line[r->count++] = (struct recall){*digest, limit_bytes};
}

struct doubt_task {
    struct task task;
    struct digest digest;
    uint64_t limit_bytes;
    int is_damaged;
};

static void doubt_run(struct task *task)
{
    struct doubt_task *t = (struct doubt_task *)task;
    const char *folder = store_folder(task->server->store);

    t->is_damaged = blobs_check(folder, &t->digest) == 0;
    if (t->is_damaged)
        blobs_drop_damaged(folder, &t->digest);
}

static void doubt_end(struct task *task)
{
    const struct doubt_task *t = (const struct doubt_task *)task;

    task->server->recalls.is_doubting = 0;
    if (t->is_damaged)
        recalls_want(task->server, &t->digest, t->limit_bytes);
}

static const struct task_kind doubt_kind = {"a look at a blob", sizeof(struct doubt_task), doubt_run, doubt_end, NULL, 0};

void recalls_doubt(struct server *server, const struct digest *digest, uint64_t limit_bytes)
{
    struct doubt_task *t = server->recalls.is_doubting ? NULL : task_new(server, &doubt_kind, NULL);

    if (!t)
        return;
    t->digest = *digest;
    t->limit_bytes = limit_bytes;
    server->recalls.is_doubting = 1;
    task_start(&t->task);
}

/* The worker that is asked will not bring it. */
static void end_asking(struct recalls *r)
{
    upload_free(r->upload);
    r->upload = NULL;
    r->session = 0;
}

/* The first in the line is over. */
static void end_first(struct recalls *r)
{
    end_asking(r);
    r->number = 0;
    memmove(r->line, r->line + 1, --r->count * sizeof *r->line);
}

/* ---- asking ---------------------------------------------------------------------------------- */

static struct session *next_worker(struct server *server)
{
    const struct recalls *r = &server->recalls;
    struct session *next = NULL;

    for (struct session *s = server->sessions; s; s = s->next)
        if (s->worker && s->state == SESSION_OPEN && s->id > r->asked && s->id <= r->last && (!next || s->id < next->id))
            next = s;
    return next;
}

static void ask(struct server *server, struct session *worker, uint64_t now_ns)
{
    Azulejo__Wire__BlobGet get = AZULEJO__WIRE__BLOB_GET__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_GET, blob_get, &get);
    struct recalls *r = &server->recalls;

    wire_digest_set(&get.digest, &r->line[0].digest);
    e.request = r->number = worker->recall = ++server->requests.last;
    r->asked = r->session = worker->id;
    r->begun_ns = r->heard_ns = now_ns;
    if (channel_send(worker->channel, &e) != STATUS_OK)
        log_debug("session %u: a BlobGet was not sent", worker->id);
}

/* Ask the next worker for the first in the line, or the first one for the next. */
static void ask_next(struct server *server, uint64_t now_ns)
{
    struct recalls *r = &server->recalls;
    char hex[DIGEST_HEX_SIZE];

    while (r->count > 0 && !r->session && !r->is_storing) {
        uint64_t size;
        struct session *worker;
        if (r->number == 0) {
            r->asked = 0;
            r->last = server->last_session;
        }
        if (blobs_find(store_folder(server->store), &r->line[0].digest, &size) != 0) {
            end_first(r); /* sent again by a client, or not to be known at present */
            continue;
        }
        worker = next_worker(server);
        if (worker) {
            ask(server, worker, now_ns);
            return;
        }
        log_warn("blob %.12s is missing, and no worker that is connected has it: submit its scene again",
                 hex_of(&r->line[0], hex));
        end_first(r);
    }
}

/* This long may it take one worker, by the size that it names. */
static uint64_t patience_ns(const struct recalls *r)
{
    return (RECALL_S + (r->upload ? upload_total(r->upload) >> 20 : 0)) * NS_PER_SECOND;
}

void recalls_tick(struct server *server, uint64_t now_ns)
{
    struct recalls *r = &server->recalls;
    struct digest dropped;

    while (blobs_take_dropped(&dropped))
        recalls_want(server, &dropped, BLOB_BYTES_MAX); /* it may have been cut */
    if (r->session &&
        (now_ns - r->heard_ns > RECALL_SILENCE_S * NS_PER_SECOND || now_ns - r->begun_ns > patience_ns(r))) {
        log_warn("session %u: did not send a blob that it was asked for in time", r->session);
        end_asking(r);
    }
    ask_next(server, now_ns);
}

/* ---- storing --------------------------------------------------------------------------------- */

struct recall_task {
    struct task task;
    struct upload *upload;
    char worker[WORKER_LABEL_MAX + 1];
};

static void run(struct task *task) { task->result = upload_finish(((struct recall_task *)task)->upload, &task->error); }

static void end(struct task *task)
{
    const struct recall_task *t = (const struct recall_task *)task;
    struct server *server = task->server;
    struct recalls *r = &server->recalls;
    uint64_t now_ns = clock_monotonic_ns();
    char hex[DIGEST_HEX_SIZE];

    r->is_storing = 0;
    if (task->result == STATUS_OK) {
        log_info("blob %.12s is back, from the cache of worker %s", hex_of(&r->line[0], hex), t->worker);
        end_first(r);
        farm_shortages_hurry(&server->farm, now_ns);
    } else if (task->result == STATUS_ERR_INPUT) {
        log_warn("worker %s was asked for blob %.12s and sent other bytes: check its machine", t->worker, hex_of(&r->line[0], hex));
    } else {
        log_warn("a blob was not stored: %s", task->error.text);
        end_first(r); /* the store's trouble, not the worker's */
    }
    ask_next(server, now_ns);
}

static void release(struct task *task) { upload_free(((struct recall_task *)task)->upload); }

static const struct task_kind kind = {"a blob that comes back", sizeof(struct recall_task), run, end, release, 1};

static status store(struct session *worker, struct error *err)
{
    struct recalls *r = &worker->server->recalls;
    struct recall_task *t = task_new(worker->server, &kind, err);

    if (!t)
        return STATUS_ERR_NO_MEMORY;
    t->upload = r->upload;
    snprintf(t->worker, sizeof t->worker, "%s", worker->worker->label);
    r->upload = NULL;
    r->session = 0;
    r->is_storing = 1;
    task_start(&t->task);
    return STATUS_OK;
}

/* ---- what workers answer ---------------------------------------------------------------------- */

/* Pieces are whole ones, in order, of the blob that was asked for. */
static status check_piece(const struct recalls *r, const struct blob_piece *piece, struct error *err)
{
    uint64_t offset = r->upload ? upload_size(r->upload) : 0, total = r->upload ? upload_total(r->upload) : piece->total_bytes;

    if (!digest_equal(&piece->digest, &r->line[0].digest) || piece->offset != offset || piece->total_bytes != total ||
        piece->raw_bytes != blob_piece_size(total, offset))
        return error_set(err, STATUS_ERR_PROTOCOL, "the pieces of a blob must come in order");
    if (total > r->line[0].limit_bytes)
        return error_set(err, STATUS_ERR_LIMIT, "a blob of %" PRIu64 " bytes has at most %" PRIu64, total, r->line[0].limit_bytes);
    return STATUS_OK;
}

static status add_piece(struct session *worker, const struct blob_piece *piece, struct error *err)
{
    static uint8_t bytes[BLOB_PIECE_BYTES];
    struct server *server = worker->server;
    struct recalls *r = &server->recalls;

    TRY(check_piece(r, piece, err));
    TRY(blob_piece_unpack(piece, bytes, err));
    if (!r->upload) {
        TRY(farm_store_usable(&server->farm, err));
        TRY(upload_begin(&r->upload, store_folder(server->store), &piece->digest, piece->total_bytes, err));
    }
    TRY(upload_add(r->upload, bytes, piece->raw_bytes, err));
    return upload_size(r->upload) < upload_total(r->upload) ? STATUS_OK : store(worker, err);
}

status recalls_put(struct session *worker, const Azulejo__Wire__Envelope *message, uint64_t now_ns, struct error *err)
{
    struct recalls *r = &worker->server->recalls;
    struct blob_piece piece;
    struct error why = {0};

    if (!worker->recall || message->request > worker->recall)
        return error_set(err, STATUS_ERR_REFUSED, "a worker sends the blobs that it is asked for, and no others");
    TRY(blob_piece_of_put(&piece, message->blob_put, err));
    if (r->session != worker->id || message->request != r->number)
        return STATUS_OK; /* too late */
    r->heard_ns = now_ns;
    if (add_piece(worker, &piece, &why) == STATUS_OK)
        return STATUS_OK;
    log_warn("session %u (%s): a blob that it was asked for was not taken: %s", worker->id, worker->host, why.text);
    end_asking(r);
    ask_next(worker->server, now_ns);
    return STATUS_OK;
}

int recalls_failure(struct session *worker, const Azulejo__Wire__Envelope *message, uint64_t now_ns)
{
    struct recalls *r = &worker->server->recalls;

    if (!worker->recall || message->request != worker->recall)
        return 0;
    if (r->session == worker->id && message->request == r->number) {
        end_asking(r);
        ask_next(worker->server, now_ns);
    }
    return 1;
}

void recalls_session_gone(struct server *server, uint32_t session)
{
    if (server->recalls.session == session)
        end_asking(&server->recalls); /* the next tick asks another */
}

void recalls_release(struct server *server) { end_asking(&server->recalls); }
