/* The plots as SVG files of their own, by day, with a title: for a paper, or to be made into a PNG. */
#include <math.h>

#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"
#include "client/terminal/must.h"

enum {
    MARGIN = 24, TITLE = 34,
    MAIN_WIDTH = 760, MAIN_HEIGHT = 500,
    CHOICE_WIDTH = 360, CHOICE_HEIGHT = 250, CHOICE_TITLE = 26, CHOICE_COLUMNS = 3,
    REFERENCE_WIDTH = 760, REFERENCE_HEIGHT = 320,
    EFFECTS_WIDTH = 860, EFFECT_ROWS_HEIGHT = 26, EFFECTS_REST_HEIGHT = 66,
};

const char *const study_figure_names[STUDY_FIGURES] = {"plot", "choices", "effects", "reference"};

/* Questions that have a plot: those that matter, first, in order; returns how many. */
static size_t plotted(const struct study *s, size_t *order)
{
    size_t count = 0;

    study_order_questions(s, order);
    while (count < s->questions.count && study_question_weight(s, &s->questions.items[order[count]]) > 0)
        count++;
    return count;
}

int study_figure_has(const struct study *s, enum study_figure figure)
{
    size_t order[STUDY_LIST_MAX];

    if (figure == STUDY_FIGURE_CHOICES)
        return plotted(s, order) > 0;
    if (figure == STUDY_FIGURE_REFERENCE)
        return study_has_reference(s);
    return figure == STUDY_FIGURE_EFFECTS ? s->effects.count > 0 : s->points.count > 0;
}

static void put_choices(struct buffer *out, const struct study *s, const size_t *order, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const struct study_question *q = &s->questions.items[order[i]];

        svg_group_begin(out, MARGIN + (double)(i % CHOICE_COLUMNS) * (CHOICE_WIDTH + MARGIN),
                        MARGIN + TITLE + (double)(i / CHOICE_COLUMNS) * (CHOICE_HEIGHT + CHOICE_TITLE + MARGIN));
        svg_text(out, 0, 12, SVG_START, "strong", q->title ? q->title : "?");
        svg_group_begin(out, 0, CHOICE_TITLE);
        study_plot_question(out, s, q, CHOICE_WIDTH, CHOICE_HEIGHT);
        svg_group_end(out);
        svg_group_end(out);
    }
}

void study_figure_file(struct buffer *out, const struct study *s, enum study_figure figure)
{
    size_t order[STUDY_LIST_MAX], count = plotted(s, order);
    const double columns = fmin(fmax((double)count, 1), CHOICE_COLUMNS);
    double width = MAIN_WIDTH, height = MAIN_HEIGHT;
    struct buffer title = BUFFER_INIT;

    if (figure == STUDY_FIGURE_CHOICES) {
        width = columns * (CHOICE_WIDTH + MARGIN) - MARGIN;
        height = ceil((double)count / CHOICE_COLUMNS) * (CHOICE_HEIGHT + CHOICE_TITLE + MARGIN) - MARGIN;
    } else if (figure == STUDY_FIGURE_REFERENCE) {
        width = REFERENCE_WIDTH;
        height = REFERENCE_HEIGHT;
    } else if (figure == STUDY_FIGURE_EFFECTS) {
        width = EFFECTS_WIDTH;
        height = EFFECTS_REST_HEIGHT + EFFECT_ROWS_HEIGHT * (double)s->effects.count;
    }
    if (s->scene)
        buffer_printf(&title, "%s: ", s->scene);
    study_say_headline(&title, s);
    svg_begin(out, width + 2 * MARGIN, height + TITLE + 2 * MARGIN, "plot", buffer_text(&title));
    buffer_puts(out, "<style>");
    study_style_rules(out, study_plot_rules, 0);
    buffer_puts(out, "</style>\n");
    svg_rectangle(out, 0, 0, width + 2 * MARGIN, height + TITLE + 2 * MARGIN, "paper");
    svg_text(out, MARGIN, MARGIN + 10, SVG_START, "strong", buffer_text(&title));
    if (figure == STUDY_FIGURE_CHOICES) {
        put_choices(out, s, order, count);
    } else {
        svg_group_begin(out, MARGIN, MARGIN + TITLE);
        if (figure == STUDY_FIGURE_MAIN)
            study_plot_main(out, s, width, height);
        else if (figure == STUDY_FIGURE_REFERENCE)
            study_plot_reference(out, s, width, height);
        else
            study_plot_effects(out, s, width);
        svg_group_end(out);
    }
    svg_end(out);
    must_hold(&title);
    must_hold(out);
    buffer_release(&title);
}
