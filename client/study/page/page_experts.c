/* The collapsed end of the page: all numbers, the predictions, the pixels by their error. */
#include <math.h>

#include "client/study/page/study_page.h"
#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"

enum { PLOT_WIDTH = 420, PLOT_HEIGHT = 260 };

static void cell(struct buffer *out, double value)
{
    buffer_puts(out, "<td>");
    words_number(out, value);
    buffer_puts(out, "</td>");
}

static void cell_exact(struct buffer *out, double value)
{
    buffer_puts(out, "<td>");
    words_exact(out, value);
    buffer_puts(out, "</td>");
}

static void cell_count(struct buffer *out, double value)
{
    buffer_puts(out, "<td>");
    words_count(out, value);
    buffer_puts(out, "</td>");
}

static void cell_interval(struct buffer *out, const struct study_interval *v, double unit)
{
    buffer_puts(out, "<td>");
    words_number(out, v->value / unit);
    words_range(out, v, unit);
    buffer_puts(out, "</td>");
}

static void cell_words(struct buffer *out, const char *text)
{
    buffer_puts(out, "<td class=\"words\">");
    svg_escape(out, text);
    buffer_puts(out, "</td>");
}

static void point_rows(struct buffer *out, const char *curve, const study_points *points, int reference)
{
    for (size_t i = 0; i < points->count; i++) {
        const struct study_point *p = &points->items[i];

        buffer_puts(out, "<tr>");
        if (i == 0) {
            buffer_printf(out, "<td class=\"words top\" rowspan=\"%zu\">", points->count);
            svg_escape(out, curve);
            buffer_puts(out, "</td>");
        }
        cell(out, p->core_s);
        cell(out, p->wall_s);
        cell(out, p->samples);
        cell_count(out, p->rays);
        cell_interval(out, &p->codes, 1);
        cell_interval(out, &p->seeds, 1);
        cell(out, p->psnr_db);
        cell_interval(out, &p->rmse, 0.01);
        if (reference) {
            cell_interval(out, &p->relmse, 1);
            cell_interval(out, &p->flip, 1);
        }
        cell_exact(out, round(1000 * p->top_share) / 10);
        cell_words(out, study_point_word(p));
        cell_words(out, p->reason ? p->reason : "");
        buffer_puts(out, "</tr>\n");
    }
}

static void put_points(struct buffer *out, const struct study *s)
{
    const int reference = study_has_reference(s);

    buffer_puts(out, "<h3>All points</h3><div class=\"scroll\"><table>\n<tr><th class=\"words\">curve</th>"
                     "<th>core-s</th><th>wall s</th><th>samples</th><th>rays</th><th>error / 255</th>"
                     "<th>by each seed's samples</th><th>PSNR, dB</th><th>RMSE / mean, %</th>");
    if (reference)
        buffer_puts(out, "<th>relMSE (seeds)</th><th>FLIP (seeds)</th>");
    buffer_puts(out, "<th>top 0.1 %, %</th><th class=\"words\">the error</th><th class=\"words\">why</th></tr>\n");
    point_rows(out, "main", &s->points, reference);
    for (size_t i = 0; i < s->questions.count; i++)
        for (size_t k = 0; k < s->questions.items[i].choices.count; k++) {
            const struct study_question *q = &s->questions.items[i];
            struct buffer name = BUFFER_INIT;

            buffer_printf(&name, "%s: %s", q->title ? q->title : "?",
                          q->choices.items[k].name ? q->choices.items[k].name : "?");
            point_rows(out, buffer_text(&name), &q->choices.items[k].points, reference);
            svg_release(out, &name);
        }
    buffer_puts(out, "</table></div>\n");
}

/* ---- facts --------------------------------------------------------------------------------- */

static void fact(struct buffer *out, const char *name, const char *value)
{
    if (!value || !*value)
        return;
    buffer_printf(out, "<dt>%s</dt><dd>", name);
    svg_escape(out, value);
    buffer_puts(out, "</dd>\n");
}

static void fact_interval(struct buffer *out, const char *name, const struct study_interval *v)
{
    struct buffer text = BUFFER_INIT;

    if (isfinite(v->value)) {
        words_exact(&text, v->value);
        words_range(&text, v, 1);
        fact(out, name, buffer_text(&text));
    }
    svg_release(out, &text);
}

static void put_facts(struct buffer *out, const struct study *s)
{
    const struct study_interval none = {NAN, NAN, NAN};
    struct study_interval number = none;

    buffer_puts(out, "<h3>How it was measured</h3><dl>\n");
    fact(out, "command", s->command);
    fact(out, "machine", s->machine);
    fact(out, "version", s->version);
    fact(out, "transform", s->transform);
    fact(out, "reference", s->reference);
    fact_interval(out, "exponent of error against time", &s->fit.exponent);
    number.value = s->seed;
    fact_interval(out, "seed", &number);
    number.value = s->traversal_share * 100;
    fact_interval(out, "ray traversal (Embree), % of the time", &number);
    number.value = s->clock_noise * 100;
    fact_interval(out, "times of equal pictures differ by, % (one deviation)", &number);
    number.value = s->tail.index;
    fact_interval(out, "Pareto index k of the largest samples", &number);
    buffer_puts(out, "</dl>\n");
    if (s->workers.count == 0)
        return;
    buffer_puts(out, "<h3>Workers</h3><div class=\"scroll\"><table>\n<tr><th class=\"words\">name</th>"
                     "<th>cores</th></tr>\n");
    for (size_t i = 0; i < s->workers.count; i++) {
        const struct study_worker *w = &s->workers.items[i];
        buffer_puts(out, "<tr>");
        cell_words(out, w->name);
        cell_exact(out, w->cores);
        buffer_puts(out, "</tr>\n");
    }
    buffer_puts(out, "</table></div>\n");
}

static void put_predictions(struct buffer *out, const struct study *s)
{
    if (s->predictions.count == 0)
        return;
    buffer_puts(out, "<h3>What each round foretold, and what came</h3><div class=\"scroll\"><table>\n"
                     "<tr><th>round</th><th>after core-s</th><th>target / 255</th>"
                     "<th>foretold core-s</th><th>came core-s</th><th>foretold / came</th></tr>\n");
    for (size_t i = 0; i < s->predictions.count; i++) {
        const struct study_prediction *p = &s->predictions.items[i];

        buffer_puts(out, "<tr>");
        cell_exact(out, p->round);
        cell(out, p->core_s_then);
        cell_exact(out, p->target_codes);
        cell_interval(out, &p->core_s, 1);
        cell(out, p->core_s_true);
        cell(out, p->core_s.value / p->core_s_true);
        buffer_puts(out, "</tr>\n");
    }
    buffer_puts(out, "</table></div>\n");
}

void page_experts(struct buffer *out, const struct study *s)
{
    buffer_puts(out, "<details class=\"experts\"><summary>For experts</summary>\n");
    put_facts(out, s);
    put_points(out, s);
    put_predictions(out, s);
    if (s->histogram.count) {
        buffer_puts(out, "<h3>Pixels by their error</h3>\n<figure style=\"max-width:520px\">");
        study_plot_histogram(out, s, PLOT_WIDTH, PLOT_HEIGHT);
        buffer_puts(out, "</figure>\n");
    }
    buffer_puts(out, "</details>\n");
}
