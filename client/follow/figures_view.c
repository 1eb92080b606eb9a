#include "client/follow/figures_view.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/field.h"
#include "client/terminal/table.h"
#include "common/accuracy/price.h"
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
        snprintf(out, FORMAT_SIZE, "%.*f/255", display < 0.995 ? 2 : display < 9.95 ? 1 : 0, display);
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
                                     .dark = f->dark, .display_all = f->display_all, .worst_part = f->worst_part,
                                     .fireflies = f->fireflies, .subject = f->subject, .known = 1,
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
    if (f->worst_part > 0 && isfinite(f->worst_part))
        buffer_printf(out, "; worst part %.2g", f->worst_part);
    if (f->fireflies > 0)
        buffer_printf(out, ", %.0f firefl%s", f->fireflies, f->fireflies > 1 ? "ies" : "y");
}

void figures_describe_word(struct buffer *out, const Azulejo__Wire__Figures *f, uint64_t effects)
{
    struct accuracy_figures figures = figures_get(f);
    char why[ACCURACY_WORDS_SIZE];

    buffer_puts(out, accuracy_word(&figures));
    if (!f->reliable)
        buffer_printf(out, ": %s", accuracy_reason_text(&figures, effects, why));
    if (!accuracy_rmse_is_reliable(&figures))
        buffer_printf(out, "; the RMSE may be understated: %s", accuracy_rmse_reason_text(&figures, effects, why));
}

void figures_describe_both(struct buffer *out, const Azulejo__Wire__HistoryPoint *point)
{
    buffer_printf(out, "RMSE %.2g %% of the mean raw", point->figures->rmse_percent);
    if (point->denoised)
        buffer_printf(out, ", %.2g %% denoised", point->denoised->rmse_percent);
}

/* An interval is shown where it says something: neither a mere width of a figure, nor any time at all. */
enum interval { INTERVAL_NARROW, INTERVAL_TOLD, INTERVAL_TOO_WIDE };

static enum interval interval_of(const Azulejo__Wire__Forecast *f)
{
    struct accuracy_estimate left = {f->seconds, f->seconds_low, f->seconds_high};

    if (!(f->seconds_high - f->seconds_low > 0.2 * f->seconds))
        return INTERVAL_NARROW;
    return prices_are_known(left) ? INTERVAL_TOLD : INTERVAL_TOO_WIDE;
}

/* Of the forecasts the one at the end: a round number may never come. NULL: it is not known. */
static const Azulejo__Wire__Forecast *milestone_of(const Azulejo__Wire__JobInfo *job)
{
    for (size_t i = 0; i < job->n_forecasts; i++)
        if (job->forecasts[i]->at_end)
            return job->forecasts[i];
    return NULL;
}

static void describe_forecast(struct buffer *out, const Azulejo__Wire__Forecast *f, const Azulejo__Wire__Forecast *end)
{
    char text[FORMAT_SIZE];
    enum interval interval = interval_of(f);
    const char *when = f->at_end ? ", in" : end && f->display < end->display ? " would take" : " in";

    buffer_printf(out, "; %s%s", figures_display_text(text, f->display), f->at_end ? " at the end" : "");
    if (interval == INTERVAL_TOO_WIDE) {
        buffer_puts(out, ": too early to say when");
        return;
    }
    buffer_printf(out, "%s %s", when, figures_time_text(text, f->seconds));
    if (interval == INTERVAL_TOLD) {
        buffer_printf(out, " (%s to ", figures_time_text(text, f->seconds_low));
        buffer_printf(out, "%s)", figures_time_text(text, f->seconds_high));
    }
}

/* The clock then, from the time in work so far: "41 s", "1:26", "2.0 h". */
static const char *clock_after(char out[FORMAT_SIZE], const Azulejo__Wire__JobInfo *job, double seconds)
{
    double then_s = job->seconds_active + seconds;

    return then_s < 3600 ? format_duration(out, then_s) : figures_time_text(out, then_s);
}

/* A slope between these is none: noise falls with -0.5. */
#define STANDS 0.1

static int shows_arrows(void)
{
    static const char *const names[] = {"LC_ALL", "LC_CTYPE", "LANG"};

    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const char *value = getenv(names[i]);
        if (value && *value)
            return strstr(value, "UTF-8") || strstr(value, "utf8") || strstr(value, "UTF8");
    }
    return 0;
}

const char *figures_trend(double slope)
{
    if (isnan(slope) || !shows_arrows())
        return "";
    return slope < -STANDS ? "\xe2\x86\x98" : slope > STANDS ? "\xe2\x86\x97" : "\xe2\x86\x92";
}

/* What is left out to fit, more and more. */
enum detail { DETAIL_ALL, DETAIL_NO_INTERVAL, DETAIL_NO_NOW, DETAIL_NO_TIME, DETAIL_NO_MILESTONE, DETAIL_COUNT };

