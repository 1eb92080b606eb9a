/* queue: the jobs, and the order in which they are served.
 *
 *   QUEUED --first lease--> RUNNING --last frame's files on disk--> DONE
 *    ^  |                    |
 *    |  +--------------------+--paused by a person--> PAUSED --resumed--> QUEUED
 *    |  +--------------------+--its workers die (suspicion.h) or hang (hang.h)--> PARKED --resumed--> QUEUED
 *    |  +--------------------+--finish--> FINISHING --first passes on disk--> DONE, finished early
 *    |  +--------------------+--cancel--> CANCELLING --pictures of what there is--> CANCELLED, or DONE if nothing is missing
 *    |  +--------------------+--cancel, discard--> CANCELLED
 *    |  +--------------------+--cannot be done--> FAILED
 *    |
 *    +--extended, tried again (job_reopen)-- DONE, FAILED, CANCELLED
 *
 * PAUSED, PARKED, FINISHING and CANCELLING jobs can be cancelled and can fail as well; a PAUSED one can be finished,
 * and a FINISHING one parked. job_edges has every edge. A job that waits for the environment (a disk, a worker) does
 * not change its state: that is a reason, which lifts itself; a pause never does. PAUSED, PARKED and CANCELLING jobs
 * hold no lease and take no result: closing.h says what happens to their frames. job_set_state and job_reopen are the
 * only functions that change a job's state; DONE, FAILED and CANCELLED are final. Jobs are served in the order of
 * order.h, once what they need (needs.h) is there.
 *
 * Invariants:
 *  - `all` is sorted by id; `active` holds exactly the jobs that are not final, by priority (higher
 *    first), then by id;
 *  - a final job has no open frames.
 * The queue owns its jobs. Across a restart the store keeps them.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/accuracy/stop.h"
#include "common/base/buffer.h"
#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/film/film.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"
#include "common/scene/stages.h"
#include "common/schema/job_states.h"
#include "common/tonemap/tonemap.h"
#include "coordinator/job/candidates.h"
#include "coordinator/frame/eta.h"
#include "coordinator/job/hang.h"
#include "coordinator/job/history.h"
#include "coordinator/job/needs.h"
#include "coordinator/job/order.h"
#include "coordinator/job/refusal.h"
#include "coordinator/farm/rate.h"
#include "coordinator/job/suspicion.h"
#include "coordinator/job/trouble.h"
#include "protocol/output.h"

enum {
    JOBS_ACTIVE_MAX = 10000,
    JOBS_MAX = 200000,
    JOB_NAME_MAX = 255,
    JOB_TEXT_MAX = 511,
    JOB_COMMENT_MAX = 255,
    JOB_TOKEN_MAX = 64,
    JOB_SOURCE_MAX = 1023,
    JOB_WHO_MAX = 127,   /* a person: user@host */
    RAY_TRACER_NAME_MAX = 127,
    RELEASE_NAME_MAX = 31,
    SCENE_BYTES_MAX = 1 << 30, /* of a packed scene */
    JOB_BROKEN_MAX = 3, /* a job without results fails when this many machines say that its scene is damaged */
    JOB_BROKEN_MACHINES_MAX = 256, /* a job with results fails when this many do */
};

/* The edges of the diagram. Every state has edges to FAILED but those that are final. */
struct job_edge {
    enum job_state from, to;
};
extern const struct job_edge job_edges[];
extern const size_t job_edge_count;

/* Bits; the numbers are the store's. */
enum job_mark {
    JOB_MARK_EARLY = 1,     /* DONE by finish, before all its samples */
    JOB_MARK_DISCARDED = 2, /* it has ended, and its films are not kept */
};

/* What workers measured, summed over merged results. */
struct work_stats {
    uint64_t cpu_ns, trace_ns;
    uint64_t effects; /* of all results together; 0: not reported */
    uint64_t stages[STAGE_COUNT], accounts[EFFECT_ACCOUNTS];
};
void work_stats_add(struct work_stats *sum, const struct work_stats *more);

struct job_frame;

/* The numbers are the store's. */
enum job_estimate {
    ESTIMATE_NONE,
    ESTIMATE_OPEN,      /* a few samples of a few frames, to predict the job's cost */
    ESTIMATE_CONTINUED, /* it was one; the same job was submitted later and continues it */
};

