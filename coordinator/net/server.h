/* server: the event loop around the farm: listener, sessions, timers, disk work.
 *
 * Ownership: the server owns the loop's handles, the farm and the sessions. Disk work runs in
 * libuv's thread pool, on copies; it ends on the loop's thread.
 *
 *   LISTENING --SIGTERM, SIGINT--> DRAINING --disk idle--> CLOSING --all handles closed--> ended
 */
#pragma once

#include <uv.h>

#include "common/base/status.h"
#include "coordinator/net/descriptors.h"
#include "coordinator/net/door.h"
#include "coordinator/farm/farm.h"
#include "coordinator/net/guest.h"
#include "coordinator/net/base/collector.h"
#include "coordinator/net/base/holders.h"
#include "coordinator/net/base/keyring.h"
#include "coordinator/net/base/scenes_shown.h"
#include "coordinator/net/base/task.h"
#include "coordinator/store/files/audit.h"
#include "coordinator/net/base/render_requests.h"
#include "coordinator/net/base/recalls.h"
#include "coordinator/net/base/scrubber.h"
#include "coordinator/net/base/unit_audits.h"
#include "coordinator/steering/distrust.h"
#include "coordinator/net/session/session.h"
#include "protocol/key.h"
#include "protocol/listen.h"

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
    uint16_t port; /* 0: any */
    const struct farm_key *key;
    struct store *store;
    uint64_t lease_ns;
    uint64_t hang_ns;       /* farm->hang_ns */
    const char *ready_file; /* NULL, or gets the port, atomically */
    struct descriptors descriptors;
    uint64_t submit_blobs; /* bytes that a token of role submit may send and no job needs; 0: token_ceilings.h */
    uint64_t scrub_rate;   /* scrubber.h */
    const char *on_event;  /* event_program.h; NULL: none */
    int no_audits;         /* unit_audits.h */
    int no_shared_keys;    /* keyring.h */
    int discards_films;    /* its jobs will not be extended */
    const char *precision; /* of its workers: "float" or "double"; NULL: float */
    struct retention_policy policy;
    struct order_rules order;
    struct server_guest guest; /* start is NULL: none */
};

enum server_state { SERVER_LISTENING, SERVER_DRAINING, SERVER_CLOSING };

struct server {
    uv_loop_t loop;
    uv_tcp_t listeners[LISTEN_ADDRESSES_MAX];
    struct listen_sockets sockets; /* of the listeners, which own them */
    uv_timer_t tick, commit_timer;
    uv_prepare_t prepare;
    uv_async_t saved; /* the store wrote what somebody waits for */
    uv_signal_t terminate, interrupt;
    struct server_guest guest; /* zero: none */
    int guest_runs;            /* it was started and is to be stopped */
    enum server_state state;
    uint64_t drain_since_ns;
    uint64_t ticked_ns; /* the last tick */
    uint64_t awake_ns;  /* the loop came back from a long pause: silence counts from here */
    const struct farm_key *key;
    struct store *store;
    struct farm farm;
    struct door door;
    struct session *sessions, *by_id[SESSION_BUCKETS];
    struct descriptors descriptors;
    uint32_t session_count, last_session;
    uint32_t page_session_count; /* of those, of the page's program; descriptors.guests_max are kept for it */
    struct render_requests requests;
    struct unit_audits audits;
    struct distrust_report reports[DISTRUST_REPORTS_MAX]; /* whose answers wait for the disk, by their numbers */
    uint64_t reports_made;
    uint64_t fingerprint; /* our own arithmetic, in the precision of our workers */
    const char *precision;
    struct audit audit;
    struct keyring keyring;
    struct log_limit refused_keys;
    int64_t keys_checked_s; /* connections' keys are good since then, in seconds since 1970 */
    struct scene_lists *scene_lists;
    int commit_running;
    uint32_t tasks; /* in the thread pool, or waiting for it (task.h) */
    struct task_line line;
    uint32_t held; /* answers that wait for the disk (held.h) */
    uint32_t previews;
    int trim_wanted;        /* memory of previews is to go back */
    struct holders holders; /* what tokens hold */
    struct collector collector;
    struct scrubber scrubber;
    struct recalls recalls;
    const char *on_event;            /* its path */
    struct event_program *events;    /* NULL: none */
    int store_event_told;            /* it has the event that the store cannot be used */
    char page_address[PAGE_URL_MAX]; /* "http://127.0.0.1:7421"; "": the page was never there */
    char wall[64], wall_lacks[256]; /* around what the page imports, as its program says (web/base/wall.h); "": no page */
    uint32_t submits;         /* jobs being stored, that are in no queue yet, */
    int64_t submits_since_ns; /* by blobs_now(): their blobs are held since then */
    struct session *due;      /* sessions that have something to send, a list */
    struct session *watching; /* sessions with watches, a list */
};

/* Run until a signal ends it. Prints "listening on HOST:PORT" to standard output, each further address after " and ". */
status server_run(const struct server_options *options, struct error *err) MUST_CHECK;
