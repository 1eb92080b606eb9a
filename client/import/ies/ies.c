#include "client/import/ies/ies.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "client/import/builder/scan.h"
#include "common/base/memory.h"
#include "common/math/elementary.h"

/* Measured are some hundred angles at most; an angle of a quarter of a degree has its own texels. */
enum { ANGLES_MAX = 4096, CANDELA_MAX = 1 << 22, ROWS_MIN = 16, ROWS_MAX = 720, TEXELS_EACH = 2 };
#define RADIANS (3.14159265358979323846 / 180)
#define SLACK_DEG 1e-3

const double ies_frame[4] = {0.70710678118654752440, 0, 0, 0.70710678118654752440}; /* a quarter turn about x */

enum { TYPE_C = 1, TYPE_B = 2, TYPE_A = 3 };

/* How the horizontal angles of type C go on beyond those of the file. */
enum symmetry { EVERYWHERE, QUADRANTS, HALVES, HALVES_ABOUT_90, NO_SYMMETRY };

struct ies {
    const char *at, *end;
    uint32_t line;
    struct error *err;
    int type;
    uint32_t vertical_count, horizontal_count;
    double *vertical, *horizontal; /* degrees, ascending */
    double *candela;               /* [horizontal_count][vertical_count] */
    double factor, most;
    enum symmetry symmetry;
};

/* ---- reading --------------------------------------------------------------------------------- */