/* A frame that is done with fewer samples than the cap allows. */
struct cut_frame {
    uint32_t frame;
    enum frame_end end;
    struct film_coverage coverage;
};

/* What is in a film that is not in memory. */
struct closed_frame {
    uint64_t samples;
    double core_s; /* spent on it */
    double share;  /* of the frame, 0..1: forecast_share() */
};

struct job {
    uint64_t id;
    char name[JOB_NAME_MAX + 1];
    enum job_state state;
    char state_text[JOB_TEXT_MAX + 1]; /* why it failed, was cancelled or parked; else empty */
    int32_t priority;
    char comment[JOB_COMMENT_MAX + 1]; /* by a person; "": none */
    char owner[JOB_WHO_MAX + 1];       /* who submitted it, user@host; "": an older release's job */
    unsigned marks;                    /* enum job_mark */
    uint32_t first_frame, last_frame;
    struct render_settings settings;
    struct stop_rules stop; /* besides settings.spp, the cap */
    struct buffer schedule; /* passes [tile][group] of a job of one frame; empty: none */
    struct output_settings output;
    struct digest scene;
    char scene_name[JOB_NAME_MAX + 1];
    char source[JOB_SOURCE_MAX + 1]; /* the scene's file and how it was imported, as words of a shell; "": not
                                          known */
    char token[JOB_TOKEN_MAX + 1];   /* of the submission; "": none. No two jobs have the same */

    char ray_tracer[RAY_TRACER_NAME_MAX + 1]; /* of the workers that got units; "": none yet */
    char release[RELEASE_NAME_MAX + 1];       /* of the coordinator that lent the first of them; "": none yet */
    uint64_t epoch_floor;                     /* results of older epochs are not this job's */
    int64_t submitted_at, finished_at;        /* seconds since 1970, UTC; 0: not yet */
    uint64_t active_ns;                       /* since the first lease, without the present run */
    uint64_t active_since_ns;                 /* monotonic; 0: not active in this run */

    enum job_estimate estimate;
    uint8_t *frames_resting; /* a bit a frame: not rendered until the job is extended */
    uint32_t frames_resting_count;
    uint8_t *frames_done; /* a bit a frame from first_frame on */
    uint32_t frames_done_count;
    uint32_t revision;         /* of `output`: how often it was changed */
    uint8_t *frames_developed; /* of those that are done: the pictures follow `output` */
    uint32_t frames_developed_count;
    struct trouble trouble;         /* its next film cannot be opened */
    uint64_t samples_done;          /* pixel samples of the frames that are done */
    struct closed_frame *closed;    /* [frames] of films that are on disk only, about; NULL: of none */
    struct closed_frame closed_sum; /* of them */
    struct cut_frame *cuts;         /* of the frames that are done */
    size_t cut_count, cut_capacity;
    struct throughput throughput; /* rate at which its results bring in processor time */
    struct unit_work work;        /* of the frames that are done */
    struct work_stats stats;

    struct job_frame *frames;   /* open ones, ascending number */
    struct rate rate;           /* pixel samples */
    struct refusals refusals;   /* machines that said JobBroken */
    struct suspicion suspicion; /* whether it kills its workers */
    struct hangs hangs;         /* units that hang */
    unsigned candidate_lists;   /* the lists of candidates.h that it is in, as bits */
    int all_begun;              /* no frame is left to begin; queue_frames_changed resets it */
    uint32_t begin_from;        /* all frames before this one are done, resting or open */
    int is_damaged;             /* its row is: it stands for it, and is never rendered */
    int removed;                /* it is in no queue, and freed when nothing holds it */
    struct job_place place;     /* in the order of service */
    struct job_needs needs;     /* what must be true before it is lent */

    /* ---- written by coordinator/farm ---- */
    struct job *next_to_develop; /* in the farm's list */
    int to_develop;              /* it is in that list */
    struct trouble pictures;     /* they cannot be made again */
    int unsaved;                 /* its state must be handed to the store again */
    uint64_t saved_ns;           /* monotonic: when the progress was last stored */
    struct job_figures figures;  /* of the frames that are done; `last` also of one that rests */
    uint32_t measurements;       /* of its frames' figures, that tasks are computing */
    uint64_t conflicts;          /* results that differed from the one merged before */
    uint32_t threads;            /* of the workers that hold its leases, at the last tick */
    uint64_t turnaround_ns;      /* from a unit's grant to its result, smoothed; 0: unknown */
    uint32_t closing_frames;     /* closed ones that a commit or develop still holds */

