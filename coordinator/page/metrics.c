#include "coordinator/page/metrics.h"

#include <ctype.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

#include "common/system/clock.h"
#include "coordinator/frame/frame.h"
#include "coordinator/net/server.h"
#include "coordinator/net/base/task.h"
#include "protocol/metric_text.h"
#include "coordinator/page/page.h"
#include "coordinator/events/event_program.h"

void metrics_tick(struct metrics *metrics, uint64_t now_ns)
{
    const uint64_t period_ns = SERVER_TICK_MS * NS_PER_MS;
    uint64_t late_ns = metrics->ticked_ns ? now_ns - metrics->ticked_ns : period_ns;

    metrics->ticked_ns = now_ns;
    histogram_add(&metrics->lag, late_ns > period_ns ? late_ns - period_ns : 0);
}

/* ---- jobs and frames -------------------------------------------------------------------------- */

static void put_jobs(struct buffer *out, const struct farm *farm)
{
    uint64_t in_state[JOB_STATE_COUNT] = {0};

    for (size_t i = 0; i < farm->queue.count; i++)
        in_state[farm->queue.all[i]->state]++;
    metric_begin(out, "azulejo_jobs", "gauge", "Jobs that the coordinator knows, by state.");
    for (int s = 0; s < JOB_STATE_COUNT; s++)
        metric_value(out, "azulejo_jobs", (double)in_state[s], "state", job_state_word(s), NULL);
    metric_begin(out, "azulejo_jobs_ended_total", "counter", "Jobs that ended, by their last state.");
    for (int s = 0; s < JOB_STATE_COUNT; s++)
        if (job_state_ended(s))
            metric_value(out, "azulejo_jobs_ended_total", (double)farm->counts.jobs[s], "state", job_state_word(s),
                         NULL);
    metric_one(out, "azulejo_frames_done_total", "counter", "Frames that were completed.", (double)farm->counts.frames);
    metric_one(out, "azulejo_frames_open", "gauge", "Frames whose films are in memory.", farm->open_frames);
}

_Static_assert((int)FRAMES_OPEN_MAX <= (int)METRICS_FRAMES_MAX, "each has a time series of its own");

/* `value` of each frame in work whose error is known. */
static void put_frames(struct buffer *out, const struct farm *farm, const char *name, const char *help,
                       double (*value)(const struct job_frame *frame))
{
    metric_begin(out, name, "gauge", help);
    for (size_t i = 0; i < farm->queue.active_count; i++)
        for (const struct job_frame *f = farm->queue.active[i]->frames; f; f = f->next) {
            char job[24], frame[16];
            const struct history_point *last = history_last(&f->history);
            if (!last || !last->figures.known)
                continue;
            snprintf(job, sizeof job, "%" PRIu64, f->job->id);
            snprintf(frame, sizeof frame, "%u", f->number);
            metric_value(out, name, value(f), "job", job, "name", f->job->name, "frame", frame, NULL);
        }
}

static double frame_error(const struct job_frame *frame)
{
    return history_last(&frame->history)->figures.display_error;
}

static double frame_core_s(const struct job_frame *frame) { return history_last(&frame->history)->core_s; }

/* ---- work ------------------------------------------------------------------------------------- */

static void put_work(struct buffer *out, const struct farm *farm, uint64_t now_ns)
{
    const struct farm_counts *c = &farm->counts;

    metric_one(out, "azulejo_results_total", "counter", "Tile results that were merged.", (double)c->results);
    metric_one(out, "azulejo_results_repeated_total", "counter", "Tile results of units that the film had already.",
               (double)c->repeats);
    metric_one(out, "azulejo_results_per_second", "gauge", "Tile results merged a second, over the last ten.",
               rate_per_second(&c->result_rate, now_ns));
    metric_one(out, "azulejo_samples_total", "counter", "Pixel samples of the merged results.", (double)c->samples);
    metric_one(out, "azulejo_samples_per_second", "gauge", "Pixel samples merged a second, over the last ten.",
               rate_per_second(&c->sample_rate, now_ns));
    metric_one(out, "azulejo_rays_total", "counter", "Rays of the merged results.", (double)c->rays);
    metric_one(out, "azulejo_core_seconds_total", "counter", "Processor time that workers spent on merged results.",
               (double)c->cpu_ns / 1e9);
    metric_one(out, "azulejo_conflicts_total", "counter",
               "Results that differed from the one merged before: a machine computes wrong.", (double)farm->conflicts);
    metric_begin(out, "azulejo_faults_total", "counter",
                 "What went wrong with single samples, by kind (dropped_samples: not finite, counted as black).");
    for (int k = 0; k < HEALTH_KINDS; k++)
        metric_value(out, "azulejo_faults_total", (double)c->health[k], "kind", health_rows[k].name, NULL);
}

