#include "coordinator/net/session/session.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/scene/effects.h"
#include "coordinator/farm/distrusted.h"
#include "coordinator/farm/merge.h"
#include "coordinator/farm/roster.h"
#include "coordinator/farm/scheduler.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/scenes_shown.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/session/session_keys.h"
#include "protocol/message.h"
#include "protocol/worker_name.h"

enum { WORKER_THREADS_MAX = 4096, ROOM_MAX = 1 << 20 };

/* ---- acknowledgements ----------------------------------------------------------------------- */

static void send_acks(struct session *session)
{
    static Azulejo__Wire__WorkUnit units[SESSION_ACKS_MAX];
    static Azulejo__Wire__WorkUnit *pointers[SESSION_ACKS_MAX];
    Azulejo__Wire__ResultAck ack = AZULEJO__WIRE__RESULT_ACK__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(RESULT_ACK, result_ack, &ack);

    if (session->ack_count == 0)
        return;
    for (uint32_t i = 0; i < session->ack_count; i++) {
        Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT;
        unit.tile = session->acks[i].tile;
        unit.group = session->acks[i].group;
        unit.pass = session->acks[i].pass;
        units[i] = unit;
        pointers[i] = &units[i];
    }
    ack.job = session->ack_job;
    ack.frame = session->ack_frame;
    ack.n_units = session->ack_count;
    ack.units = pointers;
    session->ack_count = 0;
    session_send(session, &envelope);
}

void session_ack(struct session *session, uint64_t job, uint32_t frame, struct unit_name unit, uint64_t now_ns UNUSED)
{
    if (session->ack_count > 0 && (session->ack_job != job || session->ack_frame != frame))
        send_acks(session);
    session->ack_job = job;
    session->ack_frame = frame;
    session->acks[session->ack_count++] = unit;
    if (session->ack_count == SESSION_ACKS_MAX)
        send_acks(session);
    session_due(session);
}

void session_flush(struct session *session, uint64_t now_ns)
{
    if (session->state != SESSION_OPEN)
        return;
    send_acks(session);
    if (session->watch_count)
        session_watches_send(session, now_ns, 1);
}

/* ---- greeting ------------------------------------------------------------------------------- */

static void name_for_people(struct farm_worker *worker, const struct session *session)
{
    if (strcmp(worker->label, session->host) == 0)
        snprintf(worker->name, sizeof worker->name, "%s, process %u", session->host, session->process);
    else
        snprintf(worker->name, sizeof worker->name, "%.127s (%.40s, process %u)", worker->label, session->host,
                 session->process);
}

/* The older connection of a process that has connected again. */
static void end_replaced(struct server *server, const struct farm_worker *worker)
{
    struct session *old = session_find(server, worker->held.session);

    if (!old)
        return;
    log_info("worker %s (session %u) has connected again: its old connection is closed", worker->label, old->id);
    session_end(old, NULL);
}

