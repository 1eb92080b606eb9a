/* One choice at a time: small plots with the axes of the main one, and the effects' bars. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"

enum {
    CURVES_MAX = 12, /* of a plot; more could not be distinguished */
    NAME_BYTES = 64,
    MARGIN_LEFT = 30,
    MARGIN_RIGHT = 92, /* the least and the most room for the curves' names */
    MARGIN_RIGHT_MOST = 150,
    LABEL_GAP = 14,
    LINE_GAP = 12, /* between a name's lines */
};

struct curve {
    const study_points *points;
    const struct study_choice *choice;       /* NULL: the main curve */
    char name[NAME_BYTES], rest[NAME_BYTES]; /* one or two lines */
    int colour;
    struct svg_spot end;
    double label_y;
};

/* The name, cut at a character's boundary to fit, with an ellipsis if it was cut. */
static void name_cut(char out[NAME_BYTES], const char *name, double width)
{
    static const char ellipsis[] = "\xe2\x80\xa6";
    const char *from = name ? name : "?";
    size_t length = strlen(from);

    if (length < NAME_BYTES && svg_text_width(from, PLOT_FONT - 1) <= width) {
        memcpy(out, from, length + 1);
        return;
    }
    length = length < NAME_BYTES - sizeof ellipsis ? length : NAME_BYTES - sizeof ellipsis;
    do {
        while (length && ((unsigned char)from[length] & 0xc0) == 0x80)
            length--;
        snprintf(out, NAME_BYTES, "%.*s%s", (int)length, from, ellipsis);
    } while (svg_text_width(out, PLOT_FONT - 1) > width && length-- > 0);
}

static double name_width(const char *name) { return svg_text_width(name ? name : "?", PLOT_FONT - 1); }

/* The last space before which the name's beginning fits; 0: none. */
static size_t name_break(const char *name, double width)
{
    size_t found = 0;

    for (size_t i = 1; name && name[i] && i < NAME_BYTES; i++) {
        char begin[NAME_BYTES];
        if (name[i] != ' ')
            continue;
        snprintf(begin, sizeof begin, "%.*s", (int)i, name);
        if (name_width(begin) > width)
            break;
        found = i;
    }
    return found;
}

/* On one line, or on two if there is room for them, cut if necessary. */
static void name_set(struct curve *c, const char *name, double width, int lines)
{
    const size_t at = lines > 1 && name_width(name) > width ? name_break(name, width) : 0;

    c->rest[0] = '\0';
    if (at == 0) {
        name_cut(c->name, name, width);
        return;
    }
    snprintf(c->name, NAME_BYTES, "%.*s", (int)at, name);
    name_cut(c->rest, name + at + 1, width);
}

static void curve_set(struct curve *c, const struct plot *p, const study_points *points)
{
    const struct study_point *last = &points->items[points->count - 1];

    c->points = points;
    c->end = (struct svg_spot){svg_axis_at(&p->x, last->core_s),
                               svg_axis_at(&p->y, last->codes.value)};
}

/* The usual way first, then the others that have points; names of up to `lines` lines `room` wide. */
static size_t curves_of(struct curve *out, const struct plot *p, const struct study *s, const struct study_question *q,
                        double room, int lines)
{
    const struct study_choice *usual = NULL;
    size_t count = 0, alternative = 0;

    for (size_t i = 0; i < q->choices.count; i++)
        if (q->choices.items[i].baseline)
            usual = &q->choices.items[i];
    if (s->points.count) {
        out[count] = (struct curve){.choice = NULL};
        name_set(&out[count], usual && usual->name ? usual->name : "as usual", room, lines);
        curve_set(&out[count++], p, &s->points);
    }
    for (size_t i = 0; i < q->choices.count && count < CURVES_MAX; i++) {
        const struct study_choice *c = &q->choices.items[i];
        alternative += !c->baseline;
        if (c->baseline || c->points.count == 0)
            continue;
        out[count] = (struct curve){.choice = c, .colour = (int)alternative};
        name_set(&out[count], c->name, room, lines);
        curve_set(&out[count++], p, &c->points);
    }
    return count;
}

static void draw_floor(struct buffer *out, const struct plot *p, const struct curve *c, int colour)
{
    const struct study_interval *floor = &c->choice->floor;
    const double y = svg_axis_at(&p->y, floor->value);
    char classes[32];

    if (!(floor->low > 0) || !(y < p->y.begin) || !(y > p->y.end))
        return;
    snprintf(classes, sizeof classes, "floorband f%d", colour);
    svg_rectangle(out, p->x.end - 26, svg_axis_at(&p->y, floor->high), 26,
                  fmin(svg_axis_at(&p->y, floor->low), p->y.begin) - svg_axis_at(&p->y, floor->high), classes);
    snprintf(classes, sizeof classes, "floor c%d", colour);
    svg_line(out, p->x.end - 26, y, p->x.end, y, classes);
}

