/* eta_replay: the units of one frame, worked on in order by workers under a simulated clock, and how
 * often the time left that coordinator/eta tells is right. Aborts the program when something goes
 * wrong. */
#pragma once

#include <stdint.h>

struct eta_unit {
    uint32_t tile, group, pass;
    uint64_t samples; /* of all its pixels */
};

/* A frame without rounds, all of whose passes are wanted at once. */
struct eta_frame {
    uint32_t width, height, spp;
    uint64_t (*cpu_ns)(void *user, const struct eta_unit *unit); /* asked once for each unit */
    void *user;
};

enum { ETA_THREADS_MAX = 64 };

/* The share of the time after the frame's first tenth in which the guess was within 20 % of the truth.
 * `speed`: processor seconds that a thread gets in a second. */
double eta_replay(const struct eta_frame *frame, uint32_t threads, double speed);
