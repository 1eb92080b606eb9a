/* figure: a number that a test measures, and the range in which it must lie.
 *
 * Each is printed as a line "# figure WHAT = VALUE in [LOW, HIGH], LEVEL", which `make numerics` reads:
 * its table shows the figure with a safeguard and without it.
 */
#pragma once

/* Fails the test where `value` is not in [low, high] (a NaN is not). `level`: what the range is,
 * such as "significance 1e-4, 96 tests", "closed form, tolerance 1e-5" or "exact". */
void figure_within(const char *what, double value, double low, double high, const char *level);

/* An estimate with a standard error (1 sigma) against an expected value: two-sided z-test at the family-wise
 * significance `alpha` over `tests` tests (Sidak). `error` 0: the values must be equal. */
void figure_z(const char *what, double value, double error, double expected, double alpha, unsigned tests);
