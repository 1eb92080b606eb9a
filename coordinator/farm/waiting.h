/* waiting: which jobs wait for something else than their turn (needs.h), and why; the order of the others (order.h). */
#pragma once

#include "coordinator/farm/farm.h"

enum { SHARES_SAVE_MS = 10 * 1000 }; /* how often the owners' shares go to the store */

/* The ready jobs in the order in which they get work. What jobs waited for and what has come leaves their needs. */
const struct order *waiting_order(struct farm *farm, uint64_t now_ns);

/* What has been done is waited for no longer, on disk, too. Also called before a done job is removed. */
void waiting_settle(struct farm *farm, uint64_t now_ns);
/* Do the jobs exist that this new one waits for? ERR_INPUT. */
status waiting_check(const struct farm *farm, const struct job *job, struct error *err) MUST_CHECK;
/* The job waits no longer for other jobs and for its time. */
void waiting_end(struct farm *farm, struct job *job);

/* What the active job waits for, in words. 0: for nothing of this kind. */
int waiting_explain(char *out, size_t size, const struct farm *farm, const struct job *job);
/* The same about workers, if none that is connected has the tags and the memory that the job needs. */
int waiting_explain_workers(char *out, size_t size, const struct farm *farm, const struct job *job);

/* Hand the shares that changed to the store, now and then, or at once. */
void waiting_save_shares(struct farm *farm, int now, uint64_t now_ns);
