#include "client/study/page/study_page.h"

#include <math.h>

#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"
#include "client/terminal/must.h"

enum {
    MAIN_WIDTH = 672, MAIN_HEIGHT = 440,
    PHONE_WIDTH = 368, PHONE_HEIGHT = 400,
    CHOICE_WIDTH = 360, CHOICE_HEIGHT = 250,
    EFFECTS_WIDTH = 860,
    REFERENCE_WIDTH = 760, REFERENCE_HEIGHT = 320,
    CROP_SIDE = 152,  /* CSS pixels that a crop may take on a large screen */
    CROPS_SHOWN = 3,
};

void page_say(struct buffer *out, const struct study *s, study_sayer *say)
{
    struct buffer text = BUFFER_INIT;

    say(&text, s);
    svg_escape(out, buffer_text(&text));
    svg_release(out, &text);
}

status page_picture(struct buffer *out, const struct study_picture *picture, double width, double height,
                    const char *description, struct error *err)
{
    struct buffer png = BUFFER_INIT;
    status result = study_picture_png(&png, picture, err);

    if (result == STATUS_OK) {
        buffer_printf(out, "<img width=\"%.0f\" height=\"%.0f\" alt=\"", width, height);
        svg_escape(out, description);
        buffer_puts(out, "\" src=\"data:image/png;base64,");
        study_base64(out, png.data, png.size);
        buffer_puts(out, "\">");
    }
    svg_release(out, &png);
    return result;
}

/* ---- the first screen ---------------------------------------------------------------------- */

static void put_header(struct buffer *out, const struct study *s)
{
    struct buffer text = BUFFER_INIT;

    buffer_puts(out, "<header>\n<p class=\"kicker\">What accuracy costs");
    if (s->scene) {
        buffer_puts(out, " \xc2\xb7 ");
        svg_escape(out, s->scene);
    }
    if (s->width >= 1 && s->height >= 1) {
        words_exact(&text, s->width);
        buffer_puts(&text, "\xc3\x97");
        words_exact(&text, s->height);
        buffer_printf(out, " \xc2\xb7 %s pixels", buffer_text(&text));
    }
    buffer_puts(out, "</p>\n<h1>");
    page_say(out, s, study_say_headline);
    buffer_puts(out, "</h1>\n<p class=\"lead\">");
    page_say(out, s, study_say_wall);
    buffer_puts(out, " <span class=\"soft\">");
    page_say(out, s, study_say_meaning);
    buffer_puts(out, "</span></p>\n</header>\n");
    svg_release(out, &text);
}

static status put_crop(struct buffer *out, const struct study_region *region, const struct study_crop *crop,
                       struct error *err)
{
    const struct study_picture *p = &crop->picture;
    struct buffer cost = BUFFER_INIT, error = BUFFER_INIT, words = BUFFER_INIT;
    double scale;
    status result = STATUS_OK;

    if (!p->rgb)
        return STATUS_OK;
    /* Whole steps, so that every pixel of the picture is a square of the same size. */
    scale = fmax(1, floor((double)CROP_SIDE / fmax(p->width, p->height)));
    words_time(&cost, crop->core_s);
    words_codes(&error, crop->codes);
    buffer_printf(&words, "The %s region after %s: error %s", region->label ? region->label : "same",
                  buffer_text(&cost), buffer_text(&error));
    buffer_puts(out, "<figure>");
    result = page_picture(out, p, p->width * scale, p->height * scale, buffer_text(&words), err);
    buffer_printf(out, "<figcaption><b>%s</b> <span>\xc2\xb7 %s</span></figcaption></figure>\n", buffer_text(&cost),
                  buffer_text(&error));
    svg_release(out, &words);
    svg_release(out, &error);
    svg_release(out, &cost);
    return result;
}

/* The cheapest, the best, and those between, evenly. */
static size_t shown_crop(size_t count, size_t i)
{
    return count <= CROPS_SHOWN ? i : (i * (count - 1) + (CROPS_SHOWN - 1) / 2) / (CROPS_SHOWN - 1);
}

static status put_regions(struct buffer *out, const struct study *s, struct error *err)
{
    status result = STATUS_OK;

    for (size_t i = 0; i < s->regions.count && result == STATUS_OK; i++) {
        const struct study_region *r = &s->regions.items[i];

        buffer_puts(out, "<div class=\"region\"><h3>Where the error is ");
        svg_escape(out, r->label ? r->label : "?");
        if (i == 0)
            buffer_puts(out, "<span>processor time \xc2\xb7 error</span>");
        buffer_puts(out, "</h3><div class=\"crops\">\n");
        for (size_t k = 0; k < CROPS_SHOWN && k < r->crops.count && result == STATUS_OK; k++)
            result = put_crop(out, r, &r->crops.items[shown_crop(r->crops.count, k)], err);
        buffer_puts(out, "</div></div>\n");
    }
    return result;
}

