#include "worker/agent.h"

#include <assert.h>
#include <openssl/rand.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "protocol/channel.h"
#include "protocol/message.h"
#include "protocol/worker_name.h"
#include "worker/cache/blob_cache.h"
#include "worker/fetch.h"
#include "worker/job_lines.h"
#include "worker/leases.h"
#include "worker/lend.h"
#include "worker/outbox.h"
#include "worker/pool.h"
#include "worker/requests.h"
#include "worker/scene_cache.h"
#include "worker/usage.h"

enum { TICK_MS = 200, LONG_UNITS_MAX = 16 };

enum agent_state { WAITING, CONNECTING, GREETING, WORKING, DRAINING, ENDED };

struct agent {
    struct agent_options options;
    uv_loop_t *loop;
    uv_timer_t tick;     /* heartbeats, silence, limits */
    uv_timer_t retry;    /* WAITING */
    uv_async_t finished; /* pool tasks are done */
    uv_timer_t gather;   /* more of them, since some were taken */
    enum agent_state state;
    struct error result;

    struct channel *channel; /* NULL: none; set until its on_close */
    uint32_t heartbeat_ms, silence_limit_ms;
    uint64_t since_ns; /* when the present state began */
    uint64_t started_ns, asked_ns;
    uint64_t moved_ns; /* when a result was last added to the outbox, or acknowledged */
    uint64_t backoff_ms;
    int was_welcome;    /* at any time so far */
    int last_asked;     /* units of the last LeaseRequest that were not granted yet */
    int is_answered;    /* a grant followed it */
    int failed_at_work; /* a connection ended by a Failure, and none has lasted since: keep backing off */
    uint32_t failures;  /* connections lost or failed since the last Welcome */
    char trouble[sizeof((struct error *)0)->text]; /* the reason, as last logged */

    char name[WORKER_LABEL_BYTES_MAX + 1]; /* as the coordinator said last; "": not yet */
    uint64_t instance;                     /* of this process */
    struct duty duty;
    struct usage usage;
    uint64_t status_ns;            /* when it was measured and reported last */
    enum duty_state paused;        /* DUTY_WORKS: it is not */
    char reason[DUTY_REASON_SIZE]; /* why it is paused, or drains */

    struct blob_cache *blobs;
    struct pool *pool;
    struct scene_cache *scenes;
    struct fetcher fetcher;
    struct leases leases;
    struct requests requests;
    struct lend lend;
    struct outbox outbox;
};

static void agent_set_state(struct agent *a, enum agent_state state);
static void end_if_drained(struct agent *a);

/* The channel if work messages may be sent on it; otherwise NULL. */
static struct channel *working_channel(const struct agent *a)
{
    return a->state == WORKING || a->state == DRAINING ? a->channel : NULL;
}

/* ---- work ------------------------------------------------------------------------------ */

/* Keep the threads busy: ask before they run out of work, but not while results accumulate. */
static void ask_for_work(struct agent *a)
{
    Azulejo__Wire__LeaseRequest request = AZULEJO__WIRE__LEASE_REQUEST__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(LEASE_REQUEST, lease_request, &request);
    uint64_t now = clock_monotonic_ns();

    if (a->state != WORKING || a->paused != DUTY_WORKS || a->outbox.count >= OUTBOX_HIGH)
        return;
    request.units = leases_room(&a->leases);
    if (request.units == 0)
        return;
    /* The last request still stands; repeat it only if it grew much or may have been forgotten. */
    if (a->last_asked > 0 && request.units < 2 * (uint32_t)a->last_asked &&
        now - a->asked_ns < ASK_AGAIN_MS * NS_PER_MS)
        return;
    if (channel_send(a->channel, &e) == STATUS_OK) {
        a->last_asked = (int)request.units;
        a->asked_ns = now;
        a->is_answered = 0;
    }
}

static void on_gathered(uv_timer_t *timer);

