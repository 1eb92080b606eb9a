/* An estimate's report: a table of errors and their costs, for people and for programs. */
#include "client/views/estimate.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

#include "client/follow/figures_view.h"
#include "client/follow/job_info.h"
#include "client/terminal/table.h"
#include "common/accuracy/target.h"

enum { POINTS_MAX = 64 };

/* Errors of the table, in display codes. */
static const double table_errors[] = {20, 10, 5, 3, 2, 1, 0.5};
enum { ROWS = sizeof table_errors / sizeof *table_errors };

static void fit(const Azulejo__Wire__History *h, enum allocation_measure measure, struct prices *out)
{
    struct price_point points[POINTS_MAX];
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
        points[count++] = (struct price_point){p->core_seconds, (double)p->samples, (double)p->rays, p->uneven, f};
    }
    prices_fit(out, points, count, measure);
}

void estimate_fit(struct estimate *e)
{
    for (size_t i = 0; i < e->count; i++) {
        const Azulejo__Wire__History *history = e->frames[i].history->history;
        fit(history, ALLOCATION_DISPLAY, &e->frames[i].prices);
        fit(history, e->target.measure, &e->frames[i].target_prices);
    }
}

const Azulejo__Wire__HistoryPoint *estimate_point(const struct estimate_frame *frame)
{
    const Azulejo__Wire__History *h = frame->history->history;

    return h->n_points > 0 ? h->points[h->n_points - 1] : NULL;
}

status estimate_check(const struct estimate *e, struct error *err)
{
    for (size_t i = 0; i < e->count; i++) {
        const Azulejo__Wire__HistoryPoint *point = estimate_point(&e->frames[i]);
        if (!point || !point->figures)
            return error_set(err, STATUS_ERR_INPUT,
                             "--pilot-spp %u: too few samples to estimate the error: give at least 4", e->pilot_spp);
    }
    return STATUS_OK;
}

/* ---- rows ------------------------------------------------------------------------------------ */

struct row {
    double error;                    /* display codes; NaN: of another measure */
    struct accuracy_estimate core_s; /* of all frames */
};

static void row_add(struct row *row, const struct estimate *e, struct accuracy_estimate one)
{
    double share = (double)e->frame_count / (double)e->count; /* frames that this one represents */

    row->core_s.value += one.value * share;
    row->core_s.lo += one.lo * share;
    row->core_s.hi += one.hi * share;
}

static struct row error_row(const struct estimate *e, double error)
{
    struct row row = {.error = error};

    for (size_t i = 0; i < e->count; i++)
        row_add(&row, e, prices_cost(&e->frames[i].prices, error));
    return row;
}

static struct row target_row(const struct estimate *e)
{
    struct row row = {.error = e->target.measure == ALLOCATION_DISPLAY ? e->target.value : NAN};

    for (size_t i = 0; i < e->count; i++)
        row_add(&row, e, prices_target(&e->frames[i].target_prices, &e->target));
    return row;
}

/* Core-seconds of the cap: what is still to be sampled costs what samples cost so far; the error is the worst frame's. */
static struct row cap_row(const struct estimate *e)
{
    struct row row = {.error = NAN};

    for (size_t i = 0; i < e->count; i++) {
        const struct estimate_frame *f = &e->frames[i];
        double more = f->prices.work * ((double)e->spp / e->pilot_spp - 1);
        double core_s = f->prices.core_s + fmax(more, 0) * f->prices.work_core_s;
        double error = prices_error(&f->prices, core_s).value;
        row_add(&row, e, (struct accuracy_estimate){core_s, core_s, core_s});
        if (!(error <= row.error) && !isnan(error))
            row.error = error;
    }
    return row;
}

/* The frame with the largest error. */
static const struct estimate_frame *worst_of(const struct estimate *e)
{
    size_t worst = 0;

    for (size_t i = 1; i < e->count; i++)
        if (estimate_point(&e->frames[i])->figures->display > estimate_point(&e->frames[worst])->figures->display)
            worst = i;
    return &e->frames[worst];
}

/* ---- JSON ------------------------------------------------------------------------------------ */

static json_t *row_json(const struct estimate *e, const struct row *row)
{
    json_t *out = json_object();

    json_object_set_new(out, "display", json_number(row->error));
    json_object_set_new(out, "core_seconds", json_number(row->core_s.value));
    json_object_set_new(out, "core_seconds_low", json_number(row->core_s.lo));
    json_object_set_new(out, "core_seconds_high", json_number(row->core_s.hi));
    json_object_set_new(out, "price", e->price >= 0 ? json_number(row->core_s.value / 3600 * e->price) : json_null());
    json_object_set_new(out, "cores_needed",
                        e->seconds_to_deadline > 0 ? json_number(row->core_s.value / e->seconds_to_deadline)
                                                   : json_null());
    return out;
}

static json_t *pilots_json(const struct estimate *e)
{
    json_t *out = json_array();

    for (size_t i = 0; i < e->count; i++)
        json_array_append_new(out, json_message(&e->frames[i].history->history->base));
    return out;
}

