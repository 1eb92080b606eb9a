/* azulejo estimate: what a job's accuracy will cost, from its own first passes. */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/views/estimate.h"
#include "client/follow/figures_view.h"
#include "client/follow/job_info.h"
#include "client/link/local.h"
#include "client/link/signals.h"
#include "client/farm/submission.h"
#include "client/farm/trial.h"
#include "client/follow/watch.h"
#include "client/farm/verb.h"
#include "client/terminal/moment.h"
#include "client/terminal/must.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "common/system/shell.h"
#include "protocol/message.h"

enum { PILOT_SPP = 16 };

struct pilot {
    const char *scene_path, *by, *price_text, *name;
    struct job_options options;
    struct local_options local;
    struct connection_options where;
    int on_farm;
    int64_t pilot_spp;
    int json, quiet;
    struct job_request request;
    struct import_result scene;
    char *default_name;
    struct local_farm *farm;
    struct connection *connection;
    uint64_t job;
    Azulejo__Wire__Envelope *last;
    struct buffer command; /* that continues from it */
    struct estimate estimate;
};

/* ---- options --------------------------------------------------------------------------------- */

/* "0.04/core-hour", or the number alone. */
static status parse_price(const char *text, double *out, struct error *err)
{
    char *end;

    *out = -1;
    if (!text)
        return STATUS_OK;
    *out = strtod(text, &end);
    if (end == text || !(*out >= 0) || !isfinite(*out) || (*end && strcmp(end, "/core-hour") != 0))
        return error_set(err, STATUS_ERR_USAGE,
                         "--price %s: must be the price of one core for an hour, as in 0.04/core-hour", text);
    return STATUS_OK;
}

static status parse_deadline(const char *text, double *out, struct error *err)
{
    int64_t now = clock_wall_s(), then;
    status result;

    *out = -1;
    if (!text)
        return STATUS_OK;
    result = moment_parse("--by", text, now, &then, err);
    *out = (double)(then - now);
    return result;
}

/* The first, the middle and the last. */
static size_t choose_frames(uint32_t first, uint32_t last, uint32_t out[ESTIMATE_FRAMES_MAX])
{
    uint32_t middle = first + (last - first) / 2;
    size_t count = 0;

    out[count++] = first;
    if (middle != first)
        out[count++] = middle;
    if (last != middle)
        out[count++] = last;
    return count;
}

/* The pilot is the job's own first passes, of a few of its frames, at its full size. */
static status prepare(struct pilot *p, struct error *err)
{
    struct job_request *request = &p->request;
    struct estimate *estimate = &p->estimate;
    status result = parse_price(p->price_text, &estimate->price, err);

    THEN(result, parse_deadline(p->by, &estimate->seconds_to_deadline, err));
    THEN(result, job_options_check(&p->options, request, err));
    THEN(result, job_request_one_range(request, err));
    if (result != STATUS_OK)
        return result;
    p->default_name = must(submission_name(p->scene_path));
    TRY(submission_prepare(p->scene_path, &p->options, p->quiet, request, &p->scene, err));
    estimate->has_target = request->stop.has_target;
    estimate->target = request->stop.target;
    estimate->spp = request->settings.spp;
    estimate->frame_count = request->last_frame - request->first_frame + 1;
    memset(&request->stop, 0, sizeof request->stop);
    if (request->settings.spp > p->pilot_spp)
        request->settings.spp = (uint32_t)p->pilot_spp;
    estimate->pilot_spp = request->settings.spp;
    request->output.tonemap.temporal = 1; /* most of the frames to average are not rendered */
    request->output.tonemap.denoise_around = 0;
    request->estimate = 1;
    return signals_catch(err);
}

/* ---- the pilot ------------------------------------------------------------------------------- */

/* The user no longer waits for it. A failure here does not concern the user. */
static void give_up(struct pilot *p)
{
    Azulejo__Wire__Envelope *answer = NULL;
    struct error ignored = {0};

    connection_set_watch(p->connection, NULL, NULL);
    if (verb_ask(p->connection, p->job, VERB_DISCARD, NULL, &answer, &ignored) == STATUS_OK)
        message_free(answer);
}

