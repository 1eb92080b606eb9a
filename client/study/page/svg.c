#include "client/study/page/svg.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/json_quote.h"

/* ---- texts --------------------------------------------------------------------------------- */

void svg_escape(struct buffer *out, const char *text)
{
    const unsigned char *s = (const unsigned char *)text;

    while (s && *s) {
        size_t length = utf8_length(s);

        /* C1 controls and the two noncharacters at the plane's end are not allowed in HTML. */
        int forbidden = length == 0 || *s < 0x20 || *s == 0x7f || (*s == 0xc2 && s[1] < 0xa0) ||
                        (length == 3 && *s == 0xef && s[1] == 0xbf && s[2] >= 0xbe);
        if (*s == '<')
            buffer_puts(out, "&lt;");
        else if (*s == '>')
            buffer_puts(out, "&gt;");
        else if (*s == '&')
            buffer_puts(out, "&amp;");
        else if (*s == '"')
            buffer_puts(out, "&quot;");
        else if (*s == '\'')
            buffer_puts(out, "&#39;");
        else if (forbidden)
            buffer_puts(out, "\xef\xbf\xbd");
        else
            buffer_append(out, s, length);
        s += length ? length : 1;
    }
}

void svg_release(struct buffer *out, struct buffer *text)
{
    out->failed |= text->failed;
    buffer_release(text);
}

double svg_text_width(const char *text, double font_size)
{
    double width = 0;

    for (const char *c = text; *c; c++) {
        if (((unsigned char)*c & 0xc0) == 0x80)
            continue; /* within a character */
        if ((unsigned char)*c >= 0xe0)
            width += 1.0; /* what is not Latin is wide */
        else if (strchr("iIjl.,:;'|!()[]/ ftr1", *c))
            width += 0.42;
        else if (strchr("mwMW%@", *c))
            width += 0.9;
        else
            width += 0.6;
    }
    return width * font_size;
}

/* ---- elements ------------------------------------------------------------------------------ */

/* " name="12.34"": two decimals made from integers, so that the locale has no effect. */
static void coordinate(struct buffer *out, const char *before, double value)
{
    long long hundredths = llround(fmin(fmax(value, -1e7), 1e7) * 100), rest;

    rest = llabs(hundredths) % 100;
    buffer_printf(out, "%s%s%lld", before, hundredths < 0 ? "-" : "", llabs(hundredths) / 100);
    if (rest % 10)
        buffer_printf(out, ".%02lld", rest);
    else if (rest)
        buffer_printf(out, ".%lld", rest / 10);
}

static void attribute(struct buffer *out, const char *name, double value)
{
    buffer_printf(out, " %s=\"", name);
    coordinate(out, "", value);
    buffer_puts(out, "\"");
}

static void class_attribute(struct buffer *out, const char *classes)
{
    if (classes && *classes)
        buffer_printf(out, " class=\"%s\"", classes);
}

static void view_box(struct buffer *out, double x, double y, double width, double height)
{
    coordinate(out, " viewBox=\"", x);
    coordinate(out, " ", y);
    coordinate(out, " ", width);
    coordinate(out, " ", height);
    buffer_puts(out, "\"");
}

void svg_begin(struct buffer *out, double width, double height, const char *classes, const char *description)
{
    buffer_puts(out, "<svg xmlns=\"http://www.w3.org/2000/svg\"");
    attribute(out, "width", width);
    attribute(out, "height", height);
    view_box(out, 0, 0, width, height);
    class_attribute(out, classes);
    buffer_puts(out, " role=\"img\" aria-label=\"");
    svg_escape(out, description);
    buffer_puts(out, "\">\n");
}

void svg_begin_clipped(struct buffer *out, double x, double y, double width, double height)
{
    buffer_puts(out, "<svg");
    attribute(out, "x", x);
    attribute(out, "y", y);
    attribute(out, "width", width);
    attribute(out, "height", height);
    view_box(out, x, y, width, height);
    buffer_puts(out, ">\n");
}

void svg_end(struct buffer *out) { buffer_puts(out, "</svg>\n"); }

void svg_group_begin(struct buffer *out, double x, double y)
{
    coordinate(out, "<g transform=\"translate(", x);
    coordinate(out, " ", y);
    buffer_puts(out, ")\">\n");
}

void svg_group_end(struct buffer *out) { buffer_puts(out, "</g>\n"); }

