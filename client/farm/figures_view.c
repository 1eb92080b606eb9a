#include "client/farm/figures_view.h"

#include <math.h>
#include <stdio.h>

#include "client/terminal/table.h"
#include "common/accuracy/word.h"
#include "protocol/message.h"

/* ---- words ----------------------------------------------------------------------------------- */

const char *figures_display_text(char out[FORMAT_SIZE], double display)
{
    if (!(display >= 0) || !isfinite(display))
        snprintf(out, FORMAT_SIZE, "?");
    else if (display == floor(display))
        snprintf(out, FORMAT_SIZE, "%.0f/255", display);
    else
        snprintf(out, FORMAT_SIZE, "%.*f/255", display < 0.995 ? 2 : display < 9.95 ? 1 : 0,
                 display);
    return out;
}

struct time_unit {
    const char *name;
    double seconds;
    int decimals;
};

static struct time_unit unit_of(double seconds)
{
    return seconds < 9.95           ? (struct time_unit){"s", 1, 1}
           : seconds < 99.5         ? (struct time_unit){"s", 1, 0}
           : seconds < 99.5 * 60    ? (struct time_unit){"min", 60, 0}
           : seconds < 36 * 3600.0  ? (struct time_unit){"h", 3600, 1}
           : seconds < 1000 * 86400.0 ? (struct time_unit){"d", 86400, 1}
                                    : (struct time_unit){"years", 365.25 * 86400, 0};
}

const char *figures_time_text(char out[FORMAT_SIZE], double seconds)
{
    struct time_unit unit = unit_of(seconds);

    if (!(seconds >= 0) || !isfinite(seconds))
        snprintf(out, FORMAT_SIZE, "?");
    else
        snprintf(out, FORMAT_SIZE, "%.*f %s", unit.decimals, seconds / unit.seconds, unit.name);
    return out;
}

struct accuracy_figures figures_get(const Azulejo__Wire__Figures *f)
{
    if (!f)
        return (struct accuracy_figures){.display_error = NAN, .top_share = NAN, .tail_index = NAN};
    return (struct accuracy_figures){.display_error = f->display, .top_share = f->top_share,
                                     .disagreement = f->disagreement, .unseen = f->unseen,
                                     .tail_index = f->tail_index, .lone = f->lone,
                                     .dark = f->dark, .known = 1,
                                     .reliable = f->reliable, .reasons = f->reasons};
}

void figures_describe(struct buffer *out, const Azulejo__Wire__Figures *f)
{
    char now[FORMAT_SIZE];

    buffer_printf(out, "%s", figures_display_text(now, f->display));
    if (f->display > 0)
        buffer_printf(out, " (%.2g to %.2g)", f->display_low, f->display_high);
    buffer_puts(out, " in 95 % of the pixels");
    if (isfinite(f->psnr_db))
        buffer_printf(out, ", %.1f dB", f->psnr_db);
    buffer_printf(out, ", RMSE %.2g %% of the mean", f->rmse_percent);
    if (f->rmse_percent > 0)
        buffer_printf(out, " (%.2g to %.2g)", f->rmse_low, f->rmse_high);
}

void figures_describe_word(struct buffer *out, const Azulejo__Wire__Figures *f, uint64_t effects)
{
    struct accuracy_figures figures = figures_get(f);
    char why[ACCURACY_WORDS_SIZE];

    buffer_puts(out, accuracy_word(&figures));
    if (!f->reliable)
        buffer_printf(out, ": %s", accuracy_reason_text(&figures, effects, why));
}

static void describe_forecast(struct buffer *out, const Azulejo__Wire__Forecast *f)
{
    char display[FORMAT_SIZE], time[FORMAT_SIZE];
    struct time_unit unit = unit_of(f->seconds);

    buffer_printf(out, "; %s %sin %s", figures_display_text(display, f->display),
                  f->at_end ? "at the end, " : "", figures_time_text(time, f->seconds));
    if (!f->at_end && f->seconds_high - f->seconds_low > 0.2 * f->seconds && isfinite(f->seconds_high))
        buffer_printf(out, " (%.*f to %.*f)", unit.decimals, f->seconds_low / unit.seconds,
                      unit.decimals, f->seconds_high / unit.seconds);
}

