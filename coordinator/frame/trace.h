/* trace: when the farm did what for which job, for `azulejo trace`: in memory, of this run, the newest.
 *
 * An event is a step, which may be followed by another: a unit is rendered by a worker, then merged; tiles
 * are written, then synced. Times are the coordinator's monotonic clock. A worker's are noted on its own
 * clock, and brought to it when they are read, by the smallest difference between the two clocks that any
 * result of the worker showed: the delay of the network, which is part of it, is then the smallest as well.
 *
 * Events are kept in chunks. Of a job the newest TRACE_JOB_CHUNKS stay, of the farm the newest TRACE_CHUNKS.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum {
    TRACE_CHUNK_EVENTS = 256,
    TRACE_JOB_CHUNKS = 1024,     /* 262,144 events */
    TRACE_CHUNKS = 2048,         /* 524,288 events, 34 MB */
    TRACE_CLOCKS_MAX = 16384,    /* of workers, the newest */
};

/* The numbers are the wire's. */
enum trace_kind {
    TRACE_UNIT,
    TRACE_COMMIT,                /* `tile` is the number of tiles */
    TRACE_DEVELOP,               /* a frame's pictures, */
    TRACE_REDEVELOP,             /* made again, with other settings */
    TRACE_FIGURES,               /* a frame's error */
    TRACE_FREEZE,                /* how a display shows a frame */
    TRACE_KINDS
};

struct trace_event {
    uint8_t kind; /* enum trace_kind */
    uint8_t group;
    uint8_t repeated;      /* a unit that was merged before */
    uint8_t estimated;     /* the worker did not say when it began */
    uint16_t pass, thread; /* thread: from 1; 0: not known */
    uint32_t frame, tile;
    uint32_t deliverer;                  /* the worker of a unit */
    uint64_t begin_ns, end_ns;           /* of a unit that is not `estimated`: the worker's clock until it is read */
    uint64_t then_begin_ns, then_end_ns; /* what follows it; both 0: nothing */
    uint64_t cpu_ns;                     /* of a unit */
};

/* What a worker says of a unit, on its own clock; all 0: nothing. */
struct trace_unit_times {
    uint64_t began_ns, wall_ns, sent_ns;
    uint32_t thread; /* from 1 */
};
struct trace_clock {
    uint32_t deliverer;
    int64_t offset_ns; /* coordinator's clock less the worker's */
};
struct trace_job;
struct trace_chunk;
/* Zero-initialised. */
struct trace {
    struct trace_job **jobs; /* ascending numbers */
    size_t job_count, job_capacity;
    struct trace_chunk *oldest, *newest;
    size_t chunk_count;
    struct trace_clock *clocks; /* ascending deliverers */
    size_t clock_count, clock_capacity;
};

void trace_release(struct trace *trace);
/* Without memory the event is lost. */
void trace_add(struct trace *trace, uint64_t job, const struct trace_event *event);
/* Add a unit that was received at then_begin_ns; its other times are filled in. What cannot be true counts as
 * not known: the unit then ended when it was received, and took its cpu_ns. */
void trace_add_unit(struct trace *trace, uint64_t job, const struct trace_event *event,
                    const struct trace_unit_times *times);
/* Copy the job's events with numbers above `after` (they count from 1), at most `room`. *first is the
 * number of out[0]; *lost that of the newest event that is no longer kept, 0: all are. */
size_t trace_read(const struct trace *trace, uint64_t job, uint64_t after, struct trace_event *out, size_t room,
                  uint64_t *first, uint64_t *lost);
void trace_forget(struct trace *trace, uint64_t job);