static void put_trust(struct buffer *out, const struct study *s)
{
    struct buffer text = BUFFER_INIT;
    const int reliable = study_say_trust(&text, s);

    buffer_printf(out, "<p class=\"trust%s\">", reliable ? "" : " doubt");
    svg_escape(out, buffer_text(&text));
    if (!reliable && s->points.count)
        buffer_puts(out, " Hollow dots mark such errors; the costs are the least that they can be.");
    if (!s->complete)
        buffer_puts(out, " This study is not complete.");
    buffer_puts(out, "</p>\n");
    if (study_is_small(s)) {
        buffer_puts(out, "<p class=\"small\">");
        page_say(out, s, study_say_small);
        buffer_puts(out, "</p>\n");
    }
    svg_release(out, &text);
}

static void put_provenance(struct buffer *out, const struct study *s)
{
    const char *parts[] = {s->machine, s->date, s->version};
    const char *between = "";

    buffer_puts(out, "<p class=\"small\">");
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++)
        if (parts[i]) {
            buffer_puts(out, between);
            svg_escape(out, parts[i]);
            between = " \xc2\xb7 ";
        }
    if (s->command) {
        buffer_printf(out, "%s<code>", between);
        svg_escape(out, s->command);
        buffer_puts(out, "</code>");
    }
    buffer_puts(out, "</p>\n");
}

static status put_first_screen(struct buffer *out, const struct study *s, struct error *err)
{
    status result;

    buffer_printf(out, "<section class=\"first%s\">\n", s->regions.count ? "" : " alone");
    if (s->regions.count)
        buffer_puts(out, "<div>\n");
    result = put_regions(out, s, err);
    if (s->regions.count)
        buffer_puts(out, "</div>\n");
    if (study_figure_has(s, STUDY_FIGURE_MAIN)) {
        buffer_puts(out, "<figure>\n");
        study_plot_main(out, s, MAIN_WIDTH, MAIN_HEIGHT);
        study_plot_main(out, s, PHONE_WIDTH, PHONE_HEIGHT);
        buffer_puts(out, "</figure>\n");
    }
    buffer_puts(out, "</section>\n");
    put_trust(out, s);
    put_provenance(out, s);
    return result;
}

/* ---- choices and effects ------------------------------------------------------------------- */

static void put_sentence(struct buffer *out, const struct study *s, const struct study_choice *c, int colour)
{
    struct buffer text = BUFFER_INIT;

    study_say_choice(&text, s, c);
    buffer_printf(out, "<li class=\"s%d\">", colour);
    svg_escape(out, buffer_text(&text));
    buffer_puts(out, "</li>\n");
    svg_release(out, &text);
}

/* The sentences of a question's alternatives, in the colours of its plot. */
static void put_sentences(struct buffer *out, const struct study *s, const struct study_question *q, int coloured)
{
    int alternative = 0;

    for (size_t i = 0; i < q->choices.count; i++)
        if (!q->choices.items[i].baseline)
            put_sentence(out, s, &q->choices.items[i], coloured ? 1 + alternative++ % PLOT_COLOURS : 0);
}

static void put_question(struct buffer *out, const struct study *s, const struct study_question *q)
{
    buffer_puts(out, "<article><h3>");
    svg_escape(out, q->title ? q->title : "A choice");
    buffer_puts(out, "</h3>\n<figure>\n");
    study_plot_question(out, s, q, CHOICE_WIDTH, CHOICE_HEIGHT);
    buffer_puts(out, "</figure>\n<ul class=\"says\">\n");
    put_sentences(out, s, q, 1);
    buffer_puts(out, "</ul></article>\n");
}

static void put_choices(struct buffer *out, const struct study *s)
{
    size_t order[STUDY_LIST_MAX], first_idle;

    if (s->questions.count == 0)
        return;
    study_order_questions(s, order);
    for (first_idle = 0; first_idle < s->questions.count; first_idle++)
        if (!(study_question_weight(s, &s->questions.items[order[first_idle]]) > 0))
            break;
    buffer_puts(out, "<section class=\"sheet\">\n<h2>One choice at a time</h2>\n");
    if (first_idle > 0)
        buffer_puts(out,
                    "<p class=\"hint\">The same scene rendered in other ways; what matters most comes "
                    "first. Grey is the usual way. Further down and further left is better. A thick "
                    "tick at the right edge is where a curve stays for ever, whatever it costs. Each error is measured "
                    "from two independent pictures; where the samples of either give cause for doubt, it may be "
                    "understated and its mark is hollow.</p>\n"
                    "<div class=\"choices\">\n");
    for (size_t i = 0; i < first_idle; i++)
        put_question(out, s, &s->questions.items[order[i]]);
    if (first_idle > 0)
        buffer_puts(out, "</div>\n");
    if (first_idle < s->questions.count) {
        buffer_printf(out, "<h3 style=\"margin-top:28px\">%s</h3>\n<ul class=\"says\">\n",
                      first_idle ? "These make no difference on this scene, or are not measured yet"
                                 : "None of these makes a difference on this scene so far");
        for (size_t i = first_idle; i < s->questions.count; i++)
            put_sentences(out, s, &s->questions.items[order[i]], 0);
        buffer_puts(out, "</ul>\n");
    }
    buffer_puts(out, "</section>\n");
}

