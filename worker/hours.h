/* hours: the times of day at which a worker takes work, as "20:00-08:00" or "12:00-13:00,20:00-08:00". A
 * range whose end is before its begin goes over midnight. */
#pragma once

#include <stddef.h>

#include "common/base/status.h"

enum { HOURS_RANGES_MAX = 8, MINUTES_PER_DAY = 24 * 60 };

/* Zero-initialised: always. */
struct hours {
    size_t count;
    struct {
        int begin, end; /* minutes since midnight; end is the first that is outside */
    } ranges[HOURS_RANGES_MAX];
};

/* ERR_USAGE: says what is wrong with the text. */
status hours_parse(struct hours *out, const char *text, struct error *err) MUST_CHECK;
/* Is the minute of the day (0..1439) among them? */
int hours_include(const struct hours *hours, int minute);
/* The minute at which the next range begins, after one that is outside. */
int hours_next(const struct hours *hours, int minute);
