/* forecast: what a job's rules and its frames' figures so far say of the rest: prices, time left, the share that is done.
 * Questions only; nothing is changed. */
#pragma once

#include "common/accuracy/price.h"
#include "coordinator/frame/frame.h"
#include "coordinator/job/queue.h"

/* Seconds until all wanted samples of the job are rendered; negative: not known. */
double forecast_seconds_left(const struct job *job);
/* What a smaller error in that measure will cost. */
void forecast_prices(const struct history *history, enum allocation_measure measure, struct prices *out);
/* Core-seconds of the whole frame, until the first of its rules ends it, and the target's interval where that may do so;
 * negative: not known. */
struct accuracy_estimate forecast_whole(const struct job_frame *frame);
double forecast_whole_s(const struct job_frame *frame);
/* The same, until the time limit where that comes first; `cpu_s`: processor time a second, 0: not known. */
struct accuracy_estimate forecast_end(const struct job_frame *frame, double cpu_s);
/* How much of the job's work is done, 0..1, in whatever state it is: by cost where rules end its frames, else by samples. */
double forecast_share(const struct job *job);
/* The same of an open frame. */
double forecast_frame_share(const struct job_frame *frame);
/* 1 / (error^2 * core-seconds) of a frame: error in display codes, root mean square of the finished frames,
 * core-seconds their mean. NaN: not known. */
double forecast_efficiency(const struct job *job);
