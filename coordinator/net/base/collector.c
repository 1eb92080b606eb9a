#include "coordinator/net/base/collector.h"

#include <stdio.h>
#include <string.h>

#include "common/schema/token_ceilings.h"
#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/session_table.h"
#include "coordinator/net/base/store_report.h"
#include "coordinator/net/base/task.h"
#include "coordinator/store/files/blobs.h"

/* Clients' first questions are this much older than they seem: the file system may round a blob's time. */
enum { BLOB_TIME_STEP_NS = 2000000000 };

int collector_is_read(void *user, uint64_t job)
{
    const struct server *server = user;

    for (const struct session *s = server->sessions; s; s = s->next)
        if (s->reads_job == job && s->state == SESSION_OPEN)
            return 1;
    return 0;
}

status collector_check_room(struct server *server, const struct job *job, int force, struct error *err)
{
    return collect_check_room(&server->farm, &server->collector.policy, &server->collector.footprint, job, force, err);
}

/* Bytes that the jobs of an owner with this role may take; 0: no limit. */
static uint64_t jobs_limit(const struct collector *c, enum web_role role, uint64_t disk)
{
    const uint32_t percent = token_ceiling_of(role).jobs_percent;
    const uint64_t given = role == WEB_ROLE_SUBMIT ? room_limit_bytes(&c->policy.submit, disk) : 0;

    if (given > 0 || percent >= 100)
        return given;
    return disk / 100 * percent;
}

status collector_owner_room(struct server *server, enum web_role role, const struct job *job, uint64_t estimate,
                            struct owner_room *room, struct error *err)
{
    const struct collector *c = &server->collector;
    const uint64_t blobs_most = c->measured_ns ? c->footprint.blobs + c->sent : UINT64_MAX;
    uint64_t disk, left;
    struct error why = {0};

    if (footprint_disk(store_folder(server->store), &disk, &left, &why) != STATUS_OK)
        return STATUS_OK; /* whether anything can be stored there shows soon */
    return owner_room_init(room, &server->farm, &c->policy, &c->footprint, blobs_most, job, estimate,
                           jobs_limit(c, role, disk), err);
}

void collector_wake(struct server *server) { server->collector.sweep_wanted = 1; }

void collector_release(struct collector *collector)
{
    footprint_release(&collector->footprint);
    retention_plan_release(&collector->plan);
}

/* ---- measuring ------------------------------------------------------------------------------- */

struct collect_task {
    struct task task;
    struct footprint footprint;
    uint64_t sent; /* before it was measured */
    struct sweep sweep;
    int sweeps;                     /* in any case, */
    struct retention_policy policy; /* or above its limit */
    status swept;
    struct error why;
};

static void collect_run(struct task *task)
{
    struct collect_task *t = (struct collect_task *)task;
    const char *folder = store_folder(task->server->store);
    uint64_t limit;

    task->result = footprint_measure(&t->footprint, folder, &task->error);
    if (task->result != STATUS_OK)
        return;
    limit = room_limit_bytes(&t->policy.store, t->footprint.disk_bytes);
    t->sweeps |= limit > 0 && footprint_total(&t->footprint) > limit;
    if (!t->sweeps)
        return;
    t->swept = sweep_run(&t->sweep, folder, &t->why);
    t->footprint.blobs -= t->sweep.removed_bytes < t->footprint.blobs ? t->sweep.removed_bytes : t->footprint.blobs;
}

static void collect_release(struct task *task)
{
    struct collect_task *t = (struct collect_task *)task;

    footprint_release(&t->footprint);
    mem_free(t->sweep.users);
}

/* The oldest moment at which a client that is connected may have heard that a blob is there. `now`: tokens of the page,
 * whose sessions stay, do not count. */
static int64_t blobs_cutoff(const struct server *server, int now)
{
    const struct collector *c = &server->collector;
    int64_t keep_s = now ? 0 : c->policy.keep_blobs_s, cutoff = 0;

    if (keep_s == 0 || !c->ages_wait)
        cutoff = blobs_now() - keep_s * 1000000000;

    for (const struct session *s = server->sessions; s; s = s->next)
        if (s->blobs_since_ns && !(now && s->token) && s->blobs_since_ns - BLOB_TIME_STEP_NS < cutoff)
            cutoff = s->blobs_since_ns - BLOB_TIME_STEP_NS;
    if (server->submits > 0 && server->submits_since_ns - BLOB_TIME_STEP_NS < cutoff)
        cutoff = server->submits_since_ns - BLOB_TIME_STEP_NS;
    return cutoff;
}

static uint64_t frames_done(const struct farm *farm)
{
    uint64_t sum = farm->queue.count - farm->queue.active_count;

    for (size_t i = 0; i < farm->queue.active_count; i++)
        sum += farm->queue.active[i]->frames_done_count;
    return sum;
}

