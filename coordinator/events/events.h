/* events: which events the program of --on-event gets: jobs that ended or need a person, a store that cannot be used. */
#pragma once

#include <stdint.h>

#include "coordinator/job/queue.h"
#include "coordinator/job/trouble.h"

struct event_program;

enum { EVENT_STORE_S = 5 };      /* a store that cannot be used is an event after so long */

/* The job has another state: job-done, job-failed, job-parked. `page`: the page's address; "": none. */
void events_job_state(struct event_program *program, const struct job *job, const char *page);
/* The store's trouble, at each tick: store-unusable, store-usable. *reported: whether the last event was the
 * former; 0 at first. */
void events_store(struct event_program *program, const struct trouble *trouble, int *reported, uint64_t now_ns);
