/* figures: when a frame's errors are estimated while it renders, and where the numbers go.
 *
 *   results --figures_learn--> the cost of its tiles (eta.h)
 *   enough new samples --figures_tick: events.measure--> copy, computed in another thread (develop.h)
 *     --figures_measured--> the frame's history; the next one when enough was rendered for its cost
 *   the frame is done --figures_finished--> the job's (history.h)
 *
 * Computing takes at most one part in FIGURES_COST_SHARE of the processor time that the frame took to render, whatever the
 * number of queries. Within that, figures of the whole picture come with each growth of the samples by FIGURES_GROWTH.
 * Where they would come too late, as with large pictures, they are of half as many tiles as are affordable (the next ones
 * shall not wait until as much was earned again), spread over the picture (measure.h): so the newest are never older than 5 s or a tenth of the frame's time so far, whichever is more, once
 * each tile has samples of both groups. Figures of what an operator shows only as a whole (TONEMAP_REACH_PICTURE) wait.
 * The first come sooner: a picture without any figure says too little. The last are always of the whole picture.
 */
#pragma once

#include "coordinator/farm/farm.h"
#include "coordinator/frame/frame.h"

enum {
    FIGURES_COST_SHARE = 400,
    FIGURES_FIRST_SHARE = 100,   /* the same for the first, of FIGURES_FIRST_TILES at most */
    FIGURES_FIRST_TILES = 64,
    FIGURES_LEAST_TILES = 32,    /* fewer say too little */
    FIGURES_SAMPLE_TILES = 4096, /* a sample's copy is made in one turn of the loop */
    FIGURES_PIXEL_NS = 300,      /* what the first is taken to cost: about what a pixel does */
    FIGURES_INTERVAL_MS = 500,   /* no sooner than that */
};
#define FIGURES_GROWTH 1.1
/* So old, or this share of the frame's time so far, figures are computed again of what is affordable. Less than what is
 * promised above: they take their time, and results come in batches. */
#define FIGURES_AGE_S 3.0
#define FIGURES_AGE_SHARE 0.06

/* The frame was opened: load its history from the store. */
void figures_open(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* A new result arrived. */
void figures_learn(struct job_frame *frame, uint32_t tile, uint64_t samples, uint64_t cpu_ns, uint64_t now_ns);
/* Bring frame->spent up to date. */
void figures_spend(struct job_frame *frame, uint64_t now_ns);
/* Start computing the figures if they are due. */
void figures_tick(struct farm *farm, struct job_frame *frame, uint64_t now_ns);
/* The end of events.measure, of frame->measure_tiles tiles (0: all), which took `cost_ns` of processor time. */
struct figures_result {
    const struct history_point *point; /* NULL: it failed */
    struct frame_evidence evidence;
    uint64_t cost_ns;
};
void figures_measured(struct farm *farm, struct job *job, uint32_t frame, const struct figures_result *result,
                      uint64_t now_ns);
/* The picture of a frame that is done was denoised; NULL: it was not. */
void figures_denoised(struct job *job, uint32_t frame, const struct accuracy_figures *figures);
/* The frame is done. `point` NULL or not known: it is too short for figures. */
void figures_finished(struct farm *farm, struct job *job, uint32_t frame, const struct history_point *point);
