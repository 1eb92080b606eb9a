/* azulejo estimate: what a picture's accuracy will cost, from its own first passes. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "client/command.h"
#include "client/figures_view.h"
#include "client/job_info.h"
#include "client/local.h"
#include "client/signals.h"
#include "client/submission.h"
#include "client/table.h"
#include "client/watch.h"
#include "common/accuracy/target.h"
#include "common/base/memory.h"
#include "protocol/message.h"

enum { PILOT_SPP = 16, POINTS_MAX = 64 };

/* Errors of the table, in display codes. */
static const double table_errors[] = {20, 10, 5, 3, 2, 1, 0.5};

struct estimate {
    const char *scene_path, *by, *price_text;
    struct job_options options;
    struct local_options local;
    int64_t pilot_spp;
    int json, quiet;
    double price;                        /* of a core-hour; negative: none was given */
    double seconds_to_deadline;          /* negative: none was given */
    int has_target;
    struct allocation_target target;
    uint32_t spp, frames;                /* of the job that is estimated */
    struct job_request request;
    struct import_result scene;
    char *name;
    struct local_farm *farm;
    struct connection *connection;
    uint64_t job;
    Azulejo__Wire__Envelope *last, *history;
    struct accuracy_curve curve, target_curve;
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
                         "--price %s: must be what an hour of one core costs, as in 0.04/core-hour",
                         text);
    return STATUS_OK;
}

/* "18:00": the next time that it is, in local time. */
static status parse_deadline(const char *text, double *out, struct error *err)
{
    time_t now = time(NULL), then;
    unsigned hour, minute;
    struct tm local;
    int used = 0;

    *out = -1;
    if (!text)
        return STATUS_OK;
    if (sscanf(text, "%2u:%2u%n", &hour, &minute, &used) != 2 || text[used] || hour > 23 ||
        minute > 59 || !localtime_r(&now, &local))
        return error_set(err, STATUS_ERR_USAGE, "--by %s: must be a time of day, as in 18:00", text);
    local.tm_hour = (int)hour;
    local.tm_min = (int)minute;
    local.tm_sec = 0;
    then = mktime(&local);
    if (then <= now) {
        local.tm_mday++;
        then = mktime(&local);
    }
    *out = difftime(then, now);
    return STATUS_OK;
}

/* The pilot is the job's own first passes, of its first frame, at its full size. */
static status prepare(struct estimate *e, struct error *err)
{
    status result = parse_price(e->price_text, &e->price, err);

    if (result == STATUS_OK)
        result = parse_deadline(e->by, &e->seconds_to_deadline, err);
    if (result == STATUS_OK)
        result = job_options_check(&e->options, &e->request, err);
    if (result != STATUS_OK)
        return result;
    e->name = submission_name(e->scene_path);
    if (!e->name)
        return error_no_memory(err, "a name");
    result = submission_prepare(e->scene_path, &e->options, e->quiet, &e->request, &e->scene, err);
    if (result != STATUS_OK)
        return result;
    e->has_target = e->request.stop.has_target;
    e->target = e->request.stop.target;
    e->spp = e->request.settings.spp;
    e->frames = e->request.last_frame - e->request.first_frame + 1;
    memset(&e->request.stop, 0, sizeof e->request.stop);
    e->request.last_frame = e->request.first_frame;
    if (e->request.settings.spp > e->pilot_spp)
        e->request.settings.spp = (uint32_t)e->pilot_spp;
    return signals_catch(err);
}

/* ---- the pilot ------------------------------------------------------------------------------- */

static void fit(const struct estimate *e, enum allocation_measure measure, struct accuracy_curve *out)
{
    const Azulejo__Wire__History *h = e->history->history;
    struct accuracy_point points[POINTS_MAX];
    size_t count = 0;

    for (size_t i = 0; i < h->n_points && count < POINTS_MAX; i++) {
        const Azulejo__Wire__HistoryPoint *p = h->points[i];
        struct accuracy_figures f = {.known = p->figures != NULL};
        if (p->figures)
            f = (struct accuracy_figures){
                .known = 1, .display_error = p->figures->display,
                .display_lo = p->figures->display_low, .display_hi = p->figures->display_high,
                .psnr_db = p->figures->psnr_db, .psnr_lo = p->figures->psnr_low,
                .psnr_hi = p->figures->psnr_high, .rmse_percent = p->figures->rmse_percent,
                .rmse_lo = p->figures->rmse_low, .rmse_hi = p->figures->rmse_high};
        points[count++] = target_point(&f, p->core_seconds, measure);
    }
    accuracy_curve_fit(out, points, count);
}

