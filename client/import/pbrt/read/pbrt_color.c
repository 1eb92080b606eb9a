/* Colours and spectra of parameters. */
#include <string.h>
#include <strings.h>

#include "client/import/pbrt/read/pbrt_context.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/image/color.h"

enum { SPECTRUM_SAMPLES_MAX = 1 << 16 };

/* pbrt-v4's colour spaces; all except ACES have the white point D65. */
static const struct {
    const char *name;
    struct color_primaries primaries;
} spaces[SPACE_COUNT] = {
    {"srgb", {{0.64, 0.33}, {0.30, 0.60}, {0.15, 0.06}, {0.3127, 0.3290}}},
    {"rec2020", {{0.708, 0.292}, {0.170, 0.797}, {0.131, 0.046}, {0.3127, 0.3290}}},
    {"dci-p3", {{0.680, 0.320}, {0.265, 0.690}, {0.150, 0.060}, {0.3127, 0.3290}}},
    {"aces2065-1", {{0.7347, 0.2653}, {0.0, 1.0}, {0.0001, -0.077}, {0.32168, 0.33767}}},
};

int pbrt_space_of(const char *name)
{
    for (int i = 0; i < SPACE_COUNT; i++)
        if (strcasecmp(name, spaces[i].name) == 0)
            return i;
    return -1;
}

static void to_rec709(int space, double rgb[3])
{
    double m[3][3], out[3];

    if (space <= SPACE_SRGB || space >= SPACE_COUNT || !color_to_rec709(&spaces[space].primaries, m))
        return;
    for (int i = 0; i < 3; i++)
        out[i] = m[i][0] * rgb[0] + m[i][1] * rgb[1] + m[i][2] * rgb[2];
    memcpy(rgb, out, sizeof out);
}

/* ---- files of spectra --------------------------------------------------------------------- */

static int next_field(const char *text, size_t size, size_t *at, char *field, size_t field_size)
{
    size_t length = 0;

    while (*at < size) {
        char c = text[*at];
        if (c == '#')
            while (*at < size && text[*at] != '\n')
                ++*at;
        else if (c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == ',')
            ++*at;
        else
            break;
    }
    while (*at < size && !strchr(" \t\r\n,#", text[*at]) && length + 1 < field_size)
        field[length++] = text[(*at)++];
    field[length] = 0;
    return length > 0;
}

static status parse_file(struct pbrt *p, const char *name, const struct pbrt_place *at, const struct buffer *bytes,
                         struct spectrum *out)
{
    double *samples = NULL;
    size_t capacity = 0, count = 0, place = 0;
    status result = STATUS_OK;
    char field[64];

    while (next_field(buffer_text(bytes), bytes->size, &place, field, sizeof field)) {
        double value;
        if (count >= 2 * SPECTRUM_SAMPLES_MAX || !pbrt_number(field, &value)) {
            result = pbrt_fail(p, STATUS_ERR_INPUT, at,
                               "\"%.100s\" is not a spectrum file: it takes pairs of wavelength "
                               "and value",
                               name);
            goto done;
        }
        MUST_GROW(samples, capacity, count + 1);
        samples[count++] = value;
    }
    if (count < 2 || count % 2)
        result = pbrt_fail(p, STATUS_ERR_INPUT, at,
                           "\"%.100s\" holds %zu numbers: pairs of wavelength and value are "
                           "expected",
                           name, count);
    if (result == STATUS_OK) {
        double *kept = must(ARENA_ARRAY(&p->arena, double, count));
        memcpy(kept, samples, count * sizeof *kept);
        *out = (struct spectrum){kept, count / 2, 1};
    }
done:
    mem_free(samples);
    return result;
}

static status check_ascending(struct pbrt *p, const struct spectrum *s, const struct pbrt_place *at)
{
    for (size_t i = 1; i < s->count; i++)
        if (!(s->samples[2 * i] > s->samples[2 * i - 2]))
            return pbrt_fail(p, STATUS_ERR_INPUT, at, "a spectrum's wavelengths must ascend: %g does not come after %g",
                             s->samples[2 * i], s->samples[2 * i - 2]);
    return STATUS_OK;
}

