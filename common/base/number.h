/* number: numbers as the shortest text that reads back as the same value. */
#pragma once

enum { NUMBER_TEXT_SIZE = 32 };

/* Fills `out` and returns it: "0.1", "5.0", "1e+20". There is always a point or an exponent, so
 * that readers that distinguish reals from integers see a real. The value must be finite. */
const char *number_text(char out[NUMBER_TEXT_SIZE], double value);

/* The double with the shortest text that reads back as this float: 0.1, not 0.10000000149011612.
 * Values that are not finite are returned unchanged. */
double number_of_float(float value);