/* Ages of the leases at these shares of them, which are in the order of their grants. */
static void put_leases(struct buffer *out, const struct farm *farm, uint64_t now_ns)
{
    static const struct {
        const char *word;
        double share;
    } places[] = {{"0.5", 0.5}, {"0.9", 0.9}, {"1", 1}};
    const struct lease_table *table = &farm->leases;
    double ages[3] = {NAN, NAN, NAN};
    uint32_t from_newest = 0;

    for (const struct lease *lease = table->newest; lease; lease = lease->older, from_newest++)
        for (int i = 0; i < 3; i++)
            if (from_newest == (uint32_t)(places[i].share * (table->count - 1)))
                ages[i] = (double)(now_ns - lease->granted_ns) / 1e9;
    metric_one(out, "azulejo_leases", "gauge", "Leases that workers hold.", table->count);
    metric_begin(out, "azulejo_lease_age_seconds", "gauge",
                 "The age that this share of the leases that workers hold is below; 1: the oldest.");
    for (int i = 0; i < 3; i++)
        metric_value(out, "azulejo_lease_age_seconds", ages[i], "share", places[i].word, NULL);
    metric_one(out, "azulejo_leases_granted_total", "counter", "Leases that were granted.", (double)table->last_id);
    metric_one(out, "azulejo_leases_lapsed_total", "counter", "Leases that lapsed because no result came for too long.",
               (double)farm->counts.leases_lapsed);
}

/* ---- workers ---------------------------------------------------------------------------------- */

/* "idle" of WORKER_STATE_IDLE. */
static const char *state_word(const ProtobufCEnumValue *value, char out[32])
{
    size_t i = 0;

    for (const char *c = value->name + strlen("WORKER_STATE_"); *c && i < 31; c++)
        out[i++] = (char)tolower((unsigned char)*c);
    out[i] = 0;
    return out;
}

static void put_workers(struct buffer *out, const struct server *server, uint64_t now_ns)
{
    const ProtobufCEnumDescriptor *d = &azulejo__wire__worker_state__descriptor;
    enum { STATES_MAX = 16 };
    uint32_t in_state[STATES_MAX] = {0}, threads[STATES_MAX] = {0};
    double silence_s = 0;
    char word[32];

    for (const struct session *s = server->sessions; s; s = s->next) {
        unsigned state;
        uint64_t heard_ns;
        if (!s->worker || s->worker->is_replaced)
            continue;
        state = (unsigned)session_worker_state(s->worker);
        in_state[state % STATES_MAX]++;
        threads[state % STATES_MAX] += s->worker->threads;
        heard_ns = channel_last_heard_ns(s->channel);
        if (heard_ns < now_ns)
            silence_s = fmax(silence_s, (double)(now_ns - heard_ns) / 1e9);
    }
    metric_begin(out, "azulejo_workers", "gauge", "Connected workers, by state.");
    for (unsigned i = 0; i < d->n_values; i++)
        metric_value(out, "azulejo_workers", in_state[d->values[i].value % STATES_MAX], "state",
                     state_word(&d->values[i], word), NULL);
    metric_begin(out, "azulejo_threads", "gauge", "Threads of the connected workers, by the worker's state.");
    for (unsigned i = 0; i < d->n_values; i++)
        metric_value(out, "azulejo_threads", threads[d->values[i].value % STATES_MAX], "state",
                     state_word(&d->values[i], word), NULL);
    metric_one(out, "azulejo_worker_silence_seconds", "gauge",
               "How long the worker that is silent longest has sent nothing; heartbeats come every 2 s.", silence_s);
    metric_one(out, "azulejo_workers_lost_total", "counter", "Workers whose connection was lost.",
               (double)server->farm.counts.workers_died);
}

/* ---- the store -------------------------------------------------------------------------------- */

struct measure_task {
    struct task task;
    struct page *page;
    struct footprint footprint;
    uint64_t begun_ns;
};

static void measure_run(struct task *task)
{
    struct measure_task *t = (struct measure_task *)task;

    task->result = footprint_measure(&t->footprint, store_folder(task->server->store), &task->error);
}

static void measure_end(struct task *task)
{
    struct measure_task *t = (struct measure_task *)task;
    struct metrics *m = &t->page->metrics;
    uint64_t now_ns = clock_monotonic_ns(), pause_ns = (task->ended_ns - task->begun_ns) * METRICS_STORE_SHARE;

    m->measuring = 0;
    m->next_ns = now_ns + (pause_ns > METRICS_STORE_MS * NS_PER_MS ? pause_ns : METRICS_STORE_MS * NS_PER_MS);
    if (task->result != STATUS_OK)
        return;
    m->measured_ns = now_ns;
    m->store = t->footprint;
    m->store.jobs = NULL; /* the sums are enough */
    m->store.count = m->store.capacity = 0;
}

static void measure_release(struct task *task) { footprint_release(&((struct measure_task *)task)->footprint); }

static const struct task_kind measure_kind = {"what takes the store's room", sizeof(struct measure_task),
                                              measure_run, measure_end, measure_release, 0};

static void measure_when_due(struct page *page, uint64_t now_ns)
{
    struct metrics *m = &page->metrics;
    struct measure_task *t;

    if (m->measuring || now_ns < m->next_ns || page->server->state != SERVER_LISTENING)
        return;
    t = task_new(page->server, &measure_kind, NULL);
    if (!t)
        return;
    t->page = page;
    m->measuring = 1;
    task_start(&t->task);
}