/* Continue with scenes, send results. While results flow, they go out together every POOL_GATHER_MS. */
static void take_finished(struct agent *a)
{
    struct pool_task *next, *first = pool_take_done(a->pool);

    if (first)
        uv_timer_start(&a->gather, on_gathered, POOL_GATHER_MS, 0);
    for (struct pool_task *task = first; task; task = next) {
        struct work_unit *unit;
        next = task->next;
        if (scene_cache_task_done(a->scenes, task) || requests_task_done(&a->requests, task, working_channel(a)) ||
            lend_task_done(&a->lend, task, working_channel(a)))
            continue;
        unit = leases_unit_done(&a->leases, task);
        if (!unit)
            continue;
        outbox_add(&a->outbox, unit);
        a->moved_ns = clock_monotonic_ns();
    }
    if (working_channel(a)) {
        outbox_pump(&a->outbox, a->channel);
        ask_for_work(a);
    }
    end_if_drained(a);
}

static void on_finished(uv_async_t *handle) { take_finished(handle->data); }

static void on_gathered(uv_timer_t *timer) { take_finished(timer->data); }

static void notify_finished(void *user)
{
    struct agent *a = user;

    uv_async_send(&a->finished);
}

static void on_blobs_missing(void *user, const struct scene_blob *blobs, size_t count)
{
    struct agent *a = user;

    log_debug("fetching %zu blobs", count);
    for (size_t i = 0; i < count; i++) {
        struct error why = {0};
        uint64_t limit = blobs[i].size_bytes ? BLOB_BYTES_MAX : SCENE_PACKED_MAX;
        if (fetcher_want(&a->fetcher, &blobs[i], limit, &why) != STATUS_OK)
            scene_cache_blob_failed(a->scenes, &blobs[i].digest, &why);
    }
    if (working_channel(a))
        fetcher_pump(&a->fetcher, a->channel);
}

static void on_scene_settled(void *user, struct scene_slot *slot)
{
    struct agent *a = user;

    leases_scene_settled(&a->leases, slot, working_channel(a));
    requests_scene_settled(&a->requests, slot, working_channel(a));
}

static void on_blob_arrived(void *user, struct cached_blob *blob)
{
    struct agent *a = user;

    scene_cache_blob_arrived(a->scenes, blob);
}

static void on_blob_failed(void *user, const struct digest *digest, const struct error *why)
{
    struct agent *a = user;

    scene_cache_blob_failed(a->scenes, digest, why);
}

/* ---- pauses, and what is reported about this worker ------------------------------------- */

static void send_status(struct agent *a)
{
    Azulejo__Wire__WorkerStatus report = AZULEJO__WIRE__WORKER_STATUS__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(WORKER_STATUS, worker_status, &report);
    Azulejo__Wire__LongUnit longs[LONG_UNITS_MAX], *pointers[LONG_UNITS_MAX];
    struct running_unit running[LONG_UNITS_MAX];

    if (!working_channel(a))
        return;
    report.mode = a->state == DRAINING          ? AZULEJO__WIRE__WORKER_MODE__MODE_LEAVING
                  : a->paused != DUTY_WORKS ? AZULEJO__WIRE__WORKER_MODE__MODE_PAUSED
                                            : AZULEJO__WIRE__WORKER_MODE__MODE_WORKING;
    report.reason = a->reason;
    report.threads_busy = leases_running(&a->leases, clock_monotonic_ns(), LONG_UNIT_MS * NS_PER_MS, running,
                                         LONG_UNITS_MAX, &report.n_long_units);
    for (size_t i = 0; i < report.n_long_units; i++) {
        azulejo__wire__long_unit__init(&longs[i]);
        longs[i].job = running[i].job;
        longs[i].frame = running[i].frame;
        longs[i].tile = running[i].name.tile;
        longs[i].group = running[i].name.group;
        longs[i].pass = running[i].name.pass;
        longs[i].running_ms = running[i].running_ns / NS_PER_MS;
        pointers[i] = &longs[i];
    }
    report.long_units = pointers;
    report.cpus = a->usage.cpus;
    report.other_cpus = a->usage.other_cpus;
    report.memory_bytes = a->usage.memory_bytes;
    report.machine_memory_bytes = a->usage.machine_memory_bytes;
    report.cache_bytes = blob_cache_bytes(a->blobs);
    report.cache_limit_bytes = a->options.cache_limit_bytes;
    (void)!channel_send(a->channel, &e); /* fails only when the connection does */
}

