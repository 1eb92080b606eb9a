/* roster: the workers' names, and what people do to workers.
 *
 * A name belongs to one connected worker at a time. Who comes with a name that a person chose, while
 * another process has it, is turned away until that one has left. Without a choice the coordinator
 * makes the name from the host's: HOST, HOST-2, HOST-3, the first that is free. A process keeps its
 * name when it connects again, also if its old connection is not known to be lost yet.
 *
 * The name of a worker with a key of its own begins with that key's (protocol/worker_name.h): KEY@HOST, KEY@HOST-2; on the
 * host KEY it is KEY, KEY@2. So the first part of a name is proved: no worker with another key, or a shared one, can have it.
 * A block of KEY blocks all names that begin with it.
 *
 *             | works      paused by itself  draining, drained  blocked    not connected
 *   drain     | DRAINED    DRAINED           (same)             refused    not found
 *   resume    | (same)     refused           works              refused    not found*
 *   block     | BLOCKED    BLOCKED           BLOCKED            (same)     BLOCKED
 *   unblock   | (same)     (same)            refused            works      works, or not found
 *
 *   * A drain that its process did not end is lifted.
 *
 * A drained worker finishes what it holds; this ends with its process, not with its connection. What
 * a blocked one holds goes to others at once, and its name stays blocked across restarts of both. Both
 * are on disk when roster_steer returns.
 */
#pragma once

#include "coordinator/farm/farm.h"

enum worker_verb { WORKER_VERB_DRAIN, WORKER_VERB_RESUME, WORKER_VERB_BLOCK, WORKER_VERB_UNBLOCK };

/* Load the marks of the store. ERR_IO, ERR_NO_MEMORY. */
status roster_load(struct farm *farm, struct error *err) MUST_CHECK;
void roster_release(struct farm *farm);

/* What a worker says of itself, and what its key proves. */
struct worker_claim {
    const char *host, *wish; /* "" or a valid name */
    int chosen;              /* the wish is a person's */
    const char *key;         /* the name of its key; "": others share it */
};
/* Give the worker, which is about to be added, its name and what people did to that. *replaced: the same process under an
 * older connection, which has lost its name and its leases, and must be ended; NULL: none. ERR_LIMIT: another has the
 * name. */
status roster_join(struct farm *farm, struct farm_worker *worker, const struct worker_claim *claim,
                   struct farm_worker **replaced, struct error *err) MUST_CHECK;
/* The worker leaves: its name is free. */
void roster_leave(struct farm *farm, struct farm_worker *worker);
/* The connected worker of that name; NULL: none. */
struct farm_worker *roster_find(const struct farm *farm, const char *name);
/* Is one connected, or marked, that worker_label_is_of that name? */
int roster_knows(const struct farm *farm, const char *name);
const struct worker_mark *roster_mark(const struct farm *farm, const char *name); /* NULL: none */

/* A person's verb. ERR_INPUT: not a name; ERR_REFUSED, ERR_NOT_FOUND: see above, with what to do
 * instead; ERR_IO, ERR_NO_MEMORY: nothing changed. */
status roster_steer(struct farm *farm, const char *name, enum worker_verb verb, const char *who,
                    struct error *err) MUST_CHECK;
enum { ROSTER_LIARS_OF_KEY = 3 };
/* Who is to be blocked for what the worker of that name sent: its key, so that another name does not help it. Where other
 * machines have the same key at the moment, only the name, until it would be the key's ROSTER_LIARS_OF_KEY'th. */
void roster_culprit(const struct farm *farm, const char *name, char out[WORKER_LABEL_MAX + 1]);
/* The worker sent what no machine in order can send: its culprit is blocked, and its leases go to others. */
void roster_block_liar(struct farm *farm, struct farm_worker *worker, uint64_t job, const char *why);

/* May the worker be lent work? */
int worker_takes_work(const struct farm_worker *worker);
/* Why it is not; "" if it may. */
void worker_explain(const struct farm_worker *worker, char *out, size_t size);
/* Add a line to the last ones of the worker. */
void worker_line_add(const struct farm *farm, struct farm_worker *worker, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* Store what it did since the last call. `why`: it leaves, for this reason; NULL: it stays. */
void worker_save(struct farm *farm, struct farm_worker *worker, const char *why);
