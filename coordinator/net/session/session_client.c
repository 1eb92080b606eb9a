/* What clients ask about jobs and workers, and which function handles which message. */
#include <inttypes.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/steering/report.h"
#include "common/schema/requests.h"
#include "coordinator/farm/waiting.h"
#include "coordinator/net/base/held.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_audit.h"
#include "coordinator/net/session/session_keys.h"
#include "coordinator/net/session/session_may.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/session/session_messages.h"
#include "protocol/message.h"

enum { JOB_LIST_MAX = 1000 }; /* jobs in one list: below 3 MiB, whatever their names and texts */

/* ---- job lists ------------------------------------------------------------------------------ */

/* The newest jobs that match the query, at most JOB_LIST_MAX, in ascending order; *older is the
 * number of older ones that match. */
static size_t select_jobs(const struct queue *queue, const Azulejo__Wire__JobQuery *query,
                          struct job *out[JOB_LIST_MAX], uint64_t *older)
{
    size_t count = 0;

    *older = 0;
    for (size_t i = queue->count; i-- > 0;) {
        struct job *job = queue->all[i];
        int ended = job_state_ended(job->state);

        if ((query->before && job->id >= query->before) ||
            (query->filter == AZULEJO__WIRE__JOB_FILTER__JOBS_ACTIVE && ended) ||
            (query->filter == AZULEJO__WIRE__JOB_FILTER__JOBS_ENDED && !ended))
            continue;
        if (count < JOB_LIST_MAX)
            out[JOB_LIST_MAX - ++count] = job;
        else
            ++*older;
    }
    memmove(out, out + JOB_LIST_MAX - count, count * sizeof *out);
    return count;
}

/* The first jobs in the order of service; those that wait for something else follow. */
static size_t select_first(struct farm *farm, uint32_t most, uint64_t now_ns, struct job *out[JOB_LIST_MAX])
{
    const struct order *order = waiting_order(farm, now_ns);
    size_t count = 0;

    most = most < JOB_LIST_MAX ? most : JOB_LIST_MAX;
    for (size_t i = 0; i < order->count && count < most; i++)
        out[count++] = order->jobs[i];
    for (size_t i = 0; i < farm->queue.active_count && count < most; i++)
        if (!farm->queue.active[i]->place.ready)
            out[count++] = farm->queue.active[i];
    return count;
}

/* The frames for which `is` holds, as bits; `bits` has room for SETTINGS_FRAMES_MAX. */
static void list_frames(const struct job *job, int (*is)(const struct job *job, uint32_t frame), uint8_t *bits,
                        ProtobufCBinaryData *out)
{
    *out = (ProtobufCBinaryData){job_frame_count(job) / 8 + 1, bits};
    memset(bits, 0, out->len);
    for (uint32_t i = 0; i < job_frame_count(job); i++)
        if (is(job, job->first_frame + i))
            bits[i / 8] |= (uint8_t)(1u << i % 8);
}

/* What only a job by itself says of its frames. */
static void list_single(const struct job *job, Azulejo__Wire__JobInfo *info)
{
    enum { LEFT, DONE, DEVELOPED, LISTS };
    static uint8_t bits[LISTS][SETTINGS_FRAMES_MAX / 8 + 1];

    if (job_frames_left(job) > 0)
        list_frames(job, job_frame_is_left, bits[LEFT], &info->resting);
    if (job->frames_done_count == 0)
        return;
    list_frames(job, job_frame_is_done, bits[DONE], &info->done);
    list_frames(job, job_frame_is_developed, bits[DEVELOPED], &info->developed);
}

/* `states`: also how many jobs the farm has in each. */
static status send_list(struct session *session, uint64_t request, struct job *const *jobs, size_t count,
                        uint64_t older, int states, uint64_t now_ns, struct error *err)
{
    uint32_t in_state[JOB_STATE_COUNT] = {0};
    struct job_report *reports = mem_alloc_array(count, sizeof *reports);
    Azulejo__Wire__JobInfo **pointers = mem_alloc_array(count, sizeof(Azulejo__Wire__JobInfo *));
    Azulejo__Wire__JobList list = AZULEJO__WIRE__JOB_LIST__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_LIST, job_list, &list);
    status s = reports && pointers ? STATUS_OK : error_no_memory(err, "a list of jobs");

    if (s == STATUS_OK) {
        for (size_t i = 0; i < count; i++) {
            job_report_make(&reports[i], &session->server->farm, jobs[i], now_ns);
            reports[i].message.told = ++session->server->farm.told;
            pointers[i] = &reports[i].message;
        }
        if (count == 1)
            list_single(jobs[0], &reports[0].message);
        list.n_jobs = count;
        list.jobs = pointers;
        list.older = older;
        for (size_t i = 0; states && i < session->server->farm.queue.count; i++)
            in_state[session->server->farm.queue.all[i]->state]++;
        list.n_states = states ? JOB_STATE_COUNT : 0;
        list.states = in_state;
        session_reply(session, request, &envelope);
    }
    mem_free(pointers);
    mem_free(reports);
    return s;
}

