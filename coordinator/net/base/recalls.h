/* recalls: blobs that are missing in the store, or were damaged there, are asked back from workers' caches.
 *
 *   wanted --the first in the line--> asked of one worker --its pieces--> stored: jobs that wait for it are tried again
 *                                       ^  |--it has none, is silent, goes, or sends something else
 *                                       |--/  to the next one --none is left--> given up (the next worker that needs it begins again)
 *
 * One blob and one worker at a time. A worker sends a blob only when it is asked for it, and only bytes of its digest are kept, so a
 * liar does no harm but to take time. One thread, but for the hashing and syncing of a blob that has come. */
#pragma once

#include <stdint.h>

#include "common/base/digest.h"
#include "common/base/status.h"
#include "protocol/azulejo.pb-c.h"

enum {
    RECALLS_MAX = 256,      /* in the line; more are given up at once */
    RECALL_SILENCE_S = 30,  /* without an answer or a piece, the next worker is asked */
    RECALL_S = 600,         /* for one worker, and a second for each MiB */
};

struct server;
struct session;
struct upload;

struct recall {
    struct digest digest;
    uint64_t limit_bytes; /* of its size */
};

struct recalls {
    struct recall line[RECALLS_MAX]; /* the first is asked for */
    uint32_t count;
    uint32_t session;     /* that is asked; 0: none */
    uint32_t asked, last; /* sessions up to `asked` had their turn, of those up to `last` */
    uint64_t number;      /* of the BlobGet */
    uint64_t begun_ns, heard_ns;
    struct upload *upload; /* since the first piece */
    int is_storing;        /* all pieces are there; a task has the upload */
    int is_doubting;       /* a task reads a blob */
};

/* A job needs this blob, and the store does not have it. */
void recalls_want(struct server *server, const struct digest *digest, uint64_t limit_bytes);
/* Its file has not the length that a scene says: if its bytes are damaged, it is removed and wanted. */
void recalls_doubt(struct server *server, const struct digest *digest, uint64_t limit_bytes);
/* Begin, give up, and take what was found damaged meanwhile. */
void recalls_tick(struct server *server, uint64_t now_ns);
/* A worker's BlobPut. ERR_REFUSED: it was not asked; ERR_PROTOCOL. What fails otherwise is not the worker's to know. */
status recalls_put(struct session *worker, const Azulejo__Wire__Envelope *message, uint64_t now_ns, struct error *err) MUST_CHECK;
/* A worker's Failure. 0: it does not answer a recall. */
int recalls_failure(struct session *worker, const Azulejo__Wire__Envelope *message, uint64_t now_ns);
void recalls_session_gone(struct server *server, uint32_t session);
void recalls_release(struct server *server);
