#include "client/terminal/format.h"

#include <math.h>
#include <stdio.h>
#include <time.h>

static int decimals_for(double value) { return value < 9.995 ? 2 : value < 99.95 ? 1 : 0; }

const char *format_count(char out[FORMAT_SIZE], double value)
{
    static const char prefixes[] = " kMGTPE";
    size_t step = 0;

    if (!isfinite(value)) {
        snprintf(out, FORMAT_SIZE, "?");
        return out;
    }
    if (value < 999.5) {
        snprintf(out, FORMAT_SIZE, "%.*f", value == floor(value) ? 0 : decimals_for(value), value);
        return out;
    }
    while (value >= 999.5 && prefixes[step + 1]) {
        value /= 1000;
        step++;
    }
    snprintf(out, FORMAT_SIZE, "%.*f %c", decimals_for(value), value, prefixes[step]);
    return out;
}

const char *format_duration(char out[FORMAT_SIZE], double seconds)
{
    uint64_t whole;

    if (!(seconds >= 0) || seconds > 1e12) {
        snprintf(out, FORMAT_SIZE, "?");
        return out;
    }
    if (seconds < 9.95) {
        snprintf(out, FORMAT_SIZE, "%.1f s", seconds);
        return out;
    }
    whole = (uint64_t)(seconds + 0.5);
    if (whole < 60)
        snprintf(out, FORMAT_SIZE, "%llu s", (unsigned long long)whole);
    else if (whole < 3600)
        snprintf(out, FORMAT_SIZE, "%llu:%02llu", (unsigned long long)(whole / 60), (unsigned long long)(whole % 60));
    else if (whole < 2 * 86400)
        snprintf(out, FORMAT_SIZE, "%llu:%02llu:%02llu", (unsigned long long)(whole / 3600),
                 (unsigned long long)(whole / 60 % 60), (unsigned long long)(whole % 60));
    else
        snprintf(out, FORMAT_SIZE, "%llu d %02llu h", (unsigned long long)(whole / 86400),
                 (unsigned long long)(whole / 3600 % 24));
    return out;
}

const char *format_time(char out[FORMAT_SIZE], int64_t seconds)
{
    time_t when = (time_t)seconds;
    struct tm local;

    if (seconds <= 0 || !localtime_r(&when, &local) || strftime(out, FORMAT_SIZE, "%Y-%m-%d %H:%M:%S", &local) == 0)
        snprintf(out, FORMAT_SIZE, "-");
    return out;
}

void text_disarm(char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text < 0x20 || *text == 0x7f)
            *text = '?';
}