static int local_minute(void)
{
    time_t now = time(NULL);
    struct tm local;

    return localtime_r(&now, &local) ? local.tm_hour * 60 + local.tm_min : 0;
}

/* Pause or go on, if something changed that. */
static void look_at_duty(struct agent *a)
{
    char reason[DUTY_REASON_SIZE];
    enum duty_state now;

    if (a->state == DRAINING || a->state == ENDED)
        return;
    now = duty_state(&a->duty, local_minute(), clock_monotonic_ns(), reason);
    memcpy(a->reason, reason, sizeof a->reason);
    if (now == a->paused)
        return;
    if (now != DUTY_WORKS)
        log_info("paused: %s", reason);
    else
        log_info("takes work again");
    a->paused = now;
    if (a->state != WORKING)
        return;
    if (now != DUTY_WORKS)
        leases_return_unstarted(&a->leases, a->channel, "the worker is paused");
    a->last_asked = 0;
    send_status(a);
    ask_for_work(a);
}

static void measure_when_due(struct agent *a, uint64_t now_ns)
{
    if (now_ns - a->status_ns < STATUS_MS * NS_PER_MS)
        return;
    a->status_ns = now_ns;
    usage_look(&a->usage);
    duty_look(&a->duty, &a->usage, now_ns);
    look_at_duty(a);
    send_status(a);
}

void agent_set_paused(struct agent *a, int paused)
{
    if (a->duty.by_signal == paused)
        return;
    a->duty.by_signal = paused;
    look_at_duty(a);
}

/* ---- the connection -------------------------------------------------------------------- */

static void say_hello(struct agent *a)
{
    Azulejo__Wire__Hello hello = AZULEJO__WIRE__HELLO__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HELLO, hello, &hello);
    char host[256] = "unknown", clean[256];
    size_t size = sizeof host;

    (void)uv_os_gethostname(host, &size);
    hello.protocol_version = PROTOCOL_VERSION;
    hello.role = AZULEJO__WIRE__ROLE__ROLE_WORKER;
    hello.software = (char *)"azulejo " AZULEJO_VERSION;
    hello.host = (char *)message_text(clean, sizeof clean, host);
    hello.process = (uint32_t)uv_os_getpid();
    hello.threads = a->options.threads;
    hello.isa_mask = a->options.isa_mask;
    hello.arithmetic = elementary_fingerprint_of(render_precision());
    hello.kernel = (char *)render_ray_tracer_name();
    hello.name = a->options.name ? (char *)a->options.name : a->name;
    hello.name_chosen = a->options.name != NULL;
    hello.instance = a->instance;
    hello.tags = (char *)a->options.tags;
    hello.memory = a->options.memory;
    if (channel_send(a->channel, &e) != STATUS_OK)
        channel_abort(a->channel, STATUS_ERR_NO_MEMORY, "cannot say hello");
}

static void on_open(struct channel *channel, void *user)
{
    struct agent *a = user;

    a->channel = channel;
    if (a->state == CONNECTING)
        agent_set_state(a, GREETING);
}

/* The meaning of a refusal in the greeting. The coordinator has proved the farm's key, so it speaks for the farm, and
 * this release will not fit it at the next attempt either. Any other failure (its limits, its memory) may pass. */
static status greeting_refusal(status code)
{
    return code == STATUS_ERR_REFUSED || code == STATUS_ERR_UNSUPPORTED ? STATUS_ERR_MISMATCH : code;
}

static void on_welcome(struct agent *a, const Azulejo__Wire__Welcome *welcome)
{
    struct error err = {0};

    if (welcome_check(welcome, &err) != STATUS_OK) {
        channel_abort(a->channel, greeting_refusal(err.code), "%s", err.text);
        return;
    }
    a->heartbeat_ms = welcome->heartbeat_ms;
    a->silence_limit_ms = welcome->silence_limit_ms;
    a->was_welcome = 1;
    if (!a->failed_at_work)
        a->backoff_ms = BACKOFF_FIRST_MS;
    if (a->failures > 0)
        log_info("%s: connected after %u failure%s", channel_peer(a->channel), a->failures,
                 a->failures == 1 ? "" : "s");
    a->failures = 0;
    a->trouble[0] = 0;
    if (worker_label_is_valid(welcome->name))
        snprintf(a->name, sizeof a->name, "%s", welcome->name);
    log_info("%s: joined as session %u, called %s, with %u threads, %zu results to send again",
             channel_peer(a->channel), welcome->session, a->name, a->options.threads, a->outbox.count);
    agent_set_state(a, WORKING);
}

