/* tail: do the largest contributions to a picture decrease fast enough for a reliable mean?
 *
 * A generalised Pareto distribution is fitted to what lies beyond a threshold, by the estimator of
 * Zhang and Stephens (2009), its k shrunk towards 0.5 by ten observations, and compared with the
 * threshold of Vehtari, Simpson, Gelman, Yao and Gabry (2024): below min(1 - 1/log10 S, 0.7) a mean
 * of S samples is reliable; from k = 0.5 on there is no finite variance. */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum { TAIL_FIT_MAX = 4096, TAIL_FIT_MIN = 8 };

/* Lists of largest contributions (of the tiles and groups of a frame): values[lists][length], each
 * descending and padded with 0, from `samples` samples in all. */
struct accuracy_tails {
    const float *values;
    size_t lists, length;
    uint64_t samples;
};

/* k of the excesses over `threshold` of values[count], each larger than it. NaN with less than
 * TAIL_FIT_MIN. Sorts `values`, ascending. */
double tail_index_of(float *values, size_t count, double threshold);

/* The largest k with which a mean of so many samples is reliable. */
double tail_index_limit(double samples);

/* k of the union of the lists, using only values larger than the last entry of every full list, so
 * that none is missing. NaN: too little is known. */
double accuracy_tails_index(const struct accuracy_tails *tails);
