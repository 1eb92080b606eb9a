/* event_program: what happens to jobs, given to the program of --on-event.
 *
 *   event --> waits, also in the store --its turn--> a run (event_run.h) --0--> taken
 *               |                         ^             |--EVENT_LATER, a signal--> again, after EVENT_WAIT_MIN_S, doubling
 *               |                         |             |                           up to _MAX_S; after EVENT_AGE_S dropped
 *               |                         +-------------+--another status--> failed
 *               \--EVENTS_WAITING_MAX wait: the oldest is dropped
 *
 * One event after another, in their order. The JSON is {"event": "job-done", "delivery": HEX, "at": seconds since 1970, ...};
 * an event that comes again has the same `delivery`. A thread of its own starts the program and waits for it, so that no
 * program holds up the loop.
 *
 * The store has what waits, so a restart goes on with it. What was not yet written when a coordinator was killed, some
 * milliseconds' worth, is lost; while the store cannot be written, events wait in memory alone.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    EVENTS_WAITING_MAX = 1000,
    EVENT_JSON_MAX = 8192,
    EVENT_WAIT_MIN_S = 2,
    EVENT_WAIT_MAX_S = 900,
    EVENT_AGE_S = 86400,
};

struct event_program;
struct store;

/* What became of events, since the start; `again`: runs that another one follows. */
struct event_counts {
    uint64_t taken, failed, dropped, again;
    uint32_t waiting; /* also the one that is being run */
};

/* Reads what waits in the store, and starts the thread. The path stays the caller's. ERR_INPUT: it is no program; ERR_IO,
 * ERR_NO_MEMORY. */
status event_program_open(struct event_program **out, struct store *store, const char *path, struct error *err) MUST_CHECK;
/* Breaks off the run that there may be, and begins no other: that event, and those that still come, wait in the store. */
void event_program_end(struct event_program *program);
/* Also waits for the thread's end, about a second. NULL is fine. */
void event_program_close(struct event_program *program);

/* An event for it. `fields` are further members of the JSON object, as in "\"job\": 12". Nothing waits. */
void event_program_send(struct event_program *program, const char *event, const char *fields);

struct event_counts event_program_counts(struct event_program *program);
/* How the last run ended that did not take its event; "": all did. */
void event_program_trouble(struct event_program *program, char *out, size_t size);
