#include "coordinator/steering/report.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/farm/forecast.h"
#include "coordinator/pictures/measure.h"
#include "coordinator/farm/roster.h"
#include "coordinator/steering/steer.h"
#include "coordinator/farm/waiting.h"
#include "protocol/message.h"

/* Is the remaking of pictures waiting because of a failure of the environment? */
static int explain_pictures(char *out, size_t size, const struct job *job)
{
    if (!trouble_is(&job->pictures) || job->pictures.next_ns == UINT64_MAX)
        return 0;
    snprintf(out, size, "the picture of %s; trying again", job->pictures.text);
    return 1;
}

/* Would a restart lose the job's present state? */
static int is_unsaved(const struct farm *farm, const struct job *job)
{
    return trouble_is(&farm->trouble) && (job->unsaved || store_job_unsaved(farm->store, job->id));
}

/* All workers that might render it were short of something for it when they were asked last. */
static int explain_shortage(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    const struct refusal *refusal = NULL;
    const struct farm_worker *worker = NULL;
    char why[256];
    uint32_t machines = 0;

    for (uint32_t i = 0; i < farm->worker_count && job->refusals.count > 0; i++) {
        const struct refusal *found = refusals_find(&job->refusals, farm->workers[i]->machine);
        if (found && !found->damaged && worker_takes_work(farm->workers[i])) {
            refusal = found;
            worker = farm->workers[i];
            machines++;
        } else if (worker_takes_work(farm->workers[i]) && farm_can_serve(job, farm->workers[i], why, sizeof why)) {
            return 0;
        }
    }
    if (machines > 0)
        snprintf(out, size, "waits: %s cannot render it at present, and is tried again: %s", worker->label,
                 refusal->shortage.text);
    if (machines > 1)
        snprintf(out, size, "waits: %u workers cannot render it at present, and are tried again; %s: %s", machines,
                 worker->label, refusal->shortage.text);
    return machines > 0;
}

/* It waits for workers, or for its turn. */
static void explain_workers(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    const struct farm_worker *held_back = NULL; /* of those that could render it, the first */
    char why[256] = "", unable[256] = "";
    uint32_t resting = 0, held_able = 0;

    for (uint32_t i = 0; i < farm->worker_count; i++) {
        const struct farm_worker *worker = farm->workers[i];
        int able = farm_can_serve(job, worker, why, sizeof why);
        if (able && worker_takes_work(worker)) {
            if (job->place.before > 0 && job->state != JOB_STATE_FINISHING)
                snprintf(out, size, "waits behind %zu job%s", job->place.before, job->place.before == 1 ? "" : "s");
            return;
        }
        resting += (uint32_t)!worker_takes_work(worker);
        held_able += (uint32_t)able;
        if (able && !held_back)
            held_back = worker;
        if (!able && worker_takes_work(worker))
            memcpy(unable, why, sizeof unable);
    }
    if (farm->worker_count == 0)
        snprintf(out, size, "waits: no worker is connected");
    else if (resting == farm->worker_count)
        snprintf(out, size, "waits: no worker takes work at present ('azulejo workers' says why)");
    else if (waiting_explain_workers(out, size, farm, job))
        return;
    else if (held_back) {
        worker_explain(held_back, why, sizeof why);
        snprintf(out, size, "waits: the %u worker%s that could render it take%s no work at present; %s: %s", held_able,
                 held_able == 1 ? "" : "s", held_able == 1 ? "s" : "", held_back->label, why);
    } else {
        snprintf(out, size, "waits: none of the %u workers can render it; of one: %s", farm->worker_count, unable);
    }
}

/* Open frames that need no more units. */
static uint32_t frames_ended(const struct job *job)
{
    uint32_t count = 0;

    for (const struct job_frame *frame = job->frames; frame; frame = frame->next)
        count += frame->end != FRAME_END_NONE;
    return count;
}

/* The reason why an active job makes no progress at the moment; empty if there is none. *until: the moment
 * that it waits for, if that is the reason. */
