/* refusal: machines that said that they cannot render a job.
 *
 *   none --the scene is at fault--> damaged: the machine gets no more of the job
 *     \----it is short of something--> waits --refusals_due--> tried --fails again--> waits, longer
 *                                                  \--a result of the machine--> none
 *
 * A machine's shortage (memory, disk, descriptors, threads, a lost blob) never fails a job: the machine
 * is asked again, for ever. A wait is at most SHORTAGE_LAST_MS, as an attempt may build a large scene.
 * This is not stored: a restart of the coordinator forgets it.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/job/trouble.h"

enum { SHORTAGE_LAST_MS = 60 * 1000 };

struct refusal {
    uint64_t machine; /* machine_identity */
    int damaged;      /* the scene is at fault */
    int waits;        /* it is too early to ask again */
    struct trouble shortage;
};

/* All zero: none. */
struct refusals {
    struct refusal *items;
    size_t count, capacity;
    size_t damaged; /* of them, those that blame the scene */
};

void refusals_release(struct refusals *r);
/* What the machine said last; NULL: nothing. */
const struct refusal *refusals_find(const struct refusals *r, uint64_t machine);
/* Does the machine get nothing of the job, for now or for ever? */
int refusals_bar(const struct refusals *r, uint64_t machine);
/* The machine says so. ERR_NO_MEMORY: it is not noted. */
status refusals_note(struct refusals *r, uint64_t machine, status why, const char *text, uint64_t now_ns) MUST_CHECK;
/* The machine delivered a result of the job: its shortage is over. */
void refusals_settle(struct refusals *r, uint64_t machine);
/* The machines that waited long enough may be asked again. 1: there are some. *next_ns becomes the next such moment
 * where it is earlier. */
int refusals_due(struct refusals *r, uint64_t now_ns, uint64_t *next_ns);
/* What all waited for may be there now: they may be asked again at once. 1: there are some. */
int refusals_hurry(struct refusals *r);
void refusals_clear(struct refusals *r);
