/* format: numbers and durations as people read them. Each fills `out` and returns it. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/bytes_text.h"

enum { FORMAT_SIZE = 48 };

/* Three digits and a decimal prefix: "0", "812", "4.21 k", "1.07 M", "93.1 G". */
const char *format_count(char out[FORMAT_SIZE], double value);

/* "0.4 s", "12 s", "3:07", "1:02:33", "4 d 03 h"; "?" for a negative or unknown duration. */
const char *format_duration(char out[FORMAT_SIZE], double seconds);

/* Seconds since 1970 as local time, "2024-03-01 14:05:11"; "-" for 0. */
const char *format_time(char out[FORMAT_SIZE], int64_t seconds);

/* Replace control characters, so that hostile text cannot speak to a terminal. */
void text_disarm(char *text);
