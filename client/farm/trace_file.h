/* trace_file: a job's trace in Chrome's trace format, which Perfetto and chrome://tracing show. */
#pragma once

#include <stdint.h>

#include "client/link/connection.h"
#include "common/base/buffer.h"

/* The coordinator's answers about a job. Zero-initialised. */
struct job_trace {
    Azulejo__Wire__Envelope **answers; /* JobTraces; own what `events` and `workers` point at */
    size_t answer_count, answer_capacity;
    const Azulejo__Wire__TraceEvent **events;
    size_t event_count, event_capacity;
    const Azulejo__Wire__TraceWorker **workers;
    size_t worker_count, worker_capacity;
    Azulejo__Wire__Envelope *log; /* a JobLog */
    uint64_t job, lost;
    int64_t begun_at, utc_ns;
    const char *name;
    size_t units;
    int cut; /* the job is older than the coordinator's run, of which this is */
};

/* Ask for everything. Errors: connection_ask's. */
status job_trace_get(struct connection *c, uint64_t job, struct job_trace *out, struct error *err) MUST_CHECK;
void job_trace_release(struct job_trace *trace);

/* Append the file's text. */
void job_trace_write(const struct job_trace *trace, struct buffer *out);
