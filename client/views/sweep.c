#include "client/views/sweep.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/must.h"
#include "client/terminal/progress.h"
#include "client/terminal/text_draw.h"
#include "common/base/memory.h"
#include "common/image/color.h"

/* Colours of the sheet, as display light. */
static const float PAPER = 0.015f, INK = 0.7f;

#define WIDE_ENOUGH 1.6 /* preferred ratio of the sheet's width to its height */

enum {
    ONE_ROW_MAX = 4,      /* this many tiles are never wrapped */
    PIXELS_A_SCALE = 160, /* of a tile's width for each step of the font's scale */
    SCALE_MAX = 8,
    MARGIN = 4,           /* at scale 1 */
    GAP = 2,              /* between a label and its tile, at scale 1 */
};

/* ---- parsing -------------------------------------------------------------------------------- */

static status sweep_add(struct sweep *s, const char *value, size_t length, struct error *err)
{
    size_t name_length = strlen(s->name);
    char *text;

    if (length == 0)
        return error_set(err, STATUS_ERR_USAGE, "--sweep %s: a value is empty", s->name);
    if (s->count == SWEEP_VALUES_MAX)
        return error_set(err, STATUS_ERR_USAGE, "--sweep %s: more than %d values", s->name, SWEEP_VALUES_MAX);
    text = must(mem_alloc(name_length + 1 + length + 1));
    memcpy(text, s->name, name_length);
    text[name_length] = '=';
    memcpy(text + name_length + 1, value, length);
    text[name_length + 1 + length] = 0;
    s->assignments[s->count] = text;
    s->values[s->count++] = text + name_length + 1;
    return STATUS_OK;
}

static status add_all_operators(struct sweep *s, int has_file, struct error *err)
{
    size_t count;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);
    status result = STATUS_OK;

    for (size_t i = 0; i < count && result == STATUS_OK; i++)
        if (has_file || !operators[i]->file_required)
            result = sweep_add(s, operators[i]->name, strlen(operators[i]->name), err);
    return result;
}

status sweep_parse(struct sweep *out, const char *text, int has_file, struct error *err)
{
    const char *at = strchr(text, '=');
    size_t length = at ? (size_t)(at - text) : 0;
    status result = STATUS_OK;

    memset(out, 0, sizeof *out);
    if (length == 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "--sweep: '%s' is not a sweep, write NAME=VALUE,VALUE,... as in "
                         "contrast=0.4,0.8,1.6", text);
    if (length >= sizeof out->name)
        return error_set(err, STATUS_ERR_USAGE, "--sweep: '%s': the name is too long", text);
    memcpy(out->name, text, length);
    if (strcmp(at + 1, "all") == 0 && strcmp(out->name, "operator") == 0)
        return add_all_operators(out, has_file, err);
    do {
        const char *value = at + 1;

        at = value + strcspn(value, ",");
        result = sweep_add(out, value, (size_t)(at - value), err);
    } while (result == STATUS_OK && *at);
    return result;
}

void sweep_release(struct sweep *sweep)
{
    for (size_t i = 0; i < sweep->count; i++)
        mem_free(sweep->assignments[i]);
    memset(sweep, 0, sizeof *sweep);
}

const char *sweep_label(const struct sweep *sweep, size_t value)
{
    return strcmp(sweep->name, "operator") == 0 ? sweep->values[value] : sweep->assignments[value];
}

/* ---- the sheet's plan ----------------------------------------------------------------------- */

static uint32_t longest_label(const struct sweep *s, uint32_t scale)
{
    uint32_t longest = 0;

    for (size_t i = 0; i < s->count; i++) {
        uint32_t width = text_draw_width(sweep_label(s, i), scale);
        longest = width > longest ? width : longest;
    }
    return longest;
}

static int is_matrix(const struct sheet *s) { return s->sweep_count == 2; }

static void plan_cells(struct sheet *s)
{
    uint32_t label;

    s->scale = s->tile_width / PIXELS_A_SCALE;
    s->scale = s->scale < 1 ? 1 : s->scale > SCALE_MAX ? SCALE_MAX : s->scale;
    while (s->scale > 1 && longest_label(&s->sweeps[0], s->scale) > s->tile_width)
        s->scale--;
    label = longest_label(&s->sweeps[0], s->scale);
    s->margin = MARGIN * s->scale;
    s->cell_width = label > s->tile_width ? label : s->tile_width;
    s->cell_height = s->tile_height + (is_matrix(s) ? 0 : (TEXT_HEIGHT + GAP) * s->scale);
    if (is_matrix(s) && s->cell_height < TEXT_HEIGHT * s->scale) /* of its row's label */
        s->cell_height = TEXT_HEIGHT * s->scale;
}

