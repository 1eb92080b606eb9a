/* study_plot: the study's pictures, each one SVG element.
 *
 * They use classes only; study_style_rules has the rules that they need, with variables for the
 * colours in a page or the colours themselves in a file of its own (librsvg knows no variables).
 */
#pragma once

#include "client/study/data/study_data.h"
#include "client/study/page/svg.h"

enum {
    PLOT_FONT = 12,
    PLOT_COLOURS = 4, /* of alternatives; then they begin again with other marks */
};

/* The axes; the same values in all plots of a study. */
struct plot {
    struct svg_axis x, y; /* core seconds; codes */
};
/* The ranges that hold every curve; pixels are not set. */
void plot_ranges(struct plot *p, const struct study *s);
/* The box in pixels; left < right, top < bottom. */
void plot_place(struct plot *p, double left, double top, double right, double bottom);
/* Grid, frame and labels of the axes below and at the left. */
void plot_axes(struct buffer *out, const struct plot *p);
/* The values of one to two steps of a screen, as a band. */
void plot_visible_band(struct buffer *out, const struct plot *p);
/* A measured curve: its line, intervals and marks, hollow where the error may be understated. */
void plot_points(struct buffer *out, const struct plot *p, const study_points *points, enum svg_marker marker,
                 const char *line, const char *mark);

/* The axis of time alone. */
void plot_time_axis(struct buffer *out, const struct plot *p);

/* Are there errors against a reference? */
int study_has_reference(const struct study *s);
void study_plot_reference(struct buffer *out, const struct study *s, double width, double height);
void study_plot_main(struct buffer *out, const struct study *s, double width, double height);
void study_plot_question(struct buffer *out, const struct study *s, const struct study_question *q, double width,
                         double height);
void study_plot_effects(struct buffer *out, const struct study *s, double width);
void study_plot_histogram(struct buffer *out, const struct study *s, double width, double height);
/* half: the share of the pixels that hold half of the error; NaN: not known. */
void study_plot_tail(struct buffer *out, const struct study *s, double half, double width, double height);

/* Style sheet rules: each "$name" becomes the colour itself, or (variables) var(--name). */
void study_style_rules(struct buffer *out, const char *rules, int variables);
/* The rules of the plots' classes. */
extern const char study_plot_rules[];
/* The variables, "--ink:#222;...", by day or by night. */
void study_style_variables(struct buffer *out, int night);
/* A whole SVG file of one plot: 0 is the main plot, 1 the choices, 2 the effects, 3 the reference. */
enum study_figure { STUDY_FIGURE_MAIN, STUDY_FIGURE_CHOICES, STUDY_FIGURE_EFFECTS, STUDY_FIGURE_REFERENCE, STUDY_FIGURES };
extern const char *const study_figure_names[STUDY_FIGURES]; /* for the files */
/* Is there anything to draw? */
int study_figure_has(const struct study *s, enum study_figure figure);
void study_figure_file(struct buffer *out, const struct study *s, enum study_figure figure);
