/* The location of the error: its pixels and tiles, and the response of adaptive sampling. */
#include <math.h>

#include "client/study/page/study_page.h"
#include "client/study/page/study_plot.h"
#include "client/study/data/study_words.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

enum { PLOT_WIDTH = 360, PLOT_HEIGHT = 260, MAP_WIDTH = 520 };

/* Light to dark in one hue, perceptually uniform; t from 0 to 1. */
static void ramp(double t, uint8_t *rgb)
{
    static const double stops[4][3] = {
        {0.95, 0.97, 0.99}, {0.55, 0.75, 0.89}, {0.06, 0.45, 0.70}, {0.02, 0.14, 0.30}};
    const double at = fmin(fmax(t, 0), 1) * 3;
    const int i = at >= 3 ? 2 : (int)at;

    for (int c = 0; c < 3; c++)
        rgb[c] = (uint8_t)lround(255 * (stops[i][c] + (at - i) * (stops[i + 1][c] - stops[i][c])));
}

/* A pixel for each tile, logarithmic between the smallest and the largest; grey: not known. */
static void map_picture(struct study_picture *out, const struct study_map *map, double low, double high)
{
    out->width = (uint32_t)map->columns;
    out->height = (uint32_t)map->rows;
    out->rgb = must(mem_alloc_array(map->values.count, 3));
    for (size_t i = 0; i < map->values.count; i++) {
        const double v = map->values.items[i];
        uint8_t *rgb = out->rgb + 3 * i;

        rgb[0] = rgb[1] = rgb[2] = 0x99;
        if (isfinite(v) && v >= 0)
            ramp(v > low && high > low ? log(v / low) / log(high / low) : 0, rgb);
    }
}

/* ---- sentences ------------------------------------------------------------------------------ */

/* The share of the pixels that hold half of the error, between two measured ones; NaN: not known. */
static double half_of_error(const struct study_tail *t)
{
    for (size_t i = 0; i < t->pixels.count && i < t->error.count; i++) {
        const double right = t->error.items[i], left = i ? t->error.items[i - 1] : 0;
        if (!(right >= 0.5))
            continue;
        if (i == 0 || !(left < 0.5))
            return t->pixels.items[i];
        return exp(log(t->pixels.items[i - 1]) +
                   (0.5 - left) / (right - left) * log(t->pixels.items[i] / t->pixels.items[i - 1]));
    }
    return NAN;
}

static void say_tail(struct buffer *out, const struct study *s)
{
    const struct study_point *last = study_last_point(s);
    const double half = half_of_error(&s->tail);

    if (half > 0) {
        buffer_puts(out, "Half of the error sits in ");
        words_percent(out, half);
        buffer_puts(out, " of the pixels. ");
    }
    buffer_puts(out, "The fewer pixels hold it, the likelier it is that light is still missing which no sample has "
                     "met.");
    if (last)
        buffer_printf(out, " Here the error %s%s%s%s.", last->reliable ? "is " : "", study_point_word(last),
                      last->reason ? ": " : "", last->reason ? last->reason : "");
}

static struct svg_axis range_of(const struct study_map *map)
{
    struct svg_axis range = {INFINITY, -INFINITY, 0, 1};

    for (size_t i = 0; i < map->values.count; i++)
        svg_axis_hold(&range, map->values.items[i]);
    return range;
}

/* Tiles with very small errors are as light as those with a thirtieth of the largest, so that the
 * others can be distinguished. */
static struct svg_axis shown_range(const struct study_map *map)
{
    struct svg_axis range = range_of(map);

    range.low = fmax(range.low, range.high / 30);
    return range;
}

static void say_tile_error(struct buffer *out, const struct study *s)
{
    const struct svg_axis range = shown_range(&s->tile_error);

    if (!(range.high >= range.low)) {
        buffer_puts(out, "No square of the picture has an error.");
        return;
    }
    buffer_puts(out, "Each square is a piece of the picture, 16 pixels wide. In the dark ones the grain is worst (");
    words_codes(out, range.high);
    buffer_puts(out, "), in the light ones least (");
    words_codes(out, range.low);
    buffer_puts(out, range.low > range_of(&s->tile_error).low ? " or less)." : ").");
}

static void say_tile_samples(struct buffer *out, const struct study *s)
{
    const struct svg_axis range = range_of(&s->tile_samples);

    if (!(range.high > range.low)) {
        buffer_puts(out, "Adaptive sampling had met its target before it gave some squares more samples than others.");
        return;
    }
    buffer_puts(out, "Samples are the rays that a pixel averages. Adaptive sampling gave the dark squares ");
    words_exact(out, range.high);
    buffer_puts(out, " of them, because the grain was worst there or cheap to remove, and the light ones only ");
    words_exact(out, range.low);
    buffer_puts(out, ".");
}

/* ---- the section ----------------------------------------------------------------------------- */

static status put_map(struct buffer *out, const struct study *s, const struct study_map *map, const char *title,
                      study_sayer *say, struct error *err)
{
    const struct svg_axis range = shown_range(map);
    struct study_picture picture = {0};
    status result;

    if (map->values.count == 0)
        return STATUS_OK;
    map_picture(&picture, map, range.low, range.high);
    buffer_printf(out, "<article><h3>%s</h3><figure class=\"mapbox\">", title);
    result = page_picture(out, &picture, MAP_WIDTH, round(MAP_WIDTH * map->rows / map->columns), title, err);
    buffer_puts(out, "</figure><p class=\"says\">");
    page_say(out, s, say);
    buffer_puts(out, "</p></article>\n");
    mem_free(picture.rgb);
    return result;
}

status page_where(struct buffer *out, const struct study *s, struct error *err)
{
    status result;

    if (s->tail.pixels.count == 0 && s->tile_error.values.count == 0 && s->tile_samples.values.count == 0)
        return STATUS_OK;
    buffer_puts(out, "<section>\n<h2>Where the error sits</h2>\n<div class=\"choices\">\n");
    if (s->tail.pixels.count) {
        buffer_puts(out, "<article><h3>Few pixels or many?</h3><figure>\n");
        study_plot_tail(out, s, half_of_error(&s->tail), PLOT_WIDTH, PLOT_HEIGHT);
        buffer_puts(out, "</figure><p class=\"says\">");
        page_say(out, s, say_tail);
        buffer_puts(out, "</p></article>\n");
    }
    result = put_map(out, s, &s->tile_error, "Which parts of the picture", say_tile_error, err);
    THEN(result, put_map(out, s, &s->tile_samples, "Where adaptive sampling goes", say_tile_samples, err));
    buffer_puts(out, "</div>\n</section>\n");
    return result;
}
