/* owner_room: may one owner's jobs take so much of the disk? Pictures, films and scenes count, each blob once, also of jobs
 * that have ended; films and pictures that a limit removes to make room do not.
 *
 * What may exceed the ceiling by the last footprint and by estimates is measured in the store itself, on another thread.
 * Submissions under way at the same moment do not see each other: above the ceiling is at most what they need. */
#pragma once

#include "coordinator/farm/farm.h"
#include "coordinator/steering/retention.h"
#include "coordinator/store/files/footprint.h"
#include "coordinator/store/sweep.h"

/* Zero-initialised: there is room. */
struct owner_room {
    uint64_t limit;            /* bytes; 0: nothing is left to be measured */
    uint64_t needed, promised; /* by the new job; by the owner's jobs that have not ended */
    char owner[JOB_WHO_MAX + 1];
    uint64_t *ended; /* jobs whose films and pictures stay, ascending */
    size_t ended_count;
    struct blob_user *users; /* of scenes and files: the owner's jobs and the new one */
    size_t user_count;
};

/* Of the new job, whose owner's jobs may take `limit` bytes (0: no limit). `footprint` is the last one, zeroed if there is none; all
 * blobs take at most `blobs_most` bytes. `estimate`: the job that this one continues; 0: none. ERR_NO_MEMORY. */
status owner_room_init(struct owner_room *room, const struct farm *farm, const struct retention_policy *policy,
                       const struct footprint *footprint, uint64_t blobs_most, const struct job *job, uint64_t estimate,
                       uint64_t limit, struct error *err) MUST_CHECK;
/* ERR_LIMIT: no; the text says what there is, and what to do. ERR_IO, ERR_NO_MEMORY. [any thread] */
status owner_room_check(const struct owner_room *room, const char *folder, struct error *err) MUST_CHECK;
void owner_room_release(struct owner_room *room);