/* How far a grid with this many columns is from the wanted shape; each empty place counts. */
static double grid_badness(const struct sheet *s, uint32_t columns)
{
    uint32_t rows = (s->tiles + columns - 1) / columns;
    double shape =
        (double)columns * (s->cell_width + s->margin) / ((double)rows * (s->cell_height + s->margin)) / WIDE_ENOUGH;
    double empty = (double)(rows * columns - s->tiles) / (double)s->tiles;

    return fmax(shape, 1 / shape) * (1 + 2 * empty);
}

static void plan_grid(struct sheet *s)
{
    s->tiles = (uint32_t)s->sweeps[0].count;
    s->columns = s->tiles;
    if (is_matrix(s)) {
        s->rows = (uint32_t)s->sweeps[1].count;
        s->tiles *= s->rows;
        return;
    }
    for (uint32_t columns = s->tiles; s->tiles > ONE_ROW_MAX && columns > 0; columns--)
        if (grid_badness(s, columns) < grid_badness(s, s->columns))
            s->columns = columns;
    s->rows = (s->tiles + s->columns - 1) / s->columns;
}

/* Break the title into lines, at blanks if possible. */
static void plan_title(struct sheet *s)
{
    size_t room = (s->width - 2 * s->margin + s->scale) / (TEXT_ADVANCE * s->scale);
    size_t begin = 0, length = strlen(s->title);

    room = room < 1 ? 1 : room;
    while (begin < length && s->title_lines < SWEEP_TITLE_LINES_MAX) {
        size_t take = length - begin;

        if (take > room) {
            for (take = room; take > 0 && s->title[begin + take] != ' '; take--)
                ;
            take = take == 0 ? room : take;
        }
        s->title_begin[s->title_lines] = begin;
        s->title_length[s->title_lines++] = take;
        begin += take;
        begin += strspn(s->title + begin, " ");
    }
}

void sheet_plan(struct sheet *out, const struct sweep *sweeps, size_t sweep_count, uint32_t width, uint32_t height,
                uint32_t tile_width, const char *title)
{
    const double ratio = (double)height / (double)width;
    uint32_t line;

    memset(out, 0, sizeof *out);
    out->sweeps = sweeps;
    out->sweep_count = sweep_count;
    out->title = title;
    out->tile_width = tile_width < width ? tile_width : width;
    out->tile_height = (uint32_t)(ratio * out->tile_width + 0.5);
    out->tile_height = out->tile_height < 1 ? 1 : out->tile_height;
    plan_cells(out);
    plan_grid(out);
    line = (TEXT_HEIGHT + GAP) * out->scale;
    out->left = out->margin;
    if (is_matrix(out))
        out->left += longest_label(&sweeps[1], out->scale) + out->margin;
    out->width = out->left + out->columns * (out->cell_width + out->margin);
    plan_title(out);
    out->top = 2 * out->margin + (uint32_t)out->title_lines * line + (is_matrix(out) ? line : 0);
    out->height = out->top + out->rows * (out->cell_height + out->margin);
}

static uint32_t cell_x(const struct sheet *s, uint32_t column)
{
    return s->left + column * (s->cell_width + s->margin);
}

static uint32_t cell_y(const struct sheet *s, uint32_t row) { return s->top + row * (s->cell_height + s->margin); }

void sheet_tile_at(const struct sheet *sheet, uint32_t tile, uint32_t *x, uint32_t *y)
{
    *x = cell_x(sheet, tile % sheet->columns) + (sheet->cell_width - sheet->tile_width) / 2;
    *y = cell_y(sheet, tile / sheet->columns) + sheet->cell_height - sheet->tile_height;
}

/* ---- drawing -------------------------------------------------------------------------------- */

/* The share of in's pixel `at` that lies within [begin, end). */
static double overlap(uint32_t at, double begin, double end)
{
    return fmin(end, (double)at + 1.0) - fmax(begin, (double)at);
}

