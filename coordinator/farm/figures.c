#include "coordinator/farm/figures.h"

#include <assert.h>
#include <math.h>

#include "common/base/clock.h"
#include "common/base/log.h"

void figures_open(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    struct error err = {0};

    eta_init(&frame->eta, frame->film);
    /* Without it, only the error's curve starts over. */
    if (farm->store && film_samples(frame->film) > 0 &&
        store_history_load(farm->store, frame->job->id, frame->number, &frame->history, &err) !=
            STATUS_OK)
        log_warn("job %llu, frame %u: %s", (unsigned long long)frame->job->id, frame->number,
                 err.text);
    figures_spend(frame, now_ns);
}

void figures_learn(struct job_frame *frame, uint32_t tile, uint64_t samples, uint64_t cpu_ns,
                   uint64_t now_ns)
{
    eta_learn(&frame->eta, tile, samples, cpu_ns);
    throughput_add(&frame->job->throughput, cpu_ns, now_ns);
}

void figures_spend(struct job_frame *frame, uint64_t now_ns)
{
    frame->spent.core_s = (double)job_frame_cpu_ns(frame) / 1e9;
    frame->spent.wall_s = (double)job_frame_active_ns(frame, now_ns) / 1e9;
    frame->spent.samples = film_samples(frame->film);
    frame->spent.rays = film_rays(frame->film);
}

void figures_tick(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    const struct history_point *last = history_last(&frame->history);
    double samples = (double)film_samples(frame->film);

    figures_spend(frame, now_ns);
    if (frame->job->leases == 0)
        throughput_idle(&frame->job->throughput, now_ns);
    if (!farm->events.measure || frame->measuring || frame->closing ||
        frame->state != FRAME_RENDERING || now_ns < frame->measure_next_ns ||
        !film_has_replicates(frame->film) ||
        (last && samples < FIGURES_GROWTH * (double)last->samples))
        return;
    if (farm->events.measure(farm->events.user, frame) == STATUS_OK) {
        frame->measuring = 1;
        frame->job->measurements++;
    } else {
        frame->measure_next_ns = now_ns + 10 * FIGURES_INTERVAL_MS * NS_PER_MS;
    }
}

static void frame_measured(struct farm *farm, struct job_frame *frame, const struct history_point *point,
                           uint64_t cost_ns, uint64_t now_ns)
{
    frame->measuring = 0;
    frame->measure_next_ns = now_ns + FIGURES_COST_SHARE * cost_ns;
    if (frame->measure_next_ns < now_ns + FIGURES_INTERVAL_MS * NS_PER_MS)
        frame->measure_next_ns = now_ns + FIGURES_INTERVAL_MS * NS_PER_MS;
    if (point) {
        history_add(&frame->history, point);
        farm->events.job_changed(farm->events.user, frame->job);
    }
    farm_frame_advance(farm, frame, now_ns); /* it waits for its place in the history */
}

void figures_measured(struct farm *farm, struct job *job, uint32_t number,
                      const struct history_point *point, uint64_t cost_ns, uint64_t now_ns)
{
    struct job_frame *frame = farm_frame_find(job, number);

    assert(job->measurements > 0);
    job->measurements--;
    if (job->removed)
        farm_job_dispose(farm, job);
    else if (frame && frame->measuring)
        frame_measured(farm, frame, point, cost_ns, now_ns);
}

void figures_finished(struct farm *farm, struct job *job, uint32_t frame,
                      const struct history_point *point)
{
    (void)farm;
    if (point && !job_figures_note(&job->figures, frame - job->first_frame, job_frame_count(job),
                                   point))
        log_warn("job %llu, frame %u: out of memory: its figures are only in the store",
                 (unsigned long long)job->id, frame);
}

/* ---- questions ------------------------------------------------------------------------------ */

void figures_curve(const struct job_frame *frame, enum allocation_measure measure,
                   struct accuracy_curve *out)
{
    struct accuracy_point points[HISTORY_MAX];

    for (uint32_t i = 0; i < frame->history.count; i++) {
        const struct history_point *p = &frame->history.points[i];
        points[i] = target_point(&p->figures, p->core_s, measure);
    }
    accuracy_curve_fit(out, points, frame->history.count);
}

/* The smaller of two costs, either of which may be unknown. */
static double sooner(double a, double b)
{
    return a < 0 || (b >= 0 && b < a) ? b : a;
}

double figures_whole_s(const struct job_frame *frame)
{
    const struct stop_rules *rules = &frame->job->stop;
    double whole_ns = eta_whole_ns(&frame->eta, frame->film), whole_s = whole_ns / 1e9;
    double left_ns = eta_left_ns(&frame->eta, frame->film);
    struct accuracy_curve curve;

    if (!stop_has_rounds(rules) && left_ns >= 0) /* the wanted samples are all that will be rendered
                                                    */
        whole_s = frame->spent.core_s + left_ns / 1e9;
    if (rules->has_target) {
        figures_curve(frame, rules->target.measure, &curve);
        if (curve.points > 0)
            whole_s = sooner(whole_s,
                             accuracy_curve_cost(&curve, target_error(&rules->target)).value);
        else if (film_spp(frame->film) == SETTINGS_SPP_MAX)
            whole_s = -1;
    }
    if (rules->core_limit_ms > 0)
        whole_s = sooner(whole_s, (double)rules->core_limit_ms / 1e3 +
                                      (double)frame->clock.from_cpu_ns / 1e9);
    return whole_ns < 0 ? -1 : whole_s;
}

/* Of one open frame, if nothing else is rendered; negative: not known. */
static double frame_seconds(const struct job_frame *frame, double whole_s, double cpu_s)
{
    double left_s = (whole_s - frame->spent.core_s) / cpu_s;
    double limit_s = (double)frame->job->stop.time_limit_ms / 1e3;
    double passed_s = frame->spent.wall_s - (double)frame->clock.from_active_ns / 1e9;

    if (whole_s < 0)
        return limit_s > 0 ? fmax(limit_s - passed_s, 0) : -1;
    if (limit_s > 0 && limit_s - passed_s < left_s)
        left_s = limit_s - passed_s;
    return fmax(left_s, 0);
}

double figures_seconds_left(const struct job *job)
{
    double cpu_s = throughput_of(&job->throughput), left_s = 0, each_s = -1;
    double limit_s = (double)job->stop.time_limit_ms / 1e3;
    uint32_t open = 0;

    if (job->state != JOB_STATE_RUNNING || job->leases == 0 || cpu_s <= 0)
        return -1;
    if (job->frames_done_count > 0 && job->figures.core_s > 0)
        each_s = job->figures.core_s / job->frames_done_count / cpu_s;
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next) {
        double whole_s = figures_whole_s(frame), seconds = frame_seconds(frame, whole_s, cpu_s);
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

double figures_efficiency(const struct job *job)
{
    double error = job_figures_mean(&job->figures, job_frame_count(job));

    if (!(error > 0) || job->figures.core_s <= 0 || job->frames_done_count == 0)
        return NAN;
    return job->frames_done_count / (error * error * job->figures.core_s);
}
