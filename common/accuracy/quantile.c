#include "common/accuracy/quantile.h"

#include <math.h>
#include <pthread.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"

enum { BISECTIONS = 60, SELECT_BITS = 11, FEW = 512, NEWTON_FROM = 8, NEWTON_STEPS = 12, BLOCK = 32 };
#define PRECISE 1e-7   /* of a quantile */
#define NEAR 1e-8      /* how near to it Newton's method leads */
#define FAR 6          /* beyond this many deviations times sqrt(2) the tail is below 1e-17 */

/* The same of few values: a partial sort (Hoare's FIND), where counting in bins would mostly clear them. */
static float select_of_few(const float *values, size_t count, size_t rank)
{
    uint32_t bits[FEW];
    ptrdiff_t first = 0, last = (ptrdiff_t)count - 1, wanted = (ptrdiff_t)rank;

    for (size_t i = 0; i < count; i++)
        bits[i] = float_bits(values[i]);
    while (first < last) {
        uint32_t middle = bits[rank];
        ptrdiff_t i = first, j = last;
        while (i <= j) {
            uint32_t swap;
            while (bits[i] < middle)
                i++;
            while (bits[j] > middle)
                j--;
            if (i > j)
                break;
            swap = bits[i];
            bits[i++] = bits[j];
            bits[j--] = swap;
        }
        if (j < wanted)
            first = i;
        if (wanted < i)
            last = j;
    }
    return float_from_bits(bits[rank]);
}