void image_box_reduce(struct image *out, const struct image *in)
{
    const double step_x = (double)in->width / out->width, step_y = (double)in->height / out->height;

    for (uint32_t y = 0; y < out->height; y++) {
        const double y0 = y * step_y, y1 = fmin((y + 1.0) * step_y, in->height);

        for (uint32_t x = 0; x < out->width; x++) {
            const double x0 = x * step_x, x1 = fmin((x + 1.0) * step_x, in->width);
            double sum[4] = {0}, weights = 0;

            for (uint32_t v = (uint32_t)y0; v < y1; v++) {
                for (uint32_t u = (uint32_t)x0; u < x1; u++) {
                    const double weight = overlap(v, y0, y1) * overlap(u, x0, x1);
                    const float *p = in->pixels + ((size_t)v * in->width + u) * in->channels;

                    weights += weight;
                    for (uint32_t c = 0; c < in->channels; c++)
                        sum[c] += weight * (double)p[c];
                }
            }
            for (uint32_t c = 0; c < in->channels; c++)
                out->pixels[((size_t)y * out->width + x) * in->channels + c] = (float)(sum[c] / weights);
        }
    }
}

static void put_tile(struct image *sheet, const struct image *tile, uint32_t x, uint32_t y)
{
    for (uint32_t row = 0; row < tile->height; row++)
        memcpy(sheet->pixels + ((size_t)(y + row) * sheet->width + x) * 3, tile->pixels + (size_t)row * tile->width * 3,
               (size_t)tile->width * 3 * sizeof(float));
}

static void draw_title(struct image *image, const struct sheet *s)
{
    char line[1024];

    for (size_t i = 0; i < s->title_lines; i++) {
        snprintf(line, sizeof line, "%.*s", (int)s->title_length[i], s->title + s->title_begin[i]);
        text_draw(image, s->margin, s->margin + (uint32_t)i * (TEXT_HEIGHT + GAP) * s->scale, s->scale, INK, line);
    }
}

/* Centred above column or tile. */
static void draw_label(struct image *image, const struct sheet *s, const char *label, uint32_t column, uint32_t y)
{
    uint32_t width = text_draw_width(label, s->scale);

    text_draw(image, cell_x(s, column) + (s->cell_width - width) / 2, y, s->scale, INK, label);
}

static void draw_labels(struct image *image, const struct sheet *s)
{
    const struct sweep *first = &s->sweeps[0];
    uint32_t line = (TEXT_HEIGHT + GAP) * s->scale;

    for (uint32_t i = 0; i < first->count; i++)
        draw_label(image, s, sweep_label(first, i), i % s->columns,
                   is_matrix(s) ? s->top - line : cell_y(s, i / s->columns));
    for (uint32_t i = 0; is_matrix(s) && i < s->rows; i++)
        text_draw(image, s->margin, cell_y(s, i) + (s->cell_height - TEXT_HEIGHT * s->scale) / 2, s->scale, INK,
                  sweep_label(&s->sweeps[1], i));
}

/* ---- what a tile's settings are -------------------------------------------------------------- */

/* The setting of that name; NULL: it is the operator, or one of its parameters. */
static const struct setting *look_row(const char *name)
{
    for (int i = 0; i < LOOK_COUNT; i++)
        if (i != LOOK_temporal && i != LOOK_denoise && i != LOOK_denoise_around && strcmp(look_rows[i].option, name) == 0)
            return &look_rows[i];
    return NULL;
}

static status sweep_apply(struct tonemap_options *o, const struct sweep *s, size_t value, struct error *err)
{
    const struct setting *row = look_row(s->name);
    struct tonemap_settings ignored;
    status result;

    if (strcmp(s->name, "operator") == 0) {
        o->tonemap = s->values[value];
        return STATUS_OK;
    }
    if (row) {
        o->said[row - look_rows].text = s->values[value];
        result = setting_parse(row, s->values[value], &ignored, err);
        if (result != STATUS_OK)
            error_prefix(err, "--sweep");
        return result;
    }
    if (o->parameters.count == OPTIONS_LIST_MAX)
        return error_set(err, STATUS_ERR_USAGE, "more than %d parameters", OPTIONS_LIST_MAX);
    o->parameters.items[o->parameters.count++] = s->assignments[value];
    return STATUS_OK;
}

