#include "coordinator/net/server.h"

#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "coordinator/events/event_program.h"
#include "coordinator/events/events.h"
#include "coordinator/farm/distrusted.h"
#include "coordinator/net/farm_tasks.h"
#include "coordinator/farm/merge.h"
#include "coordinator/net/base/previews.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/session/session_keys.h"
#include "coordinator/steering/remake.h"

/* ---- what the farm asks for ----------------------------------------------------------------- */

static void on_revoke(void *user, uint32_t session, uint64_t lease, const char *reason)
{
    struct session *s = session_find(user, session);

    if (s)
        session_revoke(s, lease, reason);
}

static void on_ack(void *user, uint32_t session, const struct job *job, uint32_t frame, struct unit_name unit)
{
    struct session *s = session_find(user, session);

    if (s && s->state == SESSION_OPEN)
        session_ack(s, job->id, frame, unit, 0);
}

static void on_notice(void *user, uint32_t session, const char *text)
{
    struct session *s = session_find(user, session);

    log_warn("session %u: %s", session, text);
    if (s)
        session_notice(s, LOG_LEVEL_WARN, text);
}

static void on_job_changed(void *user, struct job *job)
{
    struct server *server = user;

    for (struct session *s = server->watching; s; s = s->next_watching)
        for (uint32_t i = 0; i < s->watch_count; i++)
            if (s->watches[i].job == 0 || s->watches[i].job == job->id) {
                s->watches[i].due = 1;
                session_due(s);
            }
    if (server->guest.job_changed)
        server->guest.job_changed(server->guest.user, job);
}

static void on_job_removed(void *user, uint64_t job)
{
    const struct server_guest *guest = &((struct server *)user)->guest;

    if (guest->job_removed)
        guest->job_removed(guest->user, job);
}

static void on_job_state(void *user, const struct job *job)
{
    struct server *server = user;

    if (server->events)
        events_job_state(server->events, job, server->page_address);
}

static void on_job_event(void *user, const struct job_event *event)
{
    const struct server_guest *guest = &((struct server *)user)->guest;

    if (guest->job_event)
        guest->job_event(guest->user, event);
}

static void on_workers_changed(void *user)
{
    const struct server_guest *guest = &((struct server *)user)->guest;

    if (guest->workers_changed)
        guest->workers_changed(guest->user);
}

/* ---- ending --------------------------------------------------------------------------------- */

static void close_handles(struct server *server)
{
    if (server->state == SERVER_CLOSING)
        return;
    server->state = SERVER_CLOSING;
    for (struct session *s = server->sessions, *next; s; s = next) {
        next = s->next;
        session_end(s, NULL);
    }
    if (server->guest_runs)
        server->guest.stop(server->guest.user);
    server->guest = (struct server_guest){0};
    door_close(&server->door);
    uv_close((uv_handle_t *)&server->tick, NULL);
    uv_close((uv_handle_t *)&server->commit_timer, NULL);
    uv_close((uv_handle_t *)&server->prepare, NULL);
    store_on_saved(server->store, NULL, NULL);
    uv_close((uv_handle_t *)&server->saved, NULL);
    uv_close((uv_handle_t *)&server->terminate, NULL);
    uv_close((uv_handle_t *)&server->interrupt, NULL);
}

static void close_listeners(struct server *server)
{
    for (unsigned i = 0; i < server->sockets.count; i++)
        uv_close((uv_handle_t *)&server->listeners[i], NULL);
}

static void on_signal(uv_signal_t *handle, int number)
{
    struct server *server = handle->data;

    if (server->state != SERVER_LISTENING)
        return;
    log_info("ending on %s: writing received results to disk first", number == SIGTERM ? "SIGTERM" : "SIGINT");
    server->state = SERVER_DRAINING;
    server->drain_since_ns = clock_monotonic_ns();
    close_listeners(server);
    if (server->events)
        event_program_end(server->events);
    for (struct session *s = server->sessions; s; s = s->next)
        if (s->state == SESSION_OPEN)
            session_notice(s, LOG_LEVEL_INFO, "the coordinator is ending");
}

