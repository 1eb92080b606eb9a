/* agent: the worker's conversation with its coordinator.
 *
 *   WAITING --timer--> CONNECTING --on_open, Hello--> GREETING --Welcome--> WORKING
 *      ^                   |                              |                    |
 *      \---- lost: back-off BACKOFF_FIRST_MS, doubling to BACKOFF_LAST_MS -----/
 *   WORKING --agent_drain--> DRAINING --results acknowledged, or DRAIN_MS--> ENDED
 *   GREETING --the coordinator refuses this release--> ENDED
 *   any --agent_drain without a connection--> ENDED
 * agent_set_state is the only function that changes it.
 *
 * A lost connection costs nothing but what had not been begun: results that are not
 * acknowledged are kept and sent again.
 *
 * TLS has proved the farm's key when GREETING begins. What comes before that may come from
 * anything that listens at the address, so no error of CONNECTING ends a worker: it tries again
 * for ever, and reads its key file again before it does. Only a coordinator that proved the key
 * can end it, by a refusal that trying again does not change: another release, protocol or
 * arithmetic (ERR_MISMATCH). With exit_on_disconnect a refused key ends it as well.
 */
#ifndef AZULEJO_WORKER_AGENT_H
#define AZULEJO_WORKER_AGENT_H

#include <stdint.h>
#include <uv.h>

#include "common/base/status.h"
#include "worker/key_file.h"

enum {
    BACKOFF_FIRST_MS = 250,
    BACKOFF_LAST_MS = 60000,
    DRAIN_MS = 60000,            /* for units in work and their acknowledgements */
    FIRST_CONNECTION_MS = 30000, /* with exit_on_disconnect: to reach the coordinator at all */
    GREETING_MS = 10000,         /* from Hello to Welcome */
    SETTLED_MS = 10000,          /* a connection that lasts so long is a good one */
    ASK_AGAIN_MS = 5000,         /* a LeaseRequest that brought nothing is said again */
};

struct agent_options {
    const char *host;
    uint16_t port;
    struct key_file *key_file;   /* loaded; the agent refreshes it */
    unsigned threads;
    uint32_t isa_mask;           /* what is offered, bit per enum isa */
    const char *cache_folder;
    uint64_t cache_limit_bytes;
    int exit_on_disconnect;
};

struct agent;

/* Open the cache, start the threads, begin to connect. The options' strings and key
 * file must outlive the agent. */
status agent_new(struct agent **out, uv_loop_t *loop, const struct agent_options *options,
                 struct error *err) MUST_CHECK;

/* Finish what is being rendered, give the rest back, await the acknowledgements, end. */
void agent_drain(struct agent *agent, const char *reason);

/* After uv_run returned: why it ended; STATUS_OK after a drain or the coordinator's goodbye. */
status agent_result(const struct agent *agent, struct error *err) MUST_CHECK;
/* After uv_run returned. */
void agent_free(struct agent *agent);

#endif
