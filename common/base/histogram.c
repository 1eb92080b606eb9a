#include "common/base/histogram.h"

#include <math.h>

#include "common/system/clock.h"

const double histogram_bounds_s[HISTOGRAM_CLASSES] = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05,    0.1,
                                                      0.25,  0.5,    1,     2.5,  5,     10, INFINITY};

void histogram_add(struct histogram *histogram, uint64_t ns)
{
    int i = 0;

    while (i < HISTOGRAM_CLASSES - 1 && (double)ns > histogram_bounds_s[i] * (double)NS_PER_SECOND)
        i++;
    histogram->count[i]++;
    histogram->sum_ns += ns;
}
