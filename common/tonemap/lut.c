/* A look-up table from a `.cube` file (Adobe's Cube LUT specification 1.0, 2013), or one of those with
 * a table for each channel before the cube, as DaVinci Resolve writes them. Between its entries a
 * cube is interpolated over tetrahedra, which keeps greys grey.
 *
 * Files do not say which light they expect and give, so the user must: `input` and `output`.
 */
#include <ctype.h>
#include <float.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/color.h"
#include "common/math/curve_table.h"
#include "common/tonemap/operators.h"

enum {
    CUBE_1D_MIN = 2, CUBE_1D_MAX = 65536,
    CUBE_3D_MIN = 2, CUBE_3D_MAX = 256,
    CUBE_LINE_MAX = 1000,   /* bytes */
    CUBE_ENTRY_BYTES = 6,   /* of the shortest line of numbers */
    CUBE_SHOWN_MAX = 40,    /* bytes of a bad word in a message */
};
static const double CUBE_VALUE_MAX = 1e6;   /* of entries and domains, either way */
static const double CUBE_DOMAIN_MIN = 1e-6; /* the narrowest */

/* ---- the file ------------------------------------------------------------------------------- */

struct cube_table {
    uint32_t size;         /* 0: there is none */
    double min[3], max[3]; /* of its domain */
    float (*entries)[3];   /* [size], or [size * size * size] with red fastest */
};

struct cube {
    struct cube_table line, cube; /* the line comes first */
};

struct cube_reader {
    const char *name;
    const uint8_t *data, *end;
    unsigned line_number;
    char line[CUBE_LINE_MAX + 1];
    struct cube *into;
    int has_domain, has_line_range, has_cube_range, has_title;
    size_t expected, count; /* entries, of both tables together */
};

static void cube_free(void *file)
{
    struct cube *cube = file;

    mem_free(cube->line.entries);
    mem_free(cube->cube.entries);
    mem_free(cube);
}

/* ERR_INPUT at the reader's line. */
#define bad_line(r, err, format, ...)                                                              \
    error_set((err), STATUS_ERR_INPUT, "%s, line %u: " format, (r)->name, (r)->line_number,        \
              __VA_ARGS__)

/* The next line, without blanks at its ends; 0 at the end of the file. */
static status cube_next_line(struct cube_reader *r, int *found, struct error *err)
{
    const uint8_t *stop;
    size_t length;

    *found = r->data < r->end;
    if (!*found)
        return STATUS_OK;
    r->line_number++;
    stop = memchr(r->data, '\n', (size_t)(r->end - r->data));
    length = (size_t)((stop ? stop : r->end) - r->data);
    if (length > CUBE_LINE_MAX || memchr(r->data, 0, length))
        return bad_line(r, err, "%s; this is no .cube file",
                        length > CUBE_LINE_MAX ? "the line is too long" : "the line has a zero byte");
    memcpy(r->line, r->data, length);
    r->data += stop ? length + 1 : length;
    while (length > 0 && isspace((unsigned char)r->line[length - 1]))
        length--;
    r->line[length] = 0;
    length = strspn(r->line, " \t");
    memmove(r->line, r->line + length, strlen(r->line + length) + 1);
    return STATUS_OK;
}

/* `count` numbers and nothing else. Only characters of decimal numbers are allowed: strtod alone
 * would accept "nan", "inf" and hexadecimal. */
static status cube_numbers(const struct cube_reader *r, const char *text, double *out, int count, struct error *err)
{
    for (int i = 0; i < count; i++) {
        size_t length;
        char *end;

        text += strspn(text, " \t");
        length = strcspn(text, " \t");
        out[i] = strtod(text, &end);
        if (length == 0)
            return bad_line(r, err, "%d numbers are wanted, and there are %d", count, i);
        if (strspn(text, "+-.0123456789eE") < length || end != text + length)
            return bad_line(r, err, "\"%.*s\" is not a number",
                            (int)(length < CUBE_SHOWN_MAX ? length : CUBE_SHOWN_MAX), text);
        if (!(fabs(out[i]) <= CUBE_VALUE_MAX))
            return bad_line(r, err, "%g is beyond %g; scale the table down", out[i], CUBE_VALUE_MAX);
        text = end;
    }
    text += strspn(text, " \t");
    if (*text)
        return bad_line(r, err, "%d numbers are wanted, and there are more", count);
    return STATUS_OK;
}