static status read_spectrum_file(struct pbrt *p, const char *name, const struct pbrt_place *at, struct spectrum *out)
{
    struct spectrum *kept = pbrt_name_find(&p->spectra, name);
    struct buffer bytes = BUFFER_INIT;
    status result;

    if (kept) {
        *out = *kept;
        return STATUS_OK;
    }
    result = pbrt_read_file(&p->reader, name, at, &bytes, p->err);
    THEN(result, parse_file(p, name, at, &bytes, out));
    buffer_release(&bytes);
    THEN(result, check_ascending(p, out, at));
    if (result != STATUS_OK)
        return result;
    kept = must(ARENA_NEW(&p->arena, struct spectrum));
    *kept = *out;
    pbrt_name_set(p, &p->spectra, name, kept);
    return STATUS_OK;
}

/* ---- parameters --------------------------------------------------------------------------- */

status pbrt_spectrum(struct pbrt *p, const struct pbrt_param *param, struct spectrum *out, int *given)
{
    const struct spectrum *named;

    *given = 0;
    if (!param || param->type != PBRT_SPECTRUM)
        return STATUS_OK;
    *given = 1;
    if (param->string_count == 0) {
        *out = (struct spectrum){param->numbers, param->number_count / 2, 0};
        return check_ascending(p, out, &param->at);
    }
    named = spectrum_named(param->strings[0]);
    if (named) {
        *out = *named;
        return STATUS_OK;
    }
    return read_spectrum_file(p, param->strings[0], &param->at, out);
}

status pbrt_color_of(struct pbrt *p, const struct pbrt_param *param, int color_space, enum pbrt_use use, double out[3])
{
    double limit = use == USE_REFLECTANCE ? 1 : 1e30;
    double scale = 1;

    out[0] = out[1] = out[2] = 0;
    if (param->type == PBRT_BLACKBODY) {
        double peaked = spectrum_blackbody(param->numbers[0], out);
        /* pbrt-v3: its strength, of a spectrum whose largest value is 1 */
        if (param->number_count > 1 || p->version3)
            scale = (param->number_count > 1 ? param->numbers[1] : 1) * (p->version3 ? peaked : 1);
    } else if (param->type == PBRT_SPECTRUM) {
        struct spectrum s;
        double index, abbe;
        int given;
        if (param->string_count && use == USE_LIGHT && spectrum_named_light(param->strings[0], out))
            return STATUS_OK;
        if (param->string_count && spectrum_named_glass(param->strings[0], &index, &abbe)) {
            out[0] = out[1] = out[2] = index;
            return STATUS_OK;
        }
        TRY(pbrt_spectrum(p, param, &s, &given));
        if (use != USE_LIGHT)
            spectrum_reflectance(&s, out);
        else if (spectrum_light(&s, out) && p->version3)
            scale = spectrum_luminance(&s); /* pbrt-v4 scales every spectrum to luminance 1 */
    } else {
        memcpy(out, param->numbers, 3 * sizeof *out);
        to_rec709(color_space, out);
    }
    for (int i = 0; i < 3; i++) {
        double value = out[i] * scale;
        out[i] = value > 0 ? value < limit ? value : limit : 0;
        if (use == USE_REFLECTANCE && value > 1.0001 && param->type == PBRT_RGB)
            pbrt_warn(p, &param->at, "reflectance above 1", "\"%.60s\" is %g: a reflectance is at most 1", param->name,
                      value);
    }
    return STATUS_OK;
}

status pbrt_color(struct pbrt *p, struct pbrt_params *params, const char *name, enum pbrt_use use, double out[3],
                  int *given)
{
    const struct pbrt_param *param = pbrt_param(params, name, PBRT_COLORS);

    *given = param != NULL;
    return param ? pbrt_color_of(p, param, params->color_space, use, out) : STATUS_OK;
}
