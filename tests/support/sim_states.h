/* sim_states: a simulated farm's job in each of its states. */
#pragma once

#include "tests/support/sim_farm.h"

/* One more worker. */
struct sim_worker *sim_stored_connect(struct sim_stored *f, uint32_t threads);
/* A second passes. */
void sim_stored_tick(struct sim_stored *f);
/* The farm has no job but this one. */
struct job *sim_stored_job(struct sim_stored *f);
/* Render everything that is lent, until nothing more is. */
void sim_stored_render(struct sim_stored *f);

/* Two frames of 4 tiles: two tiles of frame 1 have their first pass on disk, frame 2 is not begun. */
struct job *sim_job_running(struct sim_stored *f);
/* The same in another state. */
struct job *sim_job_in(struct sim_stored *f, enum job_state state);
void sim_job_park(struct sim_stored *f, struct job *job);