static void draw_curves(struct buffer *out, const struct plot *p, const struct curve *curves, size_t count)
{
    svg_begin_clipped(out, p->x.begin, p->y.end, p->x.end - p->x.begin + 6, p->y.begin - p->y.end);
    for (size_t i = 0; i < count; i++) {
        const struct curve *c = &curves[i];
        const int colour = c->choice ? 1 + (c->colour - 1) % PLOT_COLOURS : 0;
        char line[32], mark[32];

        snprintf(line, sizeof line, c->choice ? "curve c%d" : "curve usual", colour);
        snprintf(mark, sizeof mark, c->choice ? "mark c%d" : "mark usual", colour);
        plot_points(out, p, c->points, c->choice ? (enum svg_marker)(c->colour % SVG_MARKERS) : SVG_DOT, line, mark);
        if (c->choice)
            draw_floor(out, p, c, colour);
    }
    svg_end(out);
}

/* Names at the right edge, each as near as possible to the end of its curve. */
static void label_curves(struct buffer *out, const struct plot *p, struct curve *curves, size_t count)
{
    double heights[CURVES_MAX], gap = LABEL_GAP;
    size_t order[CURVES_MAX];

    for (size_t i = 0; i < count; i++) {
        size_t at = i;
        gap = curves[i].rest[0] ? LABEL_GAP + LINE_GAP : gap;
        double y = fmin(fmax(curves[i].end.y, p->y.end), p->y.begin);

        y = isnan(y) ? p->y.begin : y;
        while (at > 0 && heights[at - 1] > y) {
            heights[at] = heights[at - 1];
            order[at] = order[at - 1];
            at--;
        }
        heights[at] = y;
        order[at] = i;
    }
    svg_spread(heights, count, gap, p->y.end + 4, p->y.begin - 2 - (gap - LABEL_GAP));
    for (size_t i = 0; i < count; i++) {
        const struct curve *c = &curves[order[i]];
        char classes[48];

        snprintf(classes, sizeof classes, "name %s%d", c->choice ? "t" : "usual t",
                 c->choice ? 1 + (c->colour - 1) % PLOT_COLOURS : 0);
        svg_line(out, c->end.x + 5, c->end.y, p->x.end + 5, heights[i], "leader");
        svg_text(out, p->x.end + 8, heights[i] + 4, SVG_START, classes, c->name);
        if (c->rest[0])
            svg_text(out, p->x.end + 8, heights[i] + 4 + LINE_GAP, SVG_START, classes, c->rest);
    }
}

static void describe(struct buffer *out, const struct study *s, const struct study_question *q)
{
    buffer_printf(out, "%s.", q->title ? q->title : "A choice");
    for (size_t i = 0; i < q->choices.count; i++)
        if (!q->choices.items[i].baseline) {
            buffer_puts(out, " ");
            study_say_choice(out, s, &q->choices.items[i]);
        }
}

/* The room that the names need, half of the longest one's width where they take two lines. */
static double names_margin(const struct study_question *q, int lines)
{
    double most = 0;

    for (size_t i = 0; i < q->choices.count; i++)
        most = fmax(most, name_width(q->choices.items[i].name) / lines);
    return fmin(fmax(most * (lines > 1 ? 1.4 : 1) + 12, MARGIN_RIGHT), MARGIN_RIGHT_MOST);
}

void study_plot_question(struct buffer *out, const struct study *s, const struct study_question *q, double width,
                         double height)
{
    struct curve curves[CURVES_MAX];
    struct buffer words = BUFFER_INIT;
    struct plot p;
    const int lines = (q->choices.count + 1) * (LABEL_GAP + LINE_GAP) < height - 36 ? 2 : 1;
    const double margin = names_margin(q, lines);
    size_t count;

    plot_ranges(&p, s);
    plot_place(&p, MARGIN_LEFT, 8, width - margin, height - 24);
    count = curves_of(curves, &p, s, q, margin - 12, lines);
    describe(&words, s, q);
    svg_begin(out, width, height, "plot", buffer_text(&words));
    svg_release(out, &words);
    plot_visible_band(out, &p);
    plot_axes(out, &p);
    draw_curves(out, &p, curves, count);
    label_curves(out, &p, curves, count);
    svg_end(out);
}

/* ---- effects ------------------------------------------------------------------------------- */

enum { ROW = 26, HEAD = 32, FOOT = 34, EFFECT_GAP = 46 };

static double row_middle(size_t i) { return HEAD + ROW * ((double)i + 0.5) - 4; }

static double most_saved(const struct study *s)
{
    double most = 0.1;

    for (size_t i = 0; i < s->effects.count; i++)
        if (isfinite(s->effects.items[i].saved.value))
            most = fmax(most, s->effects.items[i].saved.value);
    return fmin(most, 1);
}