static status make_worker(struct session *session, const Azulejo__Wire__Hello *hello, struct error *err)
{
    struct server *server = session->server;
    const char *other = strcmp(server->precision, "float") == 0 ? "double" : "float";
    const struct worker_claim claim = {session->host, hello->name, hello->name_chosen, channel_identity(session->channel)->name};
    struct farm_worker *worker, *replaced;
    status s;

    if (hello->arithmetic == elementary_fingerprint_of(other))
        return error_set(
            err, STATUS_ERR_REFUSED,
            "this worker computes in %s, the coordinator's workers in %s: its tiles would not match the others'. Use an "
            "azulejo-worker that computes in %s ('azulejo-worker --version' tells), or a coordinator with --precision %s",
            other, server->precision, server->precision, other);
    if (hello->arithmetic != server->fingerprint)
        return error_set(err, STATUS_ERR_REFUSED,
                         "this worker's arithmetic (fingerprint %016" PRIx64 ") differs from the "
                         "coordinator's (%016" PRIx64 "): its tiles would not match the others'. Use "
                         "the same release of azulejo, built by the same compiler with the same flags",
                         (uint64_t)hello->arithmetic, server->fingerprint);
    if (hello->threads < 1 || hello->threads > WORKER_THREADS_MAX)
        return error_set(err, STATUS_ERR_PROTOCOL, "a worker with %u threads: must be 1..%d", hello->threads,
                         WORKER_THREADS_MAX);
    if (!hello->kernel[0] || strlen(hello->kernel) > RAY_TRACER_NAME_MAX)
        return error_set(err, STATUS_ERR_PROTOCOL, "a worker must name its ray tracer in 1..%d bytes",
                         RAY_TRACER_NAME_MAX);
    if (hello->name[0] && !worker_label_is_valid(hello->name))
        return error_set(err, STATUS_ERR_PROTOCOL, "a worker's name has 1 to %d letters, digits, '.', '_' and '-'",
                         WORKER_NAME_BYTES_MAX);
    if (claim.key[0] && !worker_name_is_valid(claim.key))
        return error_set(err, STATUS_ERR_REFUSED, "the name of a worker's key has no '@', which this one has: %s", claim.key);
    worker = mem_calloc(1, sizeof *worker);
    NEED(worker, err, "a worker");
    worker->instance = hello->instance ? hello->instance : (uint64_t)server->farm.wall_s << 32 | session->id;
    worker->joined_at = server->farm.wall_s;
    snprintf(worker->address, sizeof worker->address, "%s", session->peer);
    worker->held.session = session->id;
    worker->threads = hello->threads;
    worker->machine = machine_identity(session->host, session->peer);
    worker->isa_mask = hello->isa_mask;
    message_text(worker->ray_tracer, sizeof worker->ray_tracer, hello->kernel);
    worker->memory = hello->memory;
    if (hello->tags[0] && tags_parse(hello->tags, worker->tags, err) != STATUS_OK) {
        mem_free(worker);
        return STATUS_ERR_PROTOCOL;
    }
    snprintf(worker->deliverer.host, sizeof worker->deliverer.host, "%s", session->host);
    snprintf(worker->deliverer.software, sizeof worker->deliverer.software, "%s", session->software);
    worker->deliverer.process = session->process;
    s = roster_join(&server->farm, worker, &claim, &replaced, err);
    if (s == STATUS_OK && replaced)
        end_replaced(server, replaced);
    if (s == STATUS_OK) {
        name_for_people(worker, session);
        s = farm_worker_add(&server->farm, worker, err);
    }
    if (s != STATUS_OK) {
        roster_leave(&server->farm, worker);
        mem_free(worker);
        return s;
    }
    worker_line_add(&server->farm, worker, "joins from %.100s as session %u", session->peer, session->id);
    session->worker = worker;
    return STATUS_OK;
}

static void send_welcome(struct session *session, uint64_t request)
{
    Azulejo__Wire__Welcome welcome = AZULEJO__WIRE__WELCOME__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(WELCOME, welcome, &welcome);

    welcome.protocol_version = PROTOCOL_VERSION;
    welcome.software = (char *)"azulejo " AZULEJO_VERSION;
    welcome.session = session->id;
    if (session->worker)
        welcome.name = session->worker->label;
    else
        welcome.who = session->who;
    welcome.heartbeat_ms = SESSION_HEARTBEAT_MS;
    welcome.silence_limit_ms = SESSION_SILENCE_MS;
    envelope.request = request;
    session_send(session, &envelope);
}

static void set_who(struct session *session, const char *user)
{
    const struct key_identity *id = channel_identity(session->channel);
    char clean[64];

    if (id->name[0]) {
        snprintf(session->who, sizeof session->who, "%s", id->name);
        return;
    }
    message_text(clean, sizeof clean, user);
    snprintf(session->who, sizeof session->who, "%.62s%s%s", clean, clean[0] ? "@" : "", session->host);
}

/* The page's program, for itself or for a token. */
static status take_page(struct session *session, const Azulejo__Wire__Hello *hello, struct error *err)
{
    const struct server_guest *guest = &session->server->guest;

    session->token = hello->token;
    if (!hello->token)
        return STATUS_OK;
    session->role = FARM_ROLE_CLIENT;
    session->may = WEB_ROLE_NONE;
    if (!guest->greet)
        return error_set(err, STATUS_ERR_UNSUPPORTED, "this coordinator runs without its page (--no-web)");
    return guest->greet(guest->user, session, hello->token, err);
}

