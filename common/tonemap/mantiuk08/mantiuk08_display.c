/* Displays for mantiuk08: luminance over code, by gamma, gain, black level and ambient light
 * (the paper's equation 2), or by a table. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/tonemap/mantiuk08/mantiuk08.h"

enum { ROWS_MAX = 4096, LINE_MAX_BYTES = 160 };

static const double LIGHT_MIN = 1e-6, LIGHT_MAX = 1e6; /* cd/m^2, of a table */

static const struct {
    double gamma, peak, black; /* peak and black level in cd/m^2 */
    double ambient, reflected; /* lux, and the share of it that the screen reflects */
} models[M08_DISPLAYS] = {
    [M08_LCD] = {2.2, 200.0, 0.8, 60.0, 0.01},
    [M08_LCD_OFFICE] = {2.2, 100.0, 0.8, 400.0, 0.01},
    [M08_LCD_BRIGHT] = {2.6, 500.0, 0.5, 10.0, 0.01},
    [M08_CRT] = {2.2, 80.0, 1.0, 60.0, 0.02},
};

void m08_display_init(struct m08_display *display, int model, const struct m08_lut *lut)
{
    *display = (struct m08_display){
        .gamma = models[model].gamma,
        .range = models[model].peak - models[model].black,
        .offset = models[model].black + models[model].reflected / PI_D * models[model].ambient,
        .lut = model == M08_LUT ? lut : NULL,
    };
}

/* Bisection for the row of the table with row <= `value` <= next row. */
static size_t find_row(const struct m08_lut *lut, double value, int by_light)
{
    size_t low = 0, high = lut->count - 1;

    while (high - low > 1) {
        size_t middle = (low + high) / 2;

        if (value < (by_light ? lut->rows[middle].log_light : lut->rows[middle].code))
            high = middle;
        else
            low = middle;
    }
    return low;
}

static double unit(double value) { return value > 0.0 ? fmin(value, 1.0) : 0.0; }

double m08_display_light(const struct m08_display *display, double code)
{
    const struct m08_lut *lut = display->lut;
    size_t i;
    double share;

    code = unit(code);
    if (!lut)
        return display->range * det_pow_d(code, display->gamma) + display->offset;
    i = find_row(lut, code, 0);
    share = (code - lut->rows[i].code) / (lut->rows[i + 1].code - lut->rows[i].code);
    return det_exp_d(M08_LN10 *
                     (lut->rows[i].log_light + share * (lut->rows[i + 1].log_light - lut->rows[i].log_light)));
}

double m08_display_code(const struct m08_display *display, double light)
{
    const struct m08_lut *lut = display->lut;
    size_t i;
    double share, log_light;

    if (!lut)
        return det_pow_d(unit((light - display->offset) / display->range), 1.0 / display->gamma);
    if (!(light > 0.0))
        return 0.0;
    log_light = det_log_d(light) * M08_INV_LN10;
    i = find_row(lut, log_light, 1);
    share = unit((log_light - lut->rows[i].log_light) / (lut->rows[i + 1].log_light - lut->rows[i].log_light));
    return lut->rows[i].code + share * (lut->rows[i + 1].code - lut->rows[i].code);
}

/* ---- tables --------------------------------------------------------------------------------- */

static const char REMEDY[] = "rows must be \"code,luminance\", the code rising from 0 to 1 and the "
                             "luminance rising too, in cd/m2, such as \"0.5,43.7\"";

/* Position of the reader in a table. */
struct reading {
    const char *name;
    size_t line;
    struct m08_lut *lut;
};

static status fail(const struct reading *r, const char *what, struct error *err)
{
    return error_set(err, STATUS_ERR_INPUT, "%s, line %zu: %s; %s", r->name, r->line, what, REMEDY);
}

/* A number of digits, sign, point and exponent, with spaces around it. NULL: none. */
static const char *read_number(const char *text, double *out)
{
    size_t length;
    char *end;

    text += strspn(text, " \t");
    length = strspn(text, "0123456789+-.eE");
    *out = strtod(text, &end);
    if (length == 0 || end != text + length)
        return NULL;
    return end + strspn(end, " \t");
}

static status read_row(struct reading *r, const char *text, struct error *err)
{
    struct m08_lut *lut = r->lut;
    double code, light, log_light;
    const char *rest = read_number(text, &code);

    if (!rest || *rest != ',')
        return fail(r, "no number and comma at its start", err);
    rest = read_number(rest + 1, &light);
    if (!rest || *rest)
        return fail(r, "not one number after the comma", err);
    if (lut->count == 0 ? code != 0.0 : !(code > lut->rows[lut->count - 1].code && code <= 1.0))
        return fail(r, lut->count == 0 ? "the first code is not 0" : "the code is not above the one before, or above 1",
                    err);
    if (!(light >= LIGHT_MIN && light <= LIGHT_MAX))
        return fail(r, "the luminance is not from 1e-6 to 1e6 cd/m2", err);
    log_light = det_log_d(light) * M08_INV_LN10;
    if (lut->count > 0 && !(log_light > lut->rows[lut->count - 1].log_light))
        return fail(r, "the luminance is not above the one before", err);
    if (lut->count == ROWS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%s, line %zu: a display's table may have %d rows; "
                         "leave some out", r->name, r->line, ROWS_MAX);
    lut->rows[lut->count].code = code;
    lut->rows[lut->count++].log_light = log_light;
    return STATUS_OK;
}

/* Skip empty lines and those that begin with #. */
static status read_line(struct reading *r, const char *line, size_t length, struct error *err)
{
    char text[LINE_MAX_BYTES];

    if (length > 0 && line[length - 1] == '\r')
        length--;
    if (length > 0 && line[0] == '#')
        return STATUS_OK;
    if (length >= sizeof text)
        return fail(r, "too long", err);
    if (memchr(line, 0, length))
        return fail(r, "not text", err);
    memcpy(text, line, length);
    text[length] = 0;
    return text[strspn(text, " \t")] ? read_row(r, text, err) : STATUS_OK;
}

status m08_lut_load(void **out, const uint8_t *data, size_t size, const char *name, struct error *err)
{
    struct reading r = {.name = name};
    const char *text = (const char *)data, *end = text + size;
    status st = STATUS_OK;

    *out = NULL;
    r.lut = mem_calloc(1, sizeof *r.lut + ROWS_MAX * sizeof *r.lut->rows);
    NEED(r.lut, err, "a display's table");
    while (st == STATUS_OK && text < end) {
        const char *newline = memchr(text, '\n', (size_t)(end - text));
        const char *stop = newline ? newline : end;

        r.line++;
        st = read_line(&r, text, (size_t)(stop - text), err);
        text = newline ? newline + 1 : end;
    }
    if (st == STATUS_OK && r.lut->count < 2)
        st = fail(&r, "fewer than two rows", err);
    if (st == STATUS_OK && r.lut->rows[r.lut->count - 1].code != 1.0)
        st = fail(&r, "the last code is not 1", err);
    if (st == STATUS_OK)
        *out = r.lut;
    else
        mem_free(r.lut);
    return st;
}

void m08_lut_free(void *lut) { mem_free(lut); }
