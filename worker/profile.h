/* profile: how much of the rendering time goes to which stages and effects.
 *
 * One thread samples, about a hundred times a second, what every rendering thread is doing
 * (worker/render/base/profile_scope.h). A rendering thread pays two stores per scope; sampling
 * costs the process some microseconds per look, and almost nothing while no thread renders.
 *
 * A thread must join before its counts are read and leave before it ends. There is one profile per
 * process. If it could not be started, and for a thread that did not join, all counts are 0.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "common/scene/effects.h"
#include "common/scene/stages.h"

/* Slightly off 10 ms, so that it does not beat with periodic work of the system. */
enum { PROFILE_PERIOD_NS = 10130000 };

/* Each sample adds one to each of the two. */
struct profile_counts {
    uint64_t stages[STAGE_COUNT], accounts[EFFECT_ACCOUNTS];
};

/* Look every `period_ns` (below a second): PROFILE_PERIOD_NS, or another in tests. ERR_NO_MEMORY: no thread. */
status profile_start(long period_ns, struct error *err) MUST_CHECK;
void profile_stop(void); /* after every thread has left */

/* Allow the calling thread to be sampled. Out of memory: it is not. */
void profile_join(void);
void profile_leave(void);

/* How often the calling thread was found in each since it joined. */
void profile_counts(struct profile_counts *out);