float quantile_select(const float *values, size_t count, size_t rank)
{
    uint32_t prefix = 0;

    if (count <= FEW)
        return select_of_few(values, count, rank);
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

double spreads_largest(const struct spreads *s, double beyond)
{
    double above = 0;

    for (uint32_t i = SPREADS_BINS - 1; i > 0; i--) {
        above += (double)s->bins[i];
        if (above > beyond * (double)s->count)
            return (double)float_from_bits(i << 17 | 1u << 16);
    }
    return 0;
}

double complement_erf(double x)
{
    double fraction = 0, term = x, sum = x, before;
    int unchanged = 0;

    if (x > 2 && SAFEGUARD(ERF_TAIL)) { /* the continued fraction, Abramowitz and Stegun 7.1.14, from its end */
        for (int i = 60; i > 0; i--)
            fraction = i / 2.0 / (x + fraction);
        return det_exp_d(-x * x) / (1.7724538509055160273 * (x + fraction));
    }
    /* The power series, 7.1.5. Its terms have changing signs: after two that change nothing, none does. */
    for (int i = 1; i < 60 && unchanged < 2; i++) {
        term *= -x * x / i;
        before = sum;
        sum += term / (2 * i + 1);
        unchanged = sum == before ? unchanged + 1 : 0;
    }
    return 1 - 1.1283791670955125739 * sum;
}

/* ---- the same quickly ------------------------------------------------------------------------ */

/* complement_erf() from a table: at every 1/256 its value and three derivatives. Taylor's remainder is below
 * max |fourth derivative| / 24 / 512^4 = 2.7e-12. */
enum { ERF_STEPS = 256, ERF_NODES = FAR * ERF_STEPS + 1 };
#define ERF_ERROR 1e-11
static double erf_nodes[ERF_NODES][4];
static pthread_once_t erf_once = PTHREAD_ONCE_INIT;

static void erf_build(void)
{
    for (int i = 0; i < ERF_NODES; i++) {
        double x = (double)i / ERF_STEPS, slope = -1.1283791670955125739 * det_exp_d(-x * x);
        erf_nodes[i][0] = complement_erf(x);
        erf_nodes[i][1] = slope;
        erf_nodes[i][2] = -x * slope;
        erf_nodes[i][3] = (2 * x * x - 1) / 3 * slope;
    }
}

static inline double erf_near(double x)
{
    int i = (int)(x * ERF_STEPS + 0.5);
    double off = x - (double)i / ERF_STEPS;

    return erf_nodes[i][0] + off * (erf_nodes[i][1] + off * (erf_nodes[i][2] + off * erf_nodes[i][3]));
}

/* The bins that are not empty, from the largest deviation on: how many, and 1 / (deviation sqrt(2)). */
struct full_bins {
    double times[SPREADS_BINS], scale[SPREADS_BINS];
    uint32_t count;
};

double complement_erf_quick(double x)
{
    pthread_once(&erf_once, erf_build);
    return x < FAR ? erf_near(x) : 0;
}

/* exceeds() where the table decides it: 1, 0; -1: too close to call. */
static int surely_exceeds(const struct full_bins *bins, double total, double left, double q, double beyond)
{
    double most = beyond * total, margin = ERF_ERROR * left, sum = 0;

    for (uint32_t i = 0; i < bins->count; i++) {
        double x = q * bins->scale[i], share = x < FAR ? erf_near(x) : 0;
        sum += bins->times[i] * share;
        left -= bins->times[i];
        if (sum > most + margin)
            return 1;
        if (sum + left * share < most - margin)
            return 0;
    }
    return -1;
}

/* Newton's method from `q`, which is below the quantile: the share beyond is a convex function, so it stays below. */
static double approach(const struct full_bins *bins, double total, double q, double beyond)
{
    for (int step = 0; step < NEWTON_STEPS; step++) {
        double over = -beyond * total, slope = 0, before = q;
        for (uint32_t i = 0; i < bins->count; i++) {
            double x = q * bins->scale[i], off;
            int node = (int)(x * ERF_STEPS + 0.5);
            if (x >= FAR)
                continue; /* deviations that are smaller yet add nothing either */
            off = x - (double)node / ERF_STEPS;
            over += bins->times[i] * erf_near(x);
            slope += bins->times[i] * bins->scale[i] * (erf_nodes[node][1] + 2 * off * erf_nodes[node][2]);
        }
        if (!(slope < 0))
            return q;
        q -= over / slope;
        if (fabs(q - before) < NEAR * q / 8)
            break;
    }
    return q;
}

/* Is a share of more than `beyond` of the deviates beyond q? From the largest deviations on, whose shares are the largest:
 * few bins decide it. first..last: those that are not empty; `left`: what is in them. */
static int exceeds(const struct spreads *s, uint32_t first, uint32_t last, double left, double q, double beyond)
{
    double most = beyond * (double)s->count, sum = 0, share;

    for (uint32_t i = last; i >= first; i--) {
        double x = q / (double)float_from_bits(i << 17 | 1u << 16) * 0.70710678118654752440;
        if (s->bins[i] == 0)
            continue;
        share = x < FAR ? complement_erf(x) : 0;
        sum += (double)s->bins[i] * share;
        left -= (double)s->bins[i];
        if (sum > most)
            return 1;
        if (sum + left * share <= most)
            return 0;
    }
    return 0;
}

/* The bisection by which the quantile is defined, as its bits depend on the steps. Where the quantile is nearly known,
 * a step is decided by what lies beyond places close to it on both sides. */
static double bisect(const struct spreads *s, const struct full_bins *bins, uint32_t first, uint32_t last, double left,
                     double high, double beyond)
{
    double low = 0, below = 0, above = INFINITY, total = (double)s->count;

    for (int i = 0; i < BISECTIONS && high - low > PRECISE * high; i++) {
        double middle = (low + high) / 2;
        int surely;
        if (i == NEWTON_FROM && low > 0) {
            double near = approach(bins, total, low, beyond), places[2] = {near * (1 - NEAR), near * (1 + NEAR)};
            if (surely_exceeds(bins, total, left, places[0], beyond) == 1)
                below = places[0];
            if (surely_exceeds(bins, total, left, places[1], beyond) == 0)
                above = places[1];
        }
        surely = middle <= below ? 1 : middle >= above ? 0 : surely_exceeds(bins, total, left, middle, beyond);
        if (surely >= 0 ? surely : exceeds(s, first, last, left, middle, beyond))
            low = middle;
        else
            high = middle;
    }
    return high;
}

double spreads_quantile(const struct spreads *s, double beyond)
{
    struct full_bins bins;
    uint32_t first = SPREADS_BINS, last = 0;
    double left = 0;

    bins.count = 0;
    for (uint32_t block = SPREADS_BINS; block > 0; block -= BLOCK) {
        uint64_t any = 0; /* nearly all bins are empty */
        for (uint32_t i = block - BLOCK; i < block; i++)
            any |= s->bins[i];
        for (uint32_t i = block - 1; any && i > 0 && i + BLOCK >= block; i--) {
            if (s->bins[i] == 0)
                continue;
            last = last > i ? last : i;
            first = i;
            left += (double)s->bins[i];
            bins.times[bins.count] = (double)s->bins[i];
            bins.scale[bins.count++] = 0.70710678118654752440 / (double)float_from_bits(i << 17 | 1u << 16);
        }
    }
    if (bins.count == 0)
        return 0;
    if (!(beyond > 0))
        return 20 * (double)float_from_bits(last << 17 | 1u << 16);
    pthread_once(&erf_once, erf_build);
    return bisect(s, &bins, first, last, left, 20 * (double)float_from_bits(last << 17 | 1u << 16), beyond);
}
