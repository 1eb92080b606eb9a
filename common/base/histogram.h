/* histogram: how long something took, counted in classes. It only grows. */
#pragma once

#include <stdint.h>

enum { HISTOGRAM_CLASSES = 14 };

/* The upper bound of each class in seconds; a class holds what took at most this, and more than the bound before.
 * The last is infinite. */
extern const double histogram_bounds_s[HISTOGRAM_CLASSES];

struct histogram {
    uint64_t count[HISTOGRAM_CLASSES];
    uint64_t sum_ns;
};

void histogram_add(struct histogram *histogram, uint64_t ns);