void figures_describe_curve(struct buffer *out, const Azulejo__Wire__JobInfo *job)
{
    char display[FORMAT_SIZE], time[FORMAT_SIZE];
    int printed = 0;

    if (!job->now || !job->now->figures)
        return;
    buffer_printf(out, "now %s after %s", figures_display_text(display, job->now->figures->display),
                  figures_time_text(time, job->now->wall_seconds));
    for (size_t i = 0; i < job->n_forecasts; i++)
        if (job->forecasts[i]->seconds >= 0) {
            describe_forecast(out, job->forecasts[i]);
            printed = 1;
        }
    if (printed && job->workers == 1)
        buffer_puts(out, " on this worker");
    else if (printed && job->workers > 1)
        buffer_printf(out, " on these %u workers", job->workers);
    if (!job->now->figures->reliable)
        buffer_puts(out, " (may be understated)");
}

static void print_line(FILE *file, const char *label, const struct buffer *text)
{
    if (buffer_ok(text))
        fprintf(file, "  %-10s  %s\n", label, buffer_text(text));
}

static void print_error(FILE *file, const Azulejo__Wire__JobInfo *job)
{
    struct buffer line = BUFFER_INIT;

    if (job->last_frame > job->first_frame)
        buffer_printf(&line, "frame %u: ", job->now_frame);
    figures_describe(&line, job->now->figures);
    print_line(file, "error", &line);
    buffer_clear(&line);
    figures_describe_word(&line, job->now->figures, job->error_effects);
    print_line(file, "", &line);
    buffer_release(&line);
}

void figures_print(FILE *file, const Azulejo__Wire__JobInfo *job)
{
    char a[FORMAT_SIZE], b[FORMAT_SIZE];
    struct buffer line = BUFFER_INIT;

    if (job->now && job->now->figures)
        print_error(file, job);
    if (job->last_frame > job->first_frame && isfinite(job->worst)) {
        buffer_printf(&line, "worst frame %u: %s", job->worst_frame,
                      figures_display_text(a, job->worst));
        if (isfinite(job->flicker))
            buffer_printf(&line, "; change from frame %u to %u: %s", job->flicker_frame,
                          job->flicker_frame + 1, figures_display_text(b, job->flicker));
        print_line(file, "frames", &line);
        buffer_clear(&line);
    }
    if (job->n_forecasts > 0)
        figures_describe_curve(&line, job);
    if (line.size > 0)
        print_line(file, "accuracy", &line);
    buffer_release(&line);
    if (isfinite(job->efficiency))
        fprintf(file, "  %-10s  %.3g = 1 / (codes^2 x core-seconds)\n", "efficiency",
                job->efficiency);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

static json_t *point_json(const Azulejo__Wire__HistoryPoint *p)
{
    json_t *out = json_object();
    const Azulejo__Wire__Figures *f = p->figures;

    json_object_set_new(out, "samples", json_integer((json_int_t)p->samples));
    json_object_set_new(out, "rays", json_integer((json_int_t)p->rays));
    json_object_set_new(out, "core_seconds", json_number(p->core_seconds));
    json_object_set_new(out, "wall_seconds", json_number(p->wall_seconds));
    if (!f)
        return out;
    json_object_set_new(out, "display", json_number(f->display));
    json_object_set_new(out, "display_low", json_number(f->display_low));
    json_object_set_new(out, "display_high", json_number(f->display_high));
    json_object_set_new(out, "psnr_db", json_number(f->psnr_db));
    json_object_set_new(out, "psnr_low", json_number(f->psnr_low));
    json_object_set_new(out, "psnr_high", json_number(f->psnr_high));
    json_object_set_new(out, "rmse_percent", json_number(f->rmse_percent));
    json_object_set_new(out, "rmse_low", json_number(f->rmse_low));
    json_object_set_new(out, "rmse_high", json_number(f->rmse_high));
    json_object_set_new(out, "top_share", json_number(f->top_share));
    json_object_set_new(out, "tail_index", json_number(f->tail_index));
    json_object_set_new(out, "reliable", json_boolean(f->reliable));
    return out;
}

static json_t *error_json(const Azulejo__Wire__JobInfo *job)
{
    struct accuracy_figures figures;
    char why[ACCURACY_WORDS_SIZE];
    json_t *out;

    if (!job->now || !job->now->figures)
        return json_null();
    out = point_json(job->now);
    figures = figures_get(job->now->figures);
    json_object_set_new(out, "frame", json_integer(job->now_frame));
    json_object_set_new(out, "transform", json_text(job->error_transform));
    json_object_set_new(out, "word", json_string(accuracy_word(&figures)));
    json_object_set_new(out, "reason",
                        figures.reliable
                            ? json_null()
                            : json_string(accuracy_reason_text(&figures, job->error_effects, why)));
    return out;
}

static json_t *frame_error_json(double display, uint32_t frame)
{
    if (!isfinite(display))
        return json_null();
    return json_pack("{s:I, s:f}", "frame", (json_int_t)frame, "display", display);
}

static json_t *known_seconds(double seconds)
{
    return seconds >= 0 ? json_number(seconds) : json_null();
}

static json_t *forecasts_json(const Azulejo__Wire__JobInfo *job)
{
    json_t *out = json_array();

    for (size_t i = 0; i < job->n_forecasts; i++) {
        const Azulejo__Wire__Forecast *f = job->forecasts[i];
        json_array_append_new(out, json_pack("{s:o, s:o, s:o, s:o, s:o, s:b}", "display",
                                             json_number(f->display), "core_seconds",
                                             json_number(f->core_seconds), "seconds",
                                             known_seconds(f->seconds), "seconds_low",
                                             known_seconds(f->seconds_low), "seconds_high",
                                             known_seconds(f->seconds_high), "at_end",
                                             (int)f->at_end));
    }
    return out;
}

void figures_json(json_t *root, const Azulejo__Wire__JobInfo *job)
{
    json_object_set_new(root, "error", error_json(job));
    json_object_set_new(root, "worst_error", frame_error_json(job->worst, job->worst_frame));
    json_object_set_new(root, "flicker", frame_error_json(job->flicker, job->flicker_frame));
    json_object_set_new(root, "forecasts", forecasts_json(job));
    json_object_set_new(root, "efficiency", json_number(job->efficiency));
    json_object_set_new(root, "cores", json_number(job->cores));
}

/* ---- history --------------------------------------------------------------------------------- */

status history_query(struct connection *c, uint64_t job, uint32_t frame,
                     Azulejo__Wire__Envelope **out, struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__HistoryGet get = AZULEJO__WIRE__HISTORY_GET__INIT;

    get.job = job;
    get.frame = frame;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_HISTORY_GET;
    envelope.history_get = &get;
    return connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_HISTORY, out, err);
}

