/* session: one peer, from its Hello to its end.
 *
 *   GREETING --Hello taken--> OPEN --peer, error, silence or server--> ENDING --on_close--> freed
 *       \--Hello refused, or none in time--> ENDING
 *
 * A worker's session owns its farm_worker; a client's owns its watches, uploads and transfers. The
 * session frees itself when its channel has closed.
 */
#pragma once

#include <uv.h>

#include "common/base/status.h"
#include "common/schema/token_roles.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/farm/farm.h"
#include "coordinator/net/base/transfer.h"
#include "protocol/channel.h"

enum {
    SESSION_HELLO_MS = 10000,     /* from opening the channel to the Hello */
    SESSION_HEARTBEAT_MS = 2000,  /* both sides send something at least this often */
    SESSION_SILENCE_MS = 15000,   /* a peer that sends nothing for this long is considered dead */
    SESSION_WATCHES_MAX = 16,
    SESSION_UPLOADS_MAX = 4,      /* begun and not yet complete */
    SESSION_STORING_MAX = 64,     /* complete and on their way to the disk */
    SESSION_ACKS_MAX = 1024,      /* acknowledged in one message */
    SESSION_QUEUE = 1 << 20,      /* bytes that wait for a reader of which there may be many: a token's, a named key's */
    SESSION_LINES_MAX = 64,       /* of a worker for jobs' logs, */
    SESSION_LINES_MS = 10000,     /* in this time */
    WATCH_INTERVAL_MIN_MS = 50,
    WATCH_INTERVAL_MAX_MS = 60000,
};

struct server;

enum session_state { SESSION_GREETING, SESSION_OPEN, SESSION_ENDING };

struct watch {
    uint64_t request, job; /* job 0: all */
    uint32_t interval_ms;
    uint64_t sent_ns;
    int due; /* something changed: send at once */
};

struct session {
    struct session *next, *previous;
    struct session *same_bucket;              /* of server->by_id */
    struct session *next_due, *next_watching; /* of server->due, server->watching */
    int is_due, is_watching;                  /* it is in that list */
    struct server *server;
    struct channel *channel;
    enum session_state state;
    uint32_t id;
    enum farm_role role;
    enum web_role may; /* what it may ask for (common/schema/requests.h), by its key or its token */
    uint64_t begun_ns;
    char host[64], software[64], peer[64];
    char who[JOB_WHO_MAX + 1]; /* the name of its key; a shared one's client: user@host, as it says */
    uint32_t process;
    uint32_t of_page; /* 1: it proved the page's key; */
    uint64_t token;   /* and acts for this token, as a client; 0: for itself */
    int token_ended;  /* since it began */
    uint64_t key;     /* the number of its key's name (holders.h); 0: a shared one */
    uint64_t holder;  /* whose ceilings count (holders.h); 0: it has none */
    int silent;       /* it was considered dead */
    uint32_t lines;   /* for jobs' logs, since lines_since_ns */
    uint64_t lines_since_ns;

    struct farm_worker *worker;      /* NULL: not a worker */
    Azulejo__Wire__Envelope *report; /* its last WorkerStatus; NULL: none yet */
    uint64_t told_ns;
    struct scenes_shown *scenes; /* that a worker was given work of; NULL: none */
    uint64_t recall;             /* the number of the last BlobGet that it was sent; 0: none (recalls.h) */

    struct watch watches[SESSION_WATCHES_MAX];
    uint32_t watch_count;
    struct upload *uploads[SESSION_UPLOADS_MAX];
    uint32_t storing;
    uint32_t held;          /* answers that wait for the disk (net/base/held.h) */
    int64_t blobs_since_ns; /* blobs_now() when it first named a blob; 0: it has not */
    uint64_t reads_job;     /* whose pictures it asked for last; 0: none */
    struct transfers transfers;

    /* Acknowledgements that are about to be sent, all of one frame. */
    uint64_t ack_job;
    uint32_t ack_frame, ack_count;
    struct unit_name acks[SESSION_ACKS_MAX];
};

/* For an open channel, which the session then owns. ERR_NO_MEMORY: it does not. */
status session_begin(struct server *server, struct channel *channel, struct error *err) MUST_CHECK;

/* Heartbeat, silence, watches: a few times a second. */
void session_tick(struct session *session, uint64_t now_ns);
/* Send what is due: changed watches, acknowledgements. */
void session_flush(struct session *session, uint64_t now_ns);

/* Grant leases to a worker's session, until it has enough or the farm has no more. */
void session_grant(struct session *session, uint64_t now_ns);

void session_ack(struct session *session, uint64_t job, uint32_t frame, struct unit_name unit, uint64_t now_ns);
/* session_client.c: the messages of clients, and of workers about blobs; 0: not one of them. */
int session_client_message(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns);
void session_watches_send(struct session *session, uint64_t now_ns, int only_due);

/* session_workers.c */
void session_worker_status(struct session *session, const Azulejo__Wire__WorkerStatus *status, uint64_t now_ns);
Azulejo__Wire__WorkerState session_worker_state(const struct farm_worker *worker);
/* Why the worker's connection, which has closed, ended. */
void session_worker_leaves(const struct session *session, const struct error *why, char *out, size_t size);
void session_worker_release(struct session *session);

/* session_reply.c: nothing is sent once the session is ending. A message that cannot be queued
 * closes its channel, and the session with it. */
void session_send(struct session *session, const Azulejo__Wire__Envelope *envelope);
void session_reply(struct session *session, uint64_t request, Azulejo__Wire__Envelope *envelope);
void session_accepted(struct session *session, uint64_t request, uint64_t job, uint32_t estimate_spp);
void session_stored(struct session *session, uint64_t request, const struct digest *digest);
void session_revoke(struct session *session, uint64_t lease, const char *reason);
void session_notice(struct session *session, int level, const char *text);
/* End it for its key: it may come back with another one. */
void session_refuse_key(struct session *session, const struct error *why);
void session_fail(struct session *session, uint64_t request, const struct error *why);
/* End the session; `why`, unless NULL, is sent as a Failure first. */
void session_end(struct session *session, const struct error *why);