/* Send the job; if it is NULL, all jobs that match the query (NULL: all). */
static status send_jobs(struct session *session, uint64_t request, struct job *only,
                        const Azulejo__Wire__JobQuery *query, uint64_t now_ns, struct error *err)
{
    static const Azulejo__Wire__JobQuery any = AZULEJO__WIRE__JOB_QUERY__INIT;
    struct job *jobs[JOB_LIST_MAX];
    uint64_t older = 0;
    size_t count;

    if (only)
        return send_list(session, request, &only, 1, 0, 0, now_ns, err);
    if (query && query->first) {
        count = select_first(&session->server->farm, query->first, now_ns, jobs);
        return send_list(session, request, jobs, count, 0, 1, now_ns, err);
    }
    count = select_jobs(&session->server->farm.queue, query ? query : &any, jobs, &older);
    return send_list(session, request, jobs, count, older, 0, now_ns, err);
}

static status query(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns, struct error *err)
{
    uint64_t id = message->job_query->job;
    struct job *job = id ? session_job(session, id, err) : NULL;

    if (id && !job)
        return STATUS_ERR_NOT_FOUND;
    return send_jobs(session, message->request, job, message->job_query, now_ns, err);
}

static status watch(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns, struct error *err)
{
    const Azulejo__Wire__JobWatch *wanted = message->job_watch;
    struct watch *w;

    if (wanted->job != 0 && !session_job(session, wanted->job, err))
        return STATUS_ERR_NOT_FOUND;
    if (session->watch_count == SESSION_WATCHES_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "a connection may watch %d things at once", SESSION_WATCHES_MAX);
    w = &session->watches[session->watch_count++];
    *w = (struct watch){.request = message->request, .job = wanted->job, .due = 1};
    w->interval_ms = wanted->interval_ms < WATCH_INTERVAL_MIN_MS   ? WATCH_INTERVAL_MIN_MS
                     : wanted->interval_ms > WATCH_INTERVAL_MAX_MS ? WATCH_INTERVAL_MAX_MS
                                                                   : wanted->interval_ms;
    session_watching(session);
    session_watches_send(session, now_ns, 1);
    return STATUS_OK;
}

void session_watches_send(struct session *session, uint64_t now_ns, int only_due)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < session->watch_count; i++) {
        struct watch *watch = &session->watches[i];
        struct job *job = watch->job ? queue_find(&session->server->farm.queue, watch->job) : NULL;
        struct error err = {0};
        int timely = now_ns - watch->sent_ns >= watch->interval_ms * NS_PER_MS;
        /* Nothing more is queued for a peer that does not read. */
        int blocked = channel_is_full(session->channel);

        if (!blocked && (watch->due || (!only_due && timely))) {
            watch->due = 0;
            watch->sent_ns = now_ns;
            if (watch->job && !job) {
                error_set(&err, STATUS_ERR_NOT_FOUND, "job %" PRIu64 " was removed", watch->job);
                session_fail(session, watch->request, &err);
                continue;
            }
            if (send_jobs(session, watch->request, job, NULL, now_ns, &err) != STATUS_OK)
                session_fail(session, watch->request, &err);
            if (job && job_state_ended(job->state))
                continue;
        }
        session->watches[kept++] = *watch;
    }
    session->watch_count = kept;
}

/* ---- what changes a job --------------------------------------------------------------------- */

static status answer_changed(struct session *session, uint64_t request, const struct held_subject *subject,
                             uint64_t now_ns, struct error *err)
{
    struct job *job = session_job(session, subject->number, err);

    return job ? send_jobs(session, request, job, NULL, now_ns, err) : STATUS_ERR_NOT_FOUND;
}

