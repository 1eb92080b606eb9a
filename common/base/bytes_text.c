#include "common/base/bytes_text.h"

#include <stdio.h>

const char *bytes_text(char out[BYTES_TEXT_SIZE], uint64_t bytes)
{
    static const char *const units[] = {"B", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB"};
    double value = (double)bytes;
    size_t step = 0;

    while (value >= 1023.95 && step + 1 < sizeof units / sizeof units[0]) {
        value /= 1024;
        step++;
    }
    snprintf(out, BYTES_TEXT_SIZE, "%.*f %s", step == 0 ? 0 : 1, value, units[step]);
    return out;
}
