#include "client/farm/trace_file.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/format.h"
#include "client/terminal/json.h"
#include "client/terminal/must.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/message.h"

/* ---- from the coordinator ------------------------------------------------------------------- */

static void take_page(struct job_trace *t, Azulejo__Wire__Envelope *answer)
{
    const Azulejo__Wire__JobTrace *page = answer->job_trace;

    MUST_GROW(t->answers, t->answer_capacity, t->answer_count + 1);
    t->answers[t->answer_count++] = answer;
    MUST_GROW(t->events, t->event_capacity, t->event_count + page->n_events);
    MUST_GROW(t->workers, t->worker_capacity, t->worker_count + page->n_workers);
    for (size_t i = 0; i < page->n_events; i++) {
        t->events[t->event_count++] = page->events[i];
        t->units += page->events[i]->kind == AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT;
    }
    for (size_t i = 0; i < page->n_workers; i++)
        t->workers[t->worker_count++] = page->workers[i];
    t->lost = page->lost;
    t->begun_at = page->begun_at;
    t->cut = page->cut;
    t->utc_ns = page->utc_ns;
    t->name = page->name;
}

static int by_number(const void *one, const void *other)
{
    const Azulejo__Wire__TraceWorker *const *a = one, *const *b = other;

    return ((*a)->number > (*b)->number) - ((*a)->number < (*b)->number);
}

/* Each once, ascending numbers. */
static void sort_workers(struct job_trace *t)
{
    size_t kept = 0;

    if (t->worker_count > 0)
        qsort(t->workers, t->worker_count, sizeof *t->workers, by_number);
    for (size_t i = 0; i < t->worker_count; i++)
        if (kept == 0 || t->workers[kept - 1]->number != t->workers[i]->number)
            t->workers[kept++] = t->workers[i];
    t->worker_count = kept;
}

status job_trace_get(struct connection *c, uint64_t job, struct job_trace *out, struct error *err)
{
    Azulejo__Wire__JobTraceGet get = AZULEJO__WIRE__JOB_TRACE_GET__INIT;
    Azulejo__Wire__JobLogGet log = AZULEJO__WIRE__JOB_LOG_GET__INIT;
    Azulejo__Wire__Envelope more = MESSAGE(JOB_TRACE_GET, job_trace_get, &get);
    Azulejo__Wire__Envelope events = MESSAGE(JOB_LOG_GET, job_log_get, &log);
    uint64_t last = 0;
    status s = STATUS_OK;

    out->job = get.job = log.job = job;
    do {
        Azulejo__Wire__Envelope *answer = NULL;

        get.after = last;
        TRY(connection_ask(c, &more, AZULEJO__WIRE__ENVELOPE__BODY_JOB_TRACE, &answer, err));
        last = answer->job_trace->last;
        take_page(out, answer);
        if (last && last <= get.after)
            s = error_set(err, STATUS_ERR_PROTOCOL, "the coordinator sent a page of a trace twice");
    } while (s == STATUS_OK && last);
    sort_workers(out);
    THEN(s, connection_ask(c, &events, AZULEJO__WIRE__ENVELOPE__BODY_JOB_LOG, &out->log, err));
    return s;
}

void job_trace_release(struct job_trace *t)
{
    for (size_t i = 0; i < t->answer_count; i++)
        message_free(t->answers[i]);
    message_free(t->log);
    mem_free(t->answers);
    mem_free(t->events);
    mem_free(t->workers);
    *t = (struct job_trace){0};
}

/* ---- the file ------------------------------------------------------------------------------- */

/* In the file a process is the coordinator or a worker, and a thread is a lane of slices that do not
 * overlap: a worker's thread, or what the coordinator does one after another. */
enum { COORDINATOR = 1, WORKERS = 2 };  /* processes; workers from WORKERS on */
enum { LOG, MERGE, FILMS, PICTURES, UNKNOWN_THREADS = 10001 }; /* threads; from PICTURES on as many as needed */

struct slice {
    const Azulejo__Wire__TraceEvent *event;
    uint64_t begin_ns, end_ns;
    uint32_t process, thread, lane;
    int then;   /* the event's second step */
    int shares; /* may overlap others: gets the first free lane from `thread` on */
    int opens;  /* the first slice of its lane */
};

struct writer {
    const struct job_trace *trace;
    struct buffer *out;
    struct slice *slices;
    size_t count;
    uint64_t base_ns;    /* time 0 of the file */
    uint32_t *processes; /* of trace->workers */
    int begun;           /* something was written */
};

static int same_worker(const Azulejo__Wire__TraceWorker *a, const Azulejo__Wire__TraceWorker *b)
{
    return a->process == b->process && strcmp(a->host, b->host) == 0;
}