static void on_failure(struct agent *a, const Azulejo__Wire__Envelope *message)
{
    struct error err = {0};
    status code;

    if (a->state != GREETING && fetcher_failure(&a->fetcher, message->request, message->failure)) {
        fetcher_pump(&a->fetcher, a->channel);
        return;
    }
    code = message_failure_get(message->failure, &err);
    if (message->failure->key) {
        /* Not this release, but this key: its file may get another one. */
    } else if (a->state == GREETING) {
        code = greeting_refusal(code);
    } else {
        /* It may have refused a result (for example because its store was replaced). Sending the
         * same result again would fail the same way; rendering it again is cheap. */
        log_warn("%zu results were not accepted and are dropped", a->outbox.count);
        outbox_release(&a->outbox);
        a->failed_at_work = 1;
    }
    channel_abort(a->channel, code, "the coordinator says: %s", err.text);
}

static void on_ack(struct agent *a, const Azulejo__Wire__ResultAck *ack)
{
    for (size_t i = 0; i < ack->n_units; i++)
        outbox_acknowledge(&a->outbox, ack->job, ack->frame,
                           (struct unit_name){ack->units[i]->tile, ack->units[i]->group, ack->units[i]->pass});
    a->moved_ns = clock_monotonic_ns();
    ask_for_work(a);
    end_if_drained(a);
}

static void on_grant(struct agent *a, const Azulejo__Wire__LeaseGrant *grant)
{
    struct error err = {0};

    job_lines_of(grant->job);
    if (!a->is_answered && a->leases.held > 0) /* without work it may have waited for a job */
        leases_learn_trip(&a->leases, clock_monotonic_ns() - a->asked_ns);
    a->is_answered = 1;
    a->last_asked = a->last_asked > (int)grant->n_units ? a->last_asked - (int)grant->n_units : 0;
    if (leases_grant(&a->leases, grant, a->channel, &err) != STATUS_OK)
        channel_abort(a->channel, err.code, "%s", err.text);
    else if (a->state == DRAINING)
        leases_return_unstarted(&a->leases, a->channel, "the worker is ending");
    else if (a->paused != DUTY_WORKS)
        leases_return_unstarted(&a->leases, a->channel, "the worker is paused");
    else
        ask_for_work(a);
}

static void on_message(struct channel *channel, const Azulejo__Wire__Envelope *m, void *user)
{
    struct agent *a = user;
    struct error err = {0};
    char text[MESSAGE_TEXT_MAX];

    if (a->state == GREETING && m->body_case != AZULEJO__WIRE__ENVELOPE__BODY_WELCOME &&
        m->body_case != AZULEJO__WIRE__ENVELOPE__BODY_FAILURE && m->body_case != AZULEJO__WIRE__ENVELOPE__BODY_NOTICE &&
        m->body_case != AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT) {
        channel_abort(channel, STATUS_ERR_PROTOCOL, "sent %s before a Welcome", message_name(m));
        return;
    }
    switch (m->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_WELCOME:
        if (a->state == GREETING)
            on_welcome(a, m->welcome);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_FAILURE: on_failure(a, m); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_HEARTBEAT: break;
    case AZULEJO__WIRE__ENVELOPE__BODY_NOTICE:
        log_line(m->notice->level <= LOG_LEVEL_DEBUG ? (enum log_level)m->notice->level : LOG_LEVEL_INFO,
                 "the coordinator says: %s", message_text(text, sizeof text, m->notice->text));
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_GRANT: on_grant(a, m->lease_grant); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_REVOKE:
        leases_revoke(&a->leases, m->lease_revoke);
        outbox_drop_lease(&a->outbox, m->lease_revoke->lease);
        ask_for_work(a);
        end_if_drained(a);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_RENDER_REQUEST:
        requests_take(&a->requests, m->request, m->render_request, channel);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_GET: lend_take(&a->lend, m->request, m->blob_get, channel); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_RESULT_ACK: on_ack(a, m->result_ack); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_DATA:
        if (fetcher_data(&a->fetcher, m->request, m->blob_data, &err) != STATUS_OK)
            channel_abort(channel, err.code, "%s", err.text);
        else
            fetcher_pump(&a->fetcher, channel);
        break;
    default: channel_abort(channel, STATUS_ERR_PROTOCOL, "sent %s to a worker", message_name(m)); break;
    }
}