void svg_text_turned(struct buffer *out, double x, double y, double degrees, enum svg_anchor anchor,
                     const char *classes, const char *text)
{
    static const char *const anchors[] = {"", " text-anchor=\"middle\"", " text-anchor=\"end\""};

    if (!isfinite(x) || !isfinite(y))
        return;
    buffer_puts(out, "<text");
    attribute(out, "x", x);
    attribute(out, "y", y);
    buffer_puts(out, anchors[anchor]);
    if (degrees != 0) {
        coordinate(out, " transform=\"rotate(", degrees);
        coordinate(out, " ", x);
        coordinate(out, " ", y);
        buffer_puts(out, ")\"");
    }
    class_attribute(out, classes);
    buffer_puts(out, ">");
    svg_escape(out, text);
    buffer_puts(out, "</text>\n");
}

void svg_text(struct buffer *out, double x, double y, enum svg_anchor anchor, const char *classes, const char *text)
{
    svg_text_turned(out, x, y, 0, anchor, classes, text);
}

void svg_line(struct buffer *out, double x0, double y0, double x1, double y1, const char *classes)
{
    if (!isfinite(x0 + y0 + x1 + y1))
        return;
    buffer_puts(out, "<line");
    attribute(out, "x1", x0);
    attribute(out, "y1", y0);
    attribute(out, "x2", x1);
    attribute(out, "y2", y1);
    class_attribute(out, classes);
    buffer_puts(out, "/>\n");
}

void svg_rectangle(struct buffer *out, double x, double y, double width, double height, const char *classes)
{
    if (!isfinite(x + y + width + height) || width < 0 || height < 0)
        return;
    buffer_puts(out, "<rect");
    attribute(out, "x", x);
    attribute(out, "y", y);
    attribute(out, "width", width);
    attribute(out, "height", height);
    class_attribute(out, classes);
    buffer_puts(out, "/>\n");
}

void svg_circle(struct buffer *out, double x, double y, double radius, const char *classes)
{
    if (!isfinite(x + y))
        return;
    buffer_puts(out, "<circle");
    attribute(out, "cx", x);
    attribute(out, "cy", y);
    attribute(out, "r", radius);
    class_attribute(out, classes);
    buffer_puts(out, "/>\n");
}

void svg_path(struct buffer *out, const struct svg_spot *spots, size_t count, int closed, const char *classes)
{
    const char *command = "M";

    buffer_puts(out, "<path d=\"");
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(spots[i].x + spots[i].y))
            continue;
        coordinate(out, command, spots[i].x);
        coordinate(out, " ", spots[i].y);
        command = "L";
    }
    buffer_puts(out, closed && *command == 'L' ? "Z\"" : "\"");
    class_attribute(out, classes);
    buffer_puts(out, "/>\n");
}

void svg_mark(struct buffer *out, enum svg_marker marker, double x, double y, double radius, const char *classes)
{
    const double r = radius;

    if (!isfinite(x + y))
        return;
    if (marker == SVG_SQUARE) {
        svg_rectangle(out, x - 0.9 * r, y - 0.9 * r, 1.8 * r, 1.8 * r, classes);
    } else if (marker == SVG_DIAMOND) {
        const struct svg_spot d[] = {{x, y - 1.3 * r}, {x + 1.3 * r, y}, {x, y + 1.3 * r}, {x - 1.3 * r, y}};
        svg_path(out, d, 4, 1, classes);
    } else if (marker == SVG_TRIANGLE) {
        const struct svg_spot t[] = {{x, y - 1.2 * r}, {x + 1.2 * r, y + r}, {x - 1.2 * r, y + r}};
        svg_path(out, t, 3, 1, classes);
    } else {
        svg_circle(out, x, y, r, classes);
    }
}

/* ---- axes ---------------------------------------------------------------------------------- */

const struct svg_tick svg_ticks_time[] = {
    {0.001, "1 ms", 0},  {0.01, "10 ms", 0},  {0.1, "0.1 s", 0}, {1, "1 s", 0},
    {10, "10 s", 0},     {60, "1 min", 0},    {600, "10 min", 0}, {3600, "1 h", 0},
    {36000, "10 h", 1},  {86400, "1 day", 0}, {864000, "10 days", 0},
    {8640000, "100 days", 0}, {86400000, "1000 days", 0}, {0, NULL, 0},
};
const struct svg_tick svg_ticks_codes[] = {
    {0.001, "0.001", 0}, {0.01, "0.01", 0}, {0.1, "0.1", 0}, {0.2, "0.2", 1}, {0.5, "0.5", 0},
    {1, "1", 0},     {2, "2", 0},     {5, "5", 0},    {10, "10", 0}, {20, "20", 0},
    {50, "50", 0},   {100, "100", 0}, {255, "255", 1}, {0, NULL, 0},
};

