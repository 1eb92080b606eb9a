#include "common/schema/setting.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/duration.h"
#include "common/base/number.h"

static const void *member(const struct setting *row, const void *record) { return (const char *)record + row->offset; }

/* Of a NUMBER: a float, or a double. */
static double real_of(const struct setting *row, const void *record)
{
    float value;
    double exact;

    memcpy(row->bytes == sizeof exact ? (void *)&exact : (void *)&value, member(row, record), row->bytes);
    return row->bytes == sizeof exact ? exact : (double)value;
}

/* As the member holds it. */
static double rounded(const struct setting *row, double value)
{
    return row->bytes == sizeof(float) ? (double)(float)value : value;
}

/* Of any kind but NUMBER. */
static uint64_t whole_of(const struct setting *row, const void *record)
{
    uint64_t value = 0;

    memcpy(&value, member(row, record), row->bytes); /* little-endian: protocol/message.c */
    return value;
}

double setting_number(const struct setting *row, const void *record)
{
    return row->kind == SETTING_KIND_NUMBER ? real_of(row, record) : (double)whole_of(row, record);
}

static void set_real(const struct setting *row, void *record, double exact)
{
    const float value = (float)exact;

    memcpy((char *)record + row->offset, row->bytes == sizeof exact ? (const void *)&exact : (const void *)&value,
           row->bytes);
}

static void set_whole(const struct setting *row, void *record, uint64_t value)
{
    memcpy((char *)record + row->offset, &value, row->bytes);
}

void setting_reset(const struct setting *row, void *record)
{
    if (row->kind == SETTING_KIND_NUMBER)
        set_real(row, record, row->initial);
    else
        set_whole(row, record, (uint64_t)row->initial);
}

void setting_default_absent(const struct setting *row, void *record)
{
    if (row->kind == SETTING_KIND_NUMBER && row->least > 0 && real_of(row, record) == 0)
        setting_reset(row, record);
}

int setting_is_default(const struct setting *row, const void *record)
{
    return row->kind == SETTING_KIND_NUMBER ? real_of(row, record) == rounded(row, row->initial)
                                            : whole_of(row, record) == (uint64_t)row->initial;
}

int setting_is_told(const struct setting *row, const void *record)
{
    return row->shown == SETTING_SHOWN_ALWAYS || !setting_is_default(row, record);
}

int setting_is_number(const struct setting *row)
{
    return row->kind == SETTING_KIND_NUMBER || (row->kind == SETTING_KIND_WHOLE && row->bytes < sizeof(uint64_t));
}

int setting_equal(const struct setting *row, const void *a, const void *b)
{
    return row->kind == SETTING_KIND_NUMBER ? real_of(row, a) == real_of(row, b) : whole_of(row, a) == whole_of(row, b);
}

/* ---- texts ---------------------------------------------------------------------------------- */

const char *setting_set_text(enum choice_name choice, uint64_t set, char out[SETTING_TEXT_SIZE])
{
    size_t used = 0;

    for (unsigned bit = 0; bit < 64; bit++) {
        const char *known = choice_word(choice, bit), *word = set >> bit & 1 ? known ? known : "unknown" : "";
        if (used && *word && used < SETTING_TEXT_SIZE - 1)
            out[used++] = ',';
        for (; *word && used < SETTING_TEXT_SIZE - 1; word++)
            out[used++] = *word == ' ' ? '-' : *word;
    }
    out[used] = 0;
    return out;
}

const char *setting_text(const struct setting *row, const void *record, char out[SETTING_TEXT_SIZE])
{
    const char *word;

    switch (row->kind) {
    case SETTING_KIND_NUMBER:
        if (row->bytes == sizeof(double))
            snprintf(out, SETTING_TEXT_SIZE, "%.17g", real_of(row, record));
        else
            snprintf(out, SETTING_TEXT_SIZE, "%.9g", number_of_float((float)real_of(row, record)));
        break;
    case SETTING_KIND_WHOLE: snprintf(out, SETTING_TEXT_SIZE, "%" PRIu64, whole_of(row, record)); break;
    case SETTING_KIND_DURATION: snprintf(out, SETTING_TEXT_SIZE, "%.12gs", (double)whole_of(row, record) / 1000); break;
    case SETTING_KIND_CHOICE:
        word = choice_word(row->choice, whole_of(row, record));
        snprintf(out, SETTING_TEXT_SIZE, "%s", word ? word : "unknown");
        break;
    case SETTING_KIND_SWITCH: snprintf(out, SETTING_TEXT_SIZE, "%s", whole_of(row, record) ? "off" : "on"); break;
    case SETTING_KIND_SET: return setting_set_text(row->choice, whole_of(row, record), out);
    case SETTING_KIND_OWN: out[0] = 0;
    }
    return out;
}

/* ---- checks --------------------------------------------------------------------------------- */

static int is_within(const struct setting *row, double value)
{
    return value >= rounded(row, row->least) && value <= rounded(row, row->most); /* only a NUMBER has so few bytes */
}