static void take_hello(struct session *session, const Azulejo__Wire__Envelope *message)
{
    struct error err = {0};
    status s;

    if (session_key_greet(session, &err) != STATUS_OK) {
        session_key_refused(session, &err);
        return;
    }
    if (message->body_case != AZULEJO__WIRE__ENVELOPE__BODY_HELLO) {
        error_set(&err, STATUS_ERR_PROTOCOL, "the first message must be a Hello");
        s = STATUS_ERR_PROTOCOL;
    } else {
        const Azulejo__Wire__Hello *hello = message->hello;
        message_text(session->host, sizeof session->host, hello->host);
        message_text(session->software, sizeof session->software, hello->software);
        session->process = hello->process;
        set_who(session, hello->user);
        s = hello_check(hello, session->role, &err);
        if (s == STATUS_OK && session->role == FARM_ROLE_WORKER)
            s = make_worker(session, hello, &err);
        if (s == STATUS_OK && session->role == FARM_ROLE_WEB)
            s = take_page(session, hello, &err);
        session->holder = session->token ? session->token : session->worker ? 0 : session->key;
        if (session->holder)
            channel_set_high(session->channel, SESSION_QUEUE);
    }
    if (s != STATUS_OK) {
        log_warn("session %u (%s %s) was refused: %s", session->id, session->host, session->peer, err.text);
        session_end(session, &err);
        return;
    }
    session->state = SESSION_OPEN;
    if (session->worker)
        log_info("worker %s (%s:%u) joins from %s as session %u: %u threads, %s", session->worker->label, session->host,
                 session->process, session->peer, session->id, session->worker->threads, session->worker->ray_tracer);
    else
        log_debug("%s %s:%u connects from %s as session %u", farm_role_name(session->role), session->host,
                  session->process, session->peer, session->id);
    send_welcome(session, message->request);
}

/* ---- a worker's messages -------------------------------------------------------------------- */

static void grant_message(struct session *session, const struct lease *lease)
{
    static Azulejo__Wire__WorkUnit units[LEASE_UNITS_MAX];
    static Azulejo__Wire__WorkUnit *pointers[LEASE_UNITS_MAX];
    Azulejo__Wire__LeaseGrant grant = AZULEJO__WIRE__LEASE_GRANT__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(LEASE_GRANT, lease_grant, &grant);
    const struct job *job = lease->frame->job;

    for (uint32_t i = 0; i < lease->unit_count; i++) {
        Azulejo__Wire__WorkUnit unit = AZULEJO__WIRE__WORK_UNIT__INIT;
        unit.tile = lease->units[i].tile;
        unit.group = lease->units[i].group;
        unit.pass = lease->units[i].pass;
        units[i] = unit;
        pointers[i] = &units[i];
    }
    wire_settings_set(&settings, &job->settings);
    grant.lease = lease->id;
    grant.epoch = lease->epoch;
    grant.job = job->id;
    grant.frame = lease->frame->number;
    grant.duration_ms = (uint32_t)(session->server->farm.leases.duration_ns / NS_PER_MS);
    scenes_show(&session->scenes, &job->scene);
    wire_digest_set(&grant.scene, &job->scene);
    grant.settings = &settings;
    grant.n_units = lease->unit_count;
    grant.units = pointers;
    session_send(session, &envelope);
}

void session_grant(struct session *session, uint64_t now_ns)
{
    struct lease *lease;

    if (!session->worker || session->state != SESSION_OPEN)
        return;
    while ((lease = scheduler_grant(&session->server->farm, session->worker, now_ns)))
        grant_message(session, lease);
}

static void audit_conflict(struct session *session, const struct delivery *result, const struct merge_conflict *conflict)
{
    struct audit_vote first = {.hash = conflict->hash};

    distrusted_label(&session->server->farm, conflict->deliverer, first.label);
    if (first.label[0])
        unit_audits_conflict(session, result, &first);
}