/* A worker that connected again is the same process. */
static void number_processes(struct writer *w)
{
    uint32_t next = WORKERS;

    for (size_t i = 0; i < w->trace->worker_count; i++) {
        size_t k = 0;
        while (!same_worker(w->trace->workers[k], w->trace->workers[i]))
            k++;
        w->processes[i] = k == i ? next++ : w->processes[k];
    }
}

static uint32_t process_of(const struct writer *w, uint32_t number)
{
    size_t low = 0, high = w->trace->worker_count;

    while (low < high) {
        size_t middle = (low + high) / 2;
        if (w->trace->workers[middle]->number < number)
            low = middle + 1;
        else
            high = middle;
    }
    return low < w->trace->worker_count ? w->processes[low] : WORKERS;
}

static void add_slice(struct writer *w, const Azulejo__Wire__TraceEvent *e, uint64_t begin_ns, uint64_t ns,
                      uint32_t process, uint32_t thread, int shares)
{
    struct slice *s = &w->slices[w->count++];

    *s = (struct slice){.event = e, .begin_ns = begin_ns, .end_ns = begin_ns + ns, .process = process,
                        .thread = thread, .shares = shares};
    if (begin_ns < w->base_ns)
        w->base_ns = begin_ns;
}

static void add_event(struct writer *w, const Azulejo__Wire__TraceEvent *e)
{
    switch (e->kind) {
    case AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT:
        add_slice(w, e, e->begin_ns, e->ns, process_of(w, e->worker), e->thread ? e->thread : UNKNOWN_THREADS,
                  !e->thread);
        if (e->then) {
            add_slice(w, e, e->then_begin_ns, e->then_ns, COORDINATOR, MERGE, 0);
            w->slices[w->count - 1].then = 1;
        }
        return;
    case AZULEJO__WIRE__TRACE_KIND__TRACE_COMMIT:
        add_slice(w, e, e->begin_ns, e->ns, COORDINATOR, FILMS, 0);
        if (e->then) {
            add_slice(w, e, e->then_begin_ns, e->then_ns, COORDINATOR, FILMS, 0);
            w->slices[w->count - 1].then = 1;
        }
        return;
    default: add_slice(w, e, e->begin_ns, e->ns, COORDINATOR, PICTURES, 1); return;
    }
}

static int compare(uint64_t a, uint64_t b) { return (a > b) - (a < b); }

static int by_lane(const void *one, const void *other)
{
    const struct slice *a = one, *b = other;
    int order = compare(a->process, b->process);

    if (order == 0)
        order = compare(a->thread, b->thread);
    if (order == 0)
        order = compare(a->begin_ns, b->begin_ns);
    return order ? order : compare(a->end_ns, b->end_ns);
}

/* Slices of a lane must not overlap. Those of one thread do only as far as two clocks differ, and are cut;
 * the others get lanes of their own. */
static void separate(struct writer *w)
{
    uint64_t *free_ns = must(mem_calloc(w->count + 1, sizeof *free_ns)); /* when each lane is free */
    size_t lanes = 0;

    for (size_t i = 0; i < w->count; i++) {
        struct slice *s = &w->slices[i];
        size_t lane = 0;

        if (i == 0 || s->process != w->slices[i - 1].process || s->thread != w->slices[i - 1].thread)
            lanes = 0;
        while (s->shares && lane < lanes && free_ns[lane] > s->begin_ns)
            lane++;
        s->opens = lane == lanes;
        if (s->opens)
            free_ns[lanes++] = 0;
        if (s->begin_ns < free_ns[lane])
            s->begin_ns = free_ns[lane];
        if (s->end_ns < s->begin_ns)
            s->end_ns = s->begin_ns;
        free_ns[lane] = s->end_ns;
        s->lane = s->thread + (uint32_t)lane;
    }
    mem_free(free_ns);
}

/* When it was, on the events' clock; 0: before this run. */
static uint64_t log_ns(const struct job_trace *t, const Azulejo__Wire__JobEvent *e)
{
    int64_t at_ns;

    if (e->at < t->begun_at || __builtin_mul_overflow(e->at, (int64_t)NS_PER_SECOND, &at_ns) ||
        __builtin_sub_overflow(at_ns, t->utc_ns, &at_ns))
        return 0; /* or a time that cannot be */
    return at_ns < 0 ? 0 : (uint64_t)at_ns;
}

static void begin_with_log(struct writer *w)
{
    const Azulejo__Wire__JobLog *log = w->trace->log->job_log;

    for (size_t i = 0; i < log->n_events; i++) {
        uint64_t at_ns = log_ns(w->trace, log->events[i]);
        if (at_ns && at_ns < w->base_ns)
            w->base_ns = at_ns;
    }
}