static void on_drain(struct channel *channel, void *user)
{
    struct agent *a = user;

    if (!working_channel(a))
        return;
    outbox_pump(&a->outbox, channel);
    lend_pump(&a->lend, channel);
}

/* End with this status; the loop stops once the handles have closed. */
static void end_with(struct agent *a, const struct error *why)
{
    if (a->state == ENDED)
        return;
    for (int i = 0; working_channel(a) && i < JOB_LINES_MAX / JOB_LINES_AT_ONCE; i++)
        job_lines_send(a->channel); /* its last lines */
    a->result = *why;
    agent_set_state(a, ENDED);
}

/* With exit_on_disconnect a coordinator that cannot be reached, or refuses this key, is the end.
 * Before the first Welcome the coordinator may still be starting. */
static int disconnect_is_final(const struct agent *a, const struct error *why)
{
    return a->options.exit_on_disconnect && (a->was_welcome || why->code == STATUS_ERR_REFUSED ||
                                             clock_monotonic_ns() - a->started_ns > FIRST_CONNECTION_MS * NS_PER_MS);
}

/* Logged once for each kind of trouble, not at every attempt. */
static void report_trouble(struct agent *a, const struct error *why)
{
    a->failures += a->failures < UINT32_MAX;
    if (why->code == STATUS_OK) {
        log_info("the coordinator ended the connection; connecting again");
    } else if (strcmp(why->text, a->trouble) == 0) {
        log_debug("%s", why->text);
    } else {
        log_warn("%s; trying again until it works", why->text);
        snprintf(a->trouble, sizeof a->trouble, "%s", why->text);
    }
}

static void on_close(struct channel *channel UNUSED, const struct error *why, void *user)
{
    struct agent *a = user;
    struct error reason = *why;

    a->channel = NULL;
    if (a->state == ENDED)
        return;
    fetcher_reset(&a->fetcher);
    outbox_reset(&a->outbox);
    leases_forget_unstarted(&a->leases);
    requests_forget(&a->requests);
    lend_forget(&a->lend);
    if (a->state == DRAINING) {
        log_warn("the connection ended before %zu results were acknowledged; they will be "
                 "rendered again", a->outbox.count);
        memset(&reason, 0, sizeof reason);
        end_with(a, &reason);
        return;
    }
    if ((a->state == GREETING && why->code == STATUS_ERR_MISMATCH) || disconnect_is_final(a, why)) {
        end_with(a, &reason);
        return;
    }
    report_trouble(a, why);
    agent_set_state(a, WAITING);
}

/* ---- timers and states ----------------------------------------------------------------- */

static void on_retry(uv_timer_t *timer) { agent_set_state(timer->data, CONNECTING); }

static void begin_connect(struct agent *a)
{
    static const struct channel_callbacks callbacks = {on_open, on_message, on_drain, on_close};
    struct error err = {0};

    if (a->failures > 0 && key_file_refresh(a->options.key_file))
        a->backoff_ms = BACKOFF_FIRST_MS; /* the coordinator may get its new key slightly later */
    if (channel_connect(&a->channel, a->loop, a->options.host, a->options.port, &a->options.key_file->key,
                        FARM_ROLE_WORKER, &callbacks, a, &err) == STATUS_OK)
        return;
    report_trouble(a, &err);
    agent_set_state(a, WAITING);
}

/* Twice as long each time, times a random 0.5..1, so that a farm's workers do not all reconnect at the same moment. */
static void begin_wait(struct agent *a)
{
    uint8_t random[2] = {0};
    uint64_t delay;

    if (RAND_bytes(random, sizeof random) != 1)
        random[0] = (uint8_t)uv_os_getpid();
    delay = a->backoff_ms / 2 + a->backoff_ms / 2 * ((uint64_t)random[0] << 8 | random[1]) / 65535;
    uv_timer_start(&a->retry, on_retry, delay, 0);
    a->backoff_ms = a->backoff_ms * 2 > BACKOFF_LAST_MS ? BACKOFF_LAST_MS : a->backoff_ms * 2;
}

