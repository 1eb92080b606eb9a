/* profile: in which stages of rendering the time goes, and for which effects.
 *
 * One thread looks about a thousand times a second at what every rendering thread does
 * (worker/render/base/profile_scope.h), and counts. The rendering threads pay two stores a scope; looking
 * costs the process some microseconds a millisecond, and almost nothing while no thread renders.
 *
 * A thread must join before its counts are read and leave before it ends. One profile in a
 * process. Without one (it could not be started), or in a thread that did not join, all counts
 * are 0.
 */
#ifndef AZULEJO_WORKER_PROFILE_H
#define AZULEJO_WORKER_PROFILE_H

#include <stdint.h>

#include "common/base/status.h"
#include "common/scene/effects.h"
#include "common/scene/stages.h"

/* Each look counts once in either. */
struct profile_counts {
    uint64_t stages[STAGE_COUNT], accounts[EFFECT_ACCOUNTS];
};

status profile_start(struct error *err) MUST_CHECK;
void profile_stop(void); /* after every thread has left */

/* The calling thread may be looked at. Out of memory it is not. */
void profile_join(void);
void profile_leave(void);

/* How often the calling thread was found in each since it joined. */
void profile_counts(struct profile_counts *out);

#endif
