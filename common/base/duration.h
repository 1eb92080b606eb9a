/* duration: lengths of time as people write them. */
#pragma once

#include <stdint.h>

#include "common/base/status.h"

enum { DURATION_TEXT_SIZE = 32 };
#define DURATION_S_MAX ((int64_t)100 * 366 * 86400)

/* "90s", "10m", "12h", "30d", "8w", also with a fraction; 0 of any unit is 0. `option` is what the error names.
 * ERR_USAGE: something else, or not from least_ms to most_ms. */
status duration_parse_ms(const char *option, const char *text, uint64_t least_ms, uint64_t most_ms, uint64_t *ms,
                         struct error *err) MUST_CHECK;
/* The same in whole seconds, from 0 to DURATION_S_MAX. */
status duration_parse(const char *option, const char *text, int64_t *seconds, struct error *err) MUST_CHECK;
/* In the largest unit of which it is a multiple, as "30d"; fills `out` and returns it. */
const char *duration_text(char out[DURATION_TEXT_SIZE], int64_t seconds);
/* Rounded down to what people would say: "31 days", "5 hours", "40 s". */
const char *duration_words(char out[DURATION_TEXT_SIZE], int64_t seconds);