json_t *history_json(const Azulejo__Wire__History *history)
{
    json_t *out = json_array();

    for (size_t i = 0; i < history->n_points; i++)
        json_array_append_new(out, point_json(history->points[i]));
    return out;
}

status history_print(const Azulejo__Wire__History *history, struct error *err)
{
    static const char *const titles[] = {">CORE", ">TIME", ">SAMPLES", ">ERROR", ">LOW", ">HIGH",
                                         ">PSNR", ">RMSE", "WORD"};
    struct table table;
    char text[FORMAT_SIZE];
    status result;

    table_init(&table, titles, sizeof titles / sizeof titles[0]);
    for (size_t i = 0; i < history->n_points; i++) {
        const Azulejo__Wire__HistoryPoint *p = history->points[i];
        const Azulejo__Wire__Figures *f = p->figures;
        table_add(&table, "%s", figures_time_text(text, p->core_seconds));
        table_add(&table, "%s", figures_time_text(text, p->wall_seconds));
        table_add(&table, "%s", format_count(text, (double)p->samples));
        table_add(&table, "%s", figures_display_text(text, f ? f->display : NAN));
        table_add(&table, "%s", figures_display_text(text, f ? f->display_low : NAN));
        table_add(&table, "%s", figures_display_text(text, f ? f->display_high : NAN));
        table_add(&table, "%.1f dB", f ? f->psnr_db : NAN);
        table_add(&table, "%.3g %%", f ? f->rmse_percent : NAN);
        table_add(&table, "%s", !f ? "?" : f->reliable ? "reliable" : "may be understated");
    }
    result = table_print(&table, err);
    table_release(&table);
    return result;
}
