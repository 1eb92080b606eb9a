#include "coordinator/report.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

#include "common/base/clock.h"
#include "protocol/message.h"

enum {
    ERROR_AGE_MS = 1000,   /* a frame's error estimate is computed anew after this long, */
    ERROR_COST_SHARE = 20, /* or after so many times what computing it took */
};

/* Do the pictures that are made again wait for the environment? */
static int explain_pictures(char *out, size_t size, const struct job *job)
{
    if (!trouble_is(&job->pictures) || job->pictures.next_ns == UINT64_MAX)
        return 0;
    snprintf(out, size, "the picture of %s; trying again", job->pictures.text);
    return 1;
}

/* Would a restart forget the state that the job is in? */
static int is_unsaved(const struct farm *farm, const struct job *job)
{
    return trouble_is(&farm->trouble) &&
           (job->unsaved || store_job_unsaved(farm->store, job->id));
}

/* What keeps an active job from getting on at the moment; empty when nothing does. */
static void explain_wait(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    char why[256] = "";
    uint32_t able = 0;
    size_t before = queue_position(&farm->queue, job);

    out[0] = 0;
    if (job->state == JOB_STATE_PARKED) {
        snprintf(out, size, "%s", job->state_text);
        return;
    }
    if (trouble_is(&farm->trouble)) {
        snprintf(out, size, "%swaits: the store cannot be used: %s; trying again",
                 job->state == JOB_STATE_CANCELLING && is_unsaved(farm, job) ? "not stored yet; " : "",
                 farm->trouble.text);
        return;
    }
    for (const struct job_frame *frame = job->frames; frame; frame = frame->next) {
        if (trouble_is(&frame->trouble)) {
            snprintf(out, size, "%s; trying again", frame->trouble.text);
            return;
        }
    }
    if (trouble_is(&job->trouble)) {
        snprintf(out, size, "%s; trying again", job->trouble.text);
        return;
    }
    if (job->state == JOB_STATE_CANCELLING) {
        snprintf(out, size, "pictures are made of what is rendered");
        return;
    }
    if (explain_pictures(out, size, job))
        return;
    if (job->suspicion.deaths > 0) {
        snprintf(out, size,
                 "%u worker%s died with work of it in hand; it is lent to one at a time until a "
                 "result comes",
                 job->suspicion.deaths, job->suspicion.deaths == 1 ? "" : "s");
        return;
    }
    if (job->leases > 0)
        return;
    if (job->frames_done_count == job_frame_count(job)) {
        snprintf(out, size, "its last pictures are being tone mapped");
        return;
    }
    for (uint32_t i = 0; i < farm->worker_count; i++) {
        if (farm_can_serve(job, farm->workers[i], why, sizeof why)) {
            able++;
            break;
        }
    }
    if (farm->worker_count == 0)
        snprintf(out, size, "waits: no worker is connected");
    else if (able == 0)
        snprintf(out, size, "waits: none of the %u workers can render it; of one: %s",
                 farm->worker_count, why);
    else if (before > 0)
        snprintf(out, size, "waits behind %zu job%s", before, before == 1 ? "" : "s");
}

/* How a job ended. */
static void explain_end(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    if (is_unsaved(farm, job))
        snprintf(out, size, "%.255s%snot stored yet: %.200s", job->state_text,
                 job->state_text[0] ? "; " : "", farm->trouble.text);
    else if (!explain_pictures(out, size, job))
        snprintf(out, size, "%s", job->state_text);
}

/* Computing the estimate reads the whole film: not at every question. */
static double frame_error(struct job_frame *frame, uint64_t now_ns)
{
    uint64_t begin_ns;

    if (frame->error_next_ns && now_ns < frame->error_next_ns)
        return frame->error;
    begin_ns = clock_monotonic_ns();
    frame->error = film_error(frame->film);
    frame->error_next_ns = now_ns + ERROR_AGE_MS * NS_PER_MS +
                           ERROR_COST_SHARE * (clock_monotonic_ns() - begin_ns);
    return frame->error;
}

