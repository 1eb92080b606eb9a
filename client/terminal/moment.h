/* moment: a point of time, as people type and read it. */
#pragma once

#include <stdint.h>

#include "client/terminal/format.h"
#include "common/base/status.h"

/* "18:00", the next such time of day; "2026-03-01", "2026-03-01 18:00", "2026-03-01T18:00:30"; these in local
 * time, or with "Z", "+01:00" or "-0330" at the end of a date with a time; or a length of time from now as in
 * "90s", "10m", "1.5h". Seconds since 1970, UTC. ERR_USAGE names the option. */
status moment_parse(const char *option, const char *text, int64_t now, int64_t *out, struct error *err) MUST_CHECK;

/* The same of what was: "18:00" the last such time of day, "2h" two hours ago. ERR_USAGE: it is in the future. */
status moment_parse_past(const char *option, const char *text, int64_t now, int64_t *out, struct error *err) MUST_CHECK;

/* "18:00" if that is within the next 24 hours, else "2026-03-01 18:00"; local time. */
const char *moment_text(char out[FORMAT_SIZE], int64_t when, int64_t now);