static void note_held(struct collector *c, status s, const struct error *why)
{
    if (s == STATUS_OK)
        return;
    snprintf(c->held, sizeof c->held, "%.255s", why->text);
    if (strcmp(c->held, c->logged) != 0)
        log_info("the store keeps what could be removed: %s", why->text);
    memcpy(c->logged, c->held, sizeof c->logged);
}

static void collect_end(struct task *task);
static const struct task_kind collect_kind = {"what takes the store's room",
                                              sizeof(struct collect_task), collect_run, collect_end,
                                              collect_release, 0};

/* Do ages wait in the round that begins? The log says what they keep. */
static void judge_ages(struct server *server)
{
    struct collector *c = &server->collector;
    char text[AGE_CLOCK_TEXT_MAX + 1];
    enum age_verdict verdict;
    int64_t newest_s;
    size_t due;
    int asked = 0;

    for (uint32_t i = 0; i < c->serving; i++)
        asked |= c->asked[i].collect;
    newest_s = collect_newest(&server->farm, &c->policy, &due);
    verdict = age_clock_judge(&c->clock, newest_s, asked);
    c->ages_wait = verdict != AGES_COUNT;
    if (!c->ages_wait || due == 0 || (verdict == AGES_WAIT && c->announced_ns == c->clock.since_ns))
        return;
    age_clock_text(text, &c->clock, verdict, newest_s);
    if (verdict == AGES_WAIT) {
        c->announced_ns = c->clock.since_ns;
        log_info("%zu job%s would go by age (--keep): %s", due, due == 1 ? "" : "s", text);
    } else {
        struct error why = {0};
        note_held(c, error_set(&why, STATUS_ERR_REFUSED, "%s", text), &why);
    }
}

static void begin_round(struct server *server, uint64_t now_ns)
{
    struct collector *c = &server->collector;
    struct error err = {0};
    struct collect_task *t;
    int now = 0;
    status s;

    c->serving = c->asked_count;
    if (c->next_ns <= now_ns)
        c->next_ns = now_ns + COLLECTOR_BUSY_MS * NS_PER_MS; /* if it fails */
    t = task_new(server, &collect_kind, &err);
    s = t ? collect_users(&server->farm, &t->sweep.users, &t->sweep.count, &err) : STATUS_ERR_NO_MEMORY;
    if (s != STATUS_OK) {
        log_warn("%s", err.text);
        task_drop(t ? &t->task : NULL);
        return;
    }
    t->policy = c->policy;
    t->sent = c->sent;
    judge_ages(server);
    for (uint32_t i = 0; i < c->serving; i++)
        now |= c->asked[i].collect && c->asked[i].now;
    t->sweep.cutoff_ns = blobs_cutoff(server, now);
    t->sweeps = c->sweep_wanted || now_ns - c->swept_ns >= COLLECTOR_IDLE_MS * NS_PER_MS || !c->swept_ns;
    c->sweep_wanted = 0;
    c->frames_done = frames_done(&server->farm);
    c->running = 1;
    task_start(&t->task);
}

/* Answer those for whom the round was. */
static void answer(struct server *server, status s, const struct error *why)
{
    struct collector *c = &server->collector;

    for (uint32_t i = 0; i < c->serving; i++) {
        struct session *session = session_find(server, c->asked[i].session);
        if (!session || session->state != SESSION_OPEN)
            continue;
        if (s == STATUS_OK)
            store_report_send(session, c->asked[i].request);
        else
            session_fail(session, c->asked[i].request, why);
    }
    memmove(c->asked, c->asked + c->serving, (c->asked_count - c->serving) * sizeof *c->asked);
    c->asked_count -= c->serving;
    c->serving = 0;
    c->removed_jobs = c->removed_films = c->removed_blobs = c->removed_bytes = 0;
    c->waiting_blobs = c->waiting_bytes = 0;
    c->held[0] = 0;
}

/* Only what was asked for: a question about what takes the room removes nothing. */
static int may_remove(const struct collector *c)
{
    for (uint32_t i = 0; i < c->serving; i++)
        if (c->asked[i].collect)
            return 1;
    return c->serving == 0;
}

static int is_limited(const struct retention_policy *p) { return retention_makes_room(p) || p->owner_limit > 0; }

static uint64_t period_ns(const struct retention_policy *p, size_t in_use)
{
    if (in_use > 0)
        return COLLECTOR_BUSY_MS * NS_PER_MS;
    if (is_limited(p))
        return COLLECTOR_PERIOD_MS * NS_PER_MS;
    return (p->keep_s >= 0 || p->keep_failed_s >= 0 ? COLLECTOR_AGES_MS : COLLECTOR_IDLE_MS) * NS_PER_MS;
}

