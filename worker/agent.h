/* agent: the worker's conversation with its coordinator.
 *
 *   WAITING --timer--> CONNECTING --on_open, Hello--> GREETING --Welcome--> WORKING
 *      ^                   |                              |                    |
 *      \---- lost: back-off BACKOFF_FIRST_MS, doubling to BACKOFF_LAST_MS -----/
 *   WORKING --agent_drain--> DRAINING --results acknowledged, DRAIN_ACKS_MS or DRAIN_MS--> ENDED
 *   GREETING --the coordinator refuses this release--> ENDED
 *   any --agent_drain without a connection--> ENDED
 * agent_set_state is the only function that changes it. A worker that is paused (duty.h) stays connected: it
 * finishes the units being rendered, returns the others and asks for none.
 *
 * A lost connection costs only the units that had not been started: results that are not acknowledged are kept and sent
 * again.
 *
 * TLS has proved the farm's key when GREETING begins. Before that, anything that listens at the address may answer, so
 * no error in CONNECTING ends a worker: it tries again forever, and first reads its key file again. Only a coordinator
 * that proved the key can end it, with a refusal that another attempt would not change: another release, protocol or
 * arithmetic (ERR_MISMATCH). With exit_on_disconnect a refused key ends it as well.
 */
#pragma once

#include <stdint.h>
#include <uv.h>

#include "common/base/status.h"
#include "worker/duty.h"
#include "worker/key_file.h"

enum {
    BACKOFF_FIRST_MS = 250,
    BACKOFF_LAST_MS = 60000,
    DRAIN_MS = 60000,            /* for units in progress and their acknowledgements, */
    DRAIN_ACKS_MS = 3000,        /* while these go on: the coordinator merges what it has without the worker */
    FIRST_CONNECTION_MS = 30000, /* with exit_on_disconnect: to reach the coordinator at all */
    GREETING_MS = 10000,         /* from Hello to Welcome */
    SETTLED_MS = 10000,          /* a connection that lasts this long counts as good */
    STATUS_MS = 5000,            /* how often it measures itself, and tells the coordinator */
    LONG_UNIT_MS = 1000,         /* it names units that take longer */
    ASK_AGAIN_MS = 5000,         /* repeat a LeaseRequest after this long without a grant */
};

struct agent_options {
    const char *host;
    uint16_t port;
    struct key_file *key_file; /* loaded; the agent refreshes it */
    unsigned threads;
    uint32_t isa_mask; /* what is offered, bit per enum isa */
    const char *cache_folder;
    uint64_t cache_limit_bytes;
    int exit_on_disconnect;
    const char *name; /* on the farm; NULL: the coordinator makes one of the host's */
    struct duty_options duty;
    int drain_status; /* its exit status if it must end while a unit hangs */
    const char *tags; /* as made by tags_parse */
    uint64_t memory;  /* bytes to announce; 0: none */
};

struct agent;

/* Open the cache, start the threads, begin to connect. The options' strings and key file must outlive the agent. */
status agent_new(struct agent **out, uv_loop_t *loop, const struct agent_options *options,
                 struct error *err) MUST_CHECK;

/* Pause it, or end such a pause; other reasons for a pause stay. */
void agent_set_paused(struct agent *agent, int paused);

/* Finish the units being rendered, return the rest, wait for acknowledgements while some come, end. */
void agent_drain(struct agent *agent, const char *reason);

/* After uv_run has returned: why it ended; STATUS_OK after a drain or the coordinator's Goodbye. */
status agent_result(const struct agent *agent, struct error *err) MUST_CHECK;
/* After uv_run returned. */
void agent_free(struct agent *agent);