static status run_pilot(struct estimate *e, struct error *err)
{
    const Azulejo__Wire__JobInfo *info;
    status result = connection_open(&e->connection, local_farm_address(e->farm), err);

    if (result != STATUS_OK)
        return result;
    connection_set_watch(e->connection, local_farm_check, e->farm);
    result = submission_send(e->connection, &e->scene, &e->request, e->name, OUTPUT_FORMAT_EXR,
                             e->quiet, &e->job, err);
    if (result == STATUS_OK)
        result = watch_job(e->connection, e->job, e->quiet, 0, &e->last, err);
    if (result != STATUS_OK)
        return result;
    info = job_list_find(e->last->job_list, e->job);
    result = job_info_verdict(info, err);
    if (result == STATUS_OK)
        result = history_query(e->connection, e->job, e->request.first_frame, &e->history, err);
    if (result == STATUS_OK && (!info->now || !info->now->figures))
        result = error_set(err, STATUS_ERR_INPUT,
                           "--pilot-spp %u: too few samples tell nothing of the error: at least 4",
                           e->request.settings.spp);
    return result;
}

/* ---- what it says ---------------------------------------------------------------------------- */

struct row {
    double error;                        /* display codes; NaN: of another measure */
    struct accuracy_estimate core_s;     /* of all frames */
};

static double cores_here(const struct estimate *e)
{
    const Azulejo__Wire__HistoryPoint *now = job_list_find(e->last->job_list, e->job)->now;

    return now->wall_seconds > 0 ? now->core_seconds / now->wall_seconds : 0;
}

static struct accuracy_estimate of_all_frames(const struct estimate *e, struct accuracy_estimate one)
{
    return (struct accuracy_estimate){one.value * e->frames, one.lo * e->frames, one.hi * e->frames};
}

/* Core-seconds of the cap: proportional to the samples. */
static struct accuracy_estimate cap_cost(const struct estimate *e)
{
    const Azulejo__Wire__HistoryPoint *now = job_list_find(e->last->job_list, e->job)->now;
    double one = now->core_seconds * e->spp / e->request.settings.spp;

    return (struct accuracy_estimate){one, one, one};
}

static json_t *row_json(const struct estimate *e, const struct row *row)
{
    json_t *out = json_object();

    json_object_set_new(out, "display", json_number(row->error));
    json_object_set_new(out, "core_seconds", json_number(row->core_s.value));
    json_object_set_new(out, "core_seconds_low", json_number(row->core_s.lo));
    json_object_set_new(out, "core_seconds_high", json_number(row->core_s.hi));
    json_object_set_new(out, "price", e->price >= 0
                                          ? json_number(row->core_s.value / 3600 * e->price)
                                          : json_null());
    json_object_set_new(out, "cores_needed", e->seconds_to_deadline > 0
                                                 ? json_number(row->core_s.value / e->seconds_to_deadline)
                                                 : json_null());
    return out;
}

static void print_row(const struct estimate *e, struct table *table, const char *label,
                      const struct row *row)
{
    char text[FORMAT_SIZE];
    double cores = cores_here(e);

    table_add(table, "%s", label);
    table_add(table, "%s", figures_time_text(text, row->core_s.value));
    table_add(table, "%s", figures_time_text(text, row->core_s.lo));
    table_add(table, "%s", figures_time_text(text, row->core_s.hi));
    table_add(table, "%s", figures_time_text(text, cores > 0 ? row->core_s.value / cores : NAN));
    if (e->price >= 0)
        table_add(table, "%.*f", row->core_s.value / 3600 * e->price < 1 ? 4 : 2,
                  row->core_s.value / 3600 * e->price);
    else
        table_add(table, "-");
    if (e->seconds_to_deadline > 0)
        table_add(table, "%.0f", ceil(row->core_s.value / e->seconds_to_deadline));
    else
        table_add(table, "-");
}

static size_t make_rows(const struct estimate *e, struct row *rows)
{
    size_t count = 0;

    for (size_t i = 0; i < sizeof table_errors / sizeof *table_errors; i++)
        rows[count++] = (struct row){
            table_errors[i], of_all_frames(e, accuracy_curve_cost(&e->curve, table_errors[i]))};
    return count;
}

static struct row target_row(const struct estimate *e)
{
    return (struct row){e->target.measure == ALLOCATION_DISPLAY ? e->target.value : NAN,
                        of_all_frames(e, accuracy_curve_cost(&e->target_curve,
                                                             target_error(&e->target)))};
}

static struct row cap_row(const struct estimate *e)
{
    struct accuracy_estimate one = cap_cost(e);

    return (struct row){accuracy_curve_error(&e->curve, one.value).value, of_all_frames(e, one)};
}

static status print_json(const struct estimate *e, struct error *err)
{
    const Azulejo__Wire__JobInfo *info = job_list_find(e->last->job_list, e->job);
    struct row rows[8], target = target_row(e), cap = cap_row(e);
    size_t count = make_rows(e, rows);
    json_t *out = json_object(), *curve = json_array();

    for (size_t i = 0; i < count; i++)
        json_array_append_new(curve, row_json(e, &rows[i]));
    json_object_set_new(out, "pilot", job_info_json(info));
    json_object_set_new(out, "history", history_json(e->history->history));
    json_object_set_new(out, "frames", json_integer(e->frames));
    json_object_set_new(out, "exponent", json_number(accuracy_curve_exponent(&e->curve).value));
    json_object_set_new(out, "cores", json_number(cores_here(e)));
    json_object_set_new(out, "curve", curve);
    json_object_set_new(out, "target", e->has_target ? row_json(e, &target) : json_null());
    json_object_set_new(out, "cap", e->has_target ? json_null() : row_json(e, &cap));
    return json_print(out, err);
}