static void end_round(struct server *server, uint64_t now_ns)
{
    struct collector *c = &server->collector;
    const struct error none = {0};

    c->plan.count = c->plan_at = 0;
    if (c->round_removed && ++c->rounds < COLLECTOR_ROUNDS_MAX) {
        c->round_removed = 0;
        c->sweep_wanted = 1;
        c->next_ns = 0;
        return;
    }
    c->round_removed = 0;
    c->rounds = 0;
    if (may_remove(c)) {
        uint64_t left_ns = c->ages_wait ? age_clock_left_ns(&c->clock) : 0, period = period_ns(&c->policy, c->plan.in_use);
        c->next_ns = now_ns + (left_ns > 0 && left_ns < period ? left_ns : period);
    }
    answer(server, STATUS_OK, &none);
}

static void collect_end(struct task *task)
{
    struct collect_task *t = (struct collect_task *)task;
    struct server *server = task->server;
    struct collector *c = &server->collector;
    struct retention_policy policy = c->policy;
    struct error err = {0};
    uint64_t now_ns = clock_monotonic_ns();
    status s = task->result;

    c->running = 0;
    if (c->ages_wait)
        retention_ages_wait(&policy);
    store_clear_held(server->store); /* both remove, and exclude each other: what met this round's sweep, too, goes now */
    if (s != STATUS_OK) {
        log_warn("%s", task->error.text);
        answer(server, s, &task->error);
        return;
    }
    footprint_release(&c->footprint);
    c->footprint = t->footprint;
    t->footprint = (struct footprint){0};
    c->sent -= t->sent;
    c->measured_ns = now_ns;
    if (t->sweeps) {
        c->swept_ns = now_ns;
        c->removed_blobs += t->sweep.removed;
        if (t->sweep.removed > 0)
            holders_swept(&server->holders, store_folder(server->store));
        c->removed_bytes += t->sweep.removed_bytes;
        c->waiting_blobs = t->sweep.waiting;
        c->waiting_bytes = t->sweep.waiting_bytes;
        c->sweep_wanted |= t->swept == STATUS_ERR_REFUSED;
        note_held(c, t->swept, &t->why);
    }
    if (may_remove(c) && server->state == SERVER_LISTENING)
        s = collect_plan(&c->plan, &server->farm, &policy, &c->footprint,
                         t->sweeps && t->swept == STATUS_OK ? t->sweep.users : NULL,
                         t->sweeps && t->swept == STATUS_OK ? t->sweep.count : 0, collector_is_read, server, &err);
    note_held(c, s, &err);
    c->plan_at = 0;
    if (c->plan.count == 0)
        end_round(server, now_ns);
}

/* ---- removing -------------------------------------------------------------------------------- */

static void take_steps(struct server *server, uint64_t now_ns)
{
    struct collector *c = &server->collector;
    status s = STATUS_OK;

    for (int i = 0; i < COLLECTOR_STEPS && c->plan_at < c->plan.count && s == STATUS_OK; i++) {
        enum collect_result result;
        struct error err = {0};
        s = collect_step(&server->farm, &c->plan, &c->plan.steps[c->plan_at++], &c->policy, collector_is_read, server,
                         clock_monotonic_ns(), &result, &err);
        c->removed_jobs += result == COLLECT_JOB;
        c->removed_films += result == COLLECT_FILMS;
        c->round_removed |= result == COLLECT_JOB;
        c->plan.in_use += s == STATUS_OK && result == COLLECT_NOTHING;
        note_held(c, s, &err);
    }
    if (s != STATUS_OK)
        c->round_removed = 0;
    if (s != STATUS_OK || c->plan_at == c->plan.count)
        end_round(server, now_ns);
}

void collector_tick(struct server *server, uint64_t now_ns)
{
    struct collector *c = &server->collector;

    if (age_clock_look(&c->clock, server->farm.wall_s, clock_boot_ns())) {
        char text[AGE_CLOCK_TEXT_MAX + 1];
        age_clock_text(text, &c->clock, AGES_JUMPED, 0);
        log_warn("%s", text);
    }
    if (c->running)
        return;
    if (c->plan.count > 0) {
        take_steps(server, now_ns);
        return;
    }
    if (is_limited(&c->policy) && now_ns - c->measured_ns >= COLLECTOR_BUSY_MS * NS_PER_MS &&
        frames_done(&server->farm) != c->frames_done)
        c->next_ns = 0;
    if (now_ns >= c->next_ns || c->asked_count > 0 ||
        (c->sweep_wanted && now_ns - c->measured_ns >= COLLECTOR_BUSY_MS * NS_PER_MS))
        begin_round(server, now_ns);
}

/* ---- questions ------------------------------------------------------------------------------- */

status session_store(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                     struct error *err)
{
    struct collector *c = &session->server->collector;

    if (c->asked_count == COLLECTOR_ASKED_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d clients wait for this already: try again in a moment",
                         COLLECTOR_ASKED_MAX);
    c->asked[c->asked_count++] = (struct store_asked){.session = session->id,
                                                      .request = message->request,
                                                      .collect = message->store_query->collect,
                                                      .now = message->store_query->now};
    if (message->store_query->collect)
        c->sweep_wanted = 1;
    return STATUS_OK;
}
