/* collect: the farm's jobs as retention sees them, and a plan's steps carried out. What is done to a job is in its
 * log; the coordinator's log names what became of a job that is gone. */
#pragma once

#include "coordinator/farm/farm.h"
#include "coordinator/steering/retention.h"
#include "coordinator/store/files/footprint.h"
#include "coordinator/store/sweep.h"

/* A job, as the owner of blobs. */
struct blob_user collect_user(const struct job *job);
/* Every job in the queue. The caller frees *users. ERR_NO_MEMORY. */
status collect_users(const struct farm *farm, struct blob_user **users, size_t *count, struct error *err) MUST_CHECK;

/* Is this job read by somebody just now? */
typedef int collect_read_fn(void *user, uint64_t job);

/* Plan what to remove, by what was measured. `users`: with the bytes of their blobs, in any order; NULL: not
 * known. ERR_NO_MEMORY. */
status collect_plan(struct retention_plan *plan, const struct farm *farm, const struct retention_policy *policy,
                    const struct footprint *footprint, const struct blob_user *users, size_t user_count,
                    collect_read_fn *is_read, void *user, struct error *err) MUST_CHECK;

/* The latest moment that the queue knows of; *due: jobs that are to go by their age now, and whose age is not 0. */
int64_t collect_newest(const struct farm *farm, const struct retention_policy *policy, size_t *due);

/* What became of a step. */
enum collect_result { COLLECT_NOTHING, COLLECT_FILMS, COLLECT_JOB };
/* Do it, unless the job is no longer what the plan took it for. ERR_IO, ERR_REFUSED (a backup): nothing was removed. */
status collect_step(struct farm *farm, const struct retention_plan *plan, const struct retention_step *step,
                    const struct retention_policy *policy, collect_read_fn *is_read, void *user, uint64_t now_ns,
                    enum collect_result *result, struct error *err) MUST_CHECK;

/* Does the job fit the disk and its owner's quota? `force`: only the quota counts. ERR_LIMIT: no; the text
 * says what it needs, what there is, and what to do. `footprint` is the last one, zeroed if there is none. */
status collect_check_room(const struct farm *farm, const struct retention_policy *policy,
                          const struct footprint *footprint, const struct job *job, int force,
                          struct error *err) MUST_CHECK;