double svg_axis_at(const struct svg_axis *axis, double value)
{
    if (!(value > 0))
        return NAN;
    return axis->begin + (axis->end - axis->begin) * log(value / axis->low) / log(axis->high / axis->low);
}

double svg_axis_value(const struct svg_axis *axis, double pixel)
{
    return axis->low * pow(axis->high / axis->low, (pixel - axis->begin) / (axis->end - axis->begin));
}

void svg_axis_hold(struct svg_axis *axis, double value)
{
    if (!(value > 0) || !isfinite(value))
        return;
    axis->low = fmin(axis->low, value);
    axis->high = fmax(axis->high, value);
}

/* ---- labels -------------------------------------------------------------------------------- */

void svg_take(struct svg_taken *taken, double x0, double y0, double x1, double y1)
{
    if (taken->count < SVG_TAKEN_MAX && isfinite(x0 + y0 + x1 + y1))
        taken->boxes[taken->count++] = (struct svg_box){fmin(x0, x1), fmin(y0, y1), fmax(x0, x1),
                                                        fmax(y0, y1)};
}

int svg_is_free(const struct svg_taken *taken, const struct svg_box *box)
{
    if (box->x0 < taken->bounds.x0 || box->x1 > taken->bounds.x1 || box->y0 < taken->bounds.y0 ||
        box->y1 > taken->bounds.y1)
        return 0;
    for (size_t i = 0; i < taken->count; i++) {
        const struct svg_box *t = &taken->boxes[i];
        if (box->x0 < t->x1 && t->x0 < box->x1 && box->y0 < t->y1 && t->y0 < box->y1)
            return 0;
    }
    return 1;
}

int svg_label(struct buffer *out, struct svg_taken *taken, double x, double y, int first, double font_size,
              const char *classes, const char *text)
{
    static const struct {
        double dx, dy; /* of the baseline's near end, in font sizes */
        int left;      /* the text ends there */
        int centred;   /* about x, as far as the bounds allow */
    } places[] = {
        {0.5, -0.55, 0, 0}, {0.5, 1.25, 0, 0}, {-0.5, -0.55, 1, 0}, {-0.5, 1.25, 1, 0},
        {0.9, -1.6, 0, 0},  {0, -2.6, 0, 1},   {0, -3.8, 0, 1}, {0, -5, 0, 1},     {-0.9, -1.6, 1, 0},
        {0.9, 2.4, 0, 0},   {-0.9, 2.4, 1, 0},
    };
    enum { PLACES = sizeof places / sizeof places[0] };
    const double width = svg_text_width(text, font_size);

    if (!isfinite(x + y))
        return 0;
    for (int i = 0; i < PLACES; i++) {
        const int at = (first + i) % PLACES;
        const double near = x + places[at].dx * font_size, base = y + places[at].dy * font_size;
        const double middle = fmax(fmin(x - width / 2, taken->bounds.x1 - 4 - width), taken->bounds.x0 + 4);
        const double left = places[at].centred ? middle : places[at].left ? near - width : near;
        const struct svg_box box = {left, base - 0.85 * font_size, left + width,
                                    base + 0.25 * font_size};
        if (!svg_is_free(taken, &box))
            continue;
        svg_take(taken, box.x0, box.y0, box.x1, box.y1);
        if (places[at].centred) /* far from its place: a leader line is drawn */
            svg_line(out, x, base + 0.4 * font_size, x, y - 0.5 * font_size, "leader");
        if (places[at].left)
            svg_text(out, near, base, SVG_END, classes, text);
        else
            svg_text(out, left, base, SVG_START, classes, text);
        return 1;
    }
    return 0;
}

void svg_spread(double *heights, size_t count, double gap, double low, double high)
{
    if (count == 0)
        return;
    if (heights[0] < low)
        heights[0] = low;
    for (size_t i = 1; i < count; i++)
        heights[i] = fmax(heights[i], heights[i - 1] + gap);
    if (heights[count - 1] > high)
        heights[count - 1] = high;
    for (size_t i = count - 1; i > 0; i--)
        heights[i - 1] = fmin(heights[i - 1], heights[i] - gap);
}