static int sweeps_operator(const struct sweep_options *how)
{
    for (size_t i = 0; i < how->sweep_count; i++)
        if (strcmp(how->sweeps[i].name, "operator") == 0)
            return 1;
    return 0;
}

/* The common settings, for one operator of many: without parameters that it does not have. */
static void fit_to_operator(struct tonemap_options *o)
{
    const struct tonemap_operator *op = tonemap_find(o->tonemap);

    if (!op)
        return; /* reported later */
    tonemap_options_keep(o, op);
    if (!tonemap_has_parameter(op, "percentile", strlen("percentile")) &&
        !(o->said[LOOK_metering].text && strcmp(o->said[LOOK_metering].text, "percentile") == 0))
        o->said[LOOK_metering_percentile].text = NULL;
    if (!op->file_required)
        o->file = NULL;
}

/* Settings of tile number `tile`; `file` as for tonemap_options_check. */
static status tile_settings(const struct sweep_options *how, size_t tile, struct tonemap_settings *out,
                            struct buffer *file, struct error *err)
{
    struct tonemap_options *o = must(mem_alloc(sizeof *o));
    status result = STATUS_OK;

    *o = *how->tone;
    for (int parameters = 0; parameters < 2 && result == STATUS_OK; parameters++) {
        size_t rest = tile;

        for (size_t i = 0; i < how->sweep_count && result == STATUS_OK; i++) {
            const struct sweep *s = &how->sweeps[i];

            if ((strcmp(s->name, "operator") != 0) == parameters)
                result = sweep_apply(o, s, rest % s->count, err);
            rest /= s->count;
        }
        if (!parameters && result == STATUS_OK && sweeps_operator(how))
            fit_to_operator(o);
    }
    THEN(result, tonemap_options_check(o, out, file, err));
    mem_free(o);
    return result;
}

static size_t tile_count(const struct sweep_options *how)
{
    size_t count = 1;

    for (size_t i = 0; i < how->sweep_count; i++)
        count *= how->sweeps[i].count;
    return count;
}

/* Is `name` (its first `length` bytes) a parameter of an operator that the sweep shows? */
static int some_operator_has(const struct sweep_options *how, const char *name, size_t length)
{
    for (size_t i = 0; i < how->sweep_count; i++) {
        const struct sweep *s = &how->sweeps[i];

        for (size_t k = 0; strcmp(s->name, "operator") == 0 && k < s->count; k++) {
            const struct tonemap_operator *op = tonemap_find(s->values[k]);
            if (op && tonemap_has_parameter(op, name, length))
                return 1;
        }
    }
    return 0;
}

/* Check a common setting: it must have an effect, and must not be swept as well. */
static status check_shared(const struct sweep_options *how, const char *name, size_t length, struct error *err)
{
    for (size_t i = 0; i < how->sweep_count; i++)
        if (strlen(how->sweeps[i].name) == length && memcmp(how->sweeps[i].name, name, length) == 0)
            return error_set(err, STATUS_ERR_USAGE, "%.*s is given and swept as well; leave out one of them",
                             (int)length, name);
    return STATUS_OK;
}

static status check_parameter(const struct sweep_options *how, const char *name, size_t length, struct error *err)
{
    TRY(check_shared(how, name, length, err));
    if (sweeps_operator(how) && !some_operator_has(how, name, length))
        TRY(error_set(err, STATUS_ERR_USAGE, "none of the swept operators has a parameter %.*s", (int)length, name));
    return STATUS_OK;
}

static status check_everything_shared(const struct sweep_options *how, struct error *err)
{
    const struct tonemap_options *o = how->tone;
    status result = STATUS_OK;

    if (o->tonemap)
        result = check_shared(how, "operator", strlen("operator"), err);
    for (int i = 0; i < LOOK_COUNT && result == STATUS_OK; i++)
        if (o->said[i].text)
            result = check_shared(how, look_rows[i].option, strlen(look_rows[i].option), err);
    for (size_t i = 0; i < o->direct_count && result == STATUS_OK; i++)
        if (o->direct[i].value)
            result = check_parameter(how, o->direct[i].name, strlen(o->direct[i].name), err);
    for (size_t i = 0; i < o->parameters.count && result == STATUS_OK; i++)
        result = check_parameter(how, o->parameters.items[i], strcspn(o->parameters.items[i], "="), err);
    return result;
}