static status cube_size(const struct cube_reader *r, const char *keyword, const char *text, struct cube_table *table,
                        uint32_t min, uint32_t max, struct error *err)
{
    double size;
    TRY(cube_numbers(r, text, &size, 1, err));
    if (table->size > 0)
        return bad_line(r, err, "%s is there twice; leave one", keyword);
    if (size != floor(size) || size < min || size > max)
        return bad_line(r, err, "%s must be a whole number from %u to %u, and is %g", keyword, min, max, size);
    table->size = (uint32_t)size;
    return STATUS_OK;
}

/* LUT_1D_INPUT_RANGE and LUT_3D_INPUT_RANGE: one pair for all channels. */
static status cube_range(const struct cube_reader *r, const char *keyword, const char *text, struct cube_table *table,
                         int *seen, struct error *err)
{
    double range[2];
    status st = cube_numbers(r, text, range, 2, err);

    if (st == STATUS_OK && (*seen)++)
        st = bad_line(r, err, "%s is there twice; leave one", keyword);
    for (int c = 0; st == STATUS_OK && c < 3; c++) {
        table->min[c] = range[0];
        table->max[c] = range[1];
    }
    return st;
}

/* DOMAIN_MIN and DOMAIN_MAX: of whichever table there is. */
static status cube_domain(struct cube_reader *r, const char *keyword, const char *text, int is_max, struct error *err)
{
    struct cube *cube = r->into;
    double domain[3];
    status st = cube_numbers(r, text, domain, 3, err);

    if (st == STATUS_OK && (r->has_domain & (1 << is_max)))
        st = bad_line(r, err, "%s is there twice; leave one", keyword);
    if (st != STATUS_OK)
        return st;
    r->has_domain |= 1 << is_max;
    memcpy(is_max ? cube->line.max : cube->line.min, domain, sizeof domain);
    memcpy(is_max ? cube->cube.max : cube->cube.min, domain, sizeof domain);
    return STATUS_OK;
}

static status cube_keyword(struct cube_reader *r, struct error *err)
{
    size_t length = strcspn(r->line, " \t\"");
    char keyword[32] = "";
    const char *rest = r->line + length;
    struct cube *cube = r->into;

    if (length < sizeof keyword)
        memcpy(keyword, r->line, length);
    if (strcmp(keyword, "TITLE") == 0)
        return r->has_title++ ? bad_line(r, err, "%s is there twice; leave one", keyword) : STATUS_OK;
    if (strcmp(keyword, "LUT_1D_SIZE") == 0)
        return cube_size(r, keyword, rest, &cube->line, CUBE_1D_MIN, CUBE_1D_MAX, err);
    if (strcmp(keyword, "LUT_3D_SIZE") == 0)
        return cube_size(r, keyword, rest, &cube->cube, CUBE_3D_MIN, CUBE_3D_MAX, err);
    if (strcmp(keyword, "DOMAIN_MIN") == 0)
        return cube_domain(r, keyword, rest, 0, err);
    if (strcmp(keyword, "DOMAIN_MAX") == 0)
        return cube_domain(r, keyword, rest, 1, err);
    if (strcmp(keyword, "LUT_1D_INPUT_RANGE") == 0)
        return cube_range(r, keyword, rest, &cube->line, &r->has_line_range, err);
    if (strcmp(keyword, "LUT_3D_INPUT_RANGE") == 0)
        return cube_range(r, keyword, rest, &cube->cube, &r->has_cube_range, err);
    if (strcmp(keyword, "LUT_IN_VIDEO_RANGE") == 0 || strcmp(keyword, "LUT_OUT_VIDEO_RANGE") == 0)
        return bad_line(r, err, "%s: tables in video range are not supported; export the table "
                        "in full range", keyword);
    return bad_line(r, err, "\"%.*s\" is no keyword of .cube files",
                    (int)(length < CUBE_SHOWN_MAX ? length : CUBE_SHOWN_MAX), r->line);
}