static void put_store(struct buffer *out, const struct metrics *m, const struct farm *farm, uint64_t now_ns)
{
    const struct {
        const char *kind;
        uint64_t bytes;
    } kinds[] = {{"films", m->store.films},     {"pictures", m->store.pictures}, {"blobs", m->store.blobs},
                 {"database", m->store.database}, {"reserve", m->store.reserve},   {"other", m->store.other},
                 {"trash", m->store.trash}};

    metric_one(out, "azulejo_store_usable", "gauge", "1: the store can be written; 0: jobs wait for it.",
               !trouble_is(&farm->trouble));
    metric_histogram(out, "azulejo_sync_seconds", "How long syncs of films took.", &farm->counts.syncs);
    metric_one(out, "azulejo_sync_failures_total", "counter", "Writes or syncs of films that failed.",
               (double)farm->counts.sync_failures);
    metric_one(out, "azulejo_store_measured_age_seconds", "gauge",
               "How old the following figures of the store are; NaN: not measured yet.",
               m->measured_ns ? (double)(now_ns - m->measured_ns) / 1e9 : NAN);
    metric_begin(out, "azulejo_store_bytes", "gauge", "What takes the store's room, by kind; NaN: not measured yet.");
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        metric_value(out, "azulejo_store_bytes", m->measured_ns ? (double)kinds[i].bytes : NAN, "kind", kinds[i].kind,
                     NULL);
    metric_one(out, "azulejo_disk_bytes", "gauge", "Size of the store's file system; NaN: not measured yet.",
               m->measured_ns ? (double)m->store.disk_bytes : NAN);
    metric_one(out, "azulejo_disk_free_bytes", "gauge", "What is free of it; NaN: not measured yet.",
               m->measured_ns ? (double)m->store.free_bytes : NAN);
}

/* ---- the coordinator itself ------------------------------------------------------------------- */

static void put_self(struct buffer *out, const struct page *page)
{
    const struct server *server = page->server;
    struct rusage used = {0};

    (void)getrusage(RUSAGE_SELF, &used);
    metric_begin(out, "azulejo_build_info", "gauge", "Always 1; the release is in the label.");
    metric_value(out, "azulejo_build_info", 1, "version", AZULEJO_VERSION, NULL);
    metric_one(out, "azulejo_start_time_seconds", "gauge", "When this run began, in seconds since 1970.",
               (double)server->farm.begun_s);
    metric_one(out, "azulejo_draining", "gauge", "1: the coordinator is ending.", server->state != SERVER_LISTENING);
    metric_one(out, "azulejo_cpu_seconds_total", "counter", "Processor time of the coordinator.",
               (double)used.ru_utime.tv_sec + (double)used.ru_stime.tv_sec +
                   (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec) / 1e6);
    metric_one(out, "azulejo_memory_peak_bytes", "gauge", "The most memory that the coordinator had.",
               (double)used.ru_maxrss * 1024);
    metric_histogram(out, "azulejo_loop_lag_seconds", "How late the event loop's ticks were, ten a second.",
                     &page->metrics.lag);
    metric_one(out, "azulejo_tasks", "gauge", "Tasks that wait for the disk or a processor.", server->tasks);
    metric_one(out, "azulejo_connections", "gauge", "Connections of workers and clients.", server->session_count);
}

/* Without --on-event: zeros. */
static void put_events(struct buffer *out, const struct server *server)
{
    struct event_counts counts = {0};

    if (server->events)
        counts = event_program_counts(server->events);
    metric_begin(out, "azulejo_events_total", "counter", "Events for the program of --on-event, by what became of them.");
    metric_value(out, "azulejo_events_total", (double)counts.taken, "result", "taken", NULL);
    metric_value(out, "azulejo_events_total", (double)counts.failed, "result", "failed", NULL);
    metric_value(out, "azulejo_events_total", (double)counts.dropped, "result", "dropped", NULL);
    metric_one(out, "azulejo_event_again_total", "counter",
               "Runs of that program that another one follows, for the same event.", (double)counts.again);
    metric_one(out, "azulejo_events_waiting", "gauge", "Events that it has not taken yet.", counts.waiting);
}

void metrics_write(struct page *page, uint64_t now_ns, struct buffer *out)
{
    const struct farm *farm = &page->server->farm;

    measure_when_due(page, now_ns);
    put_self(out, page);
    put_jobs(out, farm);
    put_frames(out, farm, "azulejo_frame_error_codes",
               "Display error of the frames in work whose error is known, in steps of 255.", frame_error);
    put_frames(out, farm, "azulejo_frame_core_seconds", "Processor time spent on them when that was measured.",
               frame_core_s);
    put_work(out, farm, now_ns);
    put_leases(out, farm, now_ns);
    put_workers(out, page->server, now_ns);
    put_store(out, &page->metrics, farm, now_ns);
    put_events(out, page->server);
}