static void describe_milestone(struct buffer *out, const Azulejo__Wire__JobInfo *job, enum detail detail)
{
    const Azulejo__Wire__Forecast *f = milestone_of(job);
    char text[FORMAT_SIZE];

    if (!f || f->seconds < 0)
        return;
    buffer_printf(out, " -> %s", figures_display_text(text, f->display));
    if (interval_of(f) == INTERVAL_TOO_WIDE) {
        buffer_puts(out, detail < DETAIL_NO_INTERVAL ? " (too early to say when)" : "");
        return;
    }
    buffer_printf(out, " at %s", clock_after(text, job, f->seconds));
    if (interval_of(f) == INTERVAL_TOLD && detail < DETAIL_NO_INTERVAL) {
        buffer_printf(out, " (%s to ", clock_after(text, job, f->seconds_low));
        buffer_printf(out, "%s)", clock_after(text, job, f->seconds_high));
    }
}

static void describe_line(struct buffer *out, const Azulejo__Wire__JobInfo *job, enum detail detail)
{
    char text[FORMAT_SIZE];

    if (job->seconds_left >= 0 && detail < DETAIL_NO_TIME)
        buffer_printf(out, "%s left", format_duration(text, job->seconds_left));
    if (!job->now || !job->now->figures)
        return;
    buffer_printf(out, "%s%s%s%s%s", out->size > 0 ? "  " : "", figures_display_text(text, job->now->figures->display),
                  job->now->figures->reliable ? "" : "?", figures_trend(job->error_slope),
                  detail < DETAIL_NO_NOW ? " now" : "");
    if (detail < DETAIL_NO_MILESTONE)
        describe_milestone(out, job, detail);
}

void figures_describe_line(struct buffer *out, const Azulejo__Wire__JobInfo *job, size_t columns)
{
    struct buffer line = BUFFER_INIT;

    for (int detail = 0; detail < DETAIL_COUNT; detail++) {
        buffer_clear(&line);
        describe_line(&line, job, (enum detail)detail);
        if (line.size == 0 || text_columns(buffer_text(&line)) <= columns)
            break;
    }
    buffer_puts(out, buffer_text(&line));
    buffer_release(&line);
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
            describe_forecast(out, job->forecasts[i], milestone_of(job));
            printed = 1;
        }
    if (printed && job->workers == 1)
        buffer_puts(out, " on this worker");
    else if (printed && job->workers > 1)
        buffer_printf(out, " on these %u workers", job->workers);
    if (!job->now->figures->reliable)
        buffer_puts(out, " (may be understated)");
}

static void print_error(FILE *file, const Azulejo__Wire__JobInfo *job)
{
    struct buffer line = BUFFER_INIT;

    if (job->last_frame > job->first_frame)
        buffer_printf(&line, "frame %u: ", job->now_frame);
    figures_describe(&line, job->now->figures);
    field_print_phrases(file, "error", buffer_text(&line));
    if (job->now->denoised) {
        buffer_clear(&line);
        figures_describe_both(&line, job->now);
        if (job->now->denoised->rmse_percent > 0)
            buffer_printf(&line, " (%.2g to %.2g)", job->now->denoised->rmse_low, job->now->denoised->rmse_high);
        field_print_phrases(file, "denoised", buffer_text(&line));
    }
    buffer_clear(&line);
    figures_describe_word(&line, job->now->figures, job->error_effects);
    field_print(file, "", buffer_text(&line));
    buffer_release(&line);
}

void figures_print(FILE *file, const Azulejo__Wire__JobInfo *job)
{
    char a[FORMAT_SIZE], b[FORMAT_SIZE];
    struct buffer line = BUFFER_INIT;

    if (job->now && job->now->figures)
        print_error(file, job);
    if (job->last_frame > job->first_frame && isfinite(job->worst)) {
        buffer_printf(&line, "worst frame %u: %s", job->worst_frame, figures_display_text(a, job->worst));
        if (isfinite(job->flicker))
            buffer_printf(&line, "; change from frame %u to %u: %s", job->flicker_frame, job->flicker_frame + 1,
                          figures_display_text(b, job->flicker));
        field_print_phrases(file, "frames", buffer_text(&line));
        buffer_clear(&line);
    }
    if (job->n_forecasts > 0)
        figures_describe_curve(&line, job);
    if (line.size > 0)
        field_print_phrases(file, "accuracy", buffer_text(&line));
    buffer_clear(&line);
    buffer_printf(&line, "%.3g = 1/(codes^2 x core-seconds)", job->efficiency);
    if (isfinite(job->efficiency))
        field_print_phrases(file, "efficiency", buffer_text(&line));
    buffer_release(&line);
}

/* ---- history --------------------------------------------------------------------------------- */

status history_query(struct connection *c, uint64_t job, uint32_t frame, Azulejo__Wire__Envelope **out,
                     struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__HistoryGet get = AZULEJO__WIRE__HISTORY_GET__INIT;

    get.job = job;
    get.frame = frame;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_HISTORY_GET;
    envelope.history_get = &get;
    return connection_ask(c, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_HISTORY, out, err);
}

void history_print(const Azulejo__Wire__History *history)
{
    static const char *const titles[] = {">CORE", ">TIME", ">SAMPLES", ">ERROR", ">LOW", ">HIGH",
                                         ">PSNR", ">RMSE", "WORD"};
    struct table table;
    char text[FORMAT_SIZE];

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
    table_print(&table);
    table_release(&table);
}