static void take_result(struct session *session, const Azulejo__Wire__TileResult *message, uint64_t now_ns)
{
    struct delivery result = {
        .lease = message->lease, .epoch = message->epoch, .job = message->job, .frame = message->frame};
    enum merge_outcome outcome = MERGE_PENDING;
    struct merge_conflict conflict = {0};
    struct error err = {0};
    uint64_t units_before;
    status s = wire_unit_get(&result.unit, message, &err);

    if (session->worker->hold == WORKER_BLOCKED) {
        session_revoke(session, result.lease, "the worker is blocked");
        return;
    }
    if (message->stats) {
        result.stats.cpu_ns = message->stats->cpu_ns;
        result.stats.trace_ns = message->stats->trace_ns;
        result.stats.effects = message->stats->effects & EFFECTS_ALL;
        for (size_t i = 0; i < message->stats->n_stages && i < STAGE_COUNT; i++)
            result.stats.stages[i] = message->stats->stages[i];
        for (size_t i = 0; i < message->stats->n_accounts && i < EFFECT_ACCOUNTS; i++)
            result.stats.accounts[i] = message->stats->accounts[i];
        result.times = (struct trace_unit_times){message->stats->began_ns, message->stats->wall_ns,
                                                 message->stats->sent_ns, message->stats->thread};
    }
    units_before = session->worker->units_done;
    THEN(s, merge_result(&session->server->farm, session->worker, &result, now_ns, &outcome, &conflict, &err));
    if (s == STATUS_ERR_NO_MEMORY) { /* a Failure would make the worker drop the result */
        outcome = MERGE_DEFERRED;
    } else if (s != STATUS_OK) {
        log_error("session %u (%s): %s", session->id, session->host, err.text);
        if (outcome == MERGE_IMPOSSIBLE)
            roster_block_liar(&session->server->farm, session->worker, result.job, err.text);
        session_end(session, &err);
        return;
    }
    if (conflict.found)
        audit_conflict(session, &result, &conflict);
    else if (outcome == MERGE_KEPT || outcome == MERGE_PENDING)
        unit_audits_result(session, &result, units_before);
    if (outcome == MERGE_KEPT)
        session_ack(session, result.job, result.frame, result.unit.name, now_ns);
    else if (outcome == MERGE_UNWANTED)
        session_revoke(session, result.lease, "this result is no longer needed");
    else if (outcome == MERGE_DEFERRED)
        session->worker->deferred_job = result.job;
}

static void take_return(struct session *session, const Azulejo__Wire__LeaseReturn *message)
{
    struct farm *farm = &session->server->farm;
    struct lease *lease = lease_find(&farm->leases, message->lease, 0);
    char reason[128];

    session->worker->room = 0; /* it asks again when it can take more */
    if (!lease || lease->holder != &session->worker->held)
        return;
    log_info("session %u (%s) returns %zu work units: %s", session->id, session->host, message->n_units,
             message_text(reason, sizeof reason, message->reason));
    farm_wake(farm);
    if (message->n_units == 0) {
        lease_end(&farm->leases, lease);
        return;
    }
    for (size_t i = 0; i < message->n_units; i++) {
        const struct unit_name name = {message->units[i]->tile, message->units[i]->group,
                                       message->units[i]->pass};
        /* Returning its last unit frees the lease. */
        lease = lease_find(&farm->leases, message->lease, 0);
        if (!lease)
            return;
        lease_return_unit(&farm->leases, lease, name);
    }
}

static void take_broken(struct session *session, const Azulejo__Wire__JobBroken *message, uint64_t now_ns)
{
    struct farm *farm = &session->server->farm;
    struct job *job = queue_find(&farm->queue, message->job);
    char text[256];

    message_text(text, sizeof text, message->text);
    log_warn("session %u (%s) cannot render job %" PRIu64 ": %s", session->id, session->host, message->job, text);
    if (job)
        farm_job_broken(farm, job, session->worker,
                        message->code < STATUS_COUNT ? (status)message->code : STATUS_ERR_INTERNAL, text, now_ns);
}

