/* collector: removes from the store what may go, and says what takes its room.
 *
 *   resting --due, asked, a job was removed--> measuring (a task) --> removing, a few jobs a tick --> resting
 *                                                  ^                          |
 *                                                  +--jobs were removed: their blobs may go--+
 *
 * A job is in use while its end is not on disk yet, while its pictures are made, and while they are read.
 *
 * A round measures the store's folders. Blobs are swept (sweep.h) if somebody asked for it, if a job was removed, once
 * a day, and if the store exceeds its limit. Ages count by a clock that can be right (age_clock.h). Removing happens on
 * the loop's thread, where it is known what each job needs at that moment. A coordinator that is killed in between has
 * removed less: the next round plans again.
 */
#pragma once

#include "common/schema/token_roles.h"
#include "coordinator/steering/age_clock.h"
#include "coordinator/steering/collect.h"
#include "coordinator/steering/owner_room.h"

struct server;

enum {
    COLLECTOR_PERIOD_MS = 60000,  /* between rounds, if the room is limited; */
    COLLECTOR_AGES_MS = 600000,   /* if only ages are; */
    COLLECTOR_IDLE_MS = 86400000, /* otherwise, for blobs */
    COLLECTOR_BUSY_MS = 10000,    /* after a frame was done, if the room is limited; after jobs that are due were in use */
    COLLECTOR_STEPS = 8,          /* jobs a tick */
    COLLECTOR_ASKED_MAX = 64,
    COLLECTOR_ROUNDS_MAX = 1000, /* in a row */
    STORE_ROWS_MAX = 1000,
};

struct collector {
    struct retention_policy policy;
    struct age_clock clock;
    int ages_wait;              /* in this round nothing is removed by age */
    uint64_t announced_ns;      /* of clock.since_ns: the log has said what waits */
    struct footprint footprint; /* as it was measured last */
    uint64_t sent;              /* bytes of blobs that came since */
    uint64_t measured_ns;       /* monotonic; 0: not yet */
    uint64_t next_ns;           /* the next round; 0: at once */
    uint64_t swept_ns;          /* the last sweep */
    int sweep_wanted;
    int running;                /* a task measures, */
    struct retention_plan plan; /* or a plan is carried out, */
    size_t plan_at;             /* from this step on */
    uint32_t rounds;            /* in a row */
    int round_removed;          /* a job, so another round follows */
    uint64_t frames_done;       /* when it was measured, of the jobs that had not ended */
    /* Who asked; those of this round first. */
    struct store_asked {
        uint32_t session;
        uint64_t request;
        int collect, now;
    } asked[COLLECTOR_ASKED_MAX];
    uint32_t asked_count, serving;
    /* Since the first of the present questions. */
    uint64_t removed_jobs, removed_films, removed_blobs, removed_bytes, waiting_blobs, waiting_bytes;
    char held[256];
    char logged[256]; /* the last reason in the log */
};

/* Begin and continue rounds. A few times a second. */
void collector_tick(struct server *server, uint64_t now_ns);
/* A job was removed: its blobs may go. */
void collector_wake(struct server *server);
void collector_release(struct collector *collector);

/* Does a connected client fetch pictures of the job? */
int collector_is_read(void *server, uint64_t job);
/* collect_check_room. */
status collector_check_room(struct server *server, const struct job *job, int force, struct error *err) MUST_CHECK;
/* owner_room_init, with the ceiling of the role. */
status collector_owner_room(struct server *server, enum web_role role, const struct job *job, uint64_t estimate,
                            struct owner_room *room, struct error *err) MUST_CHECK;
