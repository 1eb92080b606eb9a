#include "common/base/duration.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* From the largest on, but weeks: "14d" reads better than "2w". */
static const struct {
    const char *unit;
    int64_t seconds;
} units[] = {{"d", 86400}, {"h", 3600}, {"m", 60}, {"s", 1}, {"w", 7 * 86400}};
enum { UNITS = sizeof units / sizeof units[0] };

status duration_parse(const char *option, const char *text, int64_t *seconds, struct error *err)
{
    char *end;
    double value = strtod(text, &end);

    for (int i = 0; i < UNITS && end != text; i++)
        if (strcmp(end, units[i].unit) == 0 && value >= 0 &&
            value * (double)units[i].seconds <= (double)DURATION_S_MAX) {
            *seconds = (int64_t)(value * (double)units[i].seconds);
            return STATUS_OK;
        }
    return error_set(err, STATUS_ERR_USAGE, "%s: '%s' is not a length of time: give 12h, 30d or 8w",
                     option, text);
}

const char *duration_text(char out[DURATION_TEXT_SIZE], int64_t seconds)
{
    int unit = 3;

    for (int i = 0; i < 4 && unit == 3 && seconds != 0; i++)
        if (seconds % units[i].seconds == 0)
            unit = i;
    snprintf(out, DURATION_TEXT_SIZE, "%" PRId64 "%s", seconds / units[unit].seconds,
             units[unit].unit);
    return out;
}
