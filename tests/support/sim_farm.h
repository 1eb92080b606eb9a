/* sim_farm: the coordinator's logic under a simulated clock, with workers that are structs.
 *
 * Results are a pure function of (frame, tile, pass), so a frame's film can be checked
 * against one that was merged in order (sim_frame_is_right).
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "coordinator/farm/farm.h"
#include "coordinator/farm/merge.h"
#include "coordinator/store/store.h"
#include "tests/support/scratch_folder.h"

enum { SIM_WORKERS_MAX = 8, SIM_UNITS_MAX = 4096, SIM_FREEZINGS_MAX = FRAMES_OPEN_MAX * GROUPS };

/* A unit that a simulated worker holds, or has sent and not seen acknowledged. */
struct sim_unit {
    uint64_t lease, epoch, job;
    uint32_t frame;
    struct unit_name name;
    int sent;
};

struct sim_worker {
    struct farm_worker worker;
    int connected;
    struct sim_unit units[SIM_UNITS_MAX];
    size_t unit_count;
};

struct sim {
    struct farm farm;
    struct store *store;
    uint64_t now_ns;
    uint64_t random;
    struct sim_worker workers[SIM_WORKERS_MAX];
    uint32_t last_session;
    struct job_frame *developing[FRAMES_OPEN_MAX];
    uint64_t developing_epoch[FRAMES_OPEN_MAX]; /* of the job when that began */
    size_t developing_count;
    struct freezing *freezing[SIM_FREEZINGS_MAX];
    size_t freezing_count;
    const char *tonemap;     /* the operator of sim_submit's jobs; NULL: linear, which measures nothing */
    struct job *picture_job; /* whose picture_frame shall be developed again; NULL: none */
    uint32_t picture_frame;
    /* What happened. */
    size_t acks, revokes, notices, changes, developed, wrong_frames;
    uint32_t notice_session;
    char notice[256];
};

/* The store in this folder. Fails the test when it cannot be opened. */
struct store *sim_store(const char *folder);

/* `store` may be NULL. Fails the test when the farm cannot be made. */
void sim_init(struct sim *sim, struct store *store, uint64_t seed);
void sim_release(struct sim *sim);
/* The same for one on the heap. */
struct sim *sim_new(struct store *store, uint64_t seed);
void sim_free(struct sim *sim);
/* cmocka's set-up and tear-down of a farm without a store: *state is a struct sim. */
int sim_set_up(void **state);
int sim_tear_down(void **state);

/* A farm with a store in a folder of its own, and the same for cmocka: *state is a struct
 * sim_stored. */
struct sim_stored {
    char folder[SCRATCH_PATH];
    struct store *store;
    struct sim *sim;
    unsigned workers; /* that the test has connected since the start */
};
int sim_stored_set_up(void **state);
int sim_stored_tear_down(void **state);
/* The coordinator is killed, and started again. */
void sim_stored_restart(struct sim_stored *f);

uint32_t sim_random(struct sim *sim, uint32_t limit); /* 0..limit-1 */

struct job *sim_submit(struct sim *sim, uint32_t width, uint32_t height, uint32_t spp, uint32_t first_frame,
                       uint32_t last_frame, int32_t priority);
/* A new job that is in no queue. */
struct job *sim_job(uint32_t width, uint32_t height, uint32_t spp, uint32_t first_frame, uint32_t last_frame,
                    int32_t priority);

struct sim_worker *sim_connect(struct sim *sim, unsigned index, uint32_t threads);
/* It keeps what it holds, and can connect again and send it. */
void sim_disconnect(struct sim *sim, unsigned index);

/* Its connection is lost, and with it all that it holds. */
void sim_die(struct sim *sim, unsigned index);

/* Ask for leases with so much room; returns how many units came. */
size_t sim_grant(struct sim *sim, struct sim_worker *worker, uint32_t room);
/* Send the result of the worker's i-th unit; cost_ns: CPU time of one pixel sample. */
/* Its result, whose sums are in `sums`. */
struct delivery sim_result(const struct sim *sim, const struct sim_unit *unit, float sums[TILE_FLOATS_MAX]);
enum merge_outcome sim_send(struct sim *sim, struct sim_worker *worker, size_t i, uint64_t cost_ns);
/* Take the unit out of the worker's list. */
void sim_forget(struct sim_worker *worker, size_t i);

/* The numbers of a unit's result; returns how many. */
size_t sim_sums(uint32_t width, uint32_t height, uint32_t frame, struct unit_name name, float *out);

void sim_commit(struct sim *sim);  /* write and acknowledge what is dirty */
void sim_develop(struct sim *sim); /* end the developments that were begun, checking their films */
/* Run and end the measurements that were begun (coordinator/farm/freeze.h). */
void sim_freeze(struct sim *sim);
/* Make the one picture that was asked for again; 0: none was. */
int sim_make_picture(struct sim *sim);

/* Does the film hold exactly what merging its passes in order gives? A film of a job that is not
 * cancelled must be complete. */
int sim_frame_is_right(const struct job *job, uint32_t number, const struct film *film);