/* A line of the worker's log, for its own and a job's log. A worker that sends too many loses some. */
static void take_line(struct session *session, const Azulejo__Wire__Notice *notice, uint64_t now_ns)
{
    struct server *server = session->server;
    struct job_event event = {.job = notice->job, .at = server->farm.wall_s, .from_worker = 1};

    if (now_ns - session->lines_since_ns >= SESSION_LINES_MS * NS_PER_MS) {
        session->lines_since_ns = now_ns;
        session->lines = 0;
    }
    if (session->lines++ >= SESSION_LINES_MAX)
        return;
    message_text(event.text, sizeof event.text, notice->text);
    if (notice->own)
        worker_line_add(&server->farm, session->worker, "%.*s", WORKER_LINE_SIZE - 1, event.text);
    if (!notice->job || !queue_find(&server->farm.queue, notice->job))
        return;
    snprintf(event.who, sizeof event.who, "%.127s", session->worker->name);
    farm_event(&server->farm, &event);
}

/* 0: not a worker's message. */
static int worker_message(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns)
{
    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_REQUEST:
        session->worker->room = message->lease_request->units < ROOM_MAX ? message->lease_request->units : ROOM_MAX;
        workforce_due(&session->server->farm, session->worker);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_RETURN: take_return(session, message->lease_return); return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_TILE_RESULT: take_result(session, message->tile_result, now_ns); return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_RENDER_RESULT: render_request_answer(session, message); return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_WORKER_STATUS:
        session_worker_status(session, message->worker_status, now_ns);
        return 1;
    case AZULEJO__WIRE__ENVELOPE__BODY_JOB_BROKEN: take_broken(session, message->job_broken, now_ns); return 1;
    default: return 0;
    }
}

/* ---- the channel's callbacks ---------------------------------------------------------------- */

static void take_message(struct session *session, const Azulejo__Wire__Envelope *message)
{
    uint64_t now_ns = clock_monotonic_ns();
    struct error err = {0};
    char text[256];

    if (session->state == SESSION_ENDING)
        return;
    if (session->state == SESSION_GREETING) {
        take_hello(session, message);
        return;
    }
    switch (message->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT: return;
    case AZULEJO__WIRE__ENVELOPE__BODY_NOTICE:
        if (session->worker && (message->notice->job || message->notice->own)) {
            take_line(session, message->notice, now_ns);
            return;
        }
        log_info("session %u (%s) says: %s", session->id, session->host,
                 message_text(text, sizeof text, message->notice->text));
        return;
    case AZULEJO__WIRE__ENVELOPE__BODY_FAILURE:
        if (recalls_failure(session, message, now_ns))
            return;
        log_warn("session %u (%s) reports: %s", session->id, session->host,
                 message_text(text, sizeof text, message->failure->text));
        if (session->worker && message->request)
            render_request_answer(session, message);
        return;
    default: break;
    }
    if ((session->worker && worker_message(session, message, now_ns)) ||
        session_client_message(session, message, now_ns))
        return;
    error_set(&err, STATUS_ERR_REFUSED, "a %s may not send %s", farm_role_name(session->role), message_name(message));
    log_warn("session %u (%s): %s", session->id, session->host, err.text);
    if (message->request)
        session_fail(session, message->request, &err);
    session_end(session, message->request ? NULL : &err);
}

/* A peer that does not read its answers is not heard until it does (on_drain): they would take the memory of all. */
static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *message, void *user)
{
    take_message(user, message);
    if (channel_is_overfull(channel))
        channel_pause(channel, 1);
}

static void on_drain(struct channel *channel, void *user)
{
    struct session *session = user;

    channel_pause(channel, 0);
    if (session->state == SESSION_OPEN)
        transfers_pump(&session->transfers, channel);
}