/* ---- the loop ------------------------------------------------------------------------------- */

static void on_commit_timer(uv_timer_t *timer) { (void)timer; /* the next iteration looks for dirty tiles */ }

static void commit_when_due(struct server *server, uint64_t now_ns)
{
    uint64_t due_ns;
    uint32_t tiles;

    if (server->commit_running || !merge_is_dirty(&server->farm, &due_ns, &tiles))
        return;
    if (tiles >= COMMIT_TILES_ENOUGH)
        due_ns = now_ns;
    if (now_ns >= due_ns || server->state != SERVER_LISTENING)
        farm_task_commit(server);
    else
        uv_timer_start(&server->commit_timer, on_commit_timer, (due_ns - now_ns) / NS_PER_MS + 1, 0);
}

/* To all workers with room, or to those that were left without work. */
static void grant_all(struct server *server, int hungry_only, uint64_t now_ns)
{
    for (struct session *s = server->sessions; s; s = s->next)
        if (s->worker && s->worker->room > 0 && (!hungry_only || s->worker->place.is_hungry))
            session_grant(s, now_ns);
}

static void grant_due(struct server *server, uint64_t now_ns)
{
    struct farm *farm = &server->farm;
    struct farm_worker *worker;
    int all = farm->pump_wanted, overdue = farm->overdue_wanted && farm->workforce.hungry > 0;

    farm->pump_wanted = farm->overdue_wanted = 0;
    if (all || overdue)
        grant_all(server, !all, now_ns);
    while ((worker = workforce_next_due(farm))) {
        struct session *s = all ? NULL : session_find(server, worker->held.session);
        if (s)
            session_grant(s, now_ns);
    }
}

/* What a session may read in a turn of the loop. */
static size_t turn_bytes_each(uint32_t sessions)
{
    size_t bytes = SERVER_TURN_BYTES / (sessions + 1);

    return bytes < SERVER_TURN_EACH_MIN   ? SERVER_TURN_EACH_MIN
           : bytes > SERVER_TURN_EACH_MAX ? SERVER_TURN_EACH_MAX
                                          : bytes;
}

/* Once in each iteration of the loop, before it waits: everything that its events made due. */
static void on_prepare(uv_prepare_t *handle)
{
    struct server *server = handle->data;
    uint64_t now_ns = clock_monotonic_ns();

    if (server->state == SERVER_LISTENING)
        grant_due(server, now_ns);
    commit_when_due(server, now_ns);
    channel_turn_begin(turn_bytes_each(server->session_count));
    for (struct session *s; (s = session_next_due(server));)
        session_flush(s, now_ns);
    if (server->state == SERVER_DRAINING) {
        uint64_t due_ns;
        uint32_t tiles;
        int idle = server->tasks == 0 && server->held == 0 && !merge_is_dirty(&server->farm, &due_ns, &tiles);
        if (idle || now_ns - server->drain_since_ns > SERVER_DRAIN_MS * NS_PER_MS)
            close_handles(server);
    }
}

/* By the store's thread. */
static void wake_for_saved(void *user) { uv_async_send(&((struct server *)user)->saved); }

static void on_saved(uv_async_t *handle) { store_deliver(((struct server *)handle->data)->store); }

static void on_tick(uv_timer_t *timer)
{
    struct server *server = timer->data;
    uint64_t now_ns = clock_monotonic_ns();

    /* Timers run before sockets are read: after a pause all peers would look silent. */
    if (server->ticked_ns && now_ns - server->ticked_ns > SERVER_PAUSE_MS * NS_PER_MS) {
        log_warn("the coordinator was held up for %.1f s", (double)(now_ns - server->ticked_ns) / 1e9);
        server->awake_ns = now_ns;
        farm_pause(&server->farm, now_ns - server->ticked_ns);
    }
    server->ticked_ns = now_ns;
    server->farm.wall_s = clock_wall_s();
    farm_tick(&server->farm, now_ns);
    if (server->state == SERVER_LISTENING) {
        remake_step(&server->farm, now_ns);
        unit_audits_tick(server, now_ns);
        distrust_tick(&server->farm);
        collector_tick(server, now_ns);
        scrubber_tick(server, now_ns);
        recalls_tick(server, now_ns);
    }
    previews_tick(server, now_ns);
    for (struct session *s = server->sessions, *next; s; s = next) {
        next = s->next;
        session_tick(s, now_ns);
    }
    if (server->events)
        events_store(server->events, &server->farm.trouble, &server->store_event_told, now_ns);
    if (server->guest.tick)
        server->guest.tick(server->guest.user, now_ns);
    session_keys_tick(server);
    server->farm.overdue_wanted = 1;
}

