/* stage: where a rendering thread is, for whoever looks from outside (worker/profile.h).
 *
 * STAGE(TRACE) is one store of a byte of the thread's own, so it may stand at every border. It
 * changes no result.
 */
#ifndef AZULEJO_RENDER_STAGE_H
#define AZULEJO_RENDER_STAGE_H

#include <stdint.h>

#include "common/scene/stages.h"
#include "worker/render/watched.h"

/* The stage's number + 1; 0: the thread renders nothing, as at its start. */
extern _Thread_local watched_byte stage_now __attribute__((tls_model("local-exec")));

#define STAGE(name) WATCHED_SET(stage_now, (uint8_t)(STAGE_##name + 1))
#define STAGE_NONE() WATCHED_SET(stage_now, (uint8_t)0)

#endif
