#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/statistics.h"

void figure_within(const char *what, double value, double low, double high, const char *level)
{
    printf("# figure %s = %.6g in [%.6g, %.6g], %s\n", what, value, low, high, level);
    fflush(stdout);
    if (!(value >= low && value <= high))
        fail_msg("%s is %.6g, not in [%.6g, %.6g] (%s)", what, value, low, high, level);
}

void figure_z(const char *what, double value, double error, double expected, double alpha, unsigned tests)
{
    double z = normal_quantile(1 - sidak_alpha(alpha, tests) / 2);
    char level[96];

    snprintf(level, sizeof level, "significance %g over %u tests", alpha, tests);
    figure_within(what, value, expected - z * error, expected + z * error, level);
}
