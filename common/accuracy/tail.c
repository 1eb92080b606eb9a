#include "common/accuracy/tail.h"

#include <math.h>
#include <stdlib.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"

enum { GRID_MAX = 30 + 64 };

static int ascending(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;

    return x < y ? -1 : x > y;
}

/* The k for theta: the mean of ln(1 - theta x), eq. 6 (there with the other sign). */
static double shape_of(const float *values, size_t count, double threshold, double theta)
{
    double sum = 0;

    for (size_t i = 0; i < count; i++)
        sum += det_log_d(1 - theta * ((double)values[i] - threshold));
    return sum / (double)count;
}

double tail_index_of(float *values, size_t count, double threshold)
{
    double theta[GRID_MAX], likelihood[GRID_MAX], quarter, largest, best = 0, k;
    double n = (double)count;
    int grid = 30 + (int)sqrt(n);

    if (count < TAIL_FIT_MIN || count > TAIL_FIT_MAX)
        return NAN;
    qsort(values, count, sizeof *values, ascending);
    quarter = (double)values[(count + 2) / 4 - 1] - threshold;
    largest = (double)values[count - 1] - threshold;
    if (!(quarter > 0) || !isfinite(largest))
        return NAN;
    for (int j = 0; j < grid; j++) {
        theta[j] = 1 / largest + (1 - sqrt(grid / (j + 0.5))) / (3 * quarter);
        k = shape_of(values, count, threshold, theta[j]);
        likelihood[j] = n * (det_log_d(-theta[j] / k) - k - 1);
    }
    for (int j = 0; j < grid; j++) {
        double weight = 0;
        for (int i = 0; i < grid; i++)
            weight += det_exp_d(likelihood[i] - likelihood[j]); /* may be infinite: theta[j] counts for nothing */
        best += theta[j] / weight;
    }
    k = shape_of(values, count, threshold, best);
    return (k * n + 10 * 0.5) / (n + 10);
}

double tail_index_limit(double samples)
{
    double limit = samples > 1 ? 1 - 2.302585092994045684 / det_log_d(samples) : 0;

    return limit < 0.7 ? limit : 0.7;
}

/* The smallest number that the fit needs: min(S / 5, 3 sqrt(S)). */
static size_t wanted_count(uint64_t samples)
{
    double s = (double)samples, wanted = 3 * sqrt(s);

    wanted = wanted < s / 5 ? wanted : s / 5;
    return wanted < TAIL_FIT_MAX ? (size_t)wanted : TAIL_FIT_MAX;
}

double accuracy_tails_index(const struct accuracy_tails *tails)
{
    size_t total = tails->lists * tails->length, count = 0, wanted = wanted_count(tails->samples);
    float threshold = 0, *beyond = mem_alloc_array(total + 1, sizeof *beyond);
    double k = NAN;

    if (!beyond)
        return NAN;
    for (size_t i = 0; i < tails->lists; i++) {
        float last = tails->values[(i + 1) * tails->length - 1];
        threshold = last > threshold ? last : threshold;
    }
    for (size_t i = 0; i < total; i++)
        if (tails->values[i] > threshold)
            beyond[count++] = tails->values[i];
    qsort(beyond, count, sizeof *beyond, ascending);
    if (count > wanted && wanted > 0) { /* the last one left out is the threshold */
        threshold = beyond[count - wanted - 1];
        k = tail_index_of(beyond + (count - wanted), wanted, (double)threshold);
    } else {
        k = tail_index_of(beyond, count, (double)threshold);
    }
    mem_free(beyond);
    return k;
}
