/* The record of what the farm did for a job, and when, as it is sent to clients. */
#include <stdlib.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_messages.h"
#include "protocol/message.h"

enum { ANSWER_EVENTS = 8192 }; /* in one answer: at most half a mebibyte */

struct trace_answer {
    struct trace_event *events;
    Azulejo__Wire__TraceEvent *lines, **line_pointers;
    uint32_t *numbers; /* of workers, ascending */
    struct deliverer *deliverers;
    Azulejo__Wire__TraceWorker *workers, **worker_pointers;
    size_t count, worker_count;
};

static void answer_release(struct trace_answer *a)
{
    mem_free(a->events);
    mem_free(a->lines);
    mem_free(a->line_pointers);
    mem_free(a->numbers);
    mem_free(a->deliverers);
    mem_free(a->workers);
    mem_free(a->worker_pointers);
}

static int compare_numbers(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;

    return (x > y) - (x < y);
}

/* Which workers the events name, each once. */
static void collect_workers(struct trace_answer *a)
{
    size_t all = 0;

    for (size_t i = 0; i < a->count; i++)
        if (a->events[i].deliverer)
            a->numbers[all++] = a->events[i].deliverer;
    qsort(a->numbers, all, sizeof *a->numbers, compare_numbers);
    for (size_t i = 0; i < all; i++)
        if (i == 0 || a->numbers[i] != a->numbers[i - 1])
            a->numbers[a->worker_count++] = a->numbers[i];
}

static void find_worker(const struct farm *farm, uint32_t number, struct deliverer *out)
{
    for (uint32_t i = 0; i < farm->worker_count; i++)
        if (farm->workers[i]->deliverer.number == number) {
            *out = farm->workers[i]->deliverer;
            snprintf(out->label, sizeof out->label, "%s", farm->workers[i]->label);
            return;
        }
    if (!farm->store || store_deliverer_find(farm->store, number, out, NULL) != STATUS_OK)
        memset(out, 0, sizeof *out);
}

static void fill_worker(Azulejo__Wire__TraceWorker *out, struct deliverer *d, uint32_t number)
{
    azulejo__wire__trace_worker__init(out);
    out->number = number;
    out->host = d->host;
    out->process = d->process;
    out->software = d->software;
    out->name = d->label;
}

static void fill_event(Azulejo__Wire__TraceEvent *out, const struct trace_event *e)
{
    azulejo__wire__trace_event__init(out);
    out->kind = (Azulejo__Wire__TraceKind)e->kind;
    out->frame = e->frame;
    out->tile = e->tile;
    out->group = e->group;
    out->pass = e->pass;
    out->worker = e->deliverer;
    out->thread = e->thread;
    out->begin_ns = e->begin_ns;
    out->ns = e->end_ns - e->begin_ns;
    out->cpu_ns = e->cpu_ns;
    out->then = e->then_end_ns != 0;
    out->then_begin_ns = e->then_begin_ns;
    out->then_ns = e->then_end_ns - e->then_begin_ns;
    out->repeated = e->repeated;
    out->estimated = e->estimated;
}

static status answer_make(struct trace_answer *a, const struct farm *farm, struct error *err)
{
    a->lines = mem_alloc_array(a->count, sizeof *a->lines);
    a->line_pointers = mem_alloc_array(a->count, sizeof(Azulejo__Wire__TraceEvent *));
    a->numbers = mem_alloc_array(a->count, sizeof *a->numbers);
    NEED(a->lines && a->line_pointers && a->numbers, err, "a job's trace");
    collect_workers(a);
    a->deliverers = mem_alloc_array(a->worker_count, sizeof *a->deliverers);
    a->workers = mem_alloc_array(a->worker_count, sizeof *a->workers);
    a->worker_pointers = mem_alloc_array(a->worker_count, sizeof(Azulejo__Wire__TraceWorker *));
    NEED(a->deliverers && a->workers && a->worker_pointers, err, "a job's trace");
    for (size_t i = 0; i < a->count; i++) {
        fill_event(&a->lines[i], &a->events[i]);
        a->line_pointers[i] = &a->lines[i];
    }
    for (size_t i = 0; i < a->worker_count; i++) {
        find_worker(farm, a->numbers[i], &a->deliverers[i]);
        fill_worker(&a->workers[i], &a->deliverers[i], a->numbers[i]);
        a->worker_pointers[i] = &a->workers[i];
    }
    return STATUS_OK;
}

status session_trace(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns,
                     struct error *err)
{
    const Azulejo__Wire__JobTraceGet *wanted = message->job_trace_get;
    struct farm *farm = &session->server->farm;
    struct job *job = session_job(session, wanted->job, err);
    Azulejo__Wire__JobTrace trace = AZULEJO__WIRE__JOB_TRACE__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(JOB_TRACE, job_trace, &trace);
    struct trace_answer a = {0};
    uint64_t first;
    status s = STATUS_OK;

    if (!job)
        return STATUS_ERR_NOT_FOUND;
    a.events = mem_alloc_array(ANSWER_EVENTS, sizeof *a.events);
    NEED(a.events, err, "a job's trace");
    a.count = trace_read(&farm->trace, job->id, wanted->after, a.events, ANSWER_EVENTS, &first, &trace.lost);
    if (a.count > 0) {
        s = answer_make(&a, farm, err);
        trace.last = first + a.count - 1;
    }
    if (s == STATUS_OK) {
        trace.job = job->id;
        trace.name = job->name;
        trace.begun_at = farm->begun_s;
        trace.cut = job->id <= farm->last_old_job;
        trace.utc_ns = clock_wall_ns() - (int64_t)now_ns;
        trace.n_events = a.count;
        trace.events = a.line_pointers;
        trace.n_workers = a.worker_count;
        trace.workers = a.worker_pointers;
        session_reply(session, message->request, &envelope);
    }
    answer_release(&a);
    return s;
}
