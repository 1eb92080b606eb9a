/* merge: the path of a result: checked, merged into the film, written to disk, acknowledged.
 *
 *   tile result --merge_result--> film (dirty tile, pending ack)
 *     --merge_commit_begin--> the journals of frames, and states that their films' files ask for
 *     --merge_commit_run (any thread)--> written and synced
 *     --merge_commit_end--> durable; acknowledged
 *
 * A result is acknowledged only when the passes up to it are on disk, or when it is not part of the
 * picture. One commit is in flight at a time; each takes every dirty tile, so results that arrive during
 * a commit share the next one. A tile that a commit could not write comes again as a whole, COMMIT_STATES_MAX at once. Syncs run beside the loop, which goes on
 * receiving. The slower the disk, the longer a first dirty tile waits for others, so that the disk spends
 * at most a fifth of its time on syncs of sparse results. Only a worker's memory waits for the
 * acknowledgement. A frame that is complete does not wait: its picture does. Nor does one that makes room for another.
 */
#pragma once

#include "coordinator/farm/farm.h"

enum {
    COMMIT_STATES_MAX = 1024,    /* tiles' states in one commit, besides those that files ask for */
    COMMIT_DELAY_MIN_MS = 250,   /* how long a first dirty tile waits for others: */
    COMMIT_DELAY_SYNCS = 4,      /* so many times what the last sync took, */
    COMMIT_DELAY_MAX_MS = 1000,  /* and at most this, */
    COMMIT_DELAY_AGES = 4,       /* nor more than this part of the frame's age, but */
    COMMIT_DELAY_YOUNG_MS = 20,  /* at least this */
    COMMIT_TILES_ENOUGH = 256,   /* this many dirty tiles do not wait */
    MERGE_CPU_SLACK_S = 60,      /* a unit's processor time over its lease's age: a coordinator that slept counted none */
};

/* A unit's result, and whose it is. */
struct delivery {
    uint64_t lease, epoch, job;
    uint32_t frame;
    struct unit_result unit;
    struct work_stats stats;
    struct trace_unit_times times;
};

enum merge_outcome {
    MERGE_PENDING,  /* events.ack follows when it is on disk */
    MERGE_KEPT,     /* it is on disk already: acknowledge now */
    MERGE_UNWANTED, /* it is not wanted (job ended, ...): revoke its lease */
    MERGE_DEFERRED, /* its film cannot be opened at present: the worker keeps it, and sends it again
                     * when it connects again */
    MERGE_IMPOSSIBLE, /* with ERR_PROTOCOL: no machine in order can send it */
};

/* Another worker's result of the same unit, which was merged before and has other bits. */
struct merge_conflict {
    int found;
    uint32_t deliverer; /* 0: not known */
    uint64_t hash;      /* unit_hash() */
};

/* ERR_PROTOCOL: the worker breaks the rules (wrong size, not finite, impossible counts, an epoch
 * never granted, a lease that another worker holds): end its session, and if the outcome is MERGE_IMPOSSIBLE, block it. A time that
 * cannot be is limited where no lease tells more. ERR_NO_MEMORY, ERR_LIMIT: nothing changed. A conflict is logged
 * and counted, and the first result kept until an audit decides; it counts as KEPT or PENDING. */
status merge_result(struct farm *farm, struct farm_worker *worker, struct delivery *result, uint64_t now_ns,
                    enum merge_outcome *outcome, struct merge_conflict *conflict, struct error *err) MUST_CHECK;

struct commit_item {
    struct job_frame *frame;
    uint32_t tile, passes[GROUPS];
};

/* The items of one frame, which stand together. */
struct commit_part {
    struct job_frame *frame;
    uint32_t first, count;
    struct film_commit film;
    uint64_t begun_ns, written_ns, ended_ns; /* writing, syncing; 0: not reached */
    status result;
    struct error error;
};

struct commit {
    struct store *store;
    struct commit_item *items;
    uint32_t count;
    struct commit_part *parts;
    uint32_t part_count;
    uint64_t sync_ns; /* of the slowest part */
    status result;    /* of the first part that failed */
    struct error error;
};

/* How long a first dirty tile waits for others, when the last sync took so long. */
uint64_t merge_delay_ns(uint64_t sync_ns);
/* Is there anything to write, and when is it due? *due_ns: merge_delay_ns after the first dirty
 * tile, at once for a complete frame, or when a frame in trouble is tried again. 0: no, or the store is in trouble. */
int merge_is_dirty(const struct farm *farm, uint64_t *due_ns, uint32_t *tiles);
/* The tiles that may be written at now_ns; with UINT64_MAX all of them, despite trouble. NULL:
 * nothing, or out of memory (try again later). */
struct commit *merge_commit_begin(struct farm *farm, uint64_t now_ns);
void merge_commit_run(struct commit *commit);
/* Frees the commit. Tiles that could not be written are dirty again, and their frame is in trouble. */
void merge_commit_end(struct farm *farm, struct commit *commit, uint64_t now_ns);
/* Frees the commit without its result: nothing is durable, nothing is acknowledged. */
void merge_commit_abandon(struct farm *farm, struct commit *commit);
