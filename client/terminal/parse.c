#include "client/terminal/parse.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/effects.h"
#include "common/scene/settings.h"

/* Decimal digits only (strtoul would also accept signs and blanks); NULL if there are none or the
 * number is above `max`. */
static const char *parse_digits(const char *text, uint64_t max, uint64_t *out)
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

status parse_size(const char *text, uint32_t *width, uint32_t *height, struct error *err)
{
    uint64_t w, h;
    const char *at = parse_digits(text, UINT32_MAX, &w);

    if (!at || (*at != 'x' && *at != 'X') || !(at = parse_digits(at + 1, UINT32_MAX, &h)) || *at)
        return error_set(err, STATUS_ERR_USAGE,
                         "--size: '%s' is not a size, write WIDTHxHEIGHT as in 1280x720", text);
    if (w < 1 || h < 1 || w > SETTINGS_SIZE_MAX || h > SETTINGS_SIZE_MAX ||
        w * h > SETTINGS_PIXELS_MAX)
        return error_set(err, STATUS_ERR_USAGE,
                         "--size: %s: each side must be 1..%d and the whole at most %d pixels",
                         text, SETTINGS_SIZE_MAX, SETTINGS_PIXELS_MAX);
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return STATUS_OK;
}

/* Parse "7" or "7-9"; returns its end. NULL: it is neither. */
static const char *parse_range(const char *text, uint64_t *first, uint64_t *last)
{
    const char *at = parse_digits(text, INT32_MAX, first);

    *last = *first;
    return at && *at == '-' ? parse_digits(at + 1, INT32_MAX, last) : at;
}

status parse_frames(const char *text, uint32_t *first, uint32_t *last, struct error *err)
{
    uint64_t a, b;
    const char *at = parse_range(text, &a, &b);

    if (!at || *at)
        return error_set(err, STATUS_ERR_USAGE,
                         "--frames: '%s' is not a range, write FIRST-LAST as in 1-48, or one number",
                         text);
    if (b < a)
        return error_set(err, STATUS_ERR_USAGE, "--frames: %s: the first is after the last", text);
    if (b - a >= SETTINGS_FRAMES_MAX)
        return error_set(err, STATUS_ERR_USAGE, "--frames: %s: more than %d frames in one job",
                         text, SETTINGS_FRAMES_MAX);
    *first = (uint32_t)a;
    *last = (uint32_t)b;
    return STATUS_OK;
}

status parse_frame_list(const char *text, struct frame_list *out, struct error *err)
{
    uint64_t first = 0, last = 0, next = 0;
    size_t capacity = 0;

    *out = (struct frame_list){0};
    for (const char *at = text;; at++) {
        at = parse_range(at, &first, &last);
        if (!at || (*at && *at != ',') || last < first || first < next)
            return error_set(err, STATUS_ERR_USAGE,
                             "--frames: '%s' is not a list of frames: write numbers and ranges that "
                             "ascend, as in 3,7-9",
                             text);
        next = last + 1;
        if (last - first + out->count >= SETTINGS_FRAMES_MAX)
            return error_set(err, STATUS_ERR_USAGE, "--frames: %s: more than %d frames", text,
                             SETTINGS_FRAMES_MAX);
        if (!MEM_GROW(out->items, capacity, out->count + (last - first) + 1))
            return error_no_memory(err, "a list of frames");
        while (first <= last)
            out->items[out->count++] = (uint32_t)first++;
        if (*at == 0)
            return STATUS_OK;
    }
}

status parse_parameter(const char *text, char *name, size_t name_size, const char **value,
                       struct error *err)
{
    const char *equals = strchr(text, '=');
    size_t length = equals ? (size_t)(equals - text) : 0;

    if (length == 0 || !equals[1])
        return error_set(err, STATUS_ERR_USAGE,
                         "--tonemap-param: '%s' is not a parameter, write NAME=VALUE", text);
    if (length >= name_size)
        return error_set(err, STATUS_ERR_USAGE, "--tonemap-param: '%s': the name is too long",
                         text);
    memcpy(name, text, length);
    name[length] = 0;
    *value = equals + 1;
    return STATUS_OK;
}

/* The names of a list, each turned into a bit of *set; `find` returns -1 for an unknown one, which
 * is put into `unknown`. */
enum { NAME_SIZE = 64 };
static int parse_names(const char *text, int (*find)(const char *name), uint64_t *set,
                       char unknown[NAME_SIZE])
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
        if (!(EFFECTS_SWITCHABLE >> i & 1) ||
            !strstr(settings_effects_text((uint64_t)1 << i, text), name))
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
        return error_set(err, STATUS_ERR_USAGE,
                         "--without: '%s' is not an effect that can be left out; these can: %s",
                         unknown, settings_effects_text(EFFECTS_SWITCHABLE, known));
    return STATUS_OK;
}

status parse_aovs(const char *text, uint32_t *set, struct error *err)
{
    char unknown[NAME_SIZE], known[SETTINGS_TEXT_SIZE];
    uint64_t bits = *set;

    if (!parse_names(text, aov_parse, &bits, unknown))
        return error_set(err, STATUS_ERR_USAGE, "--aov: '%s' is unknown; known are %s", unknown,
                         settings_aovs_text((1u << AOV_COUNT) - 1, known));
    *set = (uint32_t)bits;
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
                         "--format: '%s' is not one of exr, png and jpg; write a list as in exr,png",
                         unknown);
    *formats = (unsigned)bits;
    return STATUS_OK;
}

status parse_job(const char *text, uint64_t *job, struct error *err)
{
    const char *at = parse_digits(text, INT64_MAX, job);

    if (!at || *at || *job == 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "'%s' is not a job number ('azulejo list' prints them)", text);
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