/* ---- its text ------------------------------------------------------------------------------- */

static void put_text(struct buffer *out, const char *text)
{
    char clean[512];
    json_t *value = json_text(message_text(clean, sizeof clean, text));
    char *quoted = value ? json_dumps(value, JSON_ENCODE_ANY) : NULL;

    if (quoted)
        buffer_puts(out, quoted);
    else
        out->failed = 1;
    free(quoted);
    json_decref(value);
}

static void next_item(struct writer *w)
{
    buffer_puts(w->out, w->begun ? ",\n" : "\n");
    w->begun = 1;
}

/* Microseconds. */
static void put_us(struct buffer *out, const char *name, uint64_t ns)
{
    buffer_printf(out, ", \"%s\": %" PRIu64 ".%03u", name, ns / 1000, (unsigned)(ns % 1000));
}

static void put_name(struct writer *w, const char *kind, uint32_t process, uint32_t thread, const char *name)
{
    next_item(w);
    buffer_printf(w->out, "{\"ph\": \"M\", \"name\": \"%s\", \"pid\": %u, \"tid\": %u, \"args\": {\"name\": ", kind,
                  process, thread);
    put_text(w->out, name);
    buffer_puts(w->out, "}}");
}

static void put_order(struct writer *w, const char *kind, uint32_t process, uint32_t thread, uint32_t order)
{
    next_item(w);
    buffer_printf(w->out, "{\"ph\": \"M\", \"name\": \"%s\", \"pid\": %u, \"tid\": %u, \"args\": {\"sort_index\": %u}}",
                  kind, process, thread, order);
}

static const char *slice_name(const struct slice *s, char *out, size_t size)
{
    static const char *const names[] = {"unit", "write", "pictures", "pictures again", "figures", "display"};
    const Azulejo__Wire__TraceEvent *e = s->event;
    int unit = e->kind == AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT;

    if (unit && !s->then)
        snprintf(out, size, "frame %u tile %u", e->frame, e->tile);
    else if (unit)
        snprintf(out, size, "merge");
    else if (s->then)
        snprintf(out, size, "fsync");
    else
        snprintf(out, size, "%s", (size_t)e->kind < sizeof names / sizeof *names ? names[e->kind] : "other");
    return out;
}

static const char *slice_category(const struct slice *s)
{
    if (s->event->kind == AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT)
        return s->then ? "merge" : "render";
    return s->event->kind == AZULEJO__WIRE__TRACE_KIND__TRACE_COMMIT ? "disk" : "develop";
}

static void put_slice(struct writer *w, const struct slice *s)
{
    const Azulejo__Wire__TraceEvent *e = s->event;
    char name[64];

    next_item(w);
    buffer_printf(w->out, "{\"ph\": \"X\", \"name\": \"%s\", \"cat\": \"%s\", \"pid\": %u, \"tid\": %u",
                  slice_name(s, name, sizeof name), slice_category(s), s->process, s->lane);
    put_us(w->out, "ts", s->begin_ns - w->base_ns);
    put_us(w->out, "dur", s->end_ns - s->begin_ns);
    buffer_printf(w->out, ", \"args\": {\"frame\": %u", e->frame);
    if (e->kind == AZULEJO__WIRE__TRACE_KIND__TRACE_COMMIT)
        buffer_printf(w->out, ", \"tiles\": %u", e->tile);
    if (e->kind == AZULEJO__WIRE__TRACE_KIND__TRACE_UNIT) {
        buffer_printf(w->out, ", \"tile\": %u, \"group\": %u, \"pass\": %u", e->tile, e->group, e->pass);
        if (!s->then)
            buffer_printf(w->out, ", \"cpu_ms\": %.3f", (double)e->cpu_ns / 1e6);
        if (e->repeated)
            buffer_puts(w->out, ", \"repeated\": true");
        if (e->estimated && !s->then)
            buffer_puts(w->out, ", \"estimated\": true");
    }
    buffer_puts(w->out, "}}");
}

/* Each thread's name, once. */
static void put_threads(struct writer *w)
{
    static const char *const lanes[] = {[LOG] = "log", [MERGE] = "merging", [FILMS] = "films: write, fsync"};
    char name[32];

    put_name(w, "thread_name", COORDINATOR, LOG, lanes[LOG]);
    put_order(w, "thread_sort_index", COORDINATOR, LOG, LOG);
    for (size_t i = 0; i < w->count; i++) {
        const struct slice *s = &w->slices[i];

        if (!s->opens)
            continue;
        if (s->process == COORDINATOR && s->lane < PICTURES)
            snprintf(name, sizeof name, "%s", lanes[s->lane]);
        else if (s->process == COORDINATOR)
            snprintf(name, sizeof name, "pictures %u", s->lane - PICTURES + 1);
        else if (s->event->thread)
            snprintf(name, sizeof name, "thread %u", s->lane);
        else
            snprintf(name, sizeof name, "some thread %u", s->lane - UNKNOWN_THREADS + 1);
        put_name(w, "thread_name", s->process, s->lane, name);
        put_order(w, "thread_sort_index", s->process, s->lane, s->lane);
    }
}

