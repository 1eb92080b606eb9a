/* quantile: quantiles of many non-negative numbers, and of a mixture of normal errors. */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* The value with `rank` (0-based) smaller or equal ones before it; values >= 0, rank < count. Two
 * passes; the order is not changed. */
float quantile_select(const float *values, size_t count, size_t rank);

/* The share of pixels that the display error leaves out. */
#define DISPLAY_BEYOND 0.05

enum { SPREADS_BINS = 1 << 14 };
/* How many errors have which standard deviation: bins of 1/64 octave. Zero-initialise. */
struct spreads {
    uint64_t bins[SPREADS_BINS];
    uint64_t count;
};
void spreads_add(struct spreads *s, float deviation, uint64_t times);
/* The q >= 0 exceeded by a share `beyond` (0..1) of the |errors|, each normal about 0 with its own
 * standard deviation. */
double spreads_quantile(const struct spreads *s, double beyond);

/* The value that a share `beyond` of the deviations themselves exceeds, to 1/64 octave. */
double spreads_largest(const struct spreads *s, double beyond);

/* 1 - erf(x), x >= 0; relative error below 1e-12 up to x = 20. */
double complement_erf(double x);
/* The same from a table, to 3e-12; 0 from x = 6 on. */
double complement_erf_quick(double x);
