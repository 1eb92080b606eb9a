/* The errors against a reference picture: relMSE and FLIP over processor time, each with the spread of the seeds. */
#include <math.h>
#include <stdio.h>

#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"

enum { LEFT = 44, RIGHT = 14, TOP = 28, BOTTOM = 40, BETWEEN = 20 };

struct panel {
    const char *title;
    int flip;
    double steps; /* the error falls by 4 to this power where the cost grows by four: 1, or 1/2 */
    const char *slope;
};

static struct study_interval value_of(const struct study_point *p, int flip) { return flip ? p->flip : p->relmse; }

static void hold(struct svg_axis *y, const study_points *points, int flip)
{
    for (size_t i = 0; i < points->count; i++) {
        svg_axis_hold(y, value_of(&points->items[i], flip).low);
        svg_axis_hold(y, value_of(&points->items[i], flip).high);
    }
}

/* Powers of ten, or where there is less than one, 1, 2, 5. */
static void ticks(struct buffer *out, const struct plot *p)
{
    static const double steps[] = {1, 2, 5};
    const int all = p->y.high / p->y.low < 30;

    for (int decade = -9; decade < 6; decade++)
        for (int i = 0; i < (all ? 3 : 1); i++) {
            const double value = steps[i] * pow(10, decade), y = svg_axis_at(&p->y, value);
            struct buffer text = BUFFER_INIT;
            if (!(value >= p->y.low && value <= p->y.high))
                continue;
            if (value < 0.00099)
                buffer_printf(&text, "%.0fe%d", steps[i], decade);
            else
                words_exact(&text, value);
            svg_line(out, p->x.begin, y, p->x.end, y, "grid");
            svg_text(out, p->x.begin - 6, y + 4, SVG_END, "tick", buffer_text(&text));
            svg_release(out, &text);
        }
}

static void slope(struct buffer *out, const struct plot *p, const struct panel *panel)
{
    const double wide = svg_axis_at(&p->x, 4 * p->x.low) - p->x.begin;
    const double high = p->y.begin - svg_axis_at(&p->y, p->y.low * pow(4, panel->steps));
    const double x = p->x.begin + 10, y = p->y.begin - 10;
    const struct svg_spot corners[] = {{x, y - high}, {x, y}, {x + wide, y}};

    svg_path(out, corners, 3, 1, "slope");
    svg_text(out, x + wide / 2 + 4, y - high / 2 - 2, SVG_START, "label faintword", panel->slope);
}

static void curve(struct buffer *out, const struct plot *p, const study_points *points, int flip, const char *line,
                  const char *mark)
{
    struct svg_spot spots[64];
    size_t count = 0;

    for (size_t i = 0; i < points->count && count < 64; i++) {
        const struct study_interval v = value_of(&points->items[i], flip);
        const double x = svg_axis_at(&p->x, points->items[i].core_s), y = svg_axis_at(&p->y, v.value);
        if (!(points->items[i].core_s > 0) || !(v.low > 0))
            continue;
        spots[count++] = (struct svg_spot){x, y};
        svg_line(out, x, svg_axis_at(&p->y, v.low), x, svg_axis_at(&p->y, v.high), mark);
        svg_mark(out, SVG_DOT, x, y, 3, mark);
    }
    svg_path(out, spots, count, 0, line);
}

static void draw(struct buffer *out, const struct study *s, const struct panel *panel, double left, double width,
                 double height)
{
    struct plot p;

    plot_ranges(&p, s);
    p.y = (struct svg_axis){INFINITY, -INFINITY, 0, 1};
    hold(&p.y, &s->points, panel->flip);
    if (!(p.y.high >= p.y.low))
        p.y.low = p.y.high = 1;
    p.y.low /= 4;
    p.y.high *= 1.5;
    plot_place(&p, left + LEFT, TOP, left + width - RIGHT, height - BOTTOM);
    ticks(out, &p);
    plot_time_axis(out, &p);
    slope(out, &p, panel);
    svg_begin_clipped(out, p.x.begin, p.y.end, p.x.end - p.x.begin, p.y.begin - p.y.end);
    curve(out, &p, &s->points, panel->flip, "curve c0", "mark c0");
    svg_end(out);
    svg_text(out, left, TOP - 12, SVG_START, "title", panel->title);
    svg_text(out, (p.x.begin + p.x.end) / 2, height - 4, SVG_MIDDLE, "title", "processor time");
}

int study_has_reference(const struct study *s)
{
    for (size_t i = 0; i < s->points.count; i++)
        if (s->points.items[i].relmse.value > 0)
            return 1;
    return 0;
}

void study_plot_reference(struct buffer *out, const struct study *s, double width, double height)
{
    static const struct panel panels[] = {{"relMSE", 0, 1, "1"}, {"FLIP", 1, 0.5, "1/2"}};
    const double each = (width - BETWEEN) / 2;

    svg_begin(out, width, height, "plot", "Plots of relMSE and FLIP against the reference over processor time");
    for (int i = 0; i < 2; i++)
        draw(out, s, &panels[i], i * (each + BETWEEN), each, height);
    svg_end(out);
}
