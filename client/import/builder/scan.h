/* scan: numbers from text in memory without a terminator. Independent of the locale, correctly rounded. */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* Read the number at `text` (no space before it); returns its length in bytes, 0 if there is none.
 * Decimal with an exponent; also inf, infinity and nan in any case and with any tail that MSVC
 * prints ("1.#QNAN", "nan(ind)"). Numbers too large are infinite. */
size_t scan_double(const char *text, const char *end, double *out);

/* A decimal integer with an optional sign; 0 if there is none or it exceeds 64 bits. */
size_t scan_integer(const char *text, const char *end, int64_t *out);