static void cell_interval(struct buffer *out, const struct study_interval *v, double unit, const char *after)
{
    buffer_puts(out, "<td>");
    words_number(out, v->value / unit);
    buffer_puts(out, after);
    words_range(out, v, unit);
    buffer_puts(out, "</td>");
}

static void put_effect_table(struct buffer *out, const struct study *s, const size_t *order)
{
    buffer_puts(out, "<details><summary>The numbers</summary><div class=\"scroll\"><table>\n<tr>"
                     "<th class=\"words\">left out</th><th>time saved</th><th>changes the picture by</th>"
                     "<th class=\"words\"></th></tr>\n");
    for (size_t i = 0; i < s->effects.count; i++) {
        const struct study_effect *e = &s->effects.items[order[i]];

        buffer_puts(out, "<tr><td class=\"words\">");
        svg_escape(out, e->name);
        buffer_puts(out, "</td>");
        cell_interval(out, &e->saved, 0.01, " %");
        cell_interval(out, &e->bias, 1, "/255");
        buffer_printf(out, "<td class=\"words\">%s</td></tr>\n",
                      study_effect_is_spare(s, e) ? "could be left out at this accuracy" : "");
    }
    buffer_puts(out, "</table></div></details>\n");
}

static void put_effects(struct buffer *out, const struct study *s)
{
    size_t order[STUDY_LIST_MAX];

    if (s->effects.count == 0)
        return;
    study_order_effects(s, order);
    buffer_puts(out, "<section>\n<h2>Effects that the scene calls for</h2>\n"
                     "<p class=\"hint\">Left: the time saved when an effect is left out. Right: how far "
                     "the picture is off without it. Bargains are on top; an effect in the green zone "
                     "could be left out at this accuracy, because it changes less than a quarter of the "
                     "target.</p>\n<figure style=\"max-width:980px\">\n");
    study_plot_effects(out, s, EFFECTS_WIDTH);
    study_plot_effects(out, s, PHONE_WIDTH);
    buffer_puts(out, "</figure>\n");
    put_effect_table(out, s, order);
    buffer_puts(out, "</section>\n");
}

static void put_reference(struct buffer *out, const struct study *s)
{
    if (!study_has_reference(s))
        return;
    buffer_puts(out, "<section>\n<h2>Against the reference");
    if (s->reference) {
        buffer_puts(out, " ");
        svg_escape(out, s->reference);
    }
    buffer_puts(out, "</h2>\n<p class=\"hint\">relMSE is the mean of (a - b)&#178; / (b&#178; + 0.01) of linear light; FLIP "
                     "is the mean difference that people see when one picture is shown in place of the other. Bars span "
                     "both seeds. A curve that becomes flat has met the reference's own error, or a difference of the "
                     "renderers. The triangles show how both fall with independent samples.</p>\n"
                     "<figure style=\"max-width:860px\">\n");
    study_plot_reference(out, s, REFERENCE_WIDTH, REFERENCE_HEIGHT);
    buffer_puts(out, "</figure>\n</section>\n");
}

status study_page(struct buffer *out, const struct study *s, struct error *err)
{
    status result;

    buffer_puts(out, "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
                     "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
                     "<title>What accuracy costs");
    if (s->scene) {
        buffer_puts(out, ": ");
        svg_escape(out, s->scene);
    }
    buffer_puts(out, "</title>\n");
    page_style(out);
    buffer_puts(out, "</head>\n<body>\n<div class=\"page\">\n");
    put_header(out, s);
    buffer_puts(out, "<main>\n");
    result = put_first_screen(out, s, err);
    put_choices(out, s);
    put_effects(out, s);
    put_reference(out, s);
    THEN(result, page_where(out, s, err));
    page_experts(out, s);
    buffer_puts(out, "</main>\n</div>\n</body>\n</html>\n");
    must_hold(out);
    return result;
}
