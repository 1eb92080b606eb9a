/* merge: the way of a result: checked, merged into the film, onto the disk, acknowledged.
 *
 *   tile result --merge_result--> film (dirty tile, pending ack)
 *     --merge_commit_begin--> a batch of tile states, copied
 *     --merge_commit_run (any thread)--> written and synced
 *     --merge_commit_end--> durable; acknowledged
 *
 * A result is acknowledged only when the passes up to it are on disk. One commit is in flight
 * at a time; each takes every dirty tile, up to COMMIT_TILES_MAX, so results that arrive while the
 * disk works share the next one.
 */
#ifndef AZULEJO_COORDINATOR_MERGE_H
#define AZULEJO_COORDINATOR_MERGE_H

#include "coordinator/farm.h"

enum {
    COMMIT_TILES_MAX = 1024,
    COMMIT_DELAY_MS = 20,        /* how long a first dirty tile waits for company */
    COMMIT_TILES_ENOUGH = 256,   /* so many do not wait */
};

struct tile_result {
    uint64_t lease, epoch, job;
    uint32_t frame, tile, pass;
    const uint8_t *sums;         /* float32 little-endian */
    size_t sums_bytes;
    struct work_stats stats;
};

enum merge_outcome {
    MERGE_PENDING,  /* events.ack follows when it is on disk */
    MERGE_KEPT,     /* it is on disk already: acknowledge now */
    MERGE_UNWANTED, /* nobody wants it (job ended, ...): revoke its lease */
};

/* ERR_PROTOCOL: the worker breaks the rules (wrong size, not finite, an epoch never granted):
 * end its session. ERR_NO_MEMORY, ERR_LIMIT: nothing was taken. A conflict is logged and counted
 * and the first result kept; it counts as KEPT or PENDING. */
status merge_result(struct farm *farm, struct farm_worker *worker, const struct tile_result *result,
                    uint64_t now_ns, enum merge_outcome *outcome, struct error *err) MUST_CHECK;

struct commit_item {
    struct job_frame *frame;
    uint32_t tile, passes;
    uint8_t slot;
    size_t offset, size;
};

struct commit {
    struct store *store;
    struct commit_item *items;
    uint32_t count;
    uint8_t *data;
    status result;
    struct error error;
};

/* Is there anything to write, and since when? 0: no. */
int merge_is_dirty(const struct farm *farm, uint64_t *since_ns, uint32_t *tiles);
/* NULL: nothing is dirty, or out of memory (try again later). */
struct commit *merge_commit_begin(struct farm *farm);
void merge_commit_run(struct commit *commit);
/* Frees the commit. Where the disk refused it, its tiles are dirty again and farm->commit_next_ns
 * says when to try anew; after DISK_PATIENCE_MS of that the job fails. */
void merge_commit_end(struct farm *farm, struct commit *commit, uint64_t now_ns);
/* Frees the commit without learning how it ended: nothing is durable, nothing acknowledged. */
void merge_commit_abandon(struct farm *farm, struct commit *commit);

#endif