static status cube_check_domain(const struct cube_reader *r, const struct cube_table *table, struct error *err)
{
    for (int c = 0; c < 3; c++)
        if (!(table->max[c] - table->min[c] >= CUBE_DOMAIN_MIN))
            return error_set(err, STATUS_ERR_INPUT,
                             "%s: the domain from %g to %g holds nothing; its maximum must be "
                             "larger than its minimum", r->name, table->min[c], table->max[c]);
    return STATUS_OK;
}

static status cube_allocate(struct cube_table *table, size_t count, struct error *err)
{
    if (count == 0)
        return STATUS_OK;
    table->entries = mem_alloc_array(count, sizeof *table->entries);
    return table->entries ? STATUS_OK : error_no_memory(err, "a look-up table");
}

/* All keywords have been read: check them, and allocate no more than the file can hold. */
static status cube_begin_entries(struct cube_reader *r, struct error *err)
{
    struct cube *cube = r->into;
    size_t side = cube->cube.size, left = (size_t)(r->end - r->data) + strlen(r->line) + 1;
    status st = STATUS_OK;

    r->expected = cube->line.size + side * side * side;
    if (r->expected == 0)
        return bad_line(r, err, "numbers come before the table's size; the line %s N belongs "
                        "above them", "LUT_1D_SIZE N or LUT_3D_SIZE");
    if (r->has_domain && (r->has_line_range || r->has_cube_range))
        return error_set(err, STATUS_ERR_INPUT, "%s has DOMAIN_MIN or DOMAIN_MAX beside "
                         "LUT_1D_INPUT_RANGE or LUT_3D_INPUT_RANGE; leave one of the two kinds",
                         r->name);
    if (r->has_domain && cube->line.size > 0 && side > 0)
        return error_set(err, STATUS_ERR_INPUT, "%s has two tables, and DOMAIN_MIN or DOMAIN_MAX "
                         "does not say for which; use LUT_1D_INPUT_RANGE and LUT_3D_INPUT_RANGE",
                         r->name);
    if ((left + 1) / CUBE_ENTRY_BYTES < r->expected) /* the last line may lack its end */
        return error_set(err, STATUS_ERR_INPUT, "%s should have %zu lines of numbers, and is too "
                         "short for them; it was cut off, or its size is wrong", r->name,
                         r->expected);
    THEN(st, cube_check_domain(r, &cube->line, err));
    THEN(st, cube_check_domain(r, &cube->cube, err));
    THEN(st, cube_allocate(&cube->line, cube->line.size, err));
    THEN(st, cube_allocate(&cube->cube, side * side * side, err));
    return st;
}

static status cube_entry(struct cube_reader *r, struct error *err)
{
    struct cube *cube = r->into;
    double value[3];
    float *to;
    status st = r->expected == 0 ? cube_begin_entries(r, err) : STATUS_OK;

    THEN(st, cube_numbers(r, r->line, value, 3, err));
    if (st != STATUS_OK)
        return st;
    if (r->count == r->expected)
        return bad_line(r, err, "there are more than the %zu lines of numbers that the size "
                        "tells of", r->expected);
    to = r->count < cube->line.size ? cube->line.entries[r->count]
                                    : cube->cube.entries[r->count - cube->line.size];
    for (int c = 0; c < 3; c++)
        to[c] = (float)value[c];
    r->count++;
    return STATUS_OK;
}

static status cube_read(struct cube_reader *r, struct error *err)
{
    for (;;) {
        int found;
        status st = cube_next_line(r, &found, err);

        if (st == STATUS_OK && !found)
            break;
        if (st == STATUS_OK && r->line[0] && r->line[0] != '#') {
            if (isalpha((unsigned char)r->line[0]) && r->expected > 0)
                st =
                    bad_line(r, err, "\"%.*s\" among the numbers; keywords belong above them", CUBE_SHOWN_MAX, r->line);
            else
                st = strchr("+-.0123456789", r->line[0]) ? cube_entry(r, err) : cube_keyword(r, err);
        }
        if (st != STATUS_OK)
            return st;
    }
    if (r->expected == 0)
        return error_set(err, STATUS_ERR_INPUT, "%s holds no table; is it a .cube file?", r->name);
    if (r->count < r->expected)
        return error_set(err, STATUS_ERR_INPUT, "%s ends after %zu of %zu lines of numbers; it was "
                         "cut off, or its size is wrong", r->name, r->count, r->expected);
    return STATUS_OK;
}

