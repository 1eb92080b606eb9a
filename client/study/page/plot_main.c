/* The main plot: what the error costs, measured and predicted. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"

#define RADIAN 0.017453292519943295
enum {
    MARGIN_LEFT = 34,
    MARGIN_RIGHT = 46,
    MARGIN_TOP = 54,
    MARGIN_BOTTOM = 44,
    FIT_STEPS = 48, /* of the line and its band */
    NARROW = 500,   /* pixels: fewer words below this width */
};

/* A path along the fit between two costs: the line itself (edge 0) or the closed band. */
static void fit_path(struct buffer *out, const struct study *s, const struct plot *p, double from, double to, int band,
                     const char *classes)
{
    struct svg_spot spots[2 * (FIT_STEPS + 1)];
    size_t count = 0;

    for (int i = 0; i <= FIT_STEPS; i++) {
        const double core_s = from * pow(to / from, (double)i / FIT_STEPS);
        const struct study_interval at = study_codes_after(s, core_s);
        spots[count++] = (struct svg_spot){svg_axis_at(&p->x, core_s),
                                           svg_axis_at(&p->y, band ? at.low : at.value)};
    }
    for (int i = FIT_STEPS; i >= 0 && band; i--) {
        const double core_s = from * pow(to / from, (double)i / FIT_STEPS);
        spots[count++] = (struct svg_spot){svg_axis_at(&p->x, core_s),
                                           svg_axis_at(&p->y, study_codes_after(s, core_s).high)};
    }
    svg_path(out, spots, count, band, classes);
}

static void draw_fit(struct buffer *out, const struct study *s, const struct plot *p)
{
    const double first = s->points.items[0].core_s, last = study_last_point(s)->core_s;

    if (!study_has_fit(s) || !(first > 0) || !(last >= first))
        return;
    fit_path(out, s, p, p->x.low, p->x.high, 1, "band");
    fit_path(out, s, p, p->x.low, first, 0, "fit beyond");
    fit_path(out, s, p, last, p->x.high, 0, "fit beyond");
    fit_path(out, s, p, first, last, 0, "fit");
}

/* Lines on which twice as good a picture costs four times as much: what more samples alone give. */
static void draw_efficiency(struct buffer *out, const struct plot *p)
{
    for (double codes = p->y.low / 1024; codes < p->y.high * 1024; codes *= 4) {
        const double right = codes / sqrt(p->x.high / p->x.low);

        if (codes < p->y.low || right > p->y.high)
            continue;
        svg_line(out, p->x.begin, svg_axis_at(&p->y, codes), p->x.end, svg_axis_at(&p->y, right), "faint");
    }
}

/* The angle of those lines on the screen, degrees. */
static double efficiency_angle(const struct plot *p)
{
    const double per_decade_x = (p->x.end - p->x.begin) / log10(p->x.high / p->x.low);
    const double per_decade_y = (p->y.begin - p->y.end) / log10(p->y.high / p->y.low);

    return atan2(per_decade_y / 2, per_decade_x) / RADIAN;
}

/* On the uppermost line that has room and that the curve does not reach; omitted if a label is in the way. */
static void label_efficiency(struct buffer *out, const struct plot *p, const struct svg_taken *taken, int narrow)
{
    const char *words = narrow ? "equal efficiency" : "on such a line: equal efficiency";
    const double angle = efficiency_angle(p), half = svg_text_width(words, PLOT_FONT - 1) / 2;
    const double across = half * cos(angle * RADIAN), down = half * sin(angle * RADIAN) + PLOT_FONT;
    const double middle = p->x.end - across - 8, core_s = svg_axis_value(&p->x, middle);
    double at = NAN;

    for (double codes = p->y.low / 1024; codes < p->y.high * 1024; codes *= 4) {
        const double y = svg_axis_at(&p->y, codes * sqrt(p->x.low / core_s));
        if (svg_is_free(taken, &(struct svg_box){middle - across, y - down, middle + across, y + down}))
            at = y;
    }
    if (isfinite(at))
        svg_text_turned(out, middle, at - 5, angle, SVG_MIDDLE, "label faintword", words);
}

/* A triangle on the first free place near the lower left corner: twice as good along its height costs four times as much
 * along its foot, the slope of 1/2 that independent samples have. */
static void slope_triangle(struct buffer *out, const struct plot *p, struct svg_taken *taken)
{
    const double wide = svg_axis_at(&p->x, 4 * p->x.low) - p->x.begin, high = p->y.begin - svg_axis_at(&p->y, 2 * p->y.low);

    for (double up = 8; up < (p->y.begin - p->y.end) / 2; up += 12)
        for (double right = 8; right < (p->x.end - p->x.begin) / 2; right += 12) {
            const double x = p->x.begin + right, y = p->y.begin - up;
            const struct svg_spot corners[] = {{x, y - high}, {x, y}, {x + wide, y}};
            if (!svg_is_free(taken, &(struct svg_box){x - 4, y - high - 4, x + wide + 26, y + 4}))
                continue;
            svg_take(taken, x - 4, y - high - 4, x + wide + 26, y + 4);
            svg_path(out, corners, 3, 1, "slope");
            svg_text(out, x + wide / 2 + 4, y - high / 2 - 2, SVG_START, "label faintword", "1/2");
            return;
        }
}

