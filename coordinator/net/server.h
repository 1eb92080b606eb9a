/* server: the event loop around the farm: listener, sessions, timers, disk work.
 *
 * Ownership: the server owns the loop's handles, the farm and the sessions. Disk work runs in
 * libuv's thread pool, on copies; it ends on the loop's thread.
 *
 *   LISTENING --SIGTERM, SIGINT--> DRAINING --disk idle--> CLOSING --all handles closed--> ended
 */
#ifndef AZULEJO_COORDINATOR_SERVER_H
#define AZULEJO_COORDINATOR_SERVER_H

#include <uv.h>

#include "common/base/status.h"
#include "coordinator/net/descriptors.h"
#include "coordinator/net/door.h"
#include "coordinator/farm/farm.h"
#include "coordinator/net/guest.h"
#include "coordinator/net/collector.h"
#include "coordinator/store/audit.h"
#include "coordinator/net/render_requests.h"
#include "coordinator/net/session.h"
#include "protocol/key.h"

enum {
    SESSION_BUCKETS = 1 << 14,
    SERVER_TICK_MS = 100,
    SERVER_TURN_BYTES = 4 << 20,      /* read before commits, acknowledgements and grants have their turn: */
    SERVER_TURN_EACH_MIN = 4 << 10,   /* by all sessions about that, by each at least and at most this */
    SERVER_TURN_EACH_MAX = 1 << 20,
    SERVER_PAUSE_MS = 2000,    /* a tick this late: the machine or the disk suspended us */
    SERVER_BACKLOG = 4096,
    PREVIEWS_MAX = 4,          /* being developed at once */
    SERVER_DRAIN_MS = 20000,   /* a shutdown waits this long for the disk */
};

struct server_options {
    const char *host;
    uint16_t port;             /* 0: any */
    const struct farm_key *key;
    struct store *store;
    uint64_t lease_ns;
    uint64_t hang_ns;          /* farm->hang_ns */
    const char *ready_file;    /* NULL, or gets the port, atomically */
    struct descriptors descriptors;
    int discards_films;        /* its jobs will not be extended */
    const char *precision;     /* of its workers: "float" or "double"; NULL: float */
    struct retention_policy policy;
    struct order_rules order;
    struct server_guest guest; /* start is NULL: none */
};

enum server_state { SERVER_LISTENING, SERVER_DRAINING, SERVER_CLOSING };

struct server {
    uv_loop_t loop;
    uv_tcp_t listener;
    uv_timer_t tick, commit_timer;
    uv_prepare_t prepare;
    uv_async_t saved;          /* the store wrote what somebody waits for */
    uv_signal_t terminate, interrupt;
    uint16_t port;             /* on which it listens */
    struct server_guest guest; /* zero: none */
    int guest_runs;            /* it was started and is to be stopped */
    enum server_state state;
    uint64_t drain_since_ns;
    uint64_t ticked_ns;        /* the last tick */
    uint64_t awake_ns;         /* the loop came back from a long pause: silence counts from here */
    const struct farm_key *key;
    struct store *store;
    struct farm farm;
    struct door door;
    struct session *sessions, *by_id[SESSION_BUCKETS];
    struct descriptors descriptors;
    uint32_t session_count, last_session;
    struct render_requests requests;
    uint64_t fingerprint;      /* our own arithmetic, in the precision of our workers */
    const char *precision;
    struct audit audit;
    int commit_running;
    uint32_t tasks;            /* in the thread pool (task.h) */
    uint32_t held;             /* answers that wait for the disk (held.h) */
    uint32_t previews;
    struct collector collector;
    uint32_t submits;          /* jobs being stored, that are in no queue yet, */
    int64_t submits_since_ns;  /* by blobs_now(): their blobs are held since then */
    struct session *due;       /* sessions that have something to send, a list */
    struct session *watching;  /* sessions with watches, a list */
};

/* Run until a signal ends it. Prints "listening on HOST:PORT" to standard output. */
status server_run(const struct server_options *options, struct error *err) MUST_CHECK;

#endif
