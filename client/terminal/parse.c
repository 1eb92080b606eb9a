#include "client/terminal/parse.h"

#include <math.h>
#include <string.h>

#include "common/film/tiles.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"

const char *parse_digits(const char *text, uint64_t max, uint64_t *out)
{
    uint64_t value = 0;

    if (*text < '0' || *text > '9')
        return NULL;
    for (; *text >= '0' && *text <= '9'; text++) {
        uint64_t digit = (uint64_t)(*text - '0');
        if (value > (max - digit) / 10)
            return NULL;
        value = value * 10 + digit;
    }
    *out = value;
    return text;
}

status parse_size(const char *option, const char *text, uint32_t *width, uint32_t *height, struct error *err)
{
    uint64_t w, h;
    const char *at = parse_digits(text, UINT32_MAX, &w);

    if (!at || (*at != 'x' && *at != 'X') || !(at = parse_digits(at + 1, UINT32_MAX, &h)) || *at)
        return error_set(err, STATUS_ERR_USAGE, "%s: '%s' is not a size, write WIDTHxHEIGHT as in 1280x720", option,
                         text);
    if (w < 1 || h < 1 || w > SETTINGS_SIZE_MAX || h > SETTINGS_SIZE_MAX || w * h > SETTINGS_PIXELS_MAX)
        return error_set(err, STATUS_ERR_USAGE, "%s: %s: each side must be 1..%d and the whole at most %d pixels",
                         option, text, SETTINGS_SIZE_MAX, SETTINGS_PIXELS_MAX);
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return STATUS_OK;
}

status parse_region(const char *text, struct tile_rect *out, struct error *err)
{
    uint64_t numbers[4];
    const char *at = text;

    memset(out, 0, sizeof *out);
    for (int i = 0; i < 4 && at; i++) {
        at = parse_digits(at, SETTINGS_SIZE_MAX, &numbers[i]);
        if (at && *at++ != (i < 3 ? ',' : 0))
            at = NULL;
    }
    if (!at || numbers[2] == 0 || numbers[3] == 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "--region: '%s' is no region, write X,Y,WIDTH,HEIGHT in pixels from the upper left "
                         "corner, as in 100,50,320,200",
                         text);
    *out = (struct tile_rect){(uint32_t)numbers[0], (uint32_t)numbers[1], (uint32_t)numbers[2],
                              (uint32_t)numbers[3]};
    return STATUS_OK;
}

status parse_parameter(const char *text, char *name, size_t name_size, const char **value, struct error *err)
{
    const char *equals = strchr(text, '=');
    size_t length = equals ? (size_t)(equals - text) : 0;

    if (length == 0 || !equals[1])
        return error_set(err, STATUS_ERR_USAGE, "--tonemap-param: '%s' is not a parameter, write NAME=VALUE", text);
    if (length >= name_size)
        return error_set(err, STATUS_ERR_USAGE, "--tonemap-param: '%s': the name is too long", text);
    memcpy(name, text, length);
    name[length] = 0;
    *value = equals + 1;
    return STATUS_OK;
}

/* The names of a list, each turned into a bit of *set; `find` returns -1 for an unknown one, which
 * is put into `unknown`. */
enum { NAME_SIZE = 64 };
static int parse_names(const char *text, int (*find)(const char *name), uint64_t *set, char unknown[NAME_SIZE])
{
    for (const char *at = text;; at++) {
        size_t length = strcspn(at, ","), kept = length < NAME_SIZE ? length : NAME_SIZE - 1;
        int bit;

        memcpy(unknown, at, kept);
        unknown[kept] = 0;
        bit = find(unknown);
        if (bit < 0)
            return 0;
        *set |= (uint64_t)1 << bit;
        at += length;
        if (!*at)
            return 1;
    }
}

static int effect_find(const char *name)
{
    int found = effect_parse(name);
    char text[SETTINGS_TEXT_SIZE];

    if (found >= 0)
        return EFFECTS_SWITCHABLE >> found & 1 ? found : -1;
    for (int i = 0; i < EFFECT_COUNT && *name; i++) {
        if (!(EFFECTS_SWITCHABLE >> i & 1) || !strstr(settings_effects_text((uint64_t)1 << i, text), name))
            continue;
        if (found >= 0)
            return -1;
        found = i;
    }
    return found;
}

status parse_effects(const char *text, uint64_t *set, struct error *err)
{
    char unknown[NAME_SIZE], known[SETTINGS_TEXT_SIZE];

    if (!parse_names(text, effect_find, set, unknown))
        return error_set(err, STATUS_ERR_USAGE, "--without: '%s' is not an effect that can be left out; these can: %s",
                         unknown, settings_effects_text(EFFECTS_SWITCHABLE, known));
    return STATUS_OK;
}

static int format_find(const char *name)
{
    static const char *const names[] = {"exr", "png", "jpg"}; /* in enum output_format's order */

    for (int i = 0; i < (int)(sizeof names / sizeof names[0]); i++)
        if (strcmp(names[i], name) == 0)
            return i;
    return -1;
}

status parse_formats(const char *text, unsigned *formats, struct error *err)
{
    char unknown[NAME_SIZE];
    uint64_t bits = 0;

    if (!parse_names(text, format_find, &bits, unknown))
        return error_set(err, STATUS_ERR_USAGE,
                         "--format: '%s' is not one of exr, png and jpg; write a list as in exr,png", unknown);
    *formats = (unsigned)bits;
    return STATUS_OK;
}

status parse_job(const char *text, uint64_t *job, struct error *err)
{
    const char *at = parse_digits(text, INT64_MAX, job);

    if (!at || *at || *job == 0)
        return error_set(err, STATUS_ERR_USAGE, "'%s' is not a job number ('azulejo list' prints them)", text);
    return STATUS_OK;
}

void picture_size_default(float aspect, uint32_t *width, uint32_t *height)
{
    const double rows = 720;
    double columns;

    *width = 1280;
    *height = 720;
    if (!(aspect > 0) || !isfinite(aspect))
        return;
    columns = 2 * round(rows * (double)aspect / 2);
    *width = columns < 2 ? 2 : columns > SETTINGS_SIZE_MAX ? SETTINGS_SIZE_MAX : (uint32_t)columns;
}
