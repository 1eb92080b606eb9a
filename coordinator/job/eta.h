/* eta: how much processor time a frame still needs, and how fast processor time comes in.
 *
 * Tiles differ in cost by factors of ten and a hundred, and passes walk over them in order: what is left is
 * weighted tile by tile, by what a sample of that tile has cost so far. A tile that no result came of in this
 * run costs what its rays on disk say; without these, what its neighbours cost; without neighbours, what
 * the frame does. Both parts are sums of processor time, so their quotient is a time whatever the number of
 * workers and their speed. Logic without sockets or clock.
 */
#ifndef AZULEJO_COORDINATOR_ETA_H
#define AZULEJO_COORDINATOR_ETA_H

#include <stdint.h>

#include "common/film/film.h"

struct eta_tile {
    double cpu_ns, samples;      /* of the results of this run */
    uint64_t arrived;            /* pixel samples, folded or waiting, of any run */
    uint64_t rays, rayed;        /* what the film had when it was opened: rays, and their samples */
};

struct eta {
    uint32_t tiles;
    struct eta_tile *of;
};

/* The film holds what is on disk. Out of memory: nothing is ever known. */
void eta_init(struct eta *eta, const struct film *film);
void eta_release(struct eta *eta);
/* A result came that was not there yet. */
void eta_learn(struct eta *eta, uint32_t tile, uint64_t samples, uint64_t cpu_ns);
/* Processor time of what the film wants and lacks; negative: nothing is known yet. */
double eta_left_ns(const struct eta *eta, const struct film *film);
/* The processor time of the whole frame, as far as the cap allows; negative: nothing is known yet. */
double eta_whole_ns(const struct eta *eta, const struct film *film);

/* Processor seconds a second: a mean that forgets, so that workers may come and go. */
struct throughput {
    double cpu_s, wall_s;
    uint64_t last_ns;            /* monotonic; 0: no result yet */
};

void throughput_add(struct throughput *t, uint64_t cpu_ns, uint64_t now_ns);
/* Nobody works on it: this time does not count. */
void throughput_idle(struct throughput *t, uint64_t now_ns);
double throughput_of(const struct throughput *t); /* 0: not known */

#endif