static status outside(const struct setting *row, const char *value, enum status code, struct error *err)
{
    const char *dashes = code == STATUS_ERR_USAGE ? "--" : "";
    const char *says = code == STATUS_ERR_USAGE || !row->says ? row->option ? row->option : row->name : row->says;
    const char *unit = row->kind == SETTING_KIND_DURATION ? " milliseconds" : "";

    if (row->kind == SETTING_KIND_NUMBER)
        return error_set(err, code, "%s%s: %s is outside %g..%g", dashes, says, value, row->least, row->most);
    return error_set(err, code, "%s%s: %s is outside %.0f..%.0f%s", dashes, says, value, row->least, row->most, unit);
}

status setting_check(const struct setting *row, const void *record, struct error *err)
{
    char text[SETTING_TEXT_SIZE];
    int good = 1;

    switch (row->kind) {
    case SETTING_KIND_NUMBER:
    case SETTING_KIND_WHOLE:
    case SETTING_KIND_SWITCH:
    case SETTING_KIND_DURATION:
        good = setting_is_default(row, record) || is_within(row, setting_number(row, record));
        break;
    case SETTING_KIND_CHOICE:
        if (choice_word(row->choice, whole_of(row, record)))
            break;
        return error_set(err, STATUS_ERR_INPUT, "unknown %s %" PRIu64, row->says ? row->says : row->option,
                         whole_of(row, record));
    case SETTING_KIND_SET:
        for (uint64_t left = whole_of(row, record); left; left &= left - 1)
            if (!choice_word(row->choice, (uint64_t)__builtin_ctzll(left)))
                return error_set(err, STATUS_ERR_INPUT, "%s: bit %d has no name", row->option, __builtin_ctzll(left));
        break;
    case SETTING_KIND_OWN: break;
    }
    return good ? STATUS_OK : outside(row, setting_text(row, record, text), STATUS_ERR_INPUT, err);
}

/* ---- options -------------------------------------------------------------------------------- */

static status parse_number(const struct setting *row, const char *text, void *record, struct error *err)
{
    char *end;
    double value = strtod(text, &end);

    if (end == text || *end || !isfinite(value))
        return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is not a number", row->option, text);
    set_real(row, record, value);
    return is_within(row, setting_number(row, record)) ? STATUS_OK : outside(row, text, STATUS_ERR_USAGE, err);
}

static status parse_whole(const struct setting *row, const char *text, void *record, struct error *err)
{
    char *end, *rest;
    unsigned long long value;

    errno = 0;
    value = strtoull(text, &end, 10);
    if (end > text && (*end == 'e' || *end == '.')) { /* 2e9 */
        double real = strtod(text, &rest);
        if (real >= 0 && real < 0x1p63 && real == floor(real)) {
            value = (unsigned long long)real;
            end = rest;
        }
    }
    if (end == text || *end || errno == ERANGE || strchr(text, '-'))
        return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is not a whole number from 0 on", row->option, text);
    set_whole(row, record, value);
    return is_within(row, (double)value) ? STATUS_OK : outside(row, text, STATUS_ERR_USAGE, err);
}

/* The bits of words with commas between. */
static status parse_set(const struct setting *row, const char *text, void *record, struct error *err)
{
    char word[64], known[SETTING_TEXT_SIZE];
    uint64_t all = 0, set = whole_of(row, record);

    for (unsigned bit = 0; bit < 64; bit++)
        all |= choice_word(row->choice, bit) ? (uint64_t)1 << bit : 0;
    for (const char *at = text;; at++) {
        size_t length = strcspn(at, ",");
        int bit;

        snprintf(word, sizeof word, "%.*s", (int)(length < sizeof word ? length : sizeof word - 1), at);
        bit = choice_find(row->choice, word);
        if (bit < 0)
            return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is unknown; known are %s", row->option, word,
                             setting_set_text(row->choice, all, known));
        set |= (uint64_t)1 << bit;
        at += length;
        if (!*at)
            break;
    }
    set_whole(row, record, set);
    return STATUS_OK;
}

static status parse_duration(const struct setting *row, const char *text, void *record, struct error *err)
{
    char option[64];
    uint64_t value;
    status s;

    snprintf(option, sizeof option, "--%s", row->option);
    s = duration_parse_ms(option, text, (uint64_t)row->least, (uint64_t)row->most, &value, err);
    if (s == STATUS_OK)
        set_whole(row, record, value);
    return s;
}

status setting_parse(const struct setting *row, const char *text, void *record, struct error *err)
{
    int number = -1;

    switch (row->kind) {
    case SETTING_KIND_NUMBER: return parse_number(row, text, record, err);
    case SETTING_KIND_WHOLE: return parse_whole(row, text, record, err);
    case SETTING_KIND_DURATION: return parse_duration(row, text, record, err);
    case SETTING_KIND_SET: return parse_set(row, text, record, err);
    case SETTING_KIND_CHOICE: number = choice_find(row->choice, text); break;
    case SETTING_KIND_SWITCH: number = strcmp(text, "off") == 0 ? 1 : strcmp(text, "on") == 0 ? 0 : -1; break;
    case SETTING_KIND_OWN: return STATUS_OK;
    }
    if (number < 0)
        return error_set(err, STATUS_ERR_USAGE, "--%s: '%s' is not one of %s", row->option, text, row->words);
    set_whole(row, record, (uint64_t)number);
    return STATUS_OK;
}
