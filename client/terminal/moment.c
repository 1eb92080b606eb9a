#include "client/terminal/moment.h"

#include <stdio.h>
#include <time.h>

#include "common/accuracy/stop.h"
#include "common/base/duration.h"

enum { DAY_S = 24 * 3600 };

/* Exactly `count` digits: their end; NULL if there are others. */
static const char *digits(const char *at, int count, int *out)
{
    *out = 0;
    for (; count > 0; count--, at++) {
        if (*at < '0' || *at > '9')
            return NULL;
        *out = *out * 10 + (*at - '0');
    }
    return at;
}

/* "18:00" or "18:00:30". */
static const char *time_of_day(const char *at, struct tm *tm)
{
    at = digits(at, 2, &tm->tm_hour);
    if (!at || *at != ':' || !(at = digits(at + 1, 2, &tm->tm_min)))
        return NULL;
    if (*at == ':' && !(at = digits(at + 1, 2, &tm->tm_sec)))
        return NULL;
    return tm->tm_hour < 24 && tm->tm_min < 60 && tm->tm_sec < 60 ? at : NULL;
}

/* "2026-03-01". */
static const char *date(const char *at, struct tm *tm)
{
    at = digits(at, 4, &tm->tm_year);
    if (!at || *at != '-' || !(at = digits(at + 1, 2, &tm->tm_mon)) || *at != '-' ||
        !(at = digits(at + 1, 2, &tm->tm_mday)))
        return NULL;
    tm->tm_year -= 1900;
    tm->tm_mon -= 1;
    return at;
}

/* "Z", "+01:00", "+0100", "+01" or nothing: then *local is set. */
static const char *zone(const char *at, int *local, int64_t *east_s)
{
    int sign = *at == '-' ? -1 : 1, hours, minutes = 0;

    *local = *at == 0;
    *east_s = 0;
    if (*local)
        return at;
    if (*at == 'Z')
        return at + 1;
    if ((*at != '+' && *at != '-') || !(at = digits(at + 1, 2, &hours)))
        return NULL;
    at += *at == ':';
    if (*at && !(at = digits(at, 2, &minutes)))
        return NULL;
    *east_s = sign * (hours * 3600 + minutes * 60);
    return at;
}

/* A day that the calendar does not have, like 31 February, would become another. */
static int64_t seconds_of(struct tm *tm, int local)
{
    const struct tm wanted = *tm;
    time_t when;

    tm->tm_isdst = -1;
    when = local ? mktime(tm) : timegm(tm);
    return tm->tm_mday == wanted.tm_mday && tm->tm_mon == wanted.tm_mon && when >= 0 ? (int64_t)when : -1;
}

/* -1: it is none. */
static int64_t parse_date(const char *text)
{
    struct tm tm = {0};
    int local;
    int64_t east_s, when;
    const char *at = date(text, &tm);

    if (at && *at == 0)
        return seconds_of(&tm, 1);
    if (!at || (*at != 'T' && *at != ' ') || !(at = time_of_day(at + 1, &tm)) || !(at = zone(at, &local, &east_s)) ||
        *at)
        return -1;
    when = seconds_of(&tm, local);
    return when < 0 ? when : when - east_s;
}

static int64_t parse_time(const char *text, int64_t now)
{
    time_t present = (time_t)now;
    struct tm tm;
    const char *at;
    int64_t when;

    if (!localtime_r(&present, &tm))
        return -1;
    tm.tm_sec = 0;
    at = time_of_day(text, &tm);
    if (!at || *at)
        return -1;
    tm.tm_isdst = -1;
    when = (int64_t)mktime(&tm);
    if (when <= now) {
        tm.tm_mday++;
        tm.tm_isdst = -1;
        when = (int64_t)mktime(&tm);
    }
    return when;
}

status moment_parse(const char *option, const char *text, int64_t now, int64_t *out, struct error *err)
{
    struct error unused = {0};
    uint64_t length_ms;

    *out = parse_time(text, now);
    if (*out < 0)
        *out = parse_date(text);
    if (*out >= 0)
        return STATUS_OK;
    if (duration_parse_ms(option, text, 1, STOP_LIMIT_MS_MAX, &length_ms, &unused) == STATUS_OK) {
        *out = now + (int64_t)((length_ms + 999) / 1000);
        return STATUS_OK;
    }
    return error_set(err, STATUS_ERR_USAGE,
                     "%s: '%.64s' is not a time: give 18:00, '2026-03-01 18:00', 2026-03-01T18:00:00Z, or 10m or 2h "
                     "from now",
                     option, text);
}

status moment_parse_past(const char *option, const char *text, int64_t now, int64_t *out, struct error *err)
{
    int is_time = parse_time(text, now) >= 0;
    status s = moment_parse(option, text, now, out, err);

    if (s != STATUS_OK)
        return error_set(err, s, "%s: '%.64s' is not a time: give 18:00, '2026-03-01 18:00', 2026-03-01T18:00:00Z, or 10m or "
                         "2h for so long ago", option, text);
    if (is_time)
        *out -= *out > now ? DAY_S : 0;
    else if (parse_date(text) < 0)
        *out = now - (*out - now);
    if (*out > now)
        return error_set(err, STATUS_ERR_USAGE, "%s: '%.64s' has not come yet", option, text);
    return STATUS_OK;
}

const char *moment_text(char out[FORMAT_SIZE], int64_t when, int64_t now)
{
    time_t at = (time_t)when;
    struct tm local;

    if (!localtime_r(&at, &local) ||
        strftime(out, FORMAT_SIZE, when > now && when - now < DAY_S ? "%H:%M" : "%Y-%m-%d %H:%M", &local) == 0)
        snprintf(out, FORMAT_SIZE, "-");
    return out;
}