static void on_connection(uv_stream_t *listener, int code)
{
    struct server *server = listener->data;

    door_connection(&server->door, listener, code);
}

/* The farm runs already, and goes on while its guest starts. The ready file is written after that: who waits for it finds
 * both. */
static status announce(struct server *server, const struct server_options *options, struct error *err)
{
    const char *ready_file = options->ready_file;
    const struct listen_sockets *sockets = &server->sockets;
    char where[LISTEN_ADDRESSES_MAX * (ADDRESS_TEXT_SIZE + 5)] = "", line[16];
    status s = STATUS_OK;

    for (unsigned i = 0, at = 0; i < sockets->count; i++)
        at += (unsigned)snprintf(where + at, sizeof where - at, "%s%s", i > 0 ? " and " : "", sockets->names[i]);
    log_info("listening on %s, store %s", where, store_folder(server->store));
    printf("listening on %s\n", where);
    fflush(stdout);
    if (options->guest.start) {
        server->guest = options->guest;
        s = server->guest.start(server->guest.user, server, err);
        server->guest_runs = s == STATUS_OK;
        while (server->guest_runs && server->state == SERVER_LISTENING &&
               !server->guest.is_settled(server->guest.user, &s, err))
            uv_run(&server->loop, UV_RUN_ONCE);
        if (s == STATUS_ERR_UNREACHABLE) {
            log_warn("no page: %s", err ? err->text : "");
            server->guest = (struct server_guest){0};
            s = STATUS_OK;
        }
    }
    if (s != STATUS_OK || !ready_file)
        return s;
    snprintf(line, sizeof line, "%u\n", sockets->port);
    return file_write_atomic(ready_file, line, strlen(line), err);
}

static status listen_on(struct server *server, const struct server_options *options, struct error *err)
{
    const struct listen_request request = {
        .host = options->host,
        .port = options->port,
        .backlog = SERVER_BACKLOG,
        .option = "--listen",
        .if_busy = "another coordinator may run there; choose another port with --listen",
        .busy = STATUS_ERR_IO,
    };
    struct listen_sockets *sockets = &server->sockets;
    int code = 0;

    TRY(listen_open(sockets, &request, err));
    for (unsigned i = 0; i < sockets->count; i++) {
        uv_tcp_t *listener = &server->listeners[i];
        uv_tcp_init(&server->loop, listener);
        listener->data = server;
        code = code ? code : uv_tcp_open(listener, sockets->fds[i]);
        code = code ? code : uv_listen((uv_stream_t *)listener, SERVER_BACKLOG, on_connection);
    }
    if (code != 0)
        return error_set(err, STATUS_ERR_IO, "cannot listen on %s: %s", sockets->names[0], uv_strerror(code));
    return STATUS_OK;
}

static const struct audit_actor coordinator = {.who = "coordinator"};

/* Time passes for the farm, and its jobs of before go on. */
static void begin(struct server *server)
{
    audit_note(&server->audit, &coordinator, "start", 0, NULL, NULL);
    uv_timer_start(&server->tick, on_tick, SERVER_TICK_MS, SERVER_TICK_MS);
    uv_prepare_start(&server->prepare, on_prepare);
    uv_signal_start(&server->terminate, on_signal, SIGTERM);
    uv_signal_start(&server->interrupt, on_signal, SIGINT);
    farm_resume(&server->farm, clock_monotonic_ns());
}

