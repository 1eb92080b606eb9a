/* number: numbers as the shortest text that reads back as the same value. */
#ifndef AZULEJO_BASE_NUMBER_H
#define AZULEJO_BASE_NUMBER_H

enum { NUMBER_TEXT_SIZE = 32 };

/* Fills `out` and returns it: "0.1", "5.0", "1e+20". A point or an exponent is always there, so
 * that a reader that tells reals from integers keeps the kind. The value is finite. */
const char *number_text(char out[NUMBER_TEXT_SIZE], double value);

/* The double with the shortest text that reads back as this float: 0.1, not
 * 0.10000000149011612. What is not finite stays as it is. */
double number_of_float(float value);

#endif