static int is_space(char c) { return c == ' ' || c == ',' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\0'; }

static status read_number(struct ies *f, const char *what, double *out)
{
    size_t length;

    for (; f->at < f->end && is_space(*f->at); f->at++)
        f->line += *f->at == '\n';
    length = scan_double(f->at, f->end, out);
    if (f->at == f->end)
        return error_set(f->err, STATUS_ERR_INPUT, "the IES profile ends before its %s: it is cut short", what);
    if (length == 0 || !isfinite(*out) || (f->at + length < f->end && !is_space(f->at[length])))
        return error_set(f->err, STATUS_ERR_INPUT, "line %u of the IES profile: its %s is not a number", f->line, what);
    f->at += length;
    return STATUS_OK;
}

static status read_count(struct ies *f, const char *what, uint32_t most, uint32_t *out)
{
    double value;

    TRY(read_number(f, what, &value));
    if (!(value >= 1 && value <= most) || value != floor(value))
        return error_set(f->err, STATUS_ERR_INPUT, "line %u of the IES profile: the %s is %g: must be a whole number, 1 to %u",
                         f->line, what, value, most);
    *out = (uint32_t)value;
    return STATUS_OK;
}

static status skip_numbers(struct ies *f, uint32_t count, const char *what)
{
    double ignored;

    for (uint32_t i = 0; i < count; i++)
        TRY(read_number(f, what, &ignored));
    return STATUS_OK;
}

/* The line without its end; NULL: there is none. */
static const char *next_line(struct ies *f, size_t *length)
{
    const char *start = f->at, *stop = f->at;

    if (f->at == f->end)
        return NULL;
    while (stop < f->end && *stop != '\n' && *stop != '\r')
        stop++;
    *length = (size_t)(stop - start);
    f->at = stop;
    if (f->at < f->end && *f->at == '\r')
        f->at++;
    if (f->at < f->end && *f->at == '\n')
        f->at++;
    f->line++;
    return start;
}

/* Skip the keywords, and the table of TILT: how much less a tilted lamp gives. A node does not say how its lamp hangs. */
static status read_head(struct ies *f)
{
    const char *line;
    size_t length;
    uint32_t pairs;

    while ((line = next_line(f, &length)))
        if (length >= 5 && memcmp(line, "TILT=", 5) == 0)
            break;
    if (!line)
        return error_set(f->err, STATUS_ERR_INPUT, "has no line \"TILT=\": it is not an IES profile (LM-63)");
    if (length < 12 || memcmp(line, "TILT=INCLUDE", 12) != 0)
        return STATUS_OK;
    TRY(skip_numbers(f, 1, "lamp's orientation"));
    TRY(read_count(f, "number of tilts", ANGLES_MAX, &pairs));
    return skip_numbers(f, 2 * pairs, "tilts");
}

static status read_angles(struct ies *f, const char *what, uint32_t count, double **out)
{
    double *angles = mem_alloc_array(count, sizeof *angles);

    *out = angles;
    NEED(angles, f->err, "an IES profile");
    for (uint32_t i = 0; i < count; i++) {
        TRY(read_number(f, what, &angles[i]));
        if (fabs(angles[i]) > 360 || (i > 0 && !(angles[i] > angles[i - 1])))
            return error_set(f->err, STATUS_ERR_INPUT, "line %u of the IES profile: the %s must ascend, %g degrees does not",
                             f->line, what, angles[i]);
    }
    return STATUS_OK;
}

static status read_candela(struct ies *f)
{
    const size_t count = (size_t)f->vertical_count * f->horizontal_count;

    if (count > CANDELA_MAX)
        return error_set(f->err, STATUS_ERR_LIMIT, "the IES profile has %zu values: at most %d are taken", count, CANDELA_MAX);
    f->candela = mem_alloc_array(count, sizeof *f->candela);
    NEED(f->candela, f->err, "an IES profile");
    for (size_t i = 0; i < count; i++) {
        TRY(read_number(f, "candela", &f->candela[i]));
        if (f->candela[i] < 0)
            f->candela[i] = 0; /* noise of the measurement */
        f->most = fmax(f->most, f->candela[i]);
    }
    return STATUS_OK;
}

static int is_about(double degrees, double wanted) { return fabs(degrees - wanted) < SLACK_DEG; }

static void find_symmetry(struct ies *f)
{
    const double first = f->horizontal[0], last = f->horizontal[f->horizontal_count - 1];

    f->symmetry = f->horizontal_count == 1                                ? EVERYWHERE
                  : is_about(first, 0) && is_about(last, 90)              ? QUADRANTS
                  : is_about(first, 0) && is_about(last, 180)             ? HALVES
                  : is_about(first, 90) && is_about(last, 270)            ? HALVES_ABOUT_90
                                                                          : NO_SYMMETRY;
}

static status read_profile(struct ies *f)
{
    double multiplier, ballast, later;
    uint32_t type;

    TRY(read_head(f));
    TRY(skip_numbers(f, 2, "lamps and lumens"));
    TRY(read_number(f, "multiplier", &multiplier));
    TRY(read_count(f, "number of vertical angles", ANGLES_MAX, &f->vertical_count));
    TRY(read_count(f, "number of horizontal angles", ANGLES_MAX, &f->horizontal_count));
    TRY(read_count(f, "photometric type", TYPE_A, &type));
    TRY(skip_numbers(f, 4, "units, width, length and height"));
    TRY(read_number(f, "ballast factor", &ballast));
    TRY(read_number(f, "ballast-lamp factor", &later)); /* since 1995: for future use, and 1 */
    TRY(skip_numbers(f, 1, "watts"));
    if (type == TYPE_A)
        return error_set(f->err, STATUS_ERR_UNSUPPORTED, "is an IES profile of photometry of type A: C and B are read");
    f->type = (int)type;
    f->factor = multiplier * ballast * later;
    if (!(f->factor >= 0))
        return error_set(f->err, STATUS_ERR_INPUT, "line %u of the IES profile: its factors' product is %g", f->line, f->factor);
    TRY(read_angles(f, "vertical angles", f->vertical_count, &f->vertical));
    TRY(read_angles(f, "horizontal angles", f->horizontal_count, &f->horizontal));
    TRY(read_candela(f));
    find_symmetry(f);
    return STATUS_OK;
}

/* ---- a direction ----------------------------------------------------------------------------- */

/* The angle's place among others: between *low and the next one, if `share` is not 0. 0: it is outside. */
static int place(const double *angles, uint32_t count, double degrees, uint32_t *low, double *share)
{
    uint32_t high = count - 1;

    *low = 0;
    *share = 0;
    if (degrees < angles[0] - SLACK_DEG || degrees > angles[high] + SLACK_DEG)
        return 0;
    if (degrees >= angles[high]) {
        *low = high;
        return 1;
    }
    while (high - *low > 1) {
        const uint32_t middle = *low + (high - *low) / 2;

        if (angles[middle] <= degrees)
            *low = middle;
        else
            high = middle;
    }
    if (high > *low)
        *share = fmax((degrees - angles[*low]) / (angles[high] - angles[*low]), 0);
    return 1;
}

/* Along one horizontal angle. */
static double along(const struct ies *f, uint32_t horizontal, uint32_t vertical, double share)
{
    const double *row = f->candela + (size_t)horizontal * f->vertical_count;

    return share > 0 ? (1 - share) * row[vertical] + share * row[vertical + 1] : row[vertical];
}

/* The horizontal angle, of 0 to 360 degrees, as the file has it. */
static double folded(const struct ies *f, double degrees)
{
    switch (f->symmetry) {
    case EVERYWHERE: return f->horizontal[0];
    case QUADRANTS: degrees = degrees > 180 ? 360 - degrees : degrees; return degrees > 90 ? 180 - degrees : degrees;
    case HALVES: return degrees > 180 ? 360 - degrees : degrees;
    case HALVES_ABOUT_90: return degrees < 90 ? 180 - degrees : degrees > 270 ? 540 - degrees : degrees;
    case NO_SYMMETRY: break;
    }
    return degrees < f->horizontal[0] ? degrees + 360 : degrees;
}

static double at_angles(const struct ies *f, double vertical, double horizontal)
{
    const uint32_t last = f->horizontal_count - 1;
    const double gap = f->horizontal[0] + 360 - f->horizontal[last]; /* between the last and the first, once around */
    double share_v, share_h;
    uint32_t v, h;

    if (!place(f->vertical, f->vertical_count, vertical, &v, &share_v))
        return 0;
    if (place(f->horizontal, f->horizontal_count, horizontal, &h, &share_h))
        return share_h > 0 ? (1 - share_h) * along(f, h, v, share_v) + share_h * along(f, h + 1, v, share_v)
                           : along(f, h, v, share_v);
    if (f->type != TYPE_C || f->symmetry != NO_SYMMETRY)
        return 0;
    share_h = (horizontal - f->horizontal[last]) / gap;
    return (1 - share_h) * along(f, last, v, share_v) + share_h * along(f, 0, v, share_v);
}

/* `polar`: from z; `azimuth`: from x towards y; degrees. */
static double in_direction(const struct ies *f, double polar, double azimuth)
{
    double x, y, z, horizontal;

    if (f->type == TYPE_C)
        return at_angles(f, 180 - polar, folded(f, azimuth));
    x = det_sin_d(polar * RADIANS) * det_sin_d((azimuth + 90) * RADIANS);
    y = det_sin_d(polar * RADIANS) * det_sin_d(azimuth * RADIANS);
    z = det_sin_d((polar + 90) * RADIANS);
    horizontal = det_atan2_d(-y, sqrt(x * x + z * z)) / RADIANS;
    if (f->horizontal_count == 1)
        horizontal = f->horizontal[0];
    else if (f->horizontal[0] > -SLACK_DEG) /* alike on both sides of a vertical plane */
        horizontal = fabs(horizontal);
    return at_angles(f, det_atan2_d(x, -z) / RADIANS, horizontal);
}

/* ---- the picture ------------------------------------------------------------------------------- */

static double least_step(const double *angles, uint32_t count)
{
    double least = 180;

    for (uint32_t i = 1; i < count; i++)
        least = fmin(least, angles[i] - angles[i - 1]);
    return least;
}

static uint32_t texels_of(double whole_deg, double step_deg, uint32_t most)
{
    const double wanted = ceil(TEXELS_EACH * whole_deg / step_deg);

    return wanted < ROWS_MIN ? ROWS_MIN : wanted < most ? (uint32_t)wanted : most;
}

static status draw(const struct ies *f, struct image *out)
{
    const double step_v = least_step(f->vertical, f->vertical_count), step_h = least_step(f->horizontal, f->horizontal_count);
    const int even = f->type == TYPE_C && f->symmetry == EVERYWHERE;
    const double step = f->type == TYPE_C ? step_v : fmin(step_v, step_h);
    const uint32_t height = texels_of(180, step, ROWS_MAX);
    const uint32_t width = even ? 1 : texels_of(360, f->type == TYPE_C ? step_h : step, 2 * ROWS_MAX);

    TRY(image_init(out, width, height, 3, f->err));
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++) {
            const double azimuth = 360 * fmod(1.5 - (x + 0.5) / width, 1);
            const double value = f->most > 0 ? in_direction(f, 180 * (y + 0.5) / height, azimuth) / f->most : 0;

            for (size_t c = 0; c < 3; c++)
                out->pixels[3 * ((size_t)y * width + x) + c] = (float)value;
        }
    return STATUS_OK;
}

status ies_read(struct image *out, double *candela, const void *data, size_t size_bytes, struct error *err)
{
    struct ies f = {.line = 1, .at = data, .end = (const char *)data + size_bytes, .err = err};
    status result;

    memset(out, 0, sizeof *out);
    result = read_profile(&f);
    *candela = f.most * f.factor;
    THEN(result, draw(&f, out));
    mem_free(f.candela);
    mem_free(f.horizontal);
    mem_free(f.vertical);
    return result;
}
