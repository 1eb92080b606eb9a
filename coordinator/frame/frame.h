/* frame: one picture in work: its film, and its work units with the leases that hold them.
 *
 *   RENDERING --its end (farm_frame_end)--> COMPLETE --all that was merged on disk--> DEVELOPING
 *        DEVELOPING --outputs on disk--> closed (freed)
 *        DEVELOPING --outputs cannot be written--> COMPLETE, and again (trouble.h)
 *   any --job ends or is parked--> closed, as soon as no commit or develop is in flight
 * job_frame_set_state is the only function that changes it.
 *
 * Units are granted in the order (pass, group, tile), and the first pass of group 0 with its tiles spread over the
 * frame (spread.h), so that a preview shows the whole frame early, as far as the film wants them: first those that
 * workers returned (`returned`), then from the cursor on. When these are lent, units of the next round can be lent
 * early (job_frame_take_early); their results wait in the film.
 *
 * Invariants:
 *  - a unit is in exactly one of: the film (folded or waiting), `outstanding` (lent to at least one
 *    lease), `returned`, or not yet reached by the cursor;
 *  - durable[t][g] <= film_tile_passes(t, g); they differ only for tiles that are dirty or in a commit.
 * A frame owns its film, its units and its pending acknowledgements; the film file belongs to it
 * too.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"
#include "common/film/film.h"
#include "coordinator/frame/eta.h"
#include "coordinator/job/history.h"
#include "coordinator/frame/preview.h"
#include "coordinator/job/queue.h"
#include "coordinator/frame/rounds.h"
#include "coordinator/film/store_film.h"

enum {
    UNIT_HOLDERS_MAX = 3,     /* leases that may hold one unit at once; */
    UNIT_HOLDERS_UNPROVEN_MAX = UNIT_HOLDERS_MAX - 1, /* the last place is for a proven worker */
    FRAME_PASSES_AHEAD = 64,  /* how far a tile's granted passes may be ahead of its folded ones */
    FRAME_PASSES_UNFROZEN = 8,/* the same before the group is frozen (freeze.h) */
    UNIT_BUCKETS_MAX = 1 << 20,
    FRAME_ACKS_MAX = 1 << 20, /* results that wait for the disk or for an earlier pass */
    /* While the frame cannot be written: units that are lent, and results that wait with their workers for the disk. No
     * lease is granted above this number, so it is exceeded by one lease at most. */
    TROUBLE_RESULTS_MAX = 4096,
};

struct job;
struct lease;

enum dirty_mark { FRAME_TILE_DIRTY = 1, FRAME_TILE_WHOLE = 2 };

enum frame_state { FRAME_RENDERING, FRAME_COMPLETE, FRAME_DEVELOPING };

/* A work unit that is lent to at least one lease. */
struct unit {
    struct unit_name name;
    uint32_t holder_count;
    struct lease *holders[UNIT_HOLDERS_MAX];
    uint64_t granted_ns;        /* to the newest holder */
    struct unit *chain;         /* in its hash bucket */
    struct unit *older, *newer; /* by granted_ns */
};

/* A result that is not acknowledged yet. */
struct pending_ack {
    uint64_t lease;
    uint32_t session;
    struct unit_name unit;
};

/* What its scene says of how far its figures can be trusted (common/accuracy/word.h). */
struct frame_evidence {
    int known;
    uint64_t effects;
    double brightest;
};

struct job_frame {
    struct job_frame *next; /* of the same job, ascending number */
    struct job *job;
    uint32_t number;
    enum frame_state state;
    struct film *film;
    struct film_file *file; /* NULL: kept in memory only (tests) */

    struct rounds rounds;     /* what the film wants */
    enum frame_end end;       /* FRAME_END_NONE: it goes on */
    uint64_t begun_ns;        /* monotonic: its first lease of this run; 0: none yet */
    struct frame_clock clock; /* of earlier runs */

    uint32_t *spread;           /* [tiles] the order of the first pass of group 0 */
    struct unit_name cursor;    /* `tile` counts in the order of the pass */
    uint64_t cursor_left;       /* units from the cursor on */
    struct unit_name early;     /* the same of units that are lent early */
    struct unit_name *returned; /* a binary heap, earliest unit first */
    size_t returned_count, returned_capacity;
    struct unit **buckets;
    uint32_t bucket_mask;
    uint32_t outstanding_count;
    struct unit *oldest, *newest;

