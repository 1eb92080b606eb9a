/* Shared by all curves of a study: the ranges of the axes, the grid, the marks. */
#include <math.h>
#include <stdio.h>

#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"

#define COST_SPAN_LEAST 100.0
#define COST_SPAN_MOST 1e9
#define COST_AHEAD_MOST 1e3 /* of a prediction beyond what was measured, for the axis */
#define CODES_MOST 255.0
#define CODES_SPAN_LEAST 30.0
#define CODES_SPAN_MOST 1e5

static void hold_points(struct plot *p, const study_points *points)
{
    for (size_t i = 0; i < points->count; i++) {
        svg_axis_hold(&p->x, points->items[i].core_s);
        svg_axis_hold(&p->y, points->items[i].codes.value);
    }
}

/* Margins around the values, and a range that is neither too small nor too large. */
static void widen(struct svg_axis *axis, double room, double least, double most)
{
    if (axis->high < axis->low)
        *axis = (struct svg_axis){1, 1, 0, 1};
    axis->low = fmax(axis->low, axis->high / most) / room;
    axis->high *= room;
    if (axis->high / axis->low < least) {
        const double more = sqrt(least * axis->low / axis->high);
        axis->low /= more;
        axis->high *= more;
    }
}

void plot_ranges(struct plot *p, const struct study *s)
{
    const struct study_point *last = study_last_point(s);
    const double cost = study_target_cost(s).value;

    p->x = p->y = (struct svg_axis){INFINITY, -INFINITY, 0, 1};
    hold_points(p, &s->points);
    for (size_t i = 0; i < s->questions.count; i++)
        for (size_t k = 0; k < s->questions.items[i].choices.count; k++)
            hold_points(p, &s->questions.items[i].choices.items[k].points);
    svg_axis_hold(&p->y, s->target_codes);
    svg_axis_hold(&p->y, 1);
    if (last)
        svg_axis_hold(&p->x, fmin(cost, COST_AHEAD_MOST * last->core_s));
    p->x.high *= 2; /* where the path continues */
    widen(&p->x, 1.7, COST_SPAN_LEAST, COST_SPAN_MOST);
    p->y.high = fmin(p->y.high, CODES_MOST);
    widen(&p->y, 1.4, CODES_SPAN_LEAST, CODES_SPAN_MOST);
}

void plot_place(struct plot *p, double left, double top, double right, double bottom)
{
    p->x.begin = left;
    p->x.end = right;
    p->y.begin = bottom;
    p->y.end = top;
}

static int in_range(const struct svg_axis *axis, double value)
{
    return value >= axis->low * 0.999 && value <= axis->high * 1.001;
}

static void time_ticks(struct buffer *out, const struct plot *p)
{
    double free_from = -INFINITY;

    for (const struct svg_tick *t = svg_ticks_time; t->label; t++) {
        const double x = svg_axis_at(&p->x, t->value);
        const double half = svg_text_width(t->label, PLOT_FONT) / 2;

        if (!in_range(&p->x, t->value))
            continue;
        svg_line(out, x, p->y.begin, x, p->y.end, "grid");
        if (x - half < free_from)
            continue;
        svg_text(out, x, p->y.begin + 17, SVG_MIDDLE, "tick", t->label);
        free_from = x + half + 8;
    }
}

static void code_ticks(struct buffer *out, const struct plot *p)
{
    double free_from = INFINITY;

    for (const struct svg_tick *t = svg_ticks_codes; t->label; t++) {
        const double y = svg_axis_at(&p->y, t->value);

        if (!in_range(&p->y, t->value))
            continue;
        svg_line(out, p->x.begin, y, p->x.end, y, "grid");
        if (t->minor || y > free_from)
            continue;
        svg_text(out, p->x.begin - 7, y + 4, SVG_END, "tick", t->label);
        free_from = y - PLOT_FONT - 2;
    }
}

void plot_time_axis(struct buffer *out, const struct plot *p)
{
    time_ticks(out, p);
    svg_line(out, p->x.begin, p->y.begin, p->x.end, p->y.begin, "axis");
    svg_line(out, p->x.begin, p->y.begin, p->x.begin, p->y.end, "axis");
}

void plot_axes(struct buffer *out, const struct plot *p)
{
    code_ticks(out, p);
    plot_time_axis(out, p);
}

void plot_visible_band(struct buffer *out, const struct plot *p)
{
    const double top = fmax(svg_axis_at(&p->y, 2), p->y.end);
    const double bottom = fmin(svg_axis_at(&p->y, 1), p->y.begin);

    svg_rectangle(out, p->x.begin, top, p->x.end - p->x.begin, bottom - top, "visible");
}

void plot_points(struct buffer *out, const struct plot *p, const study_points *points, enum svg_marker marker,
                 const char *line, const char *mark)
{
    if (line && points->count > 1) {
        struct svg_spot spots[256];
        size_t count = 0;

        for (size_t i = 0; i < points->count && count < 256; i++)
            spots[count++] = (struct svg_spot){svg_axis_at(&p->x, points->items[i].core_s),
                                               svg_axis_at(&p->y, points->items[i].codes.value)};
        svg_path(out, spots, count, 0, line);
    }
    for (size_t i = 0; i < points->count; i++) {
        const struct study_point *at = &points->items[i];
        const double x = svg_axis_at(&p->x, at->core_s);
        char classes[64];

        svg_line(out, x, svg_axis_at(&p->y, at->codes.low), x, svg_axis_at(&p->y, at->codes.high), mark);
        snprintf(classes, sizeof classes, "%s%s", mark, at->reliable ? "" : " doubt");
        svg_mark(out, marker, x, svg_axis_at(&p->y, at->codes.value), line ? 3 : 4, classes);
    }
}