static void on_close(struct channel *channel UNUSED, const struct error *why, void *user)
{
    struct session *session = user;
    struct server *server = session->server;

    if (session->worker) {
        char reason[256];
        session_worker_leaves(session, why, reason, sizeof reason);
        log_info("worker %s (%s:%u, session %u) leaves: %s", session->worker->label, session->host, session->process,
                 session->id, reason);
        worker_save(&server->farm, session->worker, reason);
        /* An end that we chose (a broken rule, our own shutdown) does not count as a death; silence does. */
        farm_worker_remove(&server->farm, session->worker,
                           session->silent || (why->code == STATUS_ERR_UNREACHABLE && session->state == SESSION_OPEN),
                           clock_monotonic_ns());
        mem_free(session->worker);
        session_worker_release(session);
    } else if (why->code == STATUS_ERR_PROTOCOL) {
        log_warn("session %u (%s): %s", session->id, session->host, why->text);
    } else if (why->code != STATUS_OK && session->state == SESSION_GREETING) {
        log_warn("a connection ended before its greeting: %s", why->text);
    }
    for (uint32_t i = 0; i < SESSION_UPLOADS_MAX; i++)
        upload_free(session->uploads[i]);
    transfers_release(&session->transfers);
    if (session->of_page && server->guest.session_gone)
        server->guest.session_gone(server->guest.user, session);
    mem_free(session->scenes);
    session_table_remove(server, session);
    render_requests_session_gone(server, session->id);
    recalls_session_gone(server, session->id);
    mem_free(session);
}

/* NULL: out of memory. The channel's callbacks are its from now on. */
static struct session *session_new(struct server *server, struct channel *channel, struct error *err)
{
    static const struct channel_callbacks callbacks = {NULL, on_message, on_drain, on_close};
    struct session *session = mem_calloc(1, sizeof *session);

    if (!session) {
        error_no_memory(err, "a session");
        return NULL;
    }
    session->channel = channel;
    session->role = channel_role(channel);
    session->of_page = session->role == FARM_ROLE_WEB;
    session->key = holder_of_key(channel_identity(channel)->name);
    session->may = session->of_page ? WEB_ROLE_ADMIN : channel_identity(channel)->may;
    session->begun_ns = clock_monotonic_ns();
    snprintf(session->peer, sizeof session->peer, "%s", channel_peer(channel));
    session_table_add(server, session);
    channel_adopt(channel, &callbacks, session);
    return session;
}

status session_begin(struct server *server, struct channel *channel, struct error *err)
{
    return session_new(server, channel, err) ? STATUS_OK : STATUS_ERR_NO_MEMORY;
}

void session_tick(struct session *session, uint64_t now_ns)
{
    const uint64_t awake_ns = session->server->awake_ns;
    uint64_t heard_ns;

    if (session->state == SESSION_ENDING)
        return;
    if (session->state == SESSION_GREETING) {
        uint64_t begun_ns = session->begun_ns > awake_ns ? session->begun_ns : awake_ns;
        if (now_ns - begun_ns > SESSION_HELLO_MS * NS_PER_MS) {
            session->state = SESSION_ENDING;
            channel_abort(session->channel, STATUS_ERR_TIMEOUT, "no Hello within %d s", SESSION_HELLO_MS / 1000);
        }
        return;
    }
    heard_ns = channel_last_heard_ns(session->channel);
    if (heard_ns < awake_ns)
        heard_ns = awake_ns;
    if (now_ns > heard_ns + SESSION_SILENCE_MS * NS_PER_MS) {
        log_warn("session %u (%s) was silent for %d s and is considered dead", session->id, session->host,
                 SESSION_SILENCE_MS / 1000);
        session->state = SESSION_ENDING;
        session->silent = 1;
        channel_abort(session->channel, STATUS_ERR_TIMEOUT, "silent for %d s", SESSION_SILENCE_MS / 1000);
        return;
    }
    if (now_ns > channel_last_sent_ns(session->channel) + SESSION_HEARTBEAT_MS * NS_PER_MS &&
        message_send_heartbeat(session->channel) != STATUS_OK)
        log_debug("session %u: no heartbeat was sent", session->id);
    session_watches_send(session, now_ns, 0);
    transfers_pump(&session->transfers, session->channel); /* some may wait for the store */
    if (session->worker && session->worker->deferred_job &&
        farm_takes_again(&session->server->farm, session->worker->deferred_job)) {
        session_notice(session, LOG_LEVEL_INFO,
                       "the store can be used again: connect and send what was not acknowledged");
        session_end(session, NULL);
    }
}
