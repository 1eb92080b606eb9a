#include "coordinator/farm/forecast.h"

#include <math.h>

void forecast_prices(const struct history *history, enum allocation_measure measure, struct prices *out)
{
    struct price_point points[HISTORY_MAX];

    for (uint32_t i = 0; i < history->count; i++) {
        const struct history_point *p = &history->points[i];
        points[i] = (struct price_point){p->core_s, (double)p->samples, (double)p->rays, p->uneven, p->figures};
    }
    prices_fit(out, points, history->count, measure);
}

/* The smaller of two costs, either of which may be unknown. */
static double sooner(double a, double b) { return a < 0 || (b >= 0 && b < a) ? b : a; }

struct accuracy_estimate forecast_whole(const struct job_frame *frame)
{
    const struct stop_rules *rules = &frame->job->stop;
    const int has_rounds = stop_has_rounds(rules); /* without, the wanted samples are all that will be rendered */
    double ns = has_rounds ? eta_whole_ns(&frame->eta, frame->film) : eta_left_ns(&frame->eta, frame->film);
    double whole_s = has_rounds ? ns / 1e9 : frame->spent.core_s + ns / 1e9;
    struct accuracy_estimate whole, target;
    struct prices prices;

    if (ns < 0)
        return (struct accuracy_estimate){-1, -1, -1};
    if (rules->core_limit_ms > 0)
        whole_s = sooner(whole_s, (double)rules->core_limit_ms / 1e3 + (double)frame->clock.from_cpu_ns / 1e9);
    if (rules->max_rays > 0 && frame->spent.rays > 0)
        whole_s = sooner(whole_s, frame->spent.core_s * ((double)rules->max_rays / (double)frame->spent.rays));
    whole = (struct accuracy_estimate){whole_s, whole_s, whole_s};
    if (!rules->has_target)
        return whole;
    forecast_prices(&frame->history, rules->target.measure, &prices);
    if (prices.curve.points > 0) {
        target = prices_target(&prices, &rules->target);
        if (whole_s >= 0 && whole_s < target.lo)
            return whole;
        /* It may end by the target; how sure that is, the price of the target says, too. */
        return (struct accuracy_estimate){sooner(whole_s, target.value), target.lo, target.hi};
    }
    if (film_spp(frame->film) == SETTINGS_SPP_MAX && rules->core_limit_ms == 0 && rules->max_rays == 0)
        return (struct accuracy_estimate){-1, -1, -1};
    return whole;
}

double forecast_whole_s(const struct job_frame *frame) { return forecast_whole(frame).value; }

/* Seconds that the time limit leaves it; negative: there is none. */
static double limit_left_s(const struct job_frame *frame)
{
    double passed_s = frame->spent.wall_s - (double)frame->clock.from_active_ns / 1e9;
    uint64_t limit_ms = frame->job->stop.time_limit_ms;

    return limit_ms > 0 ? fmax((double)limit_ms / 1e3 - passed_s, 0) : -1;
}

struct accuracy_estimate forecast_end(const struct job_frame *frame, double cpu_s)
{
    struct accuracy_estimate end = forecast_whole(frame);
    double left_s = limit_left_s(frame), limit_s = frame->spent.core_s + left_s * cpu_s;

    if (left_s < 0)
        return end;
    if (cpu_s <= 0)
        return (struct accuracy_estimate){-1, -1, -1};
    return (struct accuracy_estimate){sooner(limit_s, end.value), sooner(limit_s, end.lo), sooner(limit_s, end.hi)};
}

double forecast_frame_share(const struct job_frame *frame)
{
    double whole_s = forecast_whole_s(frame), limit_s = (double)frame->job->stop.time_limit_ms / 1e3;
    double share = whole_s > 0 ? frame->spent.core_s / whole_s : 0;

    if (!stop_ends_a_frame(&frame->job->stop))
        return (double)film_samples(frame->film) / (double)film_samples_total(frame->film);
    if (limit_s > 0)
        share = fmax(share, 1 - limit_left_s(frame) / limit_s);
    return fmin(share, 1);
}

/* What frames that a cancel ended lack. */
static double cancelled_share(const struct job *job)
{
    double lacks = 0;

    for (size_t i = 0; i < job->cut_count; i++)
        if (job->cuts[i].end == FRAME_END_CANCEL)
            lacks += 1 - (double)job->cuts[i].coverage.samples / (double)job_frame_samples(job);
    return lacks;
}

double forecast_share(const struct job *job)
{
    double done = job->frames_done_count - cancelled_share(job) + job_closed_sum(job).share;

    if (job->state == JOB_STATE_DONE)
        return 1;
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        done += forecast_frame_share(frame);
    return job_frames_wanted(job) > 0 ? fmin(done / job_frames_wanted(job), 1) : 0;
}

/* Of one open frame, if nothing else is rendered; negative: not known. */
static double frame_seconds(const struct job_frame *frame, double whole_s, double cpu_s)
{
    double left_s = whole_s < 0 ? -1 : fmax(whole_s - frame->spent.core_s, 0) / cpu_s;

    return sooner(left_s, limit_left_s(frame));
}

double forecast_seconds_left(const struct job *job)
{
    double cpu_s = throughput_of(&job->throughput), left_s = 0, each_s = -1;
    double limit_s = (double)job->stop.time_limit_ms / 1e3;
    uint32_t open = 0;

    if (job->state != JOB_STATE_RUNNING || job->leases == 0 || cpu_s <= 0)
        return -1;
    if (job->frames_done_count > 0 && job->figures.core_s > 0)
        each_s = job->figures.core_s / job->frames_done_count / cpu_s;
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next) {
        double whole_s = forecast_whole_s(frame), seconds = frame_seconds(frame, whole_s, cpu_s);
        if (each_s < 0 && whole_s >= 0)
            each_s = whole_s / cpu_s;
        if (seconds < 0)
            seconds = each_s; /* it has just begun: assume the time of the others */
        if (seconds < 0)
            return -1;
        left_s += seconds;
        open++;
    }
    if (limit_s > 0 && (each_s < 0 || limit_s < each_s))
        each_s = limit_s;
    if (each_s < 0)
        return -1;
    return left_s + each_s * (job_frames_wanted(job) - job->frames_done_count - open);
}

double forecast_efficiency(const struct job *job)
{
    double error = job_figures_mean(&job->figures, job_frame_count(job));

    if (!(error > 0) || job->figures.core_s <= 0 || job->frames_done_count == 0)
        return NAN;
    return job->frames_done_count / (error * error * job->figures.core_s);
}