/* Time on the clock along the upper edge. */
static void wall_axis(struct buffer *out, const struct study *s, const struct plot *p)
{
    const double rate = study_rate(s);
    double free_from = -INFINITY;
    struct buffer title = BUFFER_INIT;

    for (const struct svg_tick *t = svg_ticks_time; t->label; t++) {
        const double x = svg_axis_at(&p->x, t->value * rate);
        const double half = svg_text_width(t->label, PLOT_FONT) / 2;

        if (!(x >= p->x.begin && x <= p->x.end))
            continue;
        svg_line(out, x, p->y.end, x, p->y.end - 4, "axis");
        if (x - half < free_from)
            continue;
        svg_text(out, x, p->y.end - 8, SVG_MIDDLE, "tick", t->label);
        free_from = x + half + 8;
    }
    svg_line(out, p->x.begin, p->y.end, p->x.end, p->y.end, "axis");
    buffer_puts(&title, "time on the clock");
    if (s->workers.count > 1)
        buffer_printf(&title, ", %zu workers", s->workers.count);
    svg_text(out, p->x.end, p->y.end - 26, SVG_END, "title", buffer_text(&title));
    svg_release(out, &title);
}

static int compare_numbers(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

/* What the measured points add to 20 log10(codes) to give decibels: their median. NaN: unknown. */
static double decibel_offset(const struct study *s)
{
    double offsets[256];
    size_t count = 0;

    for (size_t i = 0; i < s->points.count && count < 256; i++) {
        const struct study_point *p = &s->points.items[i];
        const double offset = p->codes.value > 0 ? p->psnr_db + 20 * log10(p->codes.value) : NAN;
        if (isfinite(offset))
            offsets[count++] = offset;
    }
    if (count == 0)
        return NAN;
    qsort(offsets, count, sizeof offsets[0], compare_numbers);
    return offsets[count / 2];
}

static void decibel_axis(struct buffer *out, const struct study *s, const struct plot *p)
{
    const double offset = decibel_offset(s);
    const char *unit = " dB"; /* on the uppermost alone */

    if (!isfinite(offset))
        return;
    for (int db = -20; db <= 120; db += 10) {
        const double y = svg_axis_at(&p->y, pow(10, (offset - db) / 20));
        char text[16];

        if (!(y >= p->y.end + 4 && y <= p->y.begin - 4))
            continue;
        snprintf(text, sizeof text, "%d%s", db, unit);
        unit = "";
        svg_line(out, p->x.end, y, p->x.end + 4, y, "axis");
        svg_text(out, p->x.end + 8, y + 4, SVG_START, "tick", text);
    }
    svg_line(out, p->x.end, p->y.begin, p->x.end, p->y.end, "axis");
}

/* The line of the target, and the one of its cost where they meet. */
static void draw_target(struct buffer *out, const struct study *s, const struct plot *p)
{
    const struct study_interval cost = study_target_cost(s);
    const double y = svg_axis_at(&p->y, s->target_codes), x = svg_axis_at(&p->x, cost.value);

    if (!isfinite(y))
        return;
    svg_line(out, p->x.begin, y, p->x.end, y, "target");
    if (!(x <= p->x.end && x >= p->x.begin))
        return;
    if (isfinite(cost.low) && isfinite(cost.high)) {
        const double from = fmax(svg_axis_at(&p->x, cost.low), p->x.begin);
        const double to = fmin(svg_axis_at(&p->x, cost.high), p->x.end);
        svg_rectangle(out, from, y, to - from, p->y.begin - y, "costband");
    }
    svg_line(out, x, y, x, p->y.begin, "target");
    svg_circle(out, x, y, 5, "goal");
    if (study_by_target(s))
        svg_mark(out, SVG_DIAMOND, svg_axis_at(&p->x, study_headline_cost(s).value), y, 6, "mark goal");
}

static void take_curve(struct svg_taken *taken, const struct study *s, const struct plot *p)
{
    const double target_y = svg_axis_at(&p->y, s->target_codes);
    const double target_x = svg_axis_at(&p->x, study_target_cost(s).value);

    svg_take(taken, p->x.begin, target_y - 2, p->x.end, target_y + 2);
    svg_take(taken, target_x - 2, target_y, target_x + 2, p->y.begin);
    for (size_t i = 0; i < s->points.count && i < 40; i++) {
        const struct study_point *at = &s->points.items[i];
        const double x = svg_axis_at(&p->x, at->core_s), y = svg_axis_at(&p->y, at->codes.value);
        svg_take(taken, x - 5, y - 5, x + 5, y + 5);
    }
    for (int i = 0; i < 40; i++) {
        const double core_s = p->x.low * pow(p->x.high / p->x.low, i / 39.0);
        const double x = svg_axis_at(&p->x, core_s);
        const double y = svg_axis_at(&p->y, study_codes_after(s, core_s).value);
        if (study_has_fit(s))
            svg_take(taken, x - 6, y - 4, x + 6, y + 4);
    }
}

static void label_target(struct buffer *out, const struct study *s, const struct plot *p, struct svg_taken *taken)
{
    const struct study_interval cost = study_target_cost(s);
    const double y = svg_axis_at(&p->y, s->target_codes), x = svg_axis_at(&p->x, cost.value);
    struct buffer text = BUFFER_INIT, price = BUFFER_INIT;

    if (!isfinite(y))
        return;
    buffer_puts(&text, "target ");
    words_exact(&text, s->target_codes);
    buffer_puts(&text, "/255");
    if (!svg_label(out, taken, p->x.begin, y, 0, PLOT_FONT, "label strong", buffer_text(&text)))
        svg_label(out, taken, p->x.end, y, 2, PLOT_FONT, "label strong", buffer_text(&text));
    words_core_time(&price, cost.value);
    if (x >= p->x.begin && x <= p->x.end)
        svg_label(out, taken, x, p->y.begin - 1, 2, PLOT_FONT, "label strong", buffer_text(&price));
    if (study_by_target(s)) {
        const struct study_interval adaptive = study_headline_cost(s);
        const double at = svg_axis_at(&p->x, adaptive.value);
        buffer_clear(&price);
        buffer_puts(&price, "adaptive: ");
        words_core_time(&price, adaptive.value);
        svg_take(taken, at - 7, y - 7, at + 7, y + 7);
        if (at >= p->x.begin && at <= p->x.end)
            svg_label(out, taken, at, y, 3, PLOT_FONT, "label strong", buffer_text(&price));
    }
    svg_release(out, &price);
    svg_release(out, &text);
}

static void label_here(struct buffer *out, const struct study *s, const struct plot *p, struct svg_taken *taken)
{
    const struct study_point *last = study_last_point(s);
    struct buffer text = BUFFER_INIT;

    buffer_puts(&text, "you are here: ");
    words_codes(&text, last->codes.value);
    svg_label(out, taken, svg_axis_at(&p->x, last->core_s), svg_axis_at(&p->y, last->codes.value), 4, PLOT_FONT,
              "label accent", buffer_text(&text));
    svg_release(out, &text);
}

static void describe(struct buffer *out, const struct study *s)
{
    buffer_puts(out, "Plot of the error of the picture against processor time. ");
    study_say_headline(out, s);
    for (size_t i = 0; i < s->points.count && i < 12; i++) {
        buffer_puts(out, i ? ", " : " Measured: ");
        words_codes(out, s->points.items[i].codes.value);
        buffer_puts(out, " after ");
        words_time(out, s->points.items[i].core_s);
    }
}

void study_plot_main(struct buffer *out, const struct study *s, double width, double height)
{
    const int narrow = width < NARROW;
    struct svg_taken taken = {0};
    struct buffer words = BUFFER_INIT;
    struct plot p;

    plot_ranges(&p, s);
    plot_place(&p, MARGIN_LEFT, MARGIN_TOP, width - MARGIN_RIGHT, height - MARGIN_BOTTOM);
    taken.bounds = (struct svg_box){p.x.begin, p.y.end, p.x.end, p.y.begin};
    describe(&words, s);
    svg_begin(out, width, height, narrow ? "plot narrow" : "plot wide", buffer_text(&words));
    svg_release(out, &words);
    svg_begin_clipped(out, p.x.begin, p.y.end, p.x.end - p.x.begin, p.y.begin - p.y.end);
    plot_visible_band(out, &p);
    draw_efficiency(out, &p);
    svg_end(out);
    plot_axes(out, &p);
    wall_axis(out, s, &p);
    decibel_axis(out, s, &p);
    svg_begin_clipped(out, p.x.begin, p.y.end, p.x.end - p.x.begin, p.y.begin - p.y.end);
    draw_target(out, s, &p);
    if (s->points.count) {
        draw_fit(out, s, &p);
        plot_points(out, &p, &s->points, SVG_DOT, NULL, "mark c0");
    }
    svg_end(out);
    take_curve(&taken, s, &p);
    label_target(out, s, &p, &taken);
    if (s->points.count)
        label_here(out, s, &p, &taken);
    svg_label(out, &taken, p.x.begin, svg_axis_at(&p.y, 1), 0, PLOT_FONT - 1, "label faintword", "just visible");
    label_efficiency(out, &p, &taken, narrow);
    slope_triangle(out, &p, &taken);
    svg_text(out, 0, MARGIN_TOP - 26, SVG_START, "title", "error, in 255ths");
    svg_text(out, (p.x.begin + p.x.end) / 2, height - 6, SVG_MIDDLE, "title", "processor time (all cores together)");
    svg_end(out);
}