    /* ---- written by coordinator/frame ---- */
    uint32_t leases; /* live ones */
};

struct queue {
    struct job **all;
    size_t count, capacity;
    struct job **active;
    size_t active_count, active_capacity;
    unsigned changes; /* counted: the active ones, their priorities, whether they are open */
    struct candidates candidates;
};

void queue_init(struct queue *queue);
void queue_release(struct queue *queue);

/* A zeroed job that is in no queue; NULL when out of memory. frames_done has room for last - first + 1 frames. */
struct job *job_new(uint32_t first_frame, uint32_t last_frame);
void job_free(struct job *job); /* its frames must be closed */

/* Take ownership of a job with an id of its own. ERR_LIMIT: too many; ERR_NO_MEMORY. On failure the
 * caller still owns it. */
status queue_add(struct queue *queue, struct job *job, struct error *err) MUST_CHECK;
struct job *queue_find(const struct queue *queue, uint64_t id); /* NULL: none */

/* Take a job that has ended out of the queue: it is `removed`, and the caller's now. */
void queue_remove(struct queue *queue, struct job *job);
/* Give an active job another place. */
void queue_set_priority(struct queue *queue, struct job *job, int32_t priority);

/* A frame of the job was opened or closed, may be begun again, or its trouble began or ended: put it into the
 * lists of candidates where it belongs. */
void queue_frames_changed(struct queue *queue, struct job *job);
/* The frame was closed, and may have to be begun again. */
void queue_frame_closed(struct queue *queue, struct job *job, uint32_t frame);
/* The job has no frame left to begin, until the next call of queue_frames_changed. */
void queue_all_begun(struct queue *queue, struct job *job);

/* The next active job after `after` (NULL: the first) in one of the lists (a set of CANDIDATES_BIT); NULL: none. */
struct job *queue_next(const struct queue *queue, unsigned lists, const struct job *after);

/* Jobs changed their `place` (order.h). Call it before anything else is asked of the queue. */
void queue_order_changed(struct queue *queue);

/* `text` may be NULL. Asserts that the diagram allows the change. */
void job_set_state(struct queue *queue, struct job *job, enum job_state state, const char *text, uint64_t now_ns,
                   int64_t wall_s);

/* It is submitted: its number, and the seconds since 1970, UTC. */
void job_set_id(struct job *job, uint64_t id);
void job_set_submitted(struct job *job, int64_t wall_s);

/* Results of leases up to this epoch are not the job's: with another cap, a short pass is another unit. */
void job_fence(struct job *job, uint64_t epoch);
/* Other rules and another cap; job_fence comes with them. */
void job_set_rules(struct job *job, const struct stop_rules *rules, uint32_t spp);
/* The frames that rest, a bit a frame, to undo a change of them. NULL: out of memory. */
uint8_t *job_resting_copy(const struct job *job);
void job_resting_restore(struct job *job, const uint8_t *copy);
/* It is to be extended: other rules, and no frame rests. To undo it, copy the job before. */
void job_extend(struct job *job, const struct stop_rules *rules, uint32_t spp);
/* The estimate becomes the job that was submitted. To undo it, copy the estimate before. */
void job_continue(struct job *estimate, const struct job *submitted);
void job_mark(struct job *job, enum job_mark mark);
/* It has a lease: its clock runs until it is not open any more. */
void job_start_clock(struct job *job, uint64_t now_ns);
/* All frames before this one are done, resting or open. */
void job_begun_before(struct job *job, uint32_t frame);

uint32_t job_frame_count(const struct job *job);
int job_frame_is_done(const struct job *job, uint32_t frame);
void job_frame_set_done(struct job *job, uint32_t frame);
/* A frame that is done has fewer samples than the cap allows. ERR_NO_MEMORY: the job counts it as whole. */
status job_frame_set_cut(struct job *job, uint32_t frame, enum frame_end end, const struct film_coverage *coverage,
                         struct error *err) MUST_CHECK;
