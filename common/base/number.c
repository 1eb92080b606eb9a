#include "common/base/number.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* DBL_DIG digits survive conversion from text to double and back, DBL_DECIMAL_DIG the other way. */
const char *number_text(char out[NUMBER_TEXT_SIZE], double value)
{
    for (int digits = DBL_DIG; digits <= DBL_DECIMAL_DIG; digits++) {
        snprintf(out, NUMBER_TEXT_SIZE, "%.*g", digits, value);
        if (strtod(out, NULL) == value)
            break;
    }
    if (!strpbrk(out, ".e"))
        strcat(out, ".0");
    return out;
}

double number_of_float(float value)
{
    char text[NUMBER_TEXT_SIZE];

    if (!isfinite(value))
        return (double)value;
    for (int digits = FLT_DIG; digits <= FLT_DECIMAL_DIG; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, (double)value);
        if (strtof(text, NULL) == value)
            break;
    }
    return strtod(text, NULL);
}
