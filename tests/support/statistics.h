/* statistics: the arithmetic of the statistical tests, in double, plus a small generator.
 *
 * Tests state a family-wise significance level; sidak_alpha() turns it into the level of
 * one of m independent tests. All seeds are fixed by the caller, so a test that passes
 * once passes always.
 */
#pragma once

#include <stdint.h>

/* Mean and variance of a stream (Welford 1962). Zero-initialise. */
struct running_stats {
    uint64_t count;
    double mean;
    double sum_squares; /* of deviations from the mean */
};

void running_stats_add(struct running_stats *s, double x);
/* Unbiased sample variance; 0 for fewer than two values. */
double running_stats_variance(const struct running_stats *s);
/* Standard error of the mean. */
double running_stats_error(const struct running_stats *s);

/* Regularised lower incomplete gamma function P(a, x); a > 0, x >= 0. */
double gamma_p(double a, double x);
/* Its complement Q = 1 - P, without cancellation. */
double gamma_q(double a, double x);
/* Regularised incomplete beta function I_x(a, b); a, b > 0, 0 <= x <= 1. */
double beta_regularized(double a, double b, double x);

double normal_cdf(double x);
/* z with normal_cdf(z) = p; 0 < p < 1. */
double normal_quantile(double p);
double student_cdf(double t, double degrees);
/* t with student_cdf(t) = p; 0 < p < 1. */
double student_quantile(double p, double degrees);

/* Probability that a chi-square variable exceeds `statistic`. */
double chi_square_p_value(double statistic, double degrees);

/* Two-sided p-value of Student's t-test that the mean is `expected`. When all values are
 * equal: 1 if they are `expected` to 1e-9 relative, else 0. */
double mean_test_p_value(const struct running_stats *s, double expected);

/* Level of one test so that `tests` independent ones together reject with `alpha`:
 * 1 - (1 - alpha)^(1/tests) (Sidak 1967). */
double sidak_alpha(double alpha, unsigned tests);

/* SplitMix64 (Steele, Lea, Flood 2014): any seed is fine. */
struct test_random {
    uint64_t state;
};
uint64_t test_random_u64(struct test_random *r);
float test_random_float(struct test_random *r);   /* [0,1), 24 bits */
double test_random_double(struct test_random *r); /* [0,1), 53 bits */
