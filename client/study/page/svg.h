/* svg: a small writer of SVG elements, with tools for plots: logarithmic axes, ticks, labels that do not overlap.
 *
 * Every element is appended to a buffer and has a class, never a colour: the style sheet around it decides the colours,
 * also for dark mode. Texts are escaped here, coordinates are written with two decimals in every locale. Values that
 * are not finite draw nothing.
 */
#pragma once

#include <stddef.h>

#include "common/base/buffer.h"

enum svg_anchor { SVG_START, SVG_MIDDLE, SVG_END };
enum svg_marker { SVG_DOT, SVG_SQUARE, SVG_DIAMOND, SVG_TRIANGLE, SVG_MARKERS };

struct svg_spot {
    double x, y;
};

/* Append text for HTML and SVG, in elements and in quoted attributes: markup escaped, control
 * characters and what is not UTF-8 replaced. */
void svg_escape(struct buffer *out, const char *text);

/* Release a text that was made for `out`; if it ran out of memory, mark `out` as failed, too. */
void svg_release(struct buffer *out, struct buffer *text);

/* `description` is what a screen reader says. */
void svg_begin(struct buffer *out, double width, double height, const char *classes, const char *description);
void svg_end(struct buffer *out);
/* Clip the following elements, up to svg_end, to the rectangle; coordinates do not change. */
void svg_begin_clipped(struct buffer *out, double x, double y, double width, double height);
/* Move the following elements, up to svg_group_end, by (x, y). */
void svg_group_begin(struct buffer *out, double x, double y);
void svg_group_end(struct buffer *out);

void svg_text(struct buffer *out, double x, double y, enum svg_anchor anchor, const char *classes, const char *text);
/* Text rotated clockwise, in degrees, about its place. */
void svg_text_turned(struct buffer *out, double x, double y, double degrees, enum svg_anchor anchor,
                     const char *classes, const char *text);
void svg_line(struct buffer *out, double x0, double y0, double x1, double y1, const char *classes);
void svg_rectangle(struct buffer *out, double x, double y, double width, double height, const char *classes);
void svg_circle(struct buffer *out, double x, double y, double radius, const char *classes);
void svg_mark(struct buffer *out, enum svg_marker marker, double x, double y, double radius, const char *classes);
/* A line through the spots; closed: an area. Spots that are not finite are left out. */
void svg_path(struct buffer *out, const struct svg_spot *spots, size_t count, int closed, const char *classes);

/* The approximate width of a line of text in pixels: slightly more than common sans serif fonts need. */
double svg_text_width(const char *text, double font_size);

/* ---- axes -------------------------------------------------------------------------------------- */

/* Maps low..high (above 0), logarithmically, to the pixels begin..end. */
struct svg_axis {
    double low, high, begin, end;
};
struct svg_tick {
    double value;
    const char *label;
    int minor; /* labelled only where there is room */
};
extern const struct svg_tick svg_ticks_time[];  /* seconds; ends with value 0 */
extern const struct svg_tick svg_ticks_codes[]; /* of 255 */

double svg_axis_at(const struct svg_axis *axis, double value);
/* The value at a pixel. */
double svg_axis_value(const struct svg_axis *axis, double pixel);
/* Grow the range to hold the value; NaN, infinity and values that are not positive change nothing. */
void svg_axis_hold(struct svg_axis *axis, double value);

/* ---- labels ------------------------------------------------------------------------------------ */

enum { SVG_TAKEN_MAX = 96 };

struct svg_box {
    double x0, y0, x1, y1;
};
/* Boxes already drawn; zero-initialise, set `bounds`. */
struct svg_taken {
    struct svg_box bounds;
    struct svg_box boxes[SVG_TAKEN_MAX];
    size_t count;
};
void svg_take(struct svg_taken *taken, double x0, double y0, double x1, double y1);

/* Is the box within the bounds and free? */
int svg_is_free(const struct svg_taken *taken, const struct svg_box *box);

/* Write the text beside x, y at the first place of several around it that is free, and take it.
 * `first` (0..10) is the place to try first: right above, right below, left above, left below, then
 * further away. 0 when there is no room: nothing was written. */
int svg_label(struct buffer *out, struct svg_taken *taken, double x, double y, int first, double font_size,
              const char *classes, const char *text);

/* Move the ordered heights apart to at least `gap`, within low..high where they fit, each as near
 * to its old place as the order allows. */
void svg_spread(double *heights, size_t count, double gap, double low, double high);
