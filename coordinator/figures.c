#include "coordinator/figures.h"

#include <math.h>

#include "common/base/clock.h"
#include "common/base/log.h"

void figures_open(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    const struct history_point *last;
    struct error err = {0};

    eta_init(&frame->eta, frame->film);
    frame->opened_s = job_active_seconds(frame->job, now_ns);
    /* Without it only the times and the curve begin again. */
    if (farm->store && film_samples(frame->film) > 0 &&
        store_history_load(farm->store, frame->job->id, frame->number, &frame->history, &err) !=
            STATUS_OK)
        log_warn("job %llu, frame %u: %s", (unsigned long long)frame->job->id, frame->number,
                 err.text);
    last = history_last(&frame->history);
    if (last) {
        frame->spent.core_s = last->core_s;
        frame->spent.wall_s = last->wall_s;
    }
}

void figures_learn(struct job_frame *frame, uint32_t tile, uint64_t samples, uint64_t cpu_ns,
                   uint64_t now_ns)
{
    eta_learn(&frame->eta, tile, samples, cpu_ns);
    throughput_add(&frame->job->throughput, cpu_ns, now_ns);
    frame->spent.core_s += (double)cpu_ns / 1e9;
}

void figures_spend(struct job_frame *frame, uint64_t now_ns)
{
    double active_s = job_active_seconds(frame->job, now_ns);

    if (active_s > frame->opened_s)
        frame->spent.wall_s += active_s - frame->opened_s;
    frame->opened_s = active_s;
    frame->spent.samples = film_samples(frame->film);
    frame->spent.rays = film_rays(frame->film);
}

void figures_tick(struct farm *farm, struct job_frame *frame, uint64_t now_ns)
{
    const struct history_point *last = history_last(&frame->history);
    double samples = (double)film_samples(frame->film);

    if (frame->job->leases == 0)
        throughput_idle(&frame->job->throughput, now_ns);
    if (!farm->events.measure || frame->measuring || frame->closing ||
        frame->state != FRAME_RENDERING || now_ns < frame->measure_next_ns ||
        !film_has_replicates(frame->film) ||
        (last && samples < FIGURES_GROWTH * (double)last->samples))
        return;
    figures_spend(frame, now_ns);
    if (farm->events.measure(farm->events.user, frame) == STATUS_OK)
        frame->measuring = 1;
    else
        frame->measure_next_ns = now_ns + 10 * FIGURES_INTERVAL_MS * NS_PER_MS;
}

void figures_measured(struct farm *farm, struct job *job, uint32_t number,
                      const struct history_point *point, uint64_t cost_ns, uint64_t now_ns)
{
    struct job_frame *frame = farm_frame_find(job, number);

    if (!frame || !frame->measuring)
        return;
    frame->measuring = 0;
    frame->measure_next_ns = now_ns + FIGURES_COST_SHARE * cost_ns;
    if (frame->measure_next_ns < now_ns + FIGURES_INTERVAL_MS * NS_PER_MS)
        frame->measure_next_ns = now_ns + FIGURES_INTERVAL_MS * NS_PER_MS;
    if (point) {
        history_add(&frame->history, point);
        farm->events.job_changed(farm->events.user, job);
    }
    farm_frame_advance(farm, frame, now_ns); /* it waits for the place in the history */
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

double figures_seconds_left(const struct job *job)
{
    double cpu_s = throughput_of(&job->throughput), left_ns = 0, whole_ns = -1;
    uint32_t open = 0;

    if (job->state != JOB_STATE_RUNNING || job->leases == 0 || cpu_s <= 0)
        return -1;
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next) {
        double ns = eta_left_ns(&frame->eta, frame->film);
        if (ns < 0 && whole_ns >= 0)
            ns = whole_ns; /* it has only just begun: as long as the one before */
        if (ns < 0)
            return -1;
        left_ns += ns;
        if (eta_whole_ns(&frame->eta, frame->film) >= 0)
            whole_ns = eta_whole_ns(&frame->eta, frame->film);
        open++;
    }
    if (job->frames_done_count > 0 && job->figures.core_s > 0)
        whole_ns = job->figures.core_s * 1e9 / job->frames_done_count;
    if (whole_ns < 0)
        return -1;
    return (left_ns + whole_ns * (job_frame_count(job) - job->frames_done_count - open)) / 1e9 /
           cpu_s;
}

void figures_curve(const struct job_frame *frame, struct accuracy_curve *out)
{
    struct accuracy_point points[HISTORY_MAX];
    size_t count = 0;

    for (uint32_t i = 0; i < frame->history.count; i++) {
        const struct history_point *p = &frame->history.points[i];
        const struct accuracy_figures *f = &p->figures;
        if (f->known)
            points[count++] =
                (struct accuracy_point){p->core_s, f->display_error, f->display_lo, f->display_hi};
    }
    accuracy_curve_fit(out, points, count);
}

double figures_efficiency(const struct job *job)
{
    double error = job_figures_mean(&job->figures, job_frame_count(job));

    if (!(error > 0) || job->figures.core_s <= 0 || job->frames_done_count == 0)
        return NAN;
    return job->frames_done_count / (error * error * job->figures.core_s);
}
