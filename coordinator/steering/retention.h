/* retention: what is removed from the store without being asked for by name, and in which order.
 * Functions of their arguments: collect.c does it.
 *
 *   1. Jobs that ended longer ago than --keep (--keep-failed: failed and cancelled ones) go.
 *   2. Where an owner's films and pictures exceed --owner-limit, or the whole store --store-limit, until they fit:
 *      a. films of jobs that have ended go, those that ended first first;
 *      b. then kept films of done frames of jobs that have not ended;
 *      c. then jobs that have ended, with their pictures, those that ended first first.
 *
 * Films only serve extend and retry; pictures are what was wanted. What a job that has not ended needs is
 * never part of a plan, and neither is a job that is `busy`.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "coordinator/job/queue.h"

enum { RETENTION_TEXT_MAX = 255 };

/* The smaller of the two that are given. */
struct room_limit {
    uint64_t bytes; /* 0: not given */
    double share;   /* of the disk's bytes; 0: not given */
};
/* 0: no limit. */
uint64_t room_limit_bytes(const struct room_limit *limit, uint64_t disk_bytes);

struct retention_policy {
    int64_t keep_s, keep_failed_s; /* negative: for ever */
    struct room_limit store;
    uint64_t owner_limit;     /* bytes of films and pictures; 0: none */
    struct room_limit submit; /* of what an owner's jobs have with their scenes, where their key or token has the role submit */
    int64_t keep_blobs_s;          /* of blobs that no job needs, since a client last named them */
    int64_t age_wait_s;            /* age_clock.h */
};
/* Nothing is removed but blobs that no job has needed for a day. */
#define RETENTION_POLICY_DEFAULT \
    { \
        .keep_s = -1, .keep_failed_s = -1, .keep_blobs_s = 86400, .age_wait_s = 3600 \
    }

/* May films and pictures be removed to make room? */
int retention_makes_room(const struct retention_policy *policy);

/* How long a job is kept after its end; negative: for ever. */
int64_t retention_keep_s(const struct retention_policy *policy, int failed);
/* No job is old enough, but those that go at their end (a length of 0) need no clock. */
void retention_ages_wait(struct retention_policy *policy);

/* What a plan knows of a job. */
struct retention_job {
    uint64_t job;
    const char *owner;
    int ended, failed; /* failed: or cancelled */
    int busy;          /* somebody fetches its pictures, or they are being made */
    int64_t ended_at;  /* seconds since 1970 */
    uint64_t films;    /* bytes; of a job that has not ended: of its done frames */
    uint64_t pictures;
    uint64_t blobs; /* bytes that no other job needs; 0: not known */
};

enum retention_reason { RETENTION_AGE, RETENTION_OWNER, RETENTION_STORE };
struct retention_step {
    uint64_t job;
    int whole; /* the job with all it has; else its films */
    enum retention_reason reason;
    uint64_t bytes;        /* that this frees */
    int64_t age_s, keep_s; /* of RETENTION_AGE: since its end, and how long it may be */
    int failed;            /* by --keep-failed */
};
/* Zero-initialise. */
struct retention_plan {
    struct retention_step *steps;
    size_t count, capacity;
    size_t in_use;        /* jobs that would go by age, but are in use at the moment */
    uint64_t used, limit; /* of the store, for the text */
};
void retention_plan_release(struct retention_plan *plan);

/* Make the plan. `used` bytes are in the store, `limit` may be (0: no limit). ERR_NO_MEMORY. */
status retention_make(struct retention_plan *plan, const struct retention_policy *policy,
                      const struct retention_job *jobs, size_t count, uint64_t used, uint64_t limit, int64_t now_s,
                      struct error *err) MUST_CHECK;
/* Why, for the job's log: "it ended 31 days ago (--keep 30d)". */
void retention_text(char out[RETENTION_TEXT_MAX + 1], const struct retention_plan *plan,
                    const struct retention_step *step, const struct retention_policy *policy);

/* The room that the job takes on disk when it is done, at most: pictures after their usual compression, the
 * films in work and, with `films_stay`, those that are kept. */
uint64_t retention_job_bytes(const struct job *job, int films_stay);
