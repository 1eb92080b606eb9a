/* stage: where a rendering thread is, for whoever looks from outside (worker/profile.h).
 *
 * STAGE(TRACE) is one store of a byte of the thread's own, so it may stand at every border. It
 * changes no result.
 */
#ifndef AZULEJO_RENDER_STAGE_H
#define AZULEJO_RENDER_STAGE_H

#include <stdatomic.h>
#include <stdint.h>

#include "common/scene/stages.h"

/* The stage's number + 1; 0: the thread renders nothing, as at its start. */
extern _Thread_local _Atomic uint8_t stage_now __attribute__((tls_model("local-exec")));

#define STAGE(name) \
    atomic_store_explicit(&stage_now, (uint8_t)(STAGE_##name + 1), memory_order_relaxed)
#define STAGE_NONE() atomic_store_explicit(&stage_now, (uint8_t)0, memory_order_relaxed)

#endif