static void init_handles(struct server *server)
{
    uv_timer_init(&server->loop, &server->tick);
    uv_timer_init(&server->loop, &server->commit_timer);
    uv_prepare_init(&server->loop, &server->prepare);
    uv_async_init(&server->loop, &server->saved, on_saved);
    uv_signal_init(&server->loop, &server->terminate);
    uv_signal_init(&server->loop, &server->interrupt);
    server->tick.data = server->commit_timer.data = server;
    server->saved.data = server;
    store_on_saved(server->store, wake_for_saved, server);
    server->prepare.data = server->terminate.data = server->interrupt.data = server;
}

static int is_workers_key(const void *keys, const char *name) { return keyring_is_worker(keys, name); }

status server_run(const struct server_options *options, struct error *err)
{
    struct server *server = mem_calloc(1, sizeof *server);
    struct farm_events events = {on_revoke, on_ack, on_notice, on_job_changed, farm_task_develop,
                                 farm_task_redevelop, farm_task_measure, farm_task_freeze, server,
                                 on_job_removed, on_job_event, on_workers_changed,
                                 on_job_state};
    status s;

    NEED(server, err, "the server");
    server->key = options->key;
    server->store = options->store;
    server->collector.policy = options->policy;
    age_clock_begin(&server->collector.clock, options->policy.age_wait_s, clock_wall_s(), clock_boot_ns());
    server->precision = options->precision ? options->precision : "float";
    server->fingerprint = elementary_fingerprint_of(server->precision);
    if (uv_loop_init(&server->loop) != 0) {
        mem_free(server);
        return error_set(err, STATUS_ERR_INTERNAL, "no event loop");
    }
    init_handles(server);
    server->on_event = options->on_event;
    server->descriptors = options->descriptors;
    server->audits.off = options->no_audits;
    server->keyring.no_shared = options->no_shared_keys;
    server->holders.submit_blob_bytes = options->submit_blobs;
    server->scrubber.rate = options->scrub_rate;
    door_init(&server->door, server);
    s = audit_init(&server->audit, options->discards_films ? NULL : store_folder(options->store), err);
    THEN(s, keyring_open(&server->keyring, options->store, err));
    THEN(s, farm_init(&server->farm, options->store, options->lease_ns, &events, clock_wall_s(), err));
    if (s == STATUS_OK) {
        server->farm.roster.is_key = is_workers_key;
        server->farm.roster.keys = &server->keyring;
        server->farm.discards_films = options->discards_films;
        server->farm.hang_ns = options->hang_ns;
        server->farm.order.rules = options->order;
        s = options->store ? distrusted_load(&server->farm, err) : STATUS_OK;
        THEN(s, unit_audits_load(server, err));
        if (s == STATUS_OK && options->on_event)
            s = event_program_open(&server->events, options->store, options->on_event, err);
        THEN(s, listen_on(server, options, err));
        if (s == STATUS_OK) {
            begin(server);
            s = announce(server, options, err);
        }
        if (s != STATUS_OK && server->state == SERVER_LISTENING) {
            close_listeners(server);
            close_handles(server);
        }
        uv_run(&server->loop, UV_RUN_DEFAULT);
        unit_audits_keep(server);
        event_program_close(server->events);
        server->events = NULL;
        store_settle(server->store); /* what still waits belongs to this server */
        if (s == STATUS_OK)
            audit_note(&server->audit, &coordinator, "end", 0, NULL, NULL);
        unit_audits_release(server);
        for (int i = 0; i < DISTRUST_REPORTS_MAX; i++)
            distrust_report_release(&server->reports[i]);
        render_requests_release(server);
        collector_release(&server->collector);
        scrubber_release(&server->scrubber);
        recalls_release(server);
        holders_release(&server->holders);
        farm_release(&server->farm, clock_monotonic_ns());
    } else {
        close_handles(server);
        uv_run(&server->loop, UV_RUN_DEFAULT);
    }
    keyring_release(&server->keyring);
    scene_lists_free(server->scene_lists);
    uv_loop_close(&server->loop);
    audit_release(&server->audit);
    mem_free(server);
    return s;
}
