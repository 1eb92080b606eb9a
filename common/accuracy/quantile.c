#include "common/accuracy/quantile.h"

#include <math.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"

enum { BISECTIONS = 60, SELECT_BITS = 11 };
#define PRECISE 1e-7   /* of a quantile */
#define FAR 6          /* beyond this many deviations times sqrt(2) the tail is below 1e-17 */

float quantile_select(const float *values, size_t count, size_t rank)
{
    uint32_t prefix = 0;

    /* Bits of floats >= 0 are ordered as the floats are: find the top 11, the next 11, the last 10. */
    for (int shift = 21; shift >= 0; shift = shift > SELECT_BITS ? shift - SELECT_BITS : shift - 10) {
        size_t bins[1 << SELECT_BITS] = {0};
        uint32_t above = shift == 21 ? 0 : ~0u << (shift == 10 ? 21 : 10);
        uint32_t bin = 0, last = (1u << (shift ? SELECT_BITS : 10)) - 1;
        for (size_t i = 0; i < count; i++) {
            uint32_t bits = float_bits(values[i]);
            if ((bits & above) == prefix)
                bins[bits >> shift & last]++;
        }
        while (bin < last && rank >= bins[bin])
            rank -= bins[bin++];
        prefix |= bin << shift;
    }
    return float_from_bits(prefix);
}

void spreads_add(struct spreads *s, float deviation, uint64_t times)
{
    s->bins[float_bits(deviation) >> 17] += times;
    s->count += times;
}

double complement_erf(double x)
{
    double fraction = 0, term = x, sum = x;

    if (x > 2 && SAFEGUARD(ERF_TAIL)) { /* the continued fraction, Abramowitz and Stegun 7.1.14, from its end */
        for (int i = 60; i > 0; i--)
            fraction = i / 2.0 / (x + fraction);
        return det_exp_d(-x * x) / (1.7724538509055160273 * (x + fraction));
    }
    for (int i = 1; i < 60; i++) { /* the power series, 7.1.5 */
        term *= -x * x / i;
        sum += term / (2 * i + 1);
    }
    return 1 - 1.1283791670955125739 * sum;
}

static double share_beyond(const struct spreads *s, double q)
{
    double sum = 0;

    for (uint32_t i = 1; i < SPREADS_BINS; i++)
        if (s->bins[i] > 0) {
            double x = q / (double)float_from_bits(i << 17 | 1u << 16) * 0.70710678118654752440;
            if (x < FAR)
                sum += (double)s->bins[i] * complement_erf(x);
        }
    return sum / (double)s->count;
}

double spreads_quantile(const struct spreads *s, double beyond)
{
    double low = 0, high = 0;

    for (uint32_t i = 1; i < SPREADS_BINS; i++)
        if (s->bins[i] > 0)
            high = 20 * (double)float_from_bits(i << 17 | 1u << 16);
    if (!(beyond > 0))
        return high;
    for (int i = 0; i < BISECTIONS && high - low > PRECISE * high; i++) {
        double middle = (low + high) / 2;
        if (share_beyond(s, middle) > beyond)
            low = middle;
        else
            high = middle;
    }
    return high;
}
