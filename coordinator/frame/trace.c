#include "coordinator/frame/trace.h"

#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"

/* A result may wait this long on a worker that cannot reach us. */
#define AGE_MAX_NS (7 * 86400 * NS_PER_SECOND)

enum { THREADS_MAX = 4096 };

struct trace_chunk {
    struct trace_chunk *newer, *older; /* of all */
    struct trace_chunk *next;          /* of the job, a newer one */
    struct trace_job *owner;
    uint32_t count;
    struct trace_event events[TRACE_CHUNK_EVENTS];
};

struct trace_job {
    uint64_t id, lost; /* events that were dropped */
    struct trace_chunk *first, *last;
    size_t chunk_count;
};

_Static_assert(sizeof(struct trace_chunk) * TRACE_CHUNKS < 34000000, "as in the header");

/* ---- a worker's clock ----------------------------------------------------------------------- */

static int is_possible(const struct trace_unit_times *t)
{
    return t->wall_ns > 0 && t->thread > 0 && t->thread <= THREADS_MAX && t->sent_ns < INT64_MAX &&
           t->began_ns <= t->sent_ns && t->wall_ns <= t->sent_ns - t->began_ns &&
           t->sent_ns - t->began_ns <= AGE_MAX_NS;
}

/* The worker's clock; NULL: not known. Numbers of deliverers ascend. */
static struct trace_clock *clock_find(const struct trace *trace, uint32_t deliverer)
{
    size_t low = 0, high = trace->clock_count;

    while (low < high) {
        size_t middle = (low + high) / 2;
        if (trace->clocks[middle].deliverer < deliverer)
            low = middle + 1;
        else
            high = middle;
    }
    return low < trace->clock_count && trace->clocks[low].deliverer == deliverer ? &trace->clocks[low] : NULL;
}

/* 0: it cannot be noted. */
static int clock_learn(struct trace *trace, uint32_t deliverer, int64_t offset_ns)
{
    struct trace_clock *clock = clock_find(trace, deliverer);

    if (clock) {
        if (offset_ns < clock->offset_ns)
            clock->offset_ns = offset_ns;
        return 1;
    }
    if (trace->clock_count > 0 && trace->clocks[trace->clock_count - 1].deliverer > deliverer)
        return 0; /* it was dropped */
    if (trace->clock_count == TRACE_CLOCKS_MAX) {
        trace->clock_count -= TRACE_CLOCKS_MAX / 4;
        memmove(trace->clocks, trace->clocks + TRACE_CLOCKS_MAX / 4, trace->clock_count * sizeof *trace->clocks);
    }
    if (!MEM_GROW(trace->clocks, trace->clock_capacity, trace->clock_count + 1))
        return 0;
    trace->clocks[trace->clock_count++] = (struct trace_clock){deliverer, offset_ns};
    return 1;
}

/* When the unit was received it had just been rendered, as far as is known. */
static void estimate(struct trace_event *e)
{
    e->estimated = 1;
    e->thread = 0;
    e->end_ns = e->then_begin_ns;
    e->begin_ns = e->cpu_ns < e->end_ns ? e->end_ns - e->cpu_ns : 0;
}

void trace_add_unit(struct trace *trace, uint64_t job, const struct trace_event *event,
                    const struct trace_unit_times *times)
{
    struct trace_event e = *event;

    if (is_possible(times) && clock_learn(trace, e.deliverer, (int64_t)e.then_begin_ns - (int64_t)times->sent_ns)) {
        e.thread = (uint16_t)times->thread;
        e.begin_ns = times->began_ns;
        e.end_ns = times->began_ns + times->wall_ns;
    } else {
        estimate(&e);
    }
    trace_add(trace, job, &e);
}

/* From the worker's clock to ours. */
static void place_unit(const struct trace *trace, struct trace_event *e)
{
    const struct trace_clock *clock = clock_find(trace, e->deliverer);
    int64_t begin_ns = clock ? (int64_t)e->begin_ns + clock->offset_ns : -1;
    uint64_t wall_ns = e->end_ns - e->begin_ns;

    if (begin_ns < 0 || (uint64_t)begin_ns + wall_ns > e->then_begin_ns ||
        (uint64_t)begin_ns + AGE_MAX_NS < e->then_begin_ns) {
        estimate(e);
        return;
    }
    e->begin_ns = (uint64_t)begin_ns;
    e->end_ns = e->begin_ns + wall_ns;
}

/* ---- jobs and chunks ------------------------------------------------------------------------ */

