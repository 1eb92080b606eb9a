#include "client/import/builder/scan.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum {
    EXACT_POWER_MAX = 22, /* 10^22 is the largest power of ten that a double holds exactly */
    MANTISSA_DIGITS_MAX = 18,
    NUMBER_CHARS_MAX = 800, /* enough to round every double correctly */
    EXPONENT_MAX = 100000,
};
#define EXACT_MANTISSA_MAX ((uint64_t)1 << 53)

static int is_digit(char c) { return c >= '0' && c <= '9'; }

size_t scan_integer(const char *text, const char *end, int64_t *out)
{
    const char *p = text;
    int negative = 0;
    int64_t value = 0;

    if (p < end && (*p == '-' || *p == '+'))
        negative = *p++ == '-';
    if (p == end || !is_digit(*p))
        return 0;
    for (; p < end && is_digit(*p); p++)
        if (__builtin_mul_overflow(value, 10, &value) || __builtin_add_overflow(value, *p - '0', &value))
            return 0;
    *out = negative ? -value : value;
    return (size_t)(p - text);
}

/* inf, nan and similar. */
static size_t scan_special(const char *text, const char *end, int negative, double *out)
{
    static const struct {
        const char *word;
        double value;
    } words[] = {{"infinity", INFINITY}, {"inf", INFINITY}, {"nan", NAN}};
    size_t left = (size_t)(end - text);

    for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
        size_t length = strlen(words[i].word);
        if (left < length || strncasecmp(text, words[i].word, length) != 0)
            continue;
        *out = negative ? -words[i].value : words[i].value;
        if (length < left && text[length] == '(') {
            const char *close = memchr(text + length, ')', left - length < 32 ? left - length : 32);
            if (close)
                length = (size_t)(close - text) + 1;
        }
        return length;
    }
    return 0;
}

/* By strtod, which needs a terminator and uses the locale's decimal point. */
static double round_slowly(const char *text, size_t length)
{
    char copy[NUMBER_CHARS_MAX + 32];
    const char *exponent = memchr(text, 'e', length);
    size_t head, tail = 0, dropped = 0;

    if (!exponent)
        exponent = memchr(text, 'E', length);
    head = exponent ? (size_t)(exponent - text) : length;
    /* Digits past the limit change only the magnitude, and only before the point. */
    if (head > NUMBER_CHARS_MAX) {
        const char *point = memchr(text, '.', head);
        size_t whole = point ? (size_t)(point - text) : head;
        dropped = whole > NUMBER_CHARS_MAX ? whole - NUMBER_CHARS_MAX : 0;
        head = NUMBER_CHARS_MAX;
    }
    memcpy(copy, text, head);
    copy[head] = 0;
    if (exponent) {
        tail = length - (size_t)(exponent - text);
        tail = tail < 24 ? tail : 24;
        memcpy(copy + head, exponent, tail);
        copy[head + tail] = 0;
    }
    return dropped ? (copy[0] == '-' ? -INFINITY : INFINITY) : strtod(copy, NULL);
}

size_t scan_double(const char *text, const char *end, double *out)
{
    static const double powers[EXACT_POWER_MAX + 1] = {
        1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
        1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    const char *p = text;
    uint64_t mantissa = 0;
    int negative = 0, digits = 0, significant = 0, scale = 0, exponent = 0;

    if (p < end && (*p == '-' || *p == '+'))
        negative = *p++ == '-';
    for (int after_point = 0; p < end; p++) {
        if (*p == '.' && !after_point) {
            after_point = 1;
            continue;
        }
        if (!is_digit(*p))
            break;
        digits = 1;
        scale -= after_point;
        if (significant > 0 || *p != '0')
            significant++;
        if (significant <= MANTISSA_DIGITS_MAX)
            mantissa = mantissa * 10 + (uint64_t)(*p - '0');
        /* round_slowly() decides longer ones, and counts digits itself. */
        significant = significant < EXPONENT_MAX ? significant : EXPONENT_MAX;
        scale = scale > -EXPONENT_MAX ? scale : -EXPONENT_MAX;
    }
    if (!digits) {
        size_t sign = text < end && (*text == '-' || *text == '+');
        size_t length = scan_special(text + sign, end, negative, out);
        return length ? sign + length : 0;
    }
    if (p < end && *p == '#') { /* 1.#INF, 1.#QNAN, 1.#IND of old MSVC */
        const char *word = p + 1;
        while (p < end && (isalnum((unsigned char)*p) || *p == '#'))
            p++;
        *out = p - word >= 3 && strncasecmp(word, "INF", 3) == 0 ? INFINITY : (double)NAN;
        *out = negative ? -*out : *out;
        return (size_t)(p - text);
    }
    if (p < end && (*p == 'e' || *p == 'E')) {
        const char *q = p + 1;
        int minus = 0;
        if (q < end && (*q == '-' || *q == '+'))
            minus = *q++ == '-';
        if (q < end && is_digit(*q)) {
            for (; q < end && is_digit(*q); q++)
                exponent = exponent < EXPONENT_MAX ? exponent * 10 + (*q - '0') : EXPONENT_MAX;
            exponent = minus ? -exponent : exponent;
            p = q;
        }
    }
    scale += exponent;
    /* Both operands are exact: a single, correct rounding (Clinger 1990). */
    if (significant <= MANTISSA_DIGITS_MAX && mantissa <= EXACT_MANTISSA_MAX &&
        (mantissa == 0 || (scale >= -EXACT_POWER_MAX && scale <= EXACT_POWER_MAX))) {
        double value = (double)mantissa;
        if (mantissa != 0)
            value = scale < 0 ? value / powers[-scale] : value * powers[scale];
        *out = negative ? -value : value;
    } else {
        *out = round_slowly(text, (size_t)(p - text));
    }
    return (size_t)(p - text);
}