static void report_progress(Azulejo__Wire__JobInfo *info, struct job *job, uint64_t now_ns)
{
    struct job_frame *first = job->frames;

    info->frames_done = job->frames_done_count;
    info->frames_developed = job->frames_developed_count;
    info->revision = job->revision;
    if (job->pictures.next_ns == UINT64_MAX)
        info->develop_error = job->pictures.text;
    info->samples_done = job->samples_done;
    info->samples_total = job_frame_samples(job) * job_frame_count(job);
    for (const struct job_frame *frame = first; frame; frame = frame->next)
        info->samples_done += film_samples(frame->film);
    info->relative_mse = job->relative_mse;
    if (first) {
        double error = frame_error(first, now_ns);
        if (!isnan(error) || job->frames_done_count == 0)
            info->relative_mse = error;
        info->preview_frame = first->number;
        info->preview_ready = film_covered(first->film);
    } else {
        info->preview_frame = job->state == JOB_STATE_DONE ? job->last_frame : job->first_frame;
        info->preview_ready = job->state == JOB_STATE_DONE && job->output.png;
    }
    info->samples_per_second =
        !job_state_is_open(job->state) ? 0 : rate_per_second(&job->rate, now_ns);
    info->seconds_left = -1;
    if (job->state == JOB_STATE_DONE)
        info->seconds_left = 0;
    else if (info->samples_per_second > 0)
        info->seconds_left =
            (double)(info->samples_total - info->samples_done) / info->samples_per_second;
    info->seconds_active = job_active_seconds(job, now_ns);
}

static void report_cuts(struct job_report *report, Azulejo__Wire__JobInfo *info,
                        const struct job *job)
{
    size_t count = job->cut_count < REPORT_CUT_FRAMES_MAX ? job->cut_count : REPORT_CUT_FRAMES_MAX;

    for (size_t i = 0; i < count; i++) {
        Azulejo__Wire__CutFrame cut = AZULEJO__WIRE__CUT_FRAME__INIT;
        cut.frame = job->cuts[i].frame;
        cut.samples = job->cuts[i].coverage.samples;
        cut.samples_min = job->cuts[i].coverage.least;
        cut.samples_max = job->cuts[i].coverage.most;
        cut.tiles = job->cuts[i].coverage.tiles;
        cut.tiles_empty = job->cuts[i].coverage.tiles_empty;
        cut.end = (Azulejo__Wire__FrameEnd)job->cuts[i].end;
        report->cuts[i] = cut;
        report->cut_pointers[i] = &report->cuts[i];
    }
    info->n_cut_frames = count;
    info->cut_frames = report->cut_pointers;
}

static uint32_t workers_on(const struct farm *farm, const struct job *job)
{
    static uint64_t round;
    uint32_t count = 0;

    round++;
    for (const struct lease *lease = farm->leases.oldest; lease; lease = lease->newer) {
        if (lease->frame->job != job || lease->holder->counted == round)
            continue;
        lease->holder->counted = round;
        count++;
    }
    return count;
}

static void report_work(struct job_report *report, const struct job *job)
{
    struct unit_work work = job->work;

    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        unit_work_add(&work, film_work(frame->film));
    wire_work_set(&report->work, &work);
}

void job_report_make(struct job_report *report, const struct farm *farm, struct job *job,
                     uint64_t now_ns)
{
    Azulejo__Wire__JobInfo info = AZULEJO__WIRE__JOB_INFO__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;
    Azulejo__Wire__RenderStats stats = AZULEJO__WIRE__RENDER_STATS__INIT;

    report->settings = settings;
    wire_settings_set(&report->settings, &job->settings);
    wire_stop_set(&report->stop, &job->stop);
    wire_output_set(&report->output, &job->output);
    stats.cpu_ns = job->stats.cpu_ns;
    stats.trace_ns = job->stats.trace_ns;
    report->stats = stats;
    report_work(report, job);
    if (job_state_ended(job->state))
        explain_end(report->state_text, sizeof report->state_text, farm, job);
    else
        explain_wait(report->state_text, sizeof report->state_text, farm, job);

    info.job = job->id;
    info.name = job->name;
    info.state = (Azulejo__Wire__JobState)job->state;
    info.state_text = report->state_text;
    info.priority = job->priority;
    info.first_frame = job->first_frame;
    info.last_frame = job->last_frame;
    info.settings = &report->settings;
    info.stop = &report->stop;
    info.output = &report->output.message;
    wire_digest_set(&info.scene, &job->scene);
    info.scene_name = job->scene_name;
    info.stats = &report->stats;
    info.work = &report->work;
    info.submitted_at = job->submitted_at;
    info.finished_at = job->finished_at;
    info.conflicts = job->conflicts;
    info.workers = job->leases ? workers_on(farm, job) : 0;
    report_cuts(report, &info, job);
    report_progress(&info, job, now_ns);
    report->message = info;
}
