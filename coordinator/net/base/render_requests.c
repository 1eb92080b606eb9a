#include "coordinator/net/base/render_requests.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/farm/roster.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "protocol/message.h"
#include "protocol/worker_name.h"

struct render_request {
    struct render_request *next;
    uint64_t number;
    uint32_t client, worker; /* sessions */
    uint64_t asked;          /* the client's request number */
    uint64_t job;            /* 0: none */
    enum isa isa;
    uint32_t tries;
    Azulejo__Wire__Envelope *message; /* a copy, complete */
};

static void request_free(struct server *server, struct render_request *q)
{
    struct render_request **at = &server->requests.first;

    while (*at != q)
        at = &(*at)->next;
    *at = q->next;
    server->requests.count--;
    message_free(q->message);
    mem_free(q);
}

static void say_failure(struct session *client, uint64_t asked, const struct error *why)
{
    if (client && client->state == SESSION_OPEN && message_send_failure(client->channel, asked, why) != STATUS_OK)
        log_debug("session %u: a failure was not sent", client->id);
}

static void request_fail(struct server *server, struct render_request *q, const struct error *why)
{
    say_failure(session_find(server, q->client), q->asked, why);
    request_free(server, q);
}

/* ---- choosing a worker ------------------------------------------------------------------------ */

static uint32_t requests_of(const struct server *server, uint32_t session)
{
    uint32_t count = 0;

    for (const struct render_request *q = server->requests.first; q; q = q->next)
        count += q->worker == session;
    return count;
}

/* What a thread of it has before it. */
static double busy(const struct session *s, uint32_t requests)
{
    return (double)(s->worker->held.units + requests) / (double)s->worker->threads;
}

/* May the worker render it? If not, `why` says so. */
static int may_render(const struct job *job, const struct render_request *q, const struct farm_worker *worker,
                      char *why, size_t why_size)
{
    if (job)
        return farm_can_serve(job, worker, why, why_size);
    snprintf(why, why_size, "it does not offer %s", isa_name(q->isa));
    return worker->isa_mask >> q->isa & 1;
}

/* How much is another worker to be preferred? 2: it is one of those, 1: it has the key of one. */
static int is_unwanted(const struct render_request *q, const struct farm_worker *worker)
{
    const Azulejo__Wire__RenderRequest *m = q->message->render_request;
    int most = 0;

    for (size_t i = 0; i < m->n_not_by && most < 2; i++)
        if (strcmp(m->not_by[i], worker->label) == 0)
            most = 2;
        else if (worker_labels_share_key(m->not_by[i], worker->label))
            most = 1;
    return most;
}

static int is_better(const struct render_request *q, const struct session *s, uint32_t requests,
                     const struct session *than, uint32_t its_requests)
{
    int unwanted = is_unwanted(q, s->worker), its = is_unwanted(q, than->worker);

    return unwanted != its ? unwanted < its : busy(s, requests) < busy(than, its_requests);
}

/* NULL: there is none, for the reason in *err. */
static struct session *choose_worker(struct server *server, const struct render_request *q, struct error *err)
{
    const struct job *job = q->job ? queue_find(&server->farm.queue, q->job) : NULL;
    struct session *best = NULL;
    char why[256] = "", last[256] = "";
    uint32_t connected = 0, full = 0;

    for (struct session *s = server->sessions; s; s = s->next) {
        uint32_t requests;
        if (!s->worker || s->state != SESSION_OPEN)
            continue;
        connected++;
        if (!worker_takes_work(s->worker)) {
            worker_explain(s->worker, last, sizeof last);
            continue;
        }
        if (!may_render(job, q, s->worker, why, sizeof why)) {
            memcpy(last, why, sizeof last);
            continue;
        }
        requests = requests_of(server, s->id);
        if (requests >= RENDER_REQUESTS_PER_WORKER)
            full++;
        else if (!best || is_better(q, s, requests, best, requests_of(server, best->id)))
            best = s;
    }
    if (best)
        return best;
    if (connected == 0)
        error_set(err, STATUS_ERR_NOT_FOUND, "no worker is connected: start one, and ask again");
    else if (full)
        error_set(err, STATUS_ERR_LIMIT, "every worker has %d requests already; try again in a moment",
                  RENDER_REQUESTS_PER_WORKER);
    else
        error_set(err, STATUS_ERR_NOT_FOUND, "none of the %u workers can render it: %s", connected, last);
    return NULL;
}

/* Send it to a worker, or fail and free it. */
static void request_send(struct server *server, struct render_request *q)
{
    struct error err = {0};
    struct session *worker = NULL;
    struct digest scene;

    if (q->tries++ == RENDER_TRIES_MAX)
        error_set(&err, STATUS_ERR_UNREACHABLE, "%d workers were lost while they rendered it: it may "
                  "crash them; see their logs", RENDER_TRIES_MAX);
    else
        worker = choose_worker(server, q, &err);
    if (!worker) {
        request_fail(server, q, &err);
        return;
    }
    q->worker = worker->id;
    log_debug("request %" PRIu64 " of session %u goes to session %u", q->number, q->client, worker->id);
    q->message->request = q->number;
    if (wire_digest_get(&scene, &q->message->render_request->scene, "the scene", NULL) == STATUS_OK)
        scenes_show(&worker->scenes, &scene);
    /* Not sent: its channel closes, and the request goes to another. */
    if (channel_send(worker->channel, q->message) != STATUS_OK)
        log_debug("session %u: a RenderRequest was not sent", worker->id);
}