/* "worker gpu-1 (node-12, process 4711)". Any connection of the process may be the one whose name is known. */
static void name_worker(const struct writer *w, size_t i, char *out, size_t size)
{
    const Azulejo__Wire__TraceWorker *worker = w->trace->workers[i];
    const char *label = "";
    char name[128], host[128];

    for (size_t k = i; k < w->trace->worker_count && !label[0]; k++)
        if (w->processes[k] == w->processes[i])
            label = w->trace->workers[k]->name;
    message_text(host, sizeof host, worker->host);
    if (label[0])
        snprintf(out, size, "worker %s (%s, process %u)", message_text(name, sizeof name, label), host, worker->process);
    else
        snprintf(out, size, "worker %s, process %u", host, worker->process);
}

static void put_processes(struct writer *w)
{
    char name[384];

    put_name(w, "process_name", COORDINATOR, LOG, "coordinator");
    put_order(w, "process_sort_index", COORDINATOR, LOG, 0);
    for (size_t i = 0; i < w->trace->worker_count; i++) {
        size_t k = 0;

        while (w->processes[k] != w->processes[i])
            k++;
        if (k < i)
            continue;
        name_worker(w, i, name, sizeof name);
        put_name(w, "process_name", w->processes[i], 1, name);
        put_order(w, "process_sort_index", w->processes[i], 1, w->processes[i]);
    }
}

/* What the job's log has from this run on: its times are whole seconds. */
static void put_log(struct writer *w)
{
    const Azulejo__Wire__JobLog *log = w->trace->log->job_log;

    for (size_t i = 0; i < log->n_events; i++) {
        const Azulejo__Wire__JobEvent *e = log->events[i];
        uint64_t at_ns = log_ns(w->trace, e);
        char text[512];

        if (!at_ns)
            continue;
        next_item(w);
        buffer_puts(w->out, "{\"ph\": \"i\", \"s\": \"p\", \"name\": ");
        put_text(w->out, e->text);
        buffer_printf(w->out, ", \"cat\": \"log\", \"pid\": %d, \"tid\": %d", COORDINATOR, LOG);
        put_us(w->out, "ts", at_ns - w->base_ns);
        buffer_puts(w->out, ", \"args\": {\"who\": ");
        put_text(w->out, message_text(text, sizeof text, e->who));
        buffer_puts(w->out, "}}");
    }
}

static void put_rest(struct writer *w)
{
    const struct job_trace *t = w->trace;
    char when[FORMAT_SIZE];

    buffer_printf(w->out,
                  "\n],\n\"displayTimeUnit\": \"ms\",\n\"otherData\": {\"job\": %" PRIu64 ", \"name\": ", t->job);
    put_text(w->out, t->name);
    buffer_printf(w->out, ", \"coordinator_started\": \"%s\"", format_time(when, t->begun_at));
    if (w->base_ns != UINT64_MAX)
        buffer_printf(w->out, ", \"time_0\": \"%s\"",
                      format_time(when, (int64_t)((w->base_ns + (uint64_t)t->utc_ns) / NS_PER_SECOND)));
    buffer_printf(w->out, ", \"lost_events\": %" PRIu64 ", \"software\": \"azulejo %s\"}\n}\n", t->lost,
                  AZULEJO_VERSION);
}

void job_trace_write(const struct job_trace *trace, struct buffer *out)
{
    struct writer w = {.trace = trace, .out = out, .base_ns = UINT64_MAX};

    w.slices = must(mem_alloc_array(2 * trace->event_count + 1, sizeof *w.slices));
    w.processes = must(mem_alloc_array(trace->worker_count + 1, sizeof *w.processes));
    number_processes(&w);
    for (size_t i = 0; i < trace->event_count; i++)
        add_event(&w, trace->events[i]);
    begin_with_log(&w);
    qsort(w.slices, w.count, sizeof *w.slices, by_lane);
    separate(&w);
    buffer_puts(out, "{\"traceEvents\": [");
    put_processes(&w);
    put_threads(&w);
    for (size_t i = 0; i < w.count; i++)
        put_slice(&w, &w.slices[i]);
    put_log(&w);
    put_rest(&w);
    must_hold(out);
    mem_free(w.slices);
    mem_free(w.processes);
}
