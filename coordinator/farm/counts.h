/* counts: what this run of the coordinator did, for those who watch it from outside (/metrics). They only grow; a job
 * that is removed takes nothing away. */
#pragma once

#include <stdint.h>

#include "common/base/histogram.h"
#include "common/film/health.h"
#include "coordinator/farm/rate.h"
#include "coordinator/job/queue.h"

struct farm_counts {
    uint64_t results, repeats; /* merged; of units that the film had already */
    uint64_t samples, rays;    /* of those merged */
    uint64_t cpu_ns;           /* that workers spent on them */
    uint64_t health[HEALTH_KINDS];
    struct rate result_rate, sample_rate;
    uint64_t frames;                /* done */
    uint64_t jobs[JOB_STATE_COUNT]; /* came to this state */
    uint64_t leases_lapsed;
    uint64_t workers_died;  /* their connection was lost */
    struct histogram syncs; /* of films */
    uint64_t sync_failures;
};