int job_frame_is_cut(const struct job *job, uint32_t frame);
int job_frame_is_developed(const struct job *job, uint32_t frame);
void job_frame_set_developed(struct job *job, uint32_t frame);
void job_frame_set_undeveloped(struct job *job, uint32_t frame);
/* The frame is not rendered until the job is extended. */
void job_frame_rest(struct job *job, uint32_t frame);
/* It no longer rests. */
void job_frame_wake(struct job *job, uint32_t frame);
int job_frame_is_resting(const struct job *job, uint32_t frame);
uint32_t job_frames_wanted(const struct job *job); /* that do not rest */
/* The frame rests, or the job was finished before it was begun. */
int job_frame_is_left(const struct job *job, uint32_t frame);
uint32_t job_frames_left(const struct job *job);

/* Which frames of a job that are done continue, or of one that has ended. Zero-initialised: all of them. */
struct job_reopening {
    uint8_t *chosen;               /* a bit a frame; NULL: all */
    uint8_t *whole;                /* of the others, those that have all samples of the old cap, and
                                      fewer than the new cap allows */
    uint8_t *remade;               /* see job_reopening_remakes */
    struct film_coverage coverage; /* what these have */
};
/* Choose frames of the job; count 0 means all. ERR_INPUT: it has no such frame; ERR_NO_MEMORY. */
status job_reopening_init(struct job_reopening *r, const struct job *job, const uint32_t *frames, size_t count,
                          uint32_t new_spp, struct error *err) MUST_CHECK;
/* The same, and the list may be empty: none. */
status job_reopening_of(struct job_reopening *r, const struct job *job, const uint32_t *frames, size_t count,
                        uint32_t new_spp, struct error *err) MUST_CHECK;
void job_reopening_release(struct job_reopening *r);
int job_reopening_has(const struct job_reopening *r, const struct job *job, uint32_t frame);
int job_reopening_is_whole(const struct job_reopening *r, const struct job *job, uint32_t frame);
/* The frame is done and stays so, but its picture is made of others (--temporal, --denoise-around) that were not done when
 * the frames were chosen, or are not any more. */
int job_reopening_remakes(const struct job_reopening *r, const struct job *job, uint32_t frame);
/* Is there room for one more active job and for its extra data? ERR_LIMIT, ERR_NO_MEMORY. */
status job_reopen_check(struct queue *queue, struct job *job, struct error *err) MUST_CHECK;
/* The chosen frames of a job that has ended continue with its present settings: it is QUEUED again. Call
 * job_reopen_check first. */
void job_reopen(struct queue *queue, struct job *job, const struct job_reopening *r);
/* The chosen frames of a job that has not ended continue with its present settings. `cuts` has room for all frames. */
void job_reopen_frames(struct queue *queue, struct job *job, const struct job_reopening *r);
/* The frame, which is not done, has so many samples on disk, and no open film: for the job's progress. 0: none. */
void job_note_closed(struct job *job, uint32_t frame, struct closed_frame is);
/* The sum of them; nothing of a job whose films go with its end. */
struct closed_frame job_closed_sum(const struct job *job);
/* The last figures of such a frame, which job->figures keeps of the first one. */
void job_note_last(struct job *job, uint32_t frame, const struct history_point *point);
/* Mark every frame's pictures to be made again, with these settings. */
void job_revise(struct job *job, const struct output_settings *output);
/* Find a done frame whose pictures must be made and can be, because the frames that its statistics
 * are averaged with are also done. 0: none. */
int job_frame_to_develop(const struct job *job, uint32_t *frame);
/* The first of the frames that this frame's statistics are averaged with. */
uint32_t job_window_begin(const struct job *job, uint32_t frame);
/* The frames beside this one that its denoised picture is made of and that are done, ascending; how many. */
enum { JOB_AROUND_MAX = 4 };
uint32_t job_frames_around(const struct job *job, uint32_t frame, uint32_t out[JOB_AROUND_MAX]);
/* Every picture for which the frame's film is needed has been made. */
int job_film_is_spent(const struct job *job, uint32_t frame);
uint64_t job_frame_samples(const struct job *job); /* of one whole frame */
double job_active_seconds(const struct job *job, uint64_t now_ns);