static status render_pilot(struct pilot *p, struct error *err)
{
    uint32_t frames[ESTIMATE_FRAMES_MAX];
    struct estimate *estimate = &p->estimate;
    struct job_accepted accepted = {0};
    status result;

    estimate->count = choose_frames(p->request.first_frame, p->request.last_frame, frames);
    if (estimate->count < estimate->frame_count) {
        const struct frame_choice ends = {.first_middle_last = 1};
        TRY(frame_choice_of(&ends, p->request.first_frame, p->request.last_frame, &p->request.frames, err));
    }
    result = submission_send(p->connection, &p->scene, &p->request, p->name ? p->name : p->default_name,
                             OUTPUT_FORMAT_EXR, p->quiet, &accepted, err);
    p->job = accepted.job;
    THEN(result, watch_job(p->connection, p->job, p->quiet, 0, &p->last, err));
    if (result != STATUS_OK && p->job && p->on_farm && signals_stop())
        give_up(p);
    if (result != STATUS_OK)
        return result;
    estimate->info = job_list_find(p->last->job_list, p->job);
    result = job_info_verdict(estimate->info, err);
    for (size_t i = 0; i < estimate->count && result == STATUS_OK; i++) {
        estimate->frames[i].number = frames[i];
        result = history_query(p->connection, p->job, frames[i], &estimate->frames[i].history, err);
    }
    return result == STATUS_OK ? estimate_check(estimate, err) : result;
}

/* The workers of this farm now. */
static status count_workers(struct pilot *p, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__WorkerQuery query = AZULEJO__WIRE__WORKER_QUERY__INIT;
    Azulejo__Wire__Envelope *answer = NULL;

    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_WORKER_QUERY;
    envelope.worker_query = &query;
    TRY(connection_ask(p->connection, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_WORKER_LIST, &answer, err));
    for (size_t i = 0; i < answer->worker_list->n_workers; i++) {
        const Azulejo__Wire__WorkerInfo *worker = answer->worker_list->workers[i];
        p->estimate.workers += !worker->note[0];
        p->estimate.cores += worker->note[0] ? 0 : worker->threads;
    }
    message_free(answer);
    return STATUS_OK;
}

static status run_local(struct pilot *p, struct error *err)
{
    status result;

    TRY(local_farm_start(&p->farm, &p->local, err));
    result = connection_open(&p->connection, local_farm_address(p->farm), err);
    if (result == STATUS_OK) {
        connection_set_watch(p->connection, local_farm_check, p->farm);
        result = render_pilot(p, err);
    }
    if (result != STATUS_OK)
        result = local_farm_explain(p->farm, result, err);
    if (result == STATUS_OK) {
        const Azulejo__Wire__HistoryPoint *now = p->estimate.info->now;
        p->estimate.cores = now && now->wall_seconds > 0 ? now->core_seconds / now->wall_seconds : 0;
    }
    return result;
}

static status run_on_farm(struct pilot *p, struct error *err)
{
    status result;

    TRY(connection_open(&p->connection, &p->where, err));
    connection_set_watch(p->connection, trial_interrupted, NULL);
    result = render_pilot(p, err);
    THEN(result, count_workers(p, err));
    p->estimate.command = buffer_text(&p->command);
    return result;
}

/* ---- the command that goes on ---------------------------------------------------------------- */

/* Is it an option that only this command has? 2: with its value in the next word. */
static int is_own_option(const char *word)
{
    static const char *const with_value[] = {"--by", "--price", "--pilot-spp"};

    for (size_t i = 0; i < sizeof with_value / sizeof *with_value; i++) {
        size_t length = strlen(with_value[i]);
        if (strncmp(word, with_value[i], length) == 0 && (!word[length] || word[length] == '='))
            return word[length] ? 1 : 2;
    }
    return strcmp(word, "--json") == 0 || strcmp(word, "--quiet") == 0 || strcmp(word, "-q") == 0;
}

static void make_command(struct pilot *p, int argc, char *const *argv)
{
    buffer_puts(&p->command, "azulejo submit");
    for (int i = 1; i < argc; i++) {
        int own = is_own_option(argv[i]);
        if (!own)
            shell_word(&p->command, argv[i]);
        i += own == 2;
    }
    must_hold(&p->command);
}