static status print_text(const struct estimate *e, struct error *err)
{
    static const char *const titles[] = {">ERROR",     ">CORE TIME", ">LEAST", ">MOST",
                                         ">TIME HERE", ">PRICE",     ">CORES BY THEN"};
    const Azulejo__Wire__JobInfo *info = job_list_find(e->last->job_list, e->job);
    struct accuracy_estimate b = accuracy_curve_exponent(&e->curve);
    struct buffer line = BUFFER_INIT;
    struct row rows[8], last = e->has_target ? target_row(e) : cap_row(e);
    size_t count = make_rows(e, rows);
    char text[FORMAT_SIZE], label[STOP_TEXT_SIZE + 32], target[STOP_TEXT_SIZE];
    struct table table;
    status result;

    buffer_printf(&line, "%u samples a pixel, %s of core time: ", e->request.settings.spp,
                  figures_time_text(text, info->now->core_seconds));
    figures_describe(&line, info->now->figures);
    printf("  %-10s  %s\n", "pilot", buffer_text(&line));
    buffer_clear(&line);
    figures_describe_word(&line, info->now->figures, info->error_effects);
    printf("  %-10s  %s\n", "", buffer_text(&line));
    buffer_release(&line);
    printf("  %-10s  error falls as core time to the power -%.2f (%.2f to %.2f); %u frame%s\n", "curve",
           b.value, b.lo, b.hi, e->frames, e->frames == 1 ? "" : "s");
    table_init(&table, titles, sizeof titles / sizeof titles[0]);
    for (size_t i = 0; i < count; i++)
        print_row(e, &table, figures_display_text(text, rows[i].error), &rows[i]);
    if (e->has_target)
        snprintf(label, sizeof label, "target %s", stop_target_text(target, &e->target));
    else
        snprintf(label, sizeof label, "%u spp: %s", e->spp, figures_display_text(text, last.error));
    print_row(e, &table, label, &last);
    result = table_print(&table, err);
    table_release(&table);
    return result;
}

static status estimate(struct estimate *e, struct error *err)
{
    status result = prepare(e, err);

    if (result == STATUS_OK)
        result = local_farm_start(&e->farm, &e->local, err);
    if (result == STATUS_OK) {
        result = run_pilot(e, err);
        if (result != STATUS_OK)
            result = local_farm_explain(e->farm, result, err);
    }
    connection_close(e->connection);
    local_farm_stop(e->farm);
    if (result != STATUS_OK)
        return result;
    fit(e, ALLOCATION_DISPLAY, &e->curve);
    fit(e, e->target.measure, &e->target_curve);
    return e->json ? print_json(e, err) : print_text(e, err);
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    struct estimate e = {.options = JOB_OPTIONS_INIT, .pilot_spp = PILOT_SPP};
    int64_t workers = 1, threads = 0;
    int done;
    const struct option table[] = {
        {"by", 0, OPTION_STRING, &e.by, "HH:MM",
         "also say how many cores would have the frames ready by this time of day", 0, 0, NULL},
        {"price", 0, OPTION_STRING, &e.price_text, "PRICE/core-hour",
         "also say what it costs at this price, as in 0.04/core-hour", 0, 0, NULL},
        {"pilot-spp", 0, OPTION_INT, &e.pilot_spp, "N",
         "samples a pixel that are rendered for the estimate (default 16)", 4, 65536, NULL},
        JOB_STUDY_ROWS(e.options),
        {"target-error", 0, OPTION_STRING, &e.options.stop.target, "ERROR",
         "say what this error costs, as in 2/255, 1% or 45dB (default: what --spp costs)", 0, 0, NULL},
        {"workers", 'w', OPTION_INT, &workers, "N", "worker processes (default 1)", 1,
         LOCAL_WORKERS_MAX, NULL},
        {"threads", 'j', OPTION_INT, &threads, "N",
         "threads of each worker (default: the processors, shared out)", 1, 1024, NULL},
        {"json", 0, OPTION_FLAG, &e.json, NULL, "print JSON", 0, 0, NULL},
        {"quiet", 'q', OPTION_FLAG, &e.quiet, NULL, "no progress and no warnings", 0, 0, NULL},
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result = command_parse(command,
                                  tonemap_options_table(&e.options.output.tone, table, rows), argc,
                                  argv, 1, 1, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    e.scene_path = rest.items[0];
    e.local.workers = (unsigned)workers;
    e.local.threads = (unsigned)threads;
    result = estimate(&e, err);
    message_free(e.history);
    message_free(e.last);
    import_result_release(&e.scene);
    job_request_release(&e.request);
    mem_free(e.name);
    return result;
}

const struct command command_estimate = {
    .name = "estimate",
    .group = COMMAND_RENDER,
    .usage = "azulejo estimate SCENE [OPTION]...",
    .summary = "say what a picture's accuracy will cost",
    .description =
        "Render the first passes of a job's first frame at its full size on this machine, and say what the\n"
        "core time to each error is, what it costs, and how many cores would meet a time of day.",
    .run = run,
};