static void effect_row(struct buffer *out, const struct study *s, const struct study_effect *e, double y,
                       double bar_begin, double bar_length, const struct svg_axis *bias)
{
    const int spare = study_effect_is_spare(s, e);
    const double saved = fmin(fmax(e->saved.value, 0), 1);
    /* Values below the axis are drawn at its start, as are unknown bounds. */
    const double value = fmax(e->bias.value, bias->low), low = fmax(e->bias.low, bias->low);
    struct buffer text = BUFFER_INIT;
    const char *classes = spare ? "name strong" : "name";
    const double room = (bar_begin - 12) / (spare ? 1.1 : 1); /* strong letters are wider */
    struct curve label;

    name_set(&label, e->name ? e->name : "?", room, 2);
    svg_text(out, bar_begin - 10, label.rest[0] ? y - 2 : y + 4, SVG_END, classes, label.name);
    if (label.rest[0])
        svg_text(out, bar_begin - 10, y - 2 + LINE_GAP, SVG_END, classes, label.rest);
    svg_rectangle(out, bar_begin, y - 7, bar_length * saved, 14, spare ? "bar spare" : "bar");
    words_percent(&text, e->saved.value);
    svg_text(out, bar_begin + bar_length * (isfinite(saved) ? saved : 0) + 6, y + 4, SVG_START, "tick",
             buffer_text(&text));
    svg_release(out, &text);
    if (!isfinite(e->bias.value))
        return;
    svg_line(out, svg_axis_at(bias, fmin(low, bias->high)), y,
             svg_axis_at(bias, fmin(fmax(e->bias.high, value), bias->high)), y, spare ? "interval c2" : "interval c1");
    svg_circle(out, svg_axis_at(bias, fmin(value, bias->high)), y, 4.5, spare ? "mark c2" : "mark c1");
}

static void bias_axis(struct buffer *out, const struct study *s, const struct svg_axis *bias, double bottom)
{
    const double target = svg_axis_at(bias, s->target_codes);
    const double quarter = svg_axis_at(bias, s->target_codes / 4);
    double free_from = -INFINITY;
    struct buffer text = BUFFER_INIT;

    if (quarter > bias->begin && quarter < bias->end)
        svg_rectangle(out, bias->begin, HEAD - 8, quarter - bias->begin, bottom - HEAD + 8, "sparezone");
    for (size_t i = 0; i < s->effects.count; i++)
        svg_line(out, bias->begin, row_middle(i), bias->end, row_middle(i), "grid");
    for (const struct svg_tick *t = svg_ticks_codes; t->label; t++) {
        const double x = svg_axis_at(bias, t->value);
        const double half = svg_text_width(t->label, PLOT_FONT) / 2;

        if (t->minor || x < bias->begin - 0.5 || x > bias->end + 0.5)
            continue;
        svg_line(out, x, HEAD - 8, x, bottom, "grid");
        if (x - half < free_from)
            continue;
        svg_text(out, x, bottom + 16, SVG_MIDDLE, "tick", t->label);
        free_from = x + half + 6;
    }
    if (target > bias->begin && target < bias->end) {
        svg_line(out, target, HEAD - 8, target, bottom, "target");
        buffer_puts(&text, "target ");
        words_exact(&text, s->target_codes);
        svg_text(out, target, HEAD - 12, SVG_MIDDLE, "tick strong", buffer_text(&text));
    }
    svg_text(out, bias->end + 10, bottom + 31, SVG_END, "title", "change, in 255ths");
    svg_release(out, &text);
}

void study_plot_effects(struct buffer *out, const struct study *s, double width)
{
    const double bottom = HEAD + ROW * (double)s->effects.count;
    const int narrow = width < 500;
    const double names = narrow ? 118 : 190;
    const double panel = (width - names - EFFECT_GAP - 14) * (narrow ? 0.42 : 0.5);
    struct svg_axis bias = {0.01, 50, names + panel + EFFECT_GAP, width - 14};
    size_t order[STUDY_LIST_MAX];

    study_order_effects(s, order);
    svg_begin(out, width, bottom + FOOT, narrow ? "plot narrow" : "plot wide",
              "For each effect, the time that leaving it out saves, and how much that changes the "
              "picture. The table below has the numbers.");
    bias_axis(out, s, &bias, bottom);
    for (size_t i = 0; i < s->effects.count; i++)
        effect_row(out, s, &s->effects.items[order[i]], row_middle(i), names, panel / most_saved(s), &bias);
    svg_line(out, names, HEAD - 8, names, bottom, "axis");
    svg_text(out, names, bottom + 31, SVG_START, "title", "time saved without it");
    svg_end(out);
}