/* ---- taking one ------------------------------------------------------------------------------- */

/* An owned copy, by way of the wire's form. */
static status copy_message(struct render_request *q, Azulejo__Wire__RenderRequest *request, struct error *err)
{
    Azulejo__Wire__Envelope e = MESSAGE(RENDER_REQUEST, render_request, request);
    size_t size = azulejo__wire__envelope__get_packed_size(&e);
    uint8_t *bytes = mem_alloc(size);
    status s = bytes ? STATUS_OK : error_no_memory(err, "a request");

    if (s == STATUS_OK) {
        azulejo__wire__envelope__pack(&e, bytes);
        s = message_unpack(&q->message, bytes, size, err);
    }
    mem_free(bytes);
    return s;
}

static status check_frame(const struct job *job, uint32_t frame, struct error *err)
{
    if (frame >= job->first_frame && frame <= job->last_frame)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " has frames %u to %u, not %u", job->id,
                     job->first_frame, job->last_frame, frame);
}

static status check_scene(const char *folder, const struct digest *scene, struct error *err)
{
    uint64_t size;
    int found = blobs_find(folder, scene, &size);

    if (found > 0)
        return STATUS_OK;
    if (found < 0)
        return error_set(err, STATUS_ERR_IO, "the coordinator cannot look for the scene: %s", strerror(errno));
    return error_set(err, STATUS_ERR_NOT_FOUND, "the coordinator no longer has the scene");
}

/* The message with the job's scene and settings, or those that it names itself. */
static status complete(struct server *server, struct render_request *q, const Azulejo__Wire__RenderRequest *message,
                       struct error *err)
{
    Azulejo__Wire__RenderSettings wire = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__RenderRequest whole = *message;
    const struct job *job = NULL;
    struct render_settings settings;
    struct digest scene;
    status s;

    if (message->job) {
        job = queue_find(&server->farm.queue, message->job);
        if (!job)
            return error_set(err, STATUS_ERR_NOT_FOUND, "there is no job %" PRIu64, message->job);
        settings = job->settings;
        scene = job->scene;
        s = check_frame(job, message->frame, err);
    } else {
        s = wire_digest_get(&scene, &message->scene, "the scene", err);
        THEN(s, wire_settings_get(&settings, message->settings, UINT32_MAX, err));
    }
    THEN(s, wire_piece_check(message, &settings, err));
    if (s == STATUS_OK && message->n_not_by > RENDER_NOT_BY_MAX)
        s = error_set(err, STATUS_ERR_LIMIT, "%zu names of workers: at most %d", message->n_not_by, RENDER_NOT_BY_MAX);
    THEN(s, check_scene(store_folder(server->store), &scene, err));
    if (s != STATUS_OK)
        return s;
    q->job = message->job;
    q->isa = settings.isa;
    wire_settings_set(&wire, &settings);
    whole.settings = &wire;
    wire_digest_set(&whole.scene, &scene);
    return copy_message(q, &whole, err);
}

status render_request_begin(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                            struct error *err)
{
    struct server *server = session->server;
    struct render_request *q = mem_calloc(1, sizeof *q);
    status s = q ? STATUS_OK : error_no_memory(err, "a request");

    if (s == STATUS_OK && server->requests.count >= RENDER_REQUESTS_MAX)
        s = error_set(err, STATUS_ERR_LIMIT, "%d requests are under way already; try again in a moment",
                      RENDER_REQUESTS_MAX);
    THEN(s, complete(server, q, message->render_request, err));
    if (s != STATUS_OK) {
        mem_free(q);
        return s;
    }
    q->client = session->id;
    q->asked = message->request;
    q->number = ++server->requests.last;
    q->next = server->requests.first;
    server->requests.first = q;
    server->requests.count++;
    request_send(server, q);
    return STATUS_OK;
}

/* ---- answers, and what becomes of both ends --------------------------------------------------- */

static void pass_on(struct session *client, uint64_t asked, const struct session *worker,
                    const Azulejo__Wire__RenderResult *result)
{
    Azulejo__Wire__RenderResult named = *result;
    Azulejo__Wire__Envelope e = MESSAGE(RENDER_RESULT, render_result, &named);

    named.worker = worker->worker->name;
    named.worker_name = worker->worker->label;
    e.request = asked;
    if (client->state == SESSION_OPEN && channel_send(client->channel, &e) != STATUS_OK)
        log_debug("session %u: a RenderResult was not sent", client->id);
}

void render_request_answer(struct session *worker, const Azulejo__Wire__Envelope *message)
{
    struct server *server = worker->server;
    struct render_request *q = server->requests.first;
    struct session *client;
    struct error err = {0};

    if (unit_audits_answer(worker, message))
        return;
    while (q && (q->number != message->request || q->worker != worker->id))
        q = q->next;
    if (!q)
        return;
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE) {
        (void)!message_failure_get(message->failure, &err);
        error_prefix(&err, "%s", worker->worker->name);
        request_fail(server, q, &err);
        return;
    }
    client = session_find(server, q->client);
    if (client)
        pass_on(client, q->asked, worker, message->render_result);
    request_free(server, q);
}

void render_requests_session_gone(struct server *server, uint32_t session)
{
    struct render_request *next;

    for (struct render_request *q = server->requests.first; q; q = next) {
        next = q->next;
        if (q->client == session)
            request_free(server, q);
        else if (q->worker == session)
            request_send(server, q);
    }
}

void render_requests_release(struct server *server)
{
    while (server->requests.first)
        request_free(server, server->requests.first);
}
