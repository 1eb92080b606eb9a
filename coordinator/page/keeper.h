/* keeper: starts azulejo-web, the page's program, and starts it again when it ends.
 *
 *   STARTING --PageBegin--> RUNNING --it ends--> WAITING, KEEPER_WAIT_MIN_MS, doubling to _MAX_MS --> STARTING
 *       |                                           ^ a run of KEEPER_STEADY_MS begins with the shortest again
 *       |                --keeper_hung: SIGKILL--> it ends
 *       |--no PageBegin within KEEPER_START_MS: SIGKILL; the first time the keeper gives up
 *       |--a signal ends it before it ever was RUNNING, at most KEEPER_KILLED_MAX times --> WAITING
 *       |--it ends otherwise before it ever was RUNNING: the keeper gives up
 *       \--keeper_stop: SIGTERM, after KEEPER_END_MS SIGKILL
 *
 * It gets the key of the role `web` in a descriptor, no other one, and ends with the coordinator.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

enum {
    KEEPER_WAIT_MIN_MS = 250,
    KEEPER_WAIT_MAX_MS = 30000,
    KEEPER_STEADY_MS = 60000,
    KEEPER_END_MS = 2000,
    KEEPER_KILLED_MAX = 3,
    KEEPER_START_MS = 20000,     /* to its PageBegin */
    PAGE_CONNECTIONS_MAX = 256,  /* that the program is allowed: each may need a session */
};

struct keeper;
struct server;

struct page_options {
    const char *host;                      /* to listen on */
    uint16_t port;                         /* 0: any */
    int was_asked_for;                     /* a page that cannot listen is an error, else only a warning */
    int is_apart;                          /* somebody else starts the program */
    const char *name;                      /* one more name by which browsers reach it; NULL: none */
    const char *cert, *key;                /* PEM files; NULL: plain HTTP, or a certificate of its own */
    const char *store;                     /* the store's folder */
    uint32_t connections_max, address_max; /* of all; of one address */
    const char *client;                    /* the program `azulejo`, for uploads; NULL: beside this program */
    const char *log_level;
};

/* The options must stay. ERR_IO, ERR_NO_MEMORY; a program that cannot be run counts as one that ended. */
status keeper_new(struct keeper **out, struct server *server, const struct page_options *options,
                  struct error *err) MUST_CHECK;
/* It is RUNNING, on this port, which it gets again. */
void keeper_listens(struct keeper *keeper, uint16_t port);
/* 1: it ended before it ever ran, or took too long; *why. */
int keeper_gave_up(const struct keeper *keeper, struct error *why);
/* It is silent: it is killed, and so started again. */
void keeper_hung(struct keeper *keeper);
void keeper_stop(struct keeper *keeper);
/* After the loop has ended; NULL is fine. */
void keeper_free(struct keeper *keeper);