status sweep_check(const struct sweep_options *how, struct error *err)
{
    struct tonemap_settings settings;
    status result = STATUS_OK;

    if (how->sweep_count == SWEEPS_MAX && strcmp(how->sweeps[0].name, how->sweeps[1].name) == 0)
        return error_set(err, STATUS_ERR_USAGE, "--sweep %s: swept twice; put all values into one",
                         how->sweeps[0].name);
    result = check_everything_shared(how, err);
    for (size_t i = 0; i < tile_count(how) && result == STATUS_OK; i++) {
        struct buffer file = BUFFER_INIT;

        result = tile_settings(how, i, &settings, &file, err);
        buffer_release(&file);
    }
    return result;
}

/* The picture's name and the settings that the tiles have in common. */
static void title_make(struct buffer *title, const char *name, const struct sweep_options *how)
{
    const struct tonemap_options *o = how->tone;

    buffer_puts(title, name);
    if (!sweeps_operator(how))
        buffer_printf(title, "  %s", o->tonemap ? o->tonemap : TONEMAP_DEFAULT);
    for (size_t i = 0; i < o->direct_count; i++)
        if (o->direct[i].value)
            buffer_printf(title, "  %s=%s", o->direct[i].name, o->direct[i].value);
    for (size_t i = 0; i < o->parameters.count; i++)
        buffer_printf(title, "  %s", o->parameters.items[i]);
    for (int i = 0; i < LOOK_COUNT; i++)
        if (o->said[i].text)
            buffer_printf(title, "  %s=%s", look_rows[i].option, o->said[i].text);
    must_hold(title);
}

static status draw_tile(struct image *image, const struct sheet *sheet, uint32_t tile, const struct image *picture,
                        const struct sweep_options *how, struct error *err)
{
    struct tonemap_context context = {.threads = how->threads, .linear = 1};
    struct tonemap_settings settings;
    struct buffer file = BUFFER_INIT;
    struct image whole = {0}, small = {0};
    uint32_t x, y;
    status result = tile_settings(how, tile, &settings, &file, err);

    context.file_data = file.data;
    context.file_size = file.size;
    THEN(result, tonemap_apply(&whole, picture, &settings, &context, err));
    THEN(result, image_init(&small, sheet->tile_width, sheet->tile_height, 3, err));
    if (result == STATUS_OK) {
        image_box_reduce(&small, &whole);
        sheet_tile_at(sheet, tile, &x, &y);
        put_tile(image, &small, x, y);
    }
    image_release(&small);
    image_release(&whole);
    buffer_release(&file);
    return result;
}

static void tell_progress(struct progress *progress, const struct sheet *sheet, uint32_t tile)
{
    char text[96];

    snprintf(text, sizeof text, "tile %u of %u", tile + 1, sheet->tiles);
    progress_draw(progress, (double)tile / (double)sheet->tiles, text);
}

status sweep_draw(struct image *out, const struct image *picture, const char *name, const struct sweep_options *how,
                  struct error *err)
{
    struct buffer title = BUFFER_INIT;
    struct progress progress;
    struct sheet sheet = {0};
    status result;

    title_make(&title, name, how);
    progress_init(&progress, 0);
    sheet_plan(&sheet, how->sweeps, how->sweep_count, picture->width, picture->height, how->tile_width,
               buffer_text(&title));
    result = image_init(out, sheet.width, sheet.height, 3, err);
    if (result == STATUS_OK) {
        for (size_t i = 0; i < (size_t)out->width * out->height * 3; i++)
            out->pixels[i] = PAPER;
        draw_title(out, &sheet);
        draw_labels(out, &sheet);
    }
    for (uint32_t tile = 0; tile < sheet.tiles && result == STATUS_OK; tile++) {
        tell_progress(&progress, &sheet, tile);
        result = draw_tile(out, &sheet, tile, picture, how, err);
    }
    progress_clear(&progress);
    if (result == STATUS_OK && !how->linear)
        srgb_encode_row(out->pixels, (size_t)out->width * out->height * 3);
    if (result != STATUS_OK)
        image_release(out);
    buffer_release(&title);
    return result;
}