static void explain_wait(char *out, size_t size, int64_t *until, const struct farm *farm, const struct job *job)
{
    out[0] = 0;
    if (job->state == JOB_STATE_PARKED || job->state == JOB_STATE_PAUSED) {
        snprintf(out, size, "%s%.480s", is_unsaved(farm, job) ? "not stored yet; " : "", job->state_text);
        return;
    }
    if (trouble_is(&farm->trouble)) {
        snprintf(out, size, "%swaits: the store cannot be used: %s; trying again",
                 job->state != JOB_STATE_RUNNING && is_unsaved(farm, job) ? "not stored yet; " : "",
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
        snprintf(out, size, "pictures are being made of what is rendered");
        return;
    }
    if (explain_pictures(out, size, job))
        return;
    if (job->suspicion.deaths > 0) {
        snprintf(out, size,
                 "%u worker%s died while holding its work; it is lent to one worker at a time until a result comes",
                 job->suspicion.deaths, job->suspicion.deaths == 1 ? "" : "s");
        return;
    }
    if (job->state == JOB_STATE_FINISHING)
        snprintf(out, size, "frames in work complete their first pass, then it is done");
    if (explain_shortage(out, size, farm, job) || job->leases > 0)
        return;
    if (waiting_explain(out, size, farm, job)) {
        *until = job->needs.after_count == 0 ? job->needs.not_before : 0;
        return;
    }
    if (job->frames_done_count == job_frames_wanted(job)) {
        snprintf(out, size, "its last pictures are being tone mapped");
        return;
    }
    if (job->frames_done_count + frames_ended(job) == job_frames_wanted(job)) {
        snprintf(out, size, "its last pictures are being made");
        return;
    }
    explain_workers(out, size, farm, job);
}

/* Of a job that is done. 0: its frames meet its target, as far as is known, or there is none. */
static int find_missed(const struct job *job, double *error, uint32_t *frame)
{
    uint32_t index = 0;

    if (job->state != JOB_STATE_DONE || !job->stop.has_target)
        return 0;
    *error = job_figures_missed(&job->figures, job_frame_count(job), &job->stop.target, &index);
    *frame = job->first_frame + index;
    return !isnan(*error);
}

/* "target missed: 46/255" */
static void explain_missed(char *out, size_t size, const struct job *job)
{
    struct allocation_target had = job->stop.target;
    char text[STOP_TEXT_SIZE], number[STOP_TEXT_SIZE], where[32] = "";
    uint32_t frame;
    double error;

    if (!find_missed(job, &error, &frame))
        return;
    snprintf(number, sizeof number, "%.2g", target_value(&had, error));
    had.value = strtod(number, NULL);
    if (job_frame_count(job) > 1)
        snprintf(where, sizeof where, "frame %u has ", frame);
    snprintf(out, size, "%starget missed: %s%s", job->state_text[0] ? "; " : "", where, stop_target_text(text, &had));
}

/* How a job ended. */
static void explain_end(char *out, size_t size, const struct farm *farm, const struct job *job)
{
    if (is_unsaved(farm, job))
        snprintf(out, size, "%.255s%snot stored yet: %.200s", job->state_text, job->state_text[0] ? "; " : "",
                 farm->trouble.text);
    else if (!explain_pictures(out, size, job)) {
        snprintf(out, size, "%s", job->state_text);
        explain_missed(out + strlen(out), size - strlen(out), job);
    }
}

static void report_progress(Azulejo__Wire__JobInfo *info, struct job *job, uint64_t now_ns)
{
    struct job_frame *first = job->frames;

    info->frames_done = job->frames_done_count;
    info->frames_developed = job->frames_developed_count;
    info->revision = job->revision;
    if (job->pictures.next_ns == UINT64_MAX)
        info->develop_error = job->pictures.text;
    info->samples_done = job->samples_done + job_closed_sum(job).samples;
    info->samples_total = job_frame_samples(job) * (job_frame_count(job) - job_frames_left(job));
    for (const struct job_frame *frame = first; frame; frame = frame->next)
        info->samples_done += film_samples(frame->film);
    if (first) {
        info->preview_frame = first->number;
        info->preview_ready = film_covered(first->film);
        info->preview_covered = film_covered_share(first->film);
    } else {
        info->preview_frame = job->state == JOB_STATE_DONE ? job->last_frame : job->first_frame;
        info->preview_ready = job->state == JOB_STATE_DONE && job->output.png;
        info->preview_covered = job->state == JOB_STATE_DONE;
    }
    info->samples_per_second = !job_state_is_open(job->state) ? 0 : rate_per_second(&job->rate, now_ns);
    info->done_share = forecast_share(job);
    info->seconds_left = job->state == JOB_STATE_DONE ? 0 : forecast_seconds_left(job);
    info->seconds_active = job_active_seconds(job, now_ns);
}

static void report_cuts(struct job_report *report, Azulejo__Wire__JobInfo *info, const struct job *job)
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
        if (job->cuts[i].end == FRAME_END_TARGET && job->stop.has_target &&
            job_figures_misses(&job->figures, cut.frame - job->first_frame, &job->stop.target))
            cut.end = AZULEJO__WIRE__FRAME_END__FRAME_END_MISSED;
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

    if (job->leases == 0)
        return 0;
    round++;
    for (const struct lease *lease = farm->leases.oldest; lease; lease = lease->newer) {
        if (lease->frame->job != job || lease->holder->counted == round)
            continue;
        lease->holder->counted = round;
        count++;
    }
    return count;
}

/* The display errors to predict, below the present one. */
static const double round_errors[] = {20, 10, 5, 3, 2, 1, 0.5, 0.2, 0.1};