static status cube_load(void **out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    struct cube_reader r = {.name = name, .data = data, .end = data + size_bytes};
    struct cube *cube = mem_calloc(1, sizeof *cube);
    status st;

    *out = NULL;
    NEED(cube, err, "a look-up table");
    for (int c = 0; c < 3; c++)
        cube->line.max[c] = cube->cube.max[c] = 1.0;
    if (size_bytes >= 3 && memcmp(data, "\xef\xbb\xbf", 3) == 0) /* a byte order mark */
        r.data += 3;
    r.into = cube;
    st = cube_read(&r, err);
    if (st != STATUS_OK)
        cube_free(cube);
    else
        *out = cube;
    return st;
}

/* ---- looking up ----------------------------------------------------------------------------- */

/* The position of `value` in a channel of the table: the entry below, and the fraction to the next. */
static uint32_t locate(const struct cube_table *table, int channel, double value, float *fraction)
{
    double last = table->size - 1;
    double at = (value - table->min[channel]) / (table->max[channel] - table->min[channel]) * last;
    uint32_t entry;

    at = fmin(fmax(at, 0.0), last);
    entry = at < last ? (uint32_t)at : table->size - 2;
    *fraction = (float)(at - entry);
    return entry;
}

static void look_up_line(const struct cube_table *table, float rgb[3])
{
    for (int c = 0; c < 3; c++) {
        float t;
        uint32_t at = locate(table, c, (double)rgb[c], &t);
        float below = table->entries[at][c], above = table->entries[at + 1][c];

        rgb[c] = below + t * (above - below);
    }
}

/* Find which of the six tetrahedra around the diagonal from black to white holds the point: its
 * corners are reached by stepping along the channels in the order of their fractions. */
static void look_up_cube(const struct cube_table *table, float rgb[3])
{
    /* The channels, largest fraction first, indexed by which of the pairs red and green, green and
     * blue, red and blue is in order. */
    static const uint8_t orders[8][3] = {{2, 1, 0}, {2, 0, 1}, {1, 2, 0}, {0, 1, 2},
                                         {2, 1, 0}, {0, 2, 1}, {1, 0, 2}, {0, 1, 2}};
    const size_t step[3] = {1, table->size, (size_t)table->size * table->size};
    const float *corner[4];
    const uint8_t *order;
    float t[3] = {0}, weight[4];
    int first, second, third;
    size_t at = 0;

    for (int c = 0; c < 3; c++)
        at += step[c] * locate(table, c, (double)rgb[c], &t[c]);
    order = orders[(t[0] >= t[1]) | (t[1] >= t[2]) << 1 | (t[0] >= t[2]) << 2];
    first = order[0];
    second = order[1];
    third = order[2];
    corner[0] = table->entries[at];
    corner[1] = table->entries[at += step[first]];
    corner[2] = table->entries[at += step[second]];
    corner[3] = table->entries[at + step[third]];
    weight[0] = 1.0f - t[first];
    weight[1] = t[first] - t[second];
    weight[2] = t[second] - t[third];
    weight[3] = t[third];
    for (int c = 0; c < 3; c++)
        rgb[c] =
            weight[0] * corner[0][c] + weight[1] * corner[1][c] + weight[2] * corner[2][c] + weight[3] * corner[3][c];
}

/* ---- the operator --------------------------------------------------------------------------- */

enum { INPUT, OUTPUT, LOG2_MIN, LOG2_MAX };
enum { INPUT_SRGB, INPUT_LINEAR, INPUT_LOG2 };
enum { OUTPUT_DISPLAY, OUTPUT_LINEAR };

static const char *const input_choices[] = {"srgb", "linear", "log2", NULL};
static const char *const output_choices[] = {"display", "linear", NULL};

