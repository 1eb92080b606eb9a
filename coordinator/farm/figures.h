/* figures: when a frame's errors are estimated while it renders, and where the numbers go.
 *
 *   results --figures_learn--> the cost of its tiles (eta.h)
 *   enough new samples --figures_tick: events.measure--> copy, computed in another thread (develop.h)
 *     --figures_measured--> the frame's history; the next one no sooner than its cost allows
 *   the frame is done --figures_finished--> the job's (history.h)
 *
 * Computing takes at most one part in FIGURES_COST_SHARE of a processor, and once for each growth
 * of the samples by FIGURES_GROWTH, whatever the number of queries.
 */
#ifndef AZULEJO_COORDINATOR_FIGURES_H
#define AZULEJO_COORDINATOR_FIGURES_H

#include "common/accuracy/target.h"
#include "coordinator/farm/farm.h"
#include "coordinator/job/frame.h"

enum {
    FIGURES_COST_SHARE = 50,
    FIGURES_INTERVAL_MS = 500,   /* no sooner than that */
};
#define FIGURES_GROWTH 1.1

/* The frame was opened: load its history from the store. */
void figures_open(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* A new result arrived. */
void figures_learn(struct job_frame *frame, uint32_t tile, uint64_t samples, uint64_t cpu_ns,
                   uint64_t now_ns);
/* Bring frame->spent up to date. */
void figures_spend(struct job_frame *frame, uint64_t now_ns);
/* Start computing the figures if they are due. */
void figures_tick(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* The end of events.measure, which took `cost_ns` of processor time. `point` NULL: it failed. */
void figures_measured(struct farm *farm, struct job *job, uint32_t frame,
                      const struct history_point *point, uint64_t cost_ns, uint64_t now_ns);
/* The frame is done. `point` NULL or not known: it is too short for figures. */
void figures_finished(struct farm *farm, struct job *job, uint32_t frame,
                      const struct history_point *point);

/* Seconds until all wanted samples of the job are rendered; negative: not known. */
double figures_seconds_left(const struct job *job);
/* The curve of a frame's error in that measure over core-seconds. */
void figures_curve(const struct job_frame *frame, enum allocation_measure measure,
                   struct accuracy_curve *out);
/* Core-seconds of the whole frame, until the first of its rules ends it; negative: not known. */
double figures_whole_s(const struct job_frame *frame);
/* 1 / (error^2 * core-seconds) of a frame: error in display codes, root mean square of the finished frames,
 * core-seconds their mean. NaN: not known. */
double figures_efficiency(const struct job *job);

#endif
