/* eta: how much processor time a frame still needs, and how fast processor time comes in.
 *
 * Tiles differ in cost by factors of ten and a hundred, and passes visit them in order: the remaining work is weighted
 * tile by tile, by the cost of that tile's samples so far. A tile without a result in this run is estimated from its
 * rays on disk; without these from its neighbours; without neighbours from the frame. Both parts are sums of processor
 * time, so their quotient is a time for any number of workers of any speed. Logic without sockets or clock.
 */
#pragma once

#include <stdint.h>

#include "common/film/film.h"

struct eta_tile {
    double cpu_ns, samples; /* of the results of this run */
    uint64_t arrived;       /* pixel samples, folded or waiting, of any run */
    uint64_t rays, rayed;   /* the film's rays and their samples when it was opened */
};

struct eta {
    uint32_t tiles;
    struct eta_tile *of;
    uint64_t results;       /* that were learnt from */
    struct eta_sums *known; /* what was summed up last, until something changes: each report asks several times */
};

/* The film holds what is on disk. Out of memory: nothing is ever known. */
void eta_init(struct eta *eta, const struct film *film);
void eta_release(struct eta *eta);
/* A new result arrived. */
void eta_learn(struct eta *eta, uint32_t tile, uint64_t samples, uint64_t cpu_ns);
/* Processor time of what the film wants and lacks; negative: nothing is known yet. */
double eta_left_ns(const struct eta *eta, const struct film *film);
/* The processor time of the whole frame, as far as the cap allows; negative: nothing is known yet. */
double eta_whole_ns(const struct eta *eta, const struct film *film);

/* Processor seconds a second: a decaying mean of those of a thread, times the threads that are at work now, so that workers
 * may come and go. */
struct throughput {
    double cpu_s, wall_s, threads_s;   /* threads_s: wall_s times the threads at work, at least 1 */
    uint32_t threads;                  /* at work now */
    uint64_t last_ns;                  /* monotonic; 0: no result yet */
    double passed_s, passed_threads_s; /* since last_ns, until the number of threads changed last */
};

void throughput_add(struct throughput *t, uint64_t cpu_ns, uint64_t now_ns);
/* So many threads are at work from now on. */
void throughput_set_threads(struct throughput *t, uint32_t threads, uint64_t now_ns);
/* No worker renders the job: this time does not count. */
void throughput_idle(struct throughput *t, uint64_t now_ns);
double throughput_of(const struct throughput *t); /* 0: not known */
