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

status duration_parse_ms(const char *option, const char *text, uint64_t least_ms, uint64_t most_ms, uint64_t *ms,
                         struct error *err)
{
    char *end;
    double value = strtod(text, &end);

    for (int i = 0; i < UNITS && end != text; i++) {
        double found_ms = value * 1000 * (double)units[i].seconds;
        if (strcmp(end, units[i].unit) == 0 && found_ms >= (double)least_ms && found_ms <= (double)most_ms) {
            *ms = (uint64_t)found_ms;
            return STATUS_OK;
        }
    }
    return error_set(err, STATUS_ERR_USAGE, "%s: '%s' is not a length of time: give 90s, 10m, 1.5h or 30d", option,
                     text);
}

status duration_parse(const char *option, const char *text, int64_t *seconds, struct error *err)
{
    uint64_t ms = 0;
    status s = duration_parse_ms(option, text, 0, (uint64_t)DURATION_S_MAX * 1000, &ms, err);

    *seconds = (int64_t)(ms / 1000);
    return s;
}

const char *duration_text(char out[DURATION_TEXT_SIZE], int64_t seconds)
{
    int unit = 3;

    for (int i = 0; i < 4 && unit == 3 && seconds != 0; i++)
        if (seconds % units[i].seconds == 0)
            unit = i;
    snprintf(out, DURATION_TEXT_SIZE, "%" PRId64 "%s", seconds / units[unit].seconds, units[unit].unit);
    return out;
}

const char *duration_words(char out[DURATION_TEXT_SIZE], int64_t seconds)
{
    int64_t unit = seconds >= 2 * 86400 ? 86400 : seconds >= 2 * 3600 ? 3600 : 1;

    snprintf(out, DURATION_TEXT_SIZE, "%" PRId64 " %s", seconds / unit,
             unit == 86400  ? "days"
             : unit == 3600 ? "hours"
                            : "s");
    return out;
}