status estimate_print_json(const struct estimate *e, struct error *err)
{
    struct row target = target_row(e), cap = cap_row(e);
    json_t *out = json_object(), *curve = json_array();

    for (size_t i = 0; i < ROWS; i++) {
        struct row row = error_row(e, table_errors[i]);
        json_array_append_new(curve, row_json(e, &row));
    }
    json_object_set_new(out, "pilot", json_message(&e->info->base));
    json_object_set_new(out, "pilots", pilots_json(e));
    json_object_set_new(out, "frames", json_integer(e->frame_count));
    json_object_set_new(out, "exponent", json_number(accuracy_curve_exponent(&worst_of(e)->prices.curve).value));
    json_object_set_new(out, "cores", json_number(e->cores));
    json_object_set_new(out, "workers", json_integer(e->workers));
    json_object_set_new(out, "curve", curve);
    json_object_set_new(out, "target", e->has_target ? row_json(e, &target) : json_null());
    json_object_set_new(out, "cap", e->has_target ? json_null() : row_json(e, &cap));
    json_object_set_new(out, "job", e->command ? json_integer((json_int_t)e->info->job) : json_null());
    json_object_set_new(out, "command", e->command ? json_string(e->command) : json_null());
    return json_print(out, err);
}

/* ---- text ------------------------------------------------------------------------------------ */

/* Returns whether the price is one number; otherwise the row has the interval only. */
static int print_row(const struct estimate *e, struct table *table, const char *label, const struct row *row)
{
    char text[FORMAT_SIZE];
    int known = prices_are_known(row->core_s);

    table_add(table, "%s", label);
    table_add(table, "%s", figures_time_text(text, known ? row->core_s.value : NAN));
    table_add(table, "%s", figures_time_text(text, row->core_s.lo));
    table_add(table, "%s", figures_time_text(text, row->core_s.hi));
    table_add(table, "%s", figures_time_text(text, known && e->cores > 0 ? row->core_s.value / e->cores : NAN));
    if (!known) {
        table_add(table, "-");
        table_add(table, "-");
        return 0;
    }
    if (e->price >= 0)
        table_add(table, "%.*f", row->core_s.value / 3600 * e->price < 1 ? 4 : 2, row->core_s.value / 3600 * e->price);
    else
        table_add(table, "-");
    if (e->seconds_to_deadline > 0)
        table_add(table, "%.0f", ceil(row->core_s.value / e->seconds_to_deadline));
    else
        table_add(table, "-");
    return 1;
}

static void print_table(const struct estimate *e)
{
    const char *const titles[] = {">ERROR", ">CORE TIME", ">LEAST", ">MOST",
                                  e->workers ? ">TIME ON FARM" : ">TIME HERE", ">PRICE",
                                  ">CORES BY THEN"};
    struct row last = e->has_target ? target_row(e) : cap_row(e);
    char text[FORMAT_SIZE], label[STOP_TEXT_SIZE + 32], target[STOP_TEXT_SIZE];
    struct table table;
    int known = 1;

    table_init(&table, titles, sizeof titles / sizeof titles[0]);
    for (size_t i = 0; i < ROWS; i++) {
        struct row row = error_row(e, table_errors[i]);
        known &= print_row(e, &table, figures_display_text(text, row.error), &row);
    }
    if (e->has_target)
        snprintf(label, sizeof label, "target %s", stop_target_text(target, &e->target));
    else
        snprintf(label, sizeof label, "%u spp: %s", e->spp, figures_display_text(text, last.error));
    known &= print_row(e, &table, label, &last);
    table_print(&table);
    if (!known)
        printf("?: too early to say more than LEAST to MOST; a larger --pilot-spp narrows it\n");
    table_release(&table);
}

static void print_pilot(const struct estimate *e, const struct estimate_frame *frame)
{
    const Azulejo__Wire__HistoryPoint *point = estimate_point(frame);
    struct buffer line = BUFFER_INIT;
    char text[FORMAT_SIZE];

    if (e->count > 1)
        buffer_printf(&line, "frame %u: ", frame->number);
    buffer_printf(&line, "%u samples a pixel, %s of core time: ", e->pilot_spp,
                  figures_time_text(text, point->core_seconds));
    figures_describe(&line, point->figures);
    printf("  %-10s  %s\n", "pilot", buffer_text(&line));
    buffer_clear(&line);
    figures_describe_word(&line, point->figures, e->info->error_effects);
    printf("  %-10s  %s\n", "", buffer_text(&line));
    buffer_release(&line);
}

/* "2, 4 and 6" */
static void print_frames(const struct estimate *e)
{
    printf("  %-10s  %u; frames ", "frames", e->frame_count);
    for (size_t i = 0; i < e->count; i++)
        printf("%s%u", i == 0 ? "" : i + 1 == e->count ? " and " : ", ", e->frames[i].number);
    printf(" were rendered and represent all\n");
}

void estimate_print_text(const struct estimate *e)
{
    struct accuracy_estimate b = accuracy_curve_exponent(&worst_of(e)->prices.curve);

    for (size_t i = 0; i < e->count; i++)
        print_pilot(e, &e->frames[i]);
    if (e->frame_count > 1)
        print_frames(e);
    if (e->workers)
        printf("  %-10s  %u worker%s, %.0f threads\n", "farm", e->workers,
               e->workers == 1 ? "" : "s", e->cores);
    printf("  %-10s  error falls as core time to the power -%.2f (%.2f to %.2f)\n", "curve",
           b.value, b.lo, b.hi);
    print_table(e);
    if (e->command)
        printf("job %" PRIu64 " goes on from these samples with\n%s\n", e->info->job, e->command);
}