static const struct tonemap_parameter parameters[] = {
    [INPUT] = {"input", 0, 2, INPUT_SRGB,
               "what the table is for: srgb: sRGB codes of light up to 1; linear: light; log2: "
               "stops from log2-min to log2-max as 0 to 1",
               TONEMAP_CHOICE, input_choices},
    [OUTPUT] = {"result", 0, 1, OUTPUT_DISPLAY,
                "what the table gives: display: codes for the display; linear: display light",
                TONEMAP_CHOICE, output_choices},
    [LOG2_MIN] = {"log2-min", -30.0, 30.0, -10.0,
                  "with input=log2: stops from middle grey (0.18) to the table's 0",
                  TONEMAP_NUMBER, NULL},
    [LOG2_MAX] = {"log2-max", -30.0, 30.0, 6.5,
                  "with input=log2: stops from middle grey (0.18) to the table's 1",
                  TONEMAP_NUMBER, NULL},
};

static float log2_pieces[CURVE_PIECES][4]; /* of 1 to 2 */
static struct curve_table log2_table;
static pthread_once_t log2_once = PTHREAD_ONCE_INIT;

static double log2_of(double x, const void *user UNUSED) { return det_log_d(x) / det_log_d(2.0); }

static void log2_build(void) { curve_table_build(&log2_table, log2_pieces, 0, 1, log2_of, NULL); }

struct look_up {
    const struct cube *cube;
    int input, output;
    double log2_start, log2_scale;
};

/* Stops to 0..1 and beyond. */
static float log2_shape(const struct look_up *l, float light)
{
    uint32_t bits = float_bits(light > FLT_MIN ? light : FLT_MIN);
    float mantissa = float_from_bits((bits & 0x7fffff) | 0x3f800000);
    double stops = (double)((int)(bits >> 23) - 127) + (double)curve_table_at(&log2_table, mantissa);

    return (float)((stops - l->log2_start) * l->log2_scale);
}

static void lut_row(const void *user, float *rgb, uint32_t width)
{
    const struct look_up *l = user;
    size_t count = (size_t)width * 3;

    if (l->input == INPUT_SRGB)
        srgb_encode_row(rgb, count);
    else if (l->input == INPUT_LOG2)
        for (size_t i = 0; i < count; i++)
            rgb[i] = log2_shape(l, rgb[i]);
    for (float *p = rgb; p < rgb + count; p += 3) {
        if (l->cube->line.size > 0)
            look_up_line(&l->cube->line, p);
        if (l->cube->cube.size > 0)
            look_up_cube(&l->cube->cube, p);
    }
    if (l->output == OUTPUT_LINEAR)
        srgb_encode_row(rgb, count);
}

static status lut_apply(const struct tonemap_frame *frame, const double *state UNUSED, struct error *err)
{
    const double *values = frame->values;
    struct look_up l = {
        .cube = frame->file, .input = (int)values[INPUT], .output = (int)values[OUTPUT],
    };

    if (l.input == INPUT_LOG2 && !(values[LOG2_MAX] > values[LOG2_MIN]))
        return error_set(err, STATUS_ERR_INPUT,
                         "lut's log2-max must be larger than its log2-min, and they are %g and %g", values[LOG2_MAX],
                         values[LOG2_MIN]);
    pthread_once(&log2_once, log2_build);
    l.log2_start = log2_of(0.18, NULL) + values[LOG2_MIN];
    l.log2_scale = 1.0 / (values[LOG2_MAX] - values[LOG2_MIN]);
    tonemap_each_row(frame, lut_row, &l);
    return STATUS_OK;
}

const struct tonemap_operator tonemap_lut = {
    .name = "lut",
    .summary = "A look-up table of one's own, from a .cube file.",
    .source = "Adobe, \"Cube LUT Specification\", version 1.0, 2013; tetrahedral interpolation",
    .parameters = parameters,
    .parameter_count = sizeof parameters / sizeof *parameters,
    .display_encoded = 1,
    .apply = lut_apply,
    .file_help = "a .cube file with a 1D table, a 3D table, or both",
    .file_required = 1,
    .file_load = cube_load,
    .file_free = cube_free,
};
