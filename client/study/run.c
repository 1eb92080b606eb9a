#include "client/study/run.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "client/study/against.h"
#include "client/study/data/study_words.h"
#include "client/terminal/must.h"
#include "common/accuracy/word.h"
#include "common/system/clock.h"
#include "protocol/message.h"

static double passed_s(const struct study_run *run)
{
    return (double)(clock_monotonic_ns() - run->started_ns) / (double)NS_PER_SECOND;
}

double run_left_s(const struct study_run *run) { return run->budget_s - passed_s(run); }

double run_picture_s(const struct study_run *run, uint32_t spp)
{
    return run->job_overhead_s + run->wall_per_sample_s * spp;
}

/* A job's wall-clock time is a constant plus a time for each sample. Both are learnt from the usual
 * way only: the others have times of their own. */
static void learn(struct study_run *run, double wall_s, const struct trial *t)
{
    if (run->steps > 0)
        return;
    if (run->jobs++ == 0) {
        run->first_s = t->wall_s;
        run->first_samples = t->samples;
    }
    run->jobs_s += wall_s;
    run->jobs_samples += t->samples;
    run->wall_per_sample_s = t->samples > run->first_samples
                                 ? fmax(0, (t->wall_s - run->first_s) / (t->samples - run->first_samples))
                                 : t->wall_s / t->samples;
    run->job_overhead_s = fmax(0, (run->jobs_s - run->wall_per_sample_s * run->jobs_samples) / run->jobs);
}

static void show_progress(struct study_run *run, const char *what, uint32_t spp)
{
    struct buffer text = BUFFER_INIT;
    double fraction = fmin(1, fmax(0, passed_s(run) / run->budget_s));

    if (run->steps)
        buffer_printf(&text, "%zu of %zu, ", run->steps_done + 1, run->steps);
    buffer_printf(&text, "%s, %u samples", what, spp);
    if (run->study->points.count && !run->steps) {
        buffer_puts(&text, ", now ");
        words_codes(&text, study_last_point(run->study)->codes.value);
    }
    progress_draw(&run->progress, fraction, buffer_text(&text));
    buffer_release(&text);
}

static void say_no_worker(void *user)
{
    struct study_run *run = user;

    progress_draw(&run->progress, fmin(1, fmax(0, passed_s(run) / run->budget_s)),
                  "the farm has no worker: waiting for one (Ctrl-C keeps what is measured)");
}

/* The usual way's picture, again: how fast is the machine now? */
static status run_probe(struct study_run *run, struct error *err)
{
    const struct trial_waiting waiting = {say_no_worker, run};
    struct job_request mine = *run->request;
    struct trial probe = {0};
    status result;

    mine.settings.spp = run->probe_spp;
    mine.settings.seed = run->request->settings.seed + RUN_WAYS_SEED;
    show_progress(run, "the usual way again", run->probe_spp);
    result = trial_render(run->connection, run->scene, &mine, run->name, &waiting, &probe, err);
    if (result == STATUS_OK)
        study_clock_probe(&run->clock, probe.core_s);
    trial_release(&probe);
    return result;
}

status run_pair(struct study_run *run, const struct job_request *request, uint32_t spp, uint64_t first_seed,
                const char *what, struct trial pair[2], struct error *err)
{
    const struct trial_waiting waiting = {say_no_worker, run};
    struct job_request mine = *request;
    status result = STATUS_OK;

    mine.settings.spp = spp;
    for (unsigned i = 0; i < 2 && result == STATUS_OK; i++) {
        const uint64_t begun_ns = clock_monotonic_ns();
        show_progress(run, what, spp);
        mine.settings.seed = first_seed + i;
        result = trial_render(run->connection, run->scene, &mine, run->name, &waiting, &pair[i], err);
        if (result == STATUS_OK)
            learn(run, (double)(clock_monotonic_ns() - begun_ns) / (double)NS_PER_SECOND, &pair[i]);
        if (result == STATUS_OK && i == 0 && run->probe_spp)
            result = run_probe(run, err);
    }
    if (result == STATUS_OK)
        study_clock_pair(&run->clock, pair[0].core_s, pair[1].core_s);
    run->study->clock_noise = study_clock_noise(&run->clock);
    return result;
}

struct study_interval seeds_of(double a, double b)
{
    return (struct study_interval){(a + b) / 2, fmin(a, b), fmax(a, b)};
}

void run_point_set(struct study_point *p, const struct trial pair[2])
{
    const struct accuracy_figures *f = pair_judge(&pair[0].figures, &pair[1].figures);
    char reason[ACCURACY_WORDS_SIZE];

    *p = (struct study_point){
        .core_s = (pair[0].core_s + pair[1].core_s) / 2, .wall_s = (pair[0].wall_s + pair[1].wall_s) / 2,
        .samples = pair[0].samples, .rays = (pair[0].rays + pair[1].rays) / 2,
        .psnr_db = NAN, .codes = {NAN, NAN, NAN}, .rmse = {NAN, NAN, NAN}, .relmse = {NAN, NAN, NAN},
        .flip = {NAN, NAN, NAN}, .seeds = seeds_of(pair[0].figures.display_error, pair[1].figures.display_error),
        .reliable = f->reliable, .top_share = f->top_share};
    if (!f->reliable)
        study_text_set(&p->reason, accuracy_reason_text(f, pair[0].effects, reason));
}