    uint32_t (*durable)[GROUPS]; /* passes of each tile that are on disk */
    struct buffer journal;       /* records of the units that were folded, and are in no commit yet */
    struct film_stale stale;     /* tiles whose states come with the next commit */
    uint8_t *dirty_mark;         /* [tiles] DIRTY: it is in `dirty`; WHOLE: by its state, not by the journal */
    uint32_t *dirty;             /* tiles to write, in order of arrival */
    uint32_t dirty_count;
    uint64_t dirty_since_ns;
    uint32_t *shown; /* [tiles] samples of a pixel: with them the tile's picture changes (live.h) */
    struct pending_ack *acks;
    size_t ack_count, ack_capacity;
    struct tonemap_pixels *display[GROUPS]; /* how its pixels are shown; NULL: not frozen (freeze.h) */
    int freezing[GROUPS];                   /* a measurement for that is on its way */
    struct work_stats stats;                /* measured of the results merged in this run */
    struct preview previews[PREVIEW_KINDS];
    struct eta eta;
    struct history history;
    struct history_point spent; /* its clock, samples and rays when figures_spend was called last */
    uint64_t measure_next_ns;   /* when its figures may be computed again */
    uint64_t measure_cost_ns;   /* what that took in this run */
    double measure_tile_ns;     /* of a tile, about */
    uint32_t measure_tiles;     /* how many a sample is of, the last or the one in work; 0: all */
    int measuring;              /* they are being computed */
    uint32_t audited;           /* units of it that another worker rendered again, with the same bits; of this run */
    struct frame_evidence evidence;
    struct trouble trouble; /* its film or outputs cannot be written */
    int in_flight;          /* commits and develops that hold this frame */
    int closing;            /* free it when nothing is in flight */
    int leaving;            /* close it when it is on disk: it makes room for another, or */
    int returns;            /* its job has other rules: it is opened again with them */
};

/* NULL when out of memory. The film is new and empty; `file` stays the caller's on failure. */
struct job_frame *job_frame_new(struct job *job, uint32_t number, uint32_t width, uint32_t height, uint32_t spp,
                                uint32_t aovs, struct film_file *file);
void job_frame_free(struct job_frame *frame); /* no unit may be outstanding */

/* Set what the film wants by the job's rules, after it was loaded. ERR_NO_MEMORY. */
status job_frame_begin(struct job_frame *frame, struct error *err) MUST_CHECK;

void job_frame_set_state(struct job_frame *frame, enum frame_state state);

/* Its clock, over all runs. */
uint64_t job_frame_active_ns(const struct job_frame *frame, uint64_t now_ns);
uint64_t job_frame_cpu_ns(const struct job_frame *frame);

/* The film wants more than before: the cursor goes back to units that it has passed. */
void job_frame_wish(struct job_frame *frame);
/* The next unit that the film wants and lacks, and that no lease holds; 0 if there is none at the moment. */
int job_frame_take(struct job_frame *frame, struct unit_name *out);
/* The same for the next round, which may never be wanted. */
int job_frame_take_early(struct job_frame *frame, struct unit_name *out);
/* Put a unit back that was taken and is not outstanding. If memory is short, the cursor goes back
 * to the first unit instead and skips units that are merged or lent. */
void job_frame_return(struct job_frame *frame, struct unit_name name);
/* About how many units job_frame_take could still yield; exact unless results came without a lease. */
uint64_t job_frame_unleased(const struct job_frame *frame);
/* Is there such a unit at all? */
int job_frame_has_unit(const struct job_frame *frame, struct unit_name name);
/* Was the unit's result seen but is not part of the picture, so that it need not be on disk? */
int job_frame_is_watched(const struct job_frame *frame, struct unit_name name);
/* May the worker forget the unit's result? */
int job_frame_is_settled(const struct job_frame *frame, struct unit_name name);
/* Pixel samples of a unit. */
uint64_t job_frame_unit_samples(const struct job_frame *frame, struct unit_name name);

struct unit *job_frame_unit_find(const struct job_frame *frame, struct unit_name name);
/* Lend the unit to one more lease. ERR_LIMIT: it has the maximum number of holders. */
status job_frame_unit_lend(struct job_frame *frame, struct unit_name name, struct lease *lease,
                           uint64_t now_ns) MUST_CHECK;
/* Take `lease` from the unit's holders; when it was the last one the unit goes back to the pool. */
void job_frame_unit_drop(struct job_frame *frame, struct unit *unit, struct lease *lease);
/* Forget an outstanding unit: the film has it. */
void job_frame_unit_settle(struct job_frame *frame, struct unit *unit);

/* Is everything that was folded on disk? */
int job_frame_is_durable(const struct job_frame *frame);
/* Note which tiles' states must go to the disk, after film_want or film_freeze folded what waited. */
void job_frame_mark_folded(struct job_frame *frame, uint64_t now_ns);
/* Note that what was folded into a tile must go to the disk. */
void job_frame_mark_dirty(struct job_frame *frame, uint32_t tile, uint64_t now_ns);
/* From now on, what is folded comes into the journal. */
void job_frame_keep_journal(struct job_frame *frame);
status job_frame_await_ack(struct job_frame *frame, struct pending_ack ack, struct error *err) MUST_CHECK;
