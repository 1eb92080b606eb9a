#include "tests/support/statistics.h"

#include <assert.h>
#include <float.h>
#include <math.h>

enum { ITERATIONS_MAX = 100000 };
static const double TINY = 1e-300;

void running_stats_add(struct running_stats *s, double x)
{
    double delta = x - s->mean;

    s->count++;
    s->mean += delta / (double)s->count;
    s->sum_squares += delta * (x - s->mean);
}

double running_stats_variance(const struct running_stats *s)
{
    return s->count < 2 ? 0.0 : s->sum_squares / (double)(s->count - 1);
}

double running_stats_error(const struct running_stats *s)
{
    return s->count < 2 ? 0.0 : sqrt(running_stats_variance(s) / (double)s->count);
}

/* Series for P, good for x < a + 1 (Abramowitz & Stegun 6.5.29). */
static double gamma_p_series(double a, double x)
{
    double term = 1.0 / a, sum = term;

    for (int n = 1; n < ITERATIONS_MAX && fabs(term) > fabs(sum) * DBL_EPSILON; n++) {
        term *= x / (a + n);
        sum += term;
    }
    return sum * exp(a * log(x) - x - lgamma(a));
}

/* Continued fraction for Q, good for x >= a + 1 (A&S 6.5.31), by Lentz's method. */
static double gamma_q_fraction(double a, double x)
{
    double b = x + 1.0 - a, c = 1.0 / TINY, d = 1.0 / b, h = d;

    for (int n = 1; n < ITERATIONS_MAX; n++) {
        double an = -(double)n * ((double)n - a), step;
        b += 2.0;
        d = an * d + b;
        d = 1.0 / (fabs(d) < TINY ? TINY : d);
        c = b + an / c;
        c = fabs(c) < TINY ? TINY : c;
        step = c * d;
        h *= step;
        if (fabs(step - 1.0) < DBL_EPSILON)
            break;
    }
    return h * exp(a * log(x) - x - lgamma(a));
}

double gamma_p(double a, double x)
{
    assert(a > 0 && x >= 0);
    if (x == 0)
        return 0.0;
    return x < a + 1.0 ? gamma_p_series(a, x) : 1.0 - gamma_q_fraction(a, x);
}

double gamma_q(double a, double x)
{
    assert(a > 0 && x >= 0);
    if (x == 0)
        return 1.0;
    return x < a + 1.0 ? 1.0 - gamma_p_series(a, x) : gamma_q_fraction(a, x);
}

/* A&S 26.5.8, by Lentz's method; converges fast for x < (a+1)/(a+b+2). */
static double beta_fraction(double a, double b, double x)
{
    double c = 1.0, d = 1.0 - (a + b) * x / (a + 1.0), h;

    d = 1.0 / (fabs(d) < TINY ? TINY : d);
    h = d;
    for (int n = 1; n < ITERATIONS_MAX; n++) {
        double m = n, step;
        double even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m));
        double odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1));
        d = 1.0 + even * d;
        d = 1.0 / (fabs(d) < TINY ? TINY : d);
        c = 1.0 + even / c;
        c = fabs(c) < TINY ? TINY : c;
        h *= c * d;
        d = 1.0 + odd * d;
        d = 1.0 / (fabs(d) < TINY ? TINY : d);
        c = 1.0 + odd / c;
        c = fabs(c) < TINY ? TINY : c;
        step = c * d;
        h *= step;
        if (fabs(step - 1.0) < DBL_EPSILON)
            break;
    }
    return h;
}

double beta_regularized(double a, double b, double x)
{
    double front;

    assert(a > 0 && b > 0 && x >= 0 && x <= 1);
    if (x == 0 || x == 1)
        return x;
    front = exp(lgamma(a + b) - lgamma(a) - lgamma(b) + a * log(x) + b * log1p(-x));
    if (x < (a + 1.0) / (a + b + 2.0))
        return front * beta_fraction(a, b, x) / a;
    return 1.0 - front * beta_fraction(b, a, 1.0 - x) / b;
}

double normal_cdf(double x) { return 0.5 * erfc(-x * M_SQRT1_2); }

double student_cdf(double t, double degrees)
{
    double tail = 0.5 * beta_regularized(degrees / 2, 0.5, degrees / (degrees + t * t));
    return t > 0 ? 1.0 - tail : tail;
}

/* Bisection: slow, sure, and good to the last bits of double. */
static double quantile(double p, double degrees, double (*cdf)(double, double))
{
    double low = -1.0, high = 1.0;

    assert(p > 0 && p < 1);
    while (cdf(low, degrees) > p)
        low *= 2;
    while (cdf(high, degrees) < p)
        high *= 2;
    for (int i = 0; i < 200 && high - low > 1e-15 * fabs(high); i++) {
        double middle = 0.5 * (low + high);
        if (cdf(middle, degrees) < p)
            low = middle;
        else
            high = middle;
    }
    return 0.5 * (low + high);
}

static double normal_cdf_2(double x, double unused)
{
    (void)unused;
    return normal_cdf(x);
}

double normal_quantile(double p) { return quantile(p, 0, normal_cdf_2); }
double student_quantile(double p, double degrees) { return quantile(p, degrees, student_cdf); }

double chi_square_p_value(double statistic, double degrees) { return gamma_q(degrees / 2, statistic / 2); }

double mean_test_p_value(const struct running_stats *s, double expected)
{
    double error = running_stats_error(s), difference = fabs(s->mean - expected);

    if (error <= 0)
        return difference <= 1e-9 * fabs(expected) ? 1.0 : 0.0;
    return 2.0 * student_cdf(-difference / error, (double)(s->count - 1));
}

double sidak_alpha(double alpha, unsigned tests)
{
    assert(tests > 0);
    return -expm1(log1p(-alpha) / tests);
}

uint64_t test_random_u64(struct test_random *r)
{
    uint64_t z = (r->state += 0x9e3779b97f4a7c15u);

    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

float test_random_float(struct test_random *r) { return (float)(test_random_u64(r) >> 40) * 0x1p-24f; }

double test_random_double(struct test_random *r) { return (double)(test_random_u64(r) >> 11) * 0x1p-53; }