static void forecast_add(struct job_report *report, Azulejo__Wire__JobInfo *info, double display,
                         const struct accuracy_estimate *core_s, double spent_core_s, int at_end)
{
    Azulejo__Wire__Forecast *f = &report->forecasts[info->n_forecasts];

    azulejo__wire__forecast__init(f);
    f->display = display;
    f->core_seconds = core_s->value;
    f->seconds = f->seconds_low = f->seconds_high = -1;
    f->at_end = at_end;
    if (info->cores > 0) {
        f->seconds = fmax(core_s->value - spent_core_s, 0) / info->cores;
        f->seconds_low = fmax(core_s->lo - spent_core_s, 0) / info->cores;
        f->seconds_high = fmax(core_s->hi - spent_core_s, 0) / info->cores;
    }
    report->forecast_pointers[info->n_forecasts++] = f;
}

/* The next round error values below the present one, and the error at which the frame's rules end. */
static void report_forecasts(struct job_report *report, Azulejo__Wire__JobInfo *info, const struct job_frame *frame)
{
    double spent_s = frame->spent.core_s;
    struct accuracy_estimate at, whole = forecast_end(frame, info->cores);
    struct prices prices;
    size_t found = 0;

    forecast_prices(&frame->history, ALLOCATION_DISPLAY, &prices);
    if (prices.curve.points == 0)
        return;
    info->forecasts = report->forecast_pointers;
    at = prices_error(&prices, spent_s);
    for (size_t i = 0; i < sizeof round_errors / sizeof *round_errors && found < REPORT_FORECASTS_MAX - 1; i++) {
        struct accuracy_estimate core_s = prices_cost(&prices, round_errors[i]);
        if (round_errors[i] > 0.9 * at.value)
            continue;
        forecast_add(report, info, round_errors[i], &core_s, spent_s, 0);
        found++;
    }
    at = prices_error(&prices, whole.value);
    if (whole.value > spent_s && prices_are_known(at))
        forecast_add(report, info, at.value, &whole, spent_s, 1);
}

/* The pictures' errors, and the cost of reducing them. */
static void report_figures(struct job_report *report, Azulejo__Wire__JobInfo *info, const struct job *job)
{
    const struct job_frame *first = job->frames;
    const struct history_point *last = first ? history_last(&first->history) : NULL;
    uint32_t count = job_frame_count(job), index = 0;
    double error;

    info->now_frame = first ? first->number : job->first_frame + job->figures.last_frame;
    if (!last && job->figures.last.figures.known) {
        last = &job->figures.last;
        info->now_frame = job->first_frame + job->figures.last_frame;
    }
    if (last) {
        wire_point_set(&report->now, last);
        info->now = &report->now.message;
    }
    info->error_slope = first ? history_slope(&first->history) : (double)NAN;
    measure_transform_text(&job->output.tonemap, report->transform);
    info->error_transform = report->transform;
    info->worst = job_figures_worst(&job->figures, count, &index);
    info->worst_frame = job->first_frame + index;
    index = 0;
    info->flicker = job_figures_flicker(&job->figures, count, &index);
    info->flicker_frame = job->first_frame + index;
    if (find_missed(job, &error, &info->missed_frame))
        info->missed = target_value(&job->stop.target, error);
    info->efficiency = forecast_efficiency(job);
    info->core_seconds = job->figures.core_s + job_closed_sum(job).core_s;
    for (const struct job_frame *frame = first; frame; frame = frame->next)
        info->core_seconds += (double)job_frame_cpu_ns(frame) / 1e9;
    info->error_effects = first && first->stats.effects ? first->stats.effects : job->stats.effects;
    info->cores = job->leases > 0 ? throughput_of(&job->throughput) : 0;
    if (first)
        report_forecasts(report, info, first);
}

/* 0: nothing is known. */
static int report_depth(Azulejo__Wire__EndedByDepth *out, const struct job *job, const struct unit_work *work)
{
    const struct depth_report depth = depth_light_report(&work->depth, work->samples, job->settings.max_depth);

    azulejo__wire__ended_by_depth__init(out);
    out->share = depth.share;
    out->deeper = depth.deeper;
    out->deeper_share = depth.deeper_share;
    return depth_light_is_known(&work->depth);
}

static void report_work(struct job_report *report, Azulejo__Wire__JobInfo *info, const struct job *job)
{
    struct unit_work work = job->work;

    for (const struct job_frame *frame = job->frames; frame; frame = frame->next) {
        struct unit_work more = film_work(frame->film);
        health_of_frame(&more.health, frame->number);
        unit_work_add(&work, &more);
    }
    info->work = wire_work_set(&report->work, &work);
    info->ended_by_depth = report_depth(&report->depth, job, &work) ? &report->depth : NULL;
}

