/* scrubber: while nothing is rendered, one task after another looks through the store for damage (store_scrub.h), slowly.
 *
 *   resting --nothing to do for SCRUB_IDLE_MS--> looking --work comes--> resting; --all was looked at--> SCRUB_AGAIN_S of rest
 *
 * Work waits for at most one step, SCRUB_STEP_MS of reading at the rate of --scrub-rate. */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/store/store_scrub.h"

struct server;

enum {
    SCRUB_IDLE_MS = 5000,
    SCRUB_STEP_MS = 250,
    SCRUB_AGAIN_S = 6 * 3600,
};
#define SCRUB_RATE_DEFAULT ((uint64_t)16 << 20) /* bytes a second */

struct scrubber {
    uint64_t rate; /* 0: never */
    struct scrub *scrub;
    int is_looking;            /* a task runs */
    int is_said;               /* that a round began */
    uint64_t idle_ns, next_ns; /* nothing to do since then, 0: it has; no step before then */
    uint64_t files, faults;    /* since the coordinator began */
    uint64_t round_files;
    int64_t done_s;        /* the last round's end, in seconds since 1970; 0: none */
    char last[SCRUB_LINE]; /* the last fault */
};

void scrubber_tick(struct server *server, uint64_t now_ns);
void scrubber_release(struct scrubber *scrubber);
