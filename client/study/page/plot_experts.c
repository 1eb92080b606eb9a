/* The distribution of the pixels' errors, and their concentration in few pixels. */
#include <math.h>

#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"

enum { LEFT = 44, RIGHT = 12, TOP = 24, BOTTOM = 40, TAIL_SPOTS = 64 };

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
    svg_text(out, (LEFT + width - RIGHT) / 2, height - 6, SVG_MIDDLE, "title", "error of a pixel, in 255ths");
    svg_end(out);
}

/* ---- the tail ------------------------------------------------------------------------------- */

/* A share of the error, 0..1, from the bottom to the top. */
static double share_at(double share, double height)
{
    return height - BOTTOM - (height - BOTTOM - TOP) * fmin(fmax(share, 0), 1);
}

static void share_axes(struct buffer *out, const struct svg_axis *x, double width, double height)
{
    static const double pixels[] = {0.0001, 0.001, 0.01, 0.1, 1};

    for (int i = 0; i <= 4; i++) {
        const double y = share_at(0.25 * i, height);
        struct buffer text = BUFFER_INIT;

        words_percent(&text, 0.25 * i);
        svg_line(out, LEFT, y, width - RIGHT, y, "grid");
        svg_text(out, LEFT - 6, y + 4, SVG_END, "tick", buffer_text(&text));
        svg_release(out, &text);
    }
    for (size_t i = 0; i < sizeof pixels / sizeof *pixels; i++) {
        const double at = svg_axis_at(x, pixels[i]);
        struct buffer text = BUFFER_INIT;

        words_percent(&text, pixels[i]);
        if (at >= x->begin - 1) {
            svg_line(out, at, height - BOTTOM, at, height - BOTTOM + 4, "axis");
            svg_text(out, at, height - BOTTOM + 17, pixels[i] < 1 ? SVG_MIDDLE : SVG_END, "tick", buffer_text(&text));
        }
        svg_release(out, &text);
    }
}

/* The curve if all pixels had equal errors. */
static void equal_pixels(struct buffer *out, const struct svg_axis *x, double height)
{
    struct svg_spot spots[TAIL_SPOTS];

    for (int i = 0; i < TAIL_SPOTS; i++) {
        const double share = x->low * pow(x->high / x->low, (double)i / (TAIL_SPOTS - 1));
        spots[i] = (struct svg_spot){svg_axis_at(x, share), share_at(share, height)};
    }
    svg_path(out, spots, TAIL_SPOTS, 0, "curve usual beyond");
}

void study_plot_tail(struct buffer *out, const struct study *s, double half, double width, double height)
{
    const struct study_tail *t = &s->tail;
    struct svg_axis x = {0.1, 1, LEFT, width - RIGHT};
    struct svg_spot spots[TAIL_SPOTS];
    size_t count = 0;

    for (size_t i = 0; i < t->pixels.count && i < t->error.count && count < TAIL_SPOTS; i++) {
        if (!(t->pixels.items[i] > 0) || t->pixels.items[i] > 1 || !isfinite(t->error.items[i]))
            continue;
        svg_axis_hold(&x, t->pixels.items[i]);
        spots[count++] = (struct svg_spot){t->pixels.items[i], t->error.items[i]};
    }
    for (size_t i = 0; i < count; i++)
        spots[i] = (struct svg_spot){svg_axis_at(&x, spots[i].x), share_at(spots[i].y, height)};
    svg_begin(out, width, height, "plot",
              "The share of the error that the worst pixels hold, against their share of the picture.");
    share_axes(out, &x, width, height);
    svg_line(out, LEFT, height - BOTTOM, width - RIGHT, height - BOTTOM, "axis");
    equal_pixels(out, &x, height);
    svg_path(out, spots, count, 0, "fit");
    if (half > 0 && half <= 1) {
        const double at = svg_axis_at(&x, half), y = share_at(0.5, height);
        svg_line(out, at, y, at, height - BOTTOM, "target");
        svg_circle(out, at, y, 5, "goal");
    }
    svg_text(out, 0, 12, SVG_START, "title", "share of the error; dashed: if all pixels were equally wrong");
    svg_text(out, (LEFT + width - RIGHT) / 2, height - 6, SVG_MIDDLE, "title", "the worst pixels, of all");
    svg_end(out);
}