/* Sums over results, which the wire's 32 bits may not hold: then all are scaled alike, as only shares matter. */
static void report_stats(struct job_report *report, const struct work_stats *sum)
{
    Azulejo__Wire__RenderStats stats = AZULEJO__WIRE__RENDER_STATS__INIT;
    uint64_t most = 0;

    stats.cpu_ns = sum->cpu_ns;
    stats.trace_ns = sum->trace_ns;
    stats.effects = sum->effects;
    stats.accounts = report->accounts;
    for (size_t i = 0; i < EFFECT_ACCOUNTS; i++)
        most = sum->accounts[i] > most ? sum->accounts[i] : most;
    for (size_t i = 0; i < EFFECT_ACCOUNTS; i++) {
        report->accounts[i] = (uint32_t)(sum->accounts[i] / (most / UINT32_MAX + 1));
        if (report->accounts[i] > 0)
            stats.n_accounts = i + 1;
    }
    report->stats = stats;
}

/* The numbers are the wire's. */
#define STATE(NAME, ...) \
    _Static_assert((int)AZULEJO__WIRE__JOB_STATE__JOB_##NAME == (int)JOB_STATE_##NAME, "azulejo.proto");
JOB_STATES(STATE)
#undef STATE

/* Films are kept or removed for a whole job (retention.h). */
static int has_films(const struct farm *farm, const struct job *job)
{
    for (uint64_t frame = job->first_frame; farm->store && frame <= job->last_frame; frame++)
        if (job_frame_is_done(job, (uint32_t)frame))
            return store_film_exists(farm->store, job->id, (uint32_t)frame);
    return 1;
}

static void report_verbs(struct job_report *report, Azulejo__Wire__JobInfo *info, const struct farm *farm,
                         const struct job *job)
{
    info->verbs = report->verbs;
    for (int v = 0; v < VERB_COUNT; v++)
        if (steer_offers(job, (enum job_verb_name)v) &&
            (v != VERB_EXTEND || job->state != JOB_STATE_DONE || has_films(farm, job)))
            report->verbs[info->n_verbs++] = (char *)job_verbs[v].name;
}

void job_report_make(struct job_report *report, struct farm *farm, struct job *job, uint64_t now_ns)
{
    Azulejo__Wire__JobInfo info = AZULEJO__WIRE__JOB_INFO__INIT;
    Azulejo__Wire__RenderSettings settings = AZULEJO__WIRE__RENDER_SETTINGS__INIT;

    (void)waiting_order(farm, now_ns); /* it says what a job waits for */
    report->settings = settings;
    wire_settings_set(&report->settings, &job->settings);
    wire_stop_set(&report->stop, &job->stop);
    wire_output_set(&report->output, &job->output);
    report_stats(report, &job->stats);
    report_work(report, &info, job);
    if (job_state_ended(job->state)) {
        explain_end(report->state_text, sizeof report->state_text, farm, job);
    } else {
        explain_wait(report->state_text, sizeof report->state_text, &info.waits_until, farm, job);
        info.queue_position = job->place.ready ? (uint32_t)job->place.before + 1 : 0;
    }

    info.job = job->id;
    info.name = job->name;
    info.state = (Azulejo__Wire__JobState)job->state;
    info.state_text = report->state_text;
    info.not_stored = is_unsaved(farm, job);
    info.priority = job->priority;
    info.first_frame = job->first_frame;
    info.last_frame = job->last_frame;
    info.settings = &report->settings;
    info.stop = &report->stop;
    info.output = &report->output.message;
    wire_digest_set(&info.scene, &job->scene);
    info.scene_name = job->scene_name;
    info.stats = &report->stats;
    info.submitted_at = job->submitted_at;
    info.finished_at = job->finished_at;
    info.estimate = job->estimate == ESTIMATE_OPEN;
    info.frames_resting = job_frames_left(job);
    info.finished_early = job->state == JOB_STATE_DONE && (job->marks & JOB_MARK_EARLY);
    info.owner = job->owner;
    info.comment = job->comment;
    info.n_after = job->needs.after_count;
    info.after = job->needs.after;
    info.not_before = job->needs.not_before;
    info.require = job->needs.require;
    info.memory = job->needs.memory;
    info.memory_said = job->needs.memory_said;
    info.by_schedule = job->schedule.size > 0;
#define OPTION(...)
#define SETTING(o, KIND, type, name, ...) info.name = job->needs.name;
    JOB_NEEDS(OPTION, SETTING, )
#undef OPTION
#undef SETTING
    info.conflicts = job->conflicts;
    info.workers = job->leases ? workers_on(farm, job) : 0;
    report_verbs(report, &info, farm, job);
    report_cuts(report, &info, job);
    report_progress(&info, job, now_ns);
    report_figures(report, &info, job);
    report->message = info;
}
