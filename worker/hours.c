#include "worker/hours.h"

#include <ctype.h>
#include <string.h>

/* "HH:MM" or "H:MM"; the character after it, or NULL. */
static const char *parse_time(const char *text, int *minute)
{
    int hour = 0, digits = 0;

    for (; isdigit((unsigned char)*text) && digits < 3; digits++)
        hour = hour * 10 + (*text++ - '0');
    if (digits < 1 || digits > 2 || text[0] != ':' || !isdigit((unsigned char)text[1]) ||
        !isdigit((unsigned char)text[2]))
        return NULL;
    *minute = hour * 60 + (text[1] - '0') * 10 + (text[2] - '0');
    return text[1] <= '5' && *minute <= MINUTES_PER_DAY ? text + 3 : NULL;
}

status hours_parse(struct hours *out, const char *text, struct error *err)
{
    const char *at = text;

    memset(out, 0, sizeof *out);
    for (;;) {
        int begin, end;
        at = parse_time(at, &begin);
        at = at && *at == '-' ? parse_time(at + 1, &end) : NULL;
        if (!at || (*at && *at != ','))
            break;
        if (begin % MINUTES_PER_DAY == end % MINUTES_PER_DAY && end != MINUTES_PER_DAY)
            return error_set(err, STATUS_ERR_USAGE,
                             "--hours %s: a range begins and ends at the same time (00:00-24:00 is the whole day)",
                             text);
        if (out->count == HOURS_RANGES_MAX)
            return error_set(err, STATUS_ERR_USAGE, "--hours %s: more than %d ranges", text, HOURS_RANGES_MAX);
        out->ranges[out->count].begin = begin % MINUTES_PER_DAY;
        out->ranges[out->count++].end = end;
        if (!*at++)
            return STATUS_OK;
    }
    return error_set(err, STATUS_ERR_USAGE,
                     "--hours %s: give ranges of local time as in 20:00-08:00 or 12:00-13:00,20:00-08:00", text);
}

int hours_include(const struct hours *hours, int minute)
{
    for (size_t i = 0; i < hours->count; i++) {
        int begin = hours->ranges[i].begin, end = hours->ranges[i].end;
        if (begin < end ? minute >= begin && minute < end : minute >= begin || minute < end)
            return 1;
    }
    return hours->count == 0;
}

int hours_next(const struct hours *hours, int minute)
{
    int least = MINUTES_PER_DAY, next = minute;

    for (size_t i = 0; i < hours->count; i++) {
        int begin = hours->ranges[i].begin;
        int wait = (begin - minute + MINUTES_PER_DAY) % MINUTES_PER_DAY;
        if (wait < least) {
            least = wait;
            next = begin;
        }
    }
    return next;
}