static void begin_work(struct agent *a)
{
    a->last_asked = 0;
    send_status(a);
    outbox_pump(&a->outbox, a->channel);
    fetcher_pump(&a->fetcher, a->channel);
    ask_for_work(a);
}

static void begin_end(struct agent *a)
{
    uv_close((uv_handle_t *)&a->tick, NULL);
    uv_close((uv_handle_t *)&a->retry, NULL);
    uv_close((uv_handle_t *)&a->gather, NULL);
    /* The threads may still notify, so the pool must end before the async handle. */
    pool_free(a->pool);
    a->pool = NULL;
    uv_close((uv_handle_t *)&a->finished, NULL);
    if (a->channel)
        channel_close(a->channel);
}

static void agent_set_state(struct agent *a, enum agent_state state)
{
    assert(a->state != ENDED);
    a->state = state;
    a->since_ns = clock_monotonic_ns();
    switch (state) {
    case WAITING: begin_wait(a); break;
    case CONNECTING: begin_connect(a); break;
    case GREETING: say_hello(a); break;
    case WORKING: begin_work(a); break;
    case DRAINING:
        send_status(a);
        leases_return_unstarted(&a->leases, a->channel, "the worker is ending");
        break;
    case ENDED: begin_end(a); break;
    }
}

static void end_if_drained(struct agent *a)
{
    struct error none = {0};

    if (a->state == DRAINING && a->leases.held == 0 && a->outbox.count == 0 && a->requests.count == 0)
        end_with(a, &none);
}

/* The coordinator has all results, but acknowledges none of those left: their earlier passes may be no worker's, or
 * its disk hangs. */
static int waits_in_vain(const struct agent *a, uint64_t now_ns)
{
    uint64_t from_ns = a->moved_ns > a->since_ns ? a->moved_ns : a->since_ns;

    return a->state == DRAINING && a->leases.held == 0 && a->requests.count == 0 && !a->outbox.unsent && a->channel &&
           channel_queued_bytes(a->channel) == 0 && now_ns - from_ns > DRAIN_ACKS_MS * NS_PER_MS;
}

static void on_tick(uv_timer_t *timer)
{
    struct agent *a = timer->data;
    uint64_t now = clock_monotonic_ns();
    uint64_t in_state_ms = (now - a->since_ns) / NS_PER_MS;
    struct error none = {0};

    if (a->state == GREETING && in_state_ms > GREETING_MS)
        channel_abort(a->channel, STATUS_ERR_UNREACHABLE, "no Welcome within %d s", GREETING_MS / 1000);
    if (a->state == DRAINING && in_state_ms > DRAIN_MS) {
        log_warn("%zu units and %zu results are dropped after %d s", a->leases.held, a->outbox.count, DRAIN_MS / 1000);
        if (a->leases.held > 0)
            _exit(a->options.drain_status); /* a thread that still renders may never end */
        end_with(a, &none);
        return;
    }
    if (waits_in_vain(a, now)) {
        log_info("%zu results were not acknowledged within %d s; they are rendered again only if the coordinator ends "
                 "before they are on its disk", a->outbox.count, DRAIN_ACKS_MS / 1000);
        end_with(a, &none);
        return;
    }
    look_at_duty(a);
    measure_when_due(a, now);
    if (!working_channel(a))
        return;
    if (in_state_ms > SETTLED_MS)
        a->failed_at_work = 0;
    if (now - channel_last_heard_ns(a->channel) > a->silence_limit_ms * NS_PER_MS) {
        channel_abort(a->channel, STATUS_ERR_UNREACHABLE, "it sent nothing for %.1f s; connecting again",
                      a->silence_limit_ms / 1000.0);
        return;
    }
    if (now - channel_last_sent_ns(a->channel) + TICK_MS * NS_PER_MS >= a->heartbeat_ms * NS_PER_MS)
        (void)!message_send_heartbeat(a->channel); /* fails only when the connection does */
    job_lines_send(a->channel);
    if (a->leases.lease_count == 0)
        job_lines_of(0);
    outbox_pump(&a->outbox, a->channel);
    lend_pump(&a->lend, a->channel);
    ask_for_work(a);
}