status session_answer_change(struct session *session, uint64_t request, const struct job *job, status s,
                             struct error *err)
{
    const struct held_subject subject = {.number = job ? job->id : 0};

    return s == STATUS_OK ? session_hold(session, request, answer_changed, &subject, err) : s;
}

/* What the page and its API keep is theirs. */
static status guest(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns, struct error *err)
{
    const struct server_guest *page = &session->server->guest;

    if (!page->message)
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "this coordinator runs without its page, which tokens belong to (it was "
                         "started with --no-web, or built with WEB=0)");
    return page->message(page->user, session, message, now_ns, err);
}

/* ---- dispatch ------------------------------------------------------------------------------- */

/* Whose they are is in common/schema/requests.h. `holds`: it changes something, and its answer waits for the disk. */
static const struct handler {
    int body;
    enum request_name request;
    session_handler *run;
    int holds;
} handlers[] = {
#define ROW(name) AZULEJO__WIRE__ENVELOPE__BODY_##name, REQUEST_##name
    {ROW(BLOB_QUERY), session_blob_query, 0},
    {ROW(BLOB_GET), session_blob_get, 0},
    {ROW(BLOB_PUT), session_blob_put, 0},
    {ROW(JOB_SUBMIT), session_submit, 0},
    {ROW(JOB_QUERY), query, 0},
    {ROW(JOB_WATCH), watch, 0},
    {ROW(JOB_REMOVE), session_remove, 1},
#define VERB(NAME, ...) {ROW(JOB_##NAME), session_steer, 1},
    VERB_REQUESTS(VERB)
#undef VERB
        {ROW(JOB_LOG_GET), session_log, 0},
    {ROW(FARM_QUERY), session_farm, 0},
    {ROW(STORE_QUERY), session_store, 0},
    {ROW(JOB_TRACE_GET), session_trace, 0},
    {ROW(WORKER_QUERY), session_workers, 0},
    {ROW(WORKER_STEER), session_worker_steer, 1},
    {ROW(WORKER_DISTRUST), session_worker_distrust, 1},
    {ROW(OUTPUT_GET), session_output_get, 0},
    {ROW(HISTORY_GET), session_history_get, 0},
    {ROW(FRAME_TILES_GET), session_frame_tiles, 0},
    {ROW(RENDER_REQUEST), render_request_begin, 0},
    {ROW(KEY_QUERY), session_key_query, 0},
    {ROW(KEY_CHANGE), session_key_change, 0},
    {ROW(TOKEN_CREATE), guest, 1},
    {ROW(TOKEN_QUERY), guest, 0},
    {ROW(TOKEN_REVOKE), guest, 1},
    {ROW(TOKEN_RENEW), guest, 1},
    {ROW(METRICS_GET), guest, 0},
    {ROW(PAGE_BEGIN), guest, 0},
    {ROW(PAGE_LISTEN), guest, 0},
    {ROW(PAGE_NOTE), guest, 0},
    {ROW(PAGE_TAKEN), guest, 0},
    {ROW(TILES_WATCH), guest, 0},
    {ROW(TILES_TAKEN), guest, 0},
#undef ROW
};

static int is_client(const struct session *session) { return session->role >= FARM_ROLE_CLIENT; }

/* Is it a message of this side of the protocol? */
static int speaks(const struct session *session, const struct request_rule *rule)
{
    unsigned side = (session->worker ? REQUEST_FROM_WORKERS : 0u) | (is_client(session) ? REQUEST_FROM_PEOPLE : 0u) |
                    (session->of_page ? REQUEST_FROM_PAGE : 0u);

    return (side & rule->from) != 0;
}

int session_client_message(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns)
{
    struct error err = {0};

    for (size_t i = 0; i < sizeof handlers / sizeof *handlers; i++) {
        const struct handler *h = &handlers[i];
        status s;

        if (h->body != (int)message->body_case || !speaks(session, &request_rules[h->request]))
            continue;
        s = h->holds ? held_has_room(session->server, &err) : STATUS_OK;
        THEN(s, session_may(session, h->request, message, &err));
        THEN(s, h->run(session, message, now_ns, &err));
        if (is_client(session))
            session_audit(session, message, s, &err);
        if (s != STATUS_OK)
            session_fail(session, message->request, &err);
        return 1;
    }
    return 0;
}