/* The place of the job in the list, or where it would be. */
static size_t place_of(const struct trace *trace, uint64_t job)
{
    size_t low = 0, high = trace->job_count;

    while (low < high) {
        size_t middle = (low + high) / 2;
        if (trace->jobs[middle]->id < job)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static struct trace_job *job_find(const struct trace *trace, uint64_t job)
{
    size_t at = place_of(trace, job);

    return at < trace->job_count && trace->jobs[at]->id == job ? trace->jobs[at] : NULL;
}

static struct trace_job *job_new_entry(struct trace *trace, uint64_t id)
{
    size_t at = place_of(trace, id);
    struct trace_job *job = NULL;

    if (MEM_GROW(trace->jobs, trace->job_capacity, trace->job_count + 1))
        job = mem_calloc(1, sizeof *job);
    if (!job)
        return NULL;
    memmove(trace->jobs + at + 1, trace->jobs + at, (trace->job_count - at) * sizeof(struct trace_job *));
    trace->jobs[at] = job;
    trace->job_count++;
    job->id = id;
    return job;
}

static void job_drop(struct trace *trace, struct trace_job *job)
{
    size_t at = place_of(trace, job->id);

    trace->job_count--;
    memmove(trace->jobs + at, trace->jobs + at + 1, (trace->job_count - at) * sizeof(struct trace_job *));
    mem_free(job);
}

static void chunk_link(struct trace *trace, struct trace_job *job, struct trace_chunk *chunk)
{
    chunk->count = 0;
    chunk->owner = job;
    chunk->next = chunk->newer = NULL;
    chunk->older = trace->newest;
    if (trace->newest)
        trace->newest->newer = chunk;
    else
        trace->oldest = chunk;
    trace->newest = chunk;
    trace->chunk_count++;
    if (job->last)
        job->last->next = chunk;
    else
        job->first = chunk;
    job->last = chunk;
    job->chunk_count++;
}

/* Take the job's oldest chunk out of both lists. */
static struct trace_chunk *chunk_unlink(struct trace *trace, struct trace_job *job)
{
    struct trace_chunk *chunk = job->first;

    if (chunk->older)
        chunk->older->newer = chunk->newer;
    else
        trace->oldest = chunk->newer;
    if (chunk->newer)
        chunk->newer->older = chunk->older;
    else
        trace->newest = chunk->older;
    trace->chunk_count--;
    job->first = chunk->next;
    if (!job->first)
        job->last = NULL;
    job->chunk_count--;
    job->lost += chunk->count;
    return chunk;
}

/* A chunk in no list for another event of the job: a new one, or the oldest of the job or the farm. */
static struct trace_chunk *chunk_take(struct trace *trace, struct trace_job *job)
{
    struct trace_chunk *chunk;
    struct trace_job *owner;

    if (job->chunk_count == TRACE_JOB_CHUNKS)
        return chunk_unlink(trace, job);
    if (trace->chunk_count < TRACE_CHUNKS)
        return mem_alloc(sizeof *chunk);
    owner = trace->oldest->owner; /* a job's first chunk is its oldest */
    chunk = chunk_unlink(trace, owner);
    if (owner != job && !owner->first)
        job_drop(trace, owner);
    return chunk;
}

void trace_add(struct trace *trace, uint64_t id, const struct trace_event *event)
{
    struct trace_job *job = job_find(trace, id);
    struct trace_chunk *chunk;

    if (!job)
        job = job_new_entry(trace, id);
    if (!job)
        return;
    chunk = job->last;
    if (!chunk || chunk->count == TRACE_CHUNK_EVENTS) {
        chunk = chunk_take(trace, job);
        if (chunk)
            chunk_link(trace, job, chunk);
        else if (!job->first)
            job_drop(trace, job);
    }
    if (chunk)
        chunk->events[chunk->count++] = *event;
}

size_t trace_read(const struct trace *trace, uint64_t id, uint64_t after, struct trace_event *out, size_t room,
                  uint64_t *first, uint64_t *lost)
{
    const struct trace_job *job = job_find(trace, id);
    uint64_t number;
    size_t count = 0;

    *first = *lost = 0;
    if (!job)
        return 0;
    *lost = job->lost;
    number = job->lost; /* of the event before the chunk */
    for (const struct trace_chunk *c = job->first; c && count < room; number += c->count, c = c->next) {
        uint64_t skip = after > number ? after - number : 0;
        size_t more;

        if (skip >= c->count)
            continue;
        more = c->count - (size_t)skip;
        if (more > room - count)
            more = room - count;
        if (count == 0)
            *first = number + skip + 1;
        memcpy(out + count, c->events + skip, more * sizeof *out);
        for (size_t i = count; i < count + more; i++)
            if (out[i].kind == TRACE_UNIT && !out[i].estimated)
                place_unit(trace, &out[i]);
        count += more;
    }
    return count;
}

void trace_forget(struct trace *trace, uint64_t id)
{
    struct trace_job *job = job_find(trace, id);

    if (!job)
        return;
    while (job->first)
        mem_free(chunk_unlink(trace, job));
    job_drop(trace, job);
}

void trace_release(struct trace *trace)
{
    while (trace->job_count)
        trace_forget(trace, trace->jobs[trace->job_count - 1]->id);
    mem_free(trace->jobs);
    mem_free(trace->clocks);
    *trace = (struct trace){0};
}
