/* unit_audits: a share of the results is rendered again on another worker and compared by digest. The contract (same bits
 * on any machine) makes that exact. audits.h says which, and what the answers mean.
 *
 *   a result --chosen, or another one came before--> waiting --a worker of another name, and CPU time left--> asked
 *                           ^                                        |--the same bits--> done
 *                           |--no answer, other bits-----------------|--cannot be overtaken--> decided
 *
 * Which worker is asked is drawn by lot, so that no two can count on judging each other. Rendering again costs each worker at
 * most AUDIT_CPU of what its results took since it joined, and AUDIT_FREE_S seconds before that share is reached: each has an
 * account of its own, so that no claim of one keeps others from being asked.
 *
 * Who loses is blocked by name and not believed any more (coordinator/steering/distrust.h). */
#pragma once

#include "coordinator/frame/audits.h"
#include "coordinator/farm/merge.h"
#include "protocol/azulejo.pb-c.h"

enum {
    AUDIT_FREE_S = 4,
    AUDIT_WAIT_S = 60,       /* for an answer */
    AUDIT_STORE_S = 1,       /* what waits for longer is in the store, over restarts */
    AUDIT_TRIES = 64,        /* of those waiting, at a tick */
    AUDITS_MAX = 2048,       /* waiting; the newest are left out */
};
#define AUDIT_CPU 0.012

struct server;
struct session;
struct unit_audit;

struct unit_audits {
    struct unit_audit *first, **end;
    uint32_t count;
    int off;
    uint64_t secret, lots, done;
};

/* A result that was merged; `units_before` by its worker. */
void unit_audits_result(struct session *session, const struct delivery *result, uint64_t units_before);
/* A result that differs from `first`, the one of another worker that was merged before: others decide. */
void unit_audits_conflict(struct session *session, const struct delivery *result, const struct audit_vote *first);
/* A RenderResult or a Failure. 0: it answers no audit. */
int unit_audits_answer(struct session *worker, const Azulejo__Wire__Envelope *message);
/* At every tick: ask, and give up waiting. */
void unit_audits_tick(struct server *server, uint64_t now_ns);
/* What waited when the coordinator ended. ERR_IO, ERR_NO_MEMORY. */
status unit_audits_load(struct server *server, struct error *err) MUST_CHECK;
/* Before it ends: what waits is noted in the store. */
void unit_audits_keep(struct server *server);
void unit_audits_release(struct server *server);