void run_point_error(struct study_point *p, const struct pair_error *e)
{
    p->codes = e->codes;
    p->rmse = e->rmse;
    p->psnr_db = e->rms_codes > 0 ? 20 * log10(255 / e->rms_codes) : NAN;
}

status run_point_reference(const struct study_run *run, struct study_point *p, const struct image *a,
                           const struct image *b, struct error *err)
{
    return run->reference ? against_reference(&p->relmse, &p->flip, &run->shown, run->reference, a, b, err) : STATUS_OK;
}

/* ---- the study's head ----------------------------------------------------------------------- */

static void set_transform(struct study *s, const struct tonemap_settings *t)
{
    char text[160];

    snprintf(text, sizeof text, "%s, %+.2f EV, sRGB", t->op->name, t->exposure_ev);
    study_text_set(&s->transform, text);
}

static void set_head(struct study_run *run)
{
    struct study *s = run->study;
    const struct render_settings *settings = &run->request->settings;
    static const char release[] = "azulejo " AZULEJO_VERSION;
    const time_t now = (time_t)clock_wall_s();
    char date[32] = "";
    struct tm when;

    s->width = settings->width;
    s->height = settings->height;
    s->seed = (double)settings->seed;
    if (gmtime_r(&now, &when))
        strftime(date, sizeof date, "%Y-%m-%d", &when);
    study_text_set(&s->date, date);
    /* A continued study already has the worker's description. */
    if (!s->version || strncmp(s->version, release, sizeof release - 1) != 0)
        study_text_set(&s->version, release);
    set_transform(s, &run->request->output.tonemap);
}

static void set_machine(struct study *s)
{
    struct buffer text = BUFFER_INIT;

    buffer_puts(&text, s->workers.items[0].name);
    if (s->workers.count > 1)
        buffer_printf(&text, " and %zu more", s->workers.count - 1);
    must_hold(&text);
    study_text_set(&s->machine, buffer_text(&text));
    buffer_release(&text);
}

/* The workers, once one has delivered. */
static status set_workers(struct study_run *run, struct error *err)
{
    Azulejo__Wire__Envelope question = AZULEJO__WIRE__ENVELOPE__INIT, *answer = NULL;
    Azulejo__Wire__WorkerQuery query = AZULEJO__WIRE__WORKER_QUERY__INIT;
    struct study *s = run->study;

    question.body_case = AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY;
    question.worker_query = &query;
    if (s->workers.count)
        return STATUS_OK;
    TRY(connection_ask(run->connection, &question, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, &answer, err));
    s->cores = 0;
    /* Of a farm of thousands the first ones are listed. */
    for (size_t i = 0; i < answer->worker_list->n_workers && i < STUDY_LIST_MAX; i++) {
        const Azulejo__Wire__WorkerInfo *w = answer->worker_list->workers[i];
        struct study_worker *row = study_add_worker(s);
        row->cores = w->threads;
        s->cores += w->threads;
        study_text_set(&row->name, w->host);
        if (i == 0) /* all have the same, or get no work */
            study_text_set(&s->version, w->kernel);
    }
    if (s->workers.count)
        set_machine(s);
    message_free(answer);
    return STATUS_OK;
}

status study_run_check(const struct study *s, const struct job_request *request, const char *scene, struct error *err)
{
    const struct render_settings *r = &request->settings;

    if (s->scene && strcmp(s->scene, scene) != 0)
        return error_set(err, STATUS_ERR_USAGE, "--continue: the study belongs to %s, not to %s", s->scene, scene);
    if (s->width != (double)r->width || s->height != (double)r->height)
        return error_set(err, STATUS_ERR_USAGE, "--continue: the study's pictures have %gx%g pixels; give --size %gx%g",
                         s->width, s->height, s->width, s->height);
    if (s->seed != (double)r->seed)
        return error_set(err, STATUS_ERR_USAGE, "--continue: the study's seed is %.0f; give --seed %.0f", s->seed,
                         s->seed);
    return STATUS_OK;
}

status study_run(struct study_run *run, struct error *err)
{
    status result = STATUS_OK;

    set_head(run);
    run->started_ns = clock_monotonic_ns();
    progress_init(&run->progress, run->quiet);
    /* A study that has choices has its main curve. */
    if (run->study->questions.count == 0)
        result = run_main(run, err);
    THEN(result, set_workers(run, err));
    THEN(result, run_choices(run, err));
    progress_clear(&run->progress);
    for (size_t i = 0; i < RUN_POINTS_MAX; i++)
        for (size_t k = 0; k < 2; k++)
            image_release(&run->pairs[i][k]);
    image_release(&run->usual);
    return result;
}