static status estimate(struct pilot *p, struct error *err)
{
    status result = prepare(p, err);

    THEN(result, p->on_farm ? run_on_farm(p, err) : run_local(p, err));
    connection_close(p->connection);
    local_farm_stop(p->farm);
    if (result != STATUS_OK)
        return result;
    estimate_fit(&p->estimate);
    if (p->json)
        return estimate_print_json(&p->estimate, err);
    estimate_print_text(&p->estimate);
    return STATUS_OK;
}

static void pilot_release(struct pilot *p)
{
    for (size_t i = 0; i < ESTIMATE_FRAMES_MAX; i++)
        message_free(p->estimate.frames[i].history);
    message_free(p->last);
    buffer_release(&p->command);
    import_result_release(&p->scene);
    job_request_release(&p->request);
    mem_free(p->default_name);
}

/* A farm is used if a coordinator is named, unless options for local workers are given. */
static int farm_is_named(const struct pilot *p, int64_t workers, int64_t threads)
{
    const char *named = getenv("AZULEJO_COORDINATOR");

    return p->where.coordinator || (named && *named && workers == 0 && threads == 0);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct pilot e = {.options = JOB_OPTIONS_INIT, .where = CONNECTION_OPTIONS_INIT,
                      .pilot_spp = PILOT_SPP, .command = BUFFER_INIT};
    int64_t workers = 0, threads = 0;
    const char *out = NULL;
    int done;
    const struct option table[] = {
        {"by", 0, OPTION_STRING, &e.by, "TIME",
         "also print how many cores would finish the frames by then: 18:00, '2026-03-01 18:00', or 2h from now", 0, 0, NULL},
        {"price", 0, OPTION_STRING, &e.price_text, "PRICE/core-hour",
         "also print the cost at this price, as in 0.04/core-hour", 0, 0, NULL},
        {"pilot-spp", 0, OPTION_INT, &e.pilot_spp, "N",
         "samples a pixel to render for the estimate (default 16)", 4, 65536, NULL},
        JOB_STUDY_ROWS(e.options),
        {"target-error", 0, OPTION_STRING, &e.options.stop.said[STOP_target].text, "ERROR",
         "print what this error costs, as in 2/255, 1% or 45dB (default: the cost of --spp)", 0, 0,
         NULL},
        {"name", 0, OPTION_STRING, &e.name, "NAME",
         "the job's name on a farm (default: the scene file's)", 0, 0, NULL},
        {"output", 'o', OPTION_STRING, &out, "OUT",
         "not for this command, which writes no files; until 0.2.0 it was --name", 0, 0, NULL},
        {"workers", 'w', OPTION_INT, &workers, "N", "worker processes on this machine (default 1)",
         1, LOCAL_WORKERS_MAX, NULL},
        {"threads", 'j', OPTION_INT, &threads, "N",
         "threads of each worker (default: the processors, shared out)", 1, 1024, NULL},
        {"json", 0, OPTION_FLAG, &e.json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &e.quiet, NULL, "no progress and no warnings", 0, 0, NULL},
        CONNECTION_OPTION_ROWS(e.where),
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result = command_parse(command, tonemap_options_table(&e.options.output.tone, table, rows), argc, argv, 1, 1,
                                  &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (out)
        return error_set(err, STATUS_ERR_USAGE, "-o %s: an estimate writes no files; --name %s names its job", out,
                         out);
    e.scene_path = rest.items[0];
    e.on_farm = farm_is_named(&e, workers, threads);
    if (e.on_farm && (workers > 0 || threads > 0))
        return error_set(err, STATUS_ERR_USAGE,
                         "--workers and --threads are for this machine: leave them out, or "
                         "--coordinator");
    e.local.workers = workers ? (unsigned)workers : 1;
    e.local.threads = (unsigned)threads;
    make_command(&e, argc, argv);
    result = estimate(&e, err);
    pilot_release(&e);
    return result;
}

const struct command command_estimate = {
    .name = "estimate",
    .group = COMMAND_RENDER,
    .usage = "azulejo estimate SCENE [OPTION]...",
    .summary = "estimate what a picture's accuracy will cost",
    .description =
        "Render the first passes of a few of a job's frames at their full size, and say what the core time to\n"
        "each error is, what it costs, and how many cores would meet a time of day. With --coordinator, or\n"
        "AZULEJO_COORDINATOR, a farm renders them, and the same job goes on from them when it is submitted there;\n"
        "else this machine does.",
    .run = run,
};