/* ---- life ------------------------------------------------------------------------------ */

status agent_new(struct agent **out, uv_loop_t *loop, const struct agent_options *options, struct error *err)
{
    struct agent *a = mem_calloc(1, sizeof *a);
    struct scene_cache_callbacks callbacks = {on_blobs_missing, on_scene_settled, a};
    status s;

    *out = NULL;
    NEED(a, err, "the worker");
    a->options = *options;
    a->loop = loop;
    a->started_ns = clock_monotonic_ns();
    a->backoff_ms = BACKOFF_FIRST_MS;
    a->status_ns = a->started_ns;
    if (RAND_bytes((unsigned char *)&a->instance, sizeof a->instance) != 1 || a->instance == 0)
        a->instance = a->started_ns ^ (uint64_t)uv_os_getpid() << 40;
    (void)usage_init(&a->usage);
    duty_init(&a->duty, &options->duty, a->started_ns);
    a->paused = duty_state(&a->duty, local_minute(), a->started_ns, a->reason);
    if (a->paused != DUTY_WORKS)
        log_info("paused: %s", a->reason);
    s = blob_cache_open(&a->blobs, options->cache_folder, options->cache_limit_bytes, err);
    if (s != STATUS_OK)
        goto failed;
    /* Before the threads, because they notify through it. */
    if (uv_async_init(loop, &a->finished, on_finished) != 0) {
        s = error_set(err, STATUS_ERR_INTERNAL, "the event loop has no handle left");
        goto failed;
    }
    a->finished.data = a;
    s = pool_new(&a->pool, options->threads, notify_finished, a, err);
    THEN(s, scene_cache_new(&a->scenes, a->blobs, a->pool, callbacks, err));
    if (s != STATUS_OK) {
        pool_free(a->pool);
        a->pool = NULL;
        uv_close((uv_handle_t *)&a->finished, NULL);
        uv_run(loop, UV_RUN_DEFAULT);
        goto failed;
    }
    fetcher_init(&a->fetcher, a->blobs);
    a->fetcher.arrived = on_blob_arrived;
    a->fetcher.failed = on_blob_failed;
    a->fetcher.user = a;
    leases_init(&a->leases, a->pool, a->scenes, options->threads, options->isa_mask);
    requests_init(&a->requests, a->pool, a->scenes, a->blobs, options->isa_mask);
    lend_init(&a->lend, a->pool, a->blobs);
    uv_timer_init(loop, &a->tick);
    uv_timer_init(loop, &a->retry);
    uv_timer_init(loop, &a->gather);
    a->tick.data = a->retry.data = a->gather.data = a;
    uv_timer_start(&a->tick, on_tick, TICK_MS, TICK_MS);
    job_lines_of(0);
    agent_set_state(a, CONNECTING);
    *out = a;
    return STATUS_OK;
failed:
    blob_cache_close(a->blobs);
    mem_free(a);
    return s;
}

void agent_drain(struct agent *a, const char *reason)
{
    struct error none = {0};

    if (a->state == ENDED || a->state == DRAINING)
        return;
    if (a->state != WORKING) {
        log_info("%s: ending; no coordinator is connected", reason);
        end_with(a, &none);
        return;
    }
    log_info("%s: finishing units in progress, returning the rest", reason);
    snprintf(a->reason, sizeof a->reason, "%s", reason);
    agent_set_state(a, DRAINING);
    end_if_drained(a);
}

status agent_result(const struct agent *a, struct error *err)
{
    if (err)
        *err = a->result;
    return a->result.code;
}

void agent_free(struct agent *a)
{
    if (!a)
        return;
    assert(a->state == ENDED && !a->channel);
    leases_release(&a->leases);
    requests_release(&a->requests);
    lend_release(&a->lend);
    outbox_release(&a->outbox);
    fetcher_release(&a->fetcher);
    scene_cache_free(a->scenes);
    blob_cache_close(a->blobs);
    mem_free(a);
}
