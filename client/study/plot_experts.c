/* Plots for experts: how the errors of the pixels are spread, and the largest contributions. */
#include <math.h>

#include "client/study/study_plot.h"
#include "client/study/study_words.h"

enum { LEFT = 44, RIGHT = 12, TOP = 24, BOTTOM = 40, SPOTS_MAX = 400 };

static double most_count(const struct study *s)
{
    double most = 0;

    for (size_t i = 0; i < s->histogram.count; i++)
        if (isfinite(s->histogram.items[i].count))
            most = fmax(most, s->histogram.items[i].count);
    return most;
}

void study_plot_histogram(struct buffer *out, const struct study *s, double width, double height)
{
    struct svg_axis x = {INFINITY, -INFINITY, LEFT, width - RIGHT};
    const double bottom = height - BOTTOM, most = most_count(s);

    for (size_t i = 0; i < s->histogram.count; i++) {
        svg_axis_hold(&x, s->histogram.items[i].low);
        svg_axis_hold(&x, s->histogram.items[i].high);
    }
    svg_begin(out, width, height, "plot", "Histogram of the pixels by their error, in 255ths.");
    for (size_t i = 0; i < s->histogram.count && most > 0 && x.high > x.low; i++) {
        const struct study_bin *b = &s->histogram.items[i];
        const double from = svg_axis_at(&x, b->low), to = svg_axis_at(&x, b->high);
        const double tall = (bottom - TOP) * b->count / most;
        svg_rectangle(out, from + 0.5, bottom - tall, to - from - 1, tall, "bar");
    }
    for (const struct svg_tick *t = svg_ticks_codes; t->label && x.high > x.low; t++) {
        const double at = svg_axis_at(&x, t->value);
        if (t->minor || at < x.begin - 1 || at > x.end + 1)
            continue;
        svg_line(out, at, bottom, at, bottom + 4, "axis");
        svg_text(out, at, bottom + 17, SVG_MIDDLE, "tick", t->label);
    }
    svg_line(out, LEFT, bottom, width - RIGHT, bottom, "axis");
    svg_text(out, LEFT, 12, SVG_START, "title", "pixels");
    svg_text(out, (LEFT + width - RIGHT) / 2, height - 6, SVG_MIDDLE, "title",
             "error of a pixel, in 255ths");
    svg_end(out);
}

/* Powers of ten along an axis, each with its label where there is room. */
static void decade_ticks(struct buffer *out, const struct svg_axis *axis, int upright, double edge)
{
    double free_from = upright ? INFINITY : -INFINITY;

    for (int power = (int)ceil(log10(axis->low) - 1e-9); power <= (int)floor(log10(axis->high) + 1e-9);
         power++) {
        const double at = svg_axis_at(axis, pow(10, power));
        struct buffer text = BUFFER_INIT;

        words_number(&text, pow(10, power));
        if (upright && at < free_from) {
            svg_text(out, edge - 6, at + 4, SVG_END, "tick", buffer_text(&text));
            free_from = at - PLOT_FONT - 2;
        } else if (!upright && at - 20 > free_from) {
            svg_text(out, at, edge + 17, SVG_MIDDLE, "tick", buffer_text(&text));
            free_from = at + 20;
        }
        svg_release(out, &text);
    }
}

void study_plot_tail(struct buffer *out, const struct study *s, double width, double height)
{
    const struct study_tail *tail = &s->tail;
    struct svg_axis x = {1, 10, LEFT, width - RIGHT};
    struct svg_axis y = {INFINITY, -INFINITY, height - BOTTOM, TOP};
    /* Dots that would lie on one another are drawn once. */
    double last_x = -INFINITY, last_y = -INFINITY;

    for (size_t i = 0; i < tail->largest.count; i++)
        svg_axis_hold(&y, tail->largest.items[i]);
    svg_axis_hold(&x, (double)tail->largest.count);
    svg_begin(out, width, height, "plot",
              "The largest contributions of single samples, by rank, with the Pareto fit.");
    if (y.high >= y.low) {
        y.low /= 1.5;
        y.high *= 1.5;
        decade_ticks(out, &x, 0, height - BOTTOM);
        decade_ticks(out, &y, 1, LEFT);
    }
    svg_begin_clipped(out, LEFT, TOP, width - RIGHT - LEFT, height - BOTTOM - TOP);
    if (tail->pareto_index > 0 && tail->largest.count > 1) {
        /* Through the middle of the ranks: contribution ~ rank^(-1 / index). */
        const double rank = sqrt((double)tail->largest.count);
        const double at = tail->largest.items[(size_t)rank - 1];
        svg_line(out, x.begin, svg_axis_at(&y, at * pow(rank, 1 / tail->pareto_index)), x.end,
                 svg_axis_at(&y, at * pow(rank / x.high, 1 / tail->pareto_index)), "fit beyond");
    }
    for (size_t i = 0; i < tail->largest.count; i++) {
        const double at_x = svg_axis_at(&x, (double)i + 1), at_y = svg_axis_at(&y, tail->largest.items[i]);
        if (hypot(at_x - last_x, at_y - last_y) < 2)
            continue;
        svg_circle(out, at_x, at_y, 2, "mark c0");
        last_x = at_x;
        last_y = at_y;
    }
    svg_end(out);
    svg_line(out, LEFT, height - BOTTOM, width - RIGHT, height - BOTTOM, "axis");
    svg_line(out, LEFT, height - BOTTOM, LEFT, TOP, "axis");
    svg_text(out, 0, 12, SVG_START, "title", "contribution over the frame's mean");
    svg_text(out, (LEFT + width - RIGHT) / 2, height - 6, SVG_MIDDLE, "title", "rank");
    svg_end(out);
}
