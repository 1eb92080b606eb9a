/* Known values of the distributions, and the running statistics. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "tests/support/statistics.h"

static void assert_near(double a, double b, double relative)
{
    if (!(fabs(a - b) <= relative * fabs(b)))
        fail_msg("%.17g is not %.17g to %g", a, b, relative);
}

static void running_stats_match_the_definition(void **state)
{
    struct running_stats s = {0};
    const double values[] = {1e9 + 4, 1e9 + 7, 1e9 + 13, 1e9 + 16};

    (void)state;
    assert_true(running_stats_variance(&s) == 0 && running_stats_error(&s) == 0);
    for (int i = 0; i < 4; i++)
        running_stats_add(&s, values[i]);
    assert_near(s.mean, 1e9 + 10, 1e-15);
    assert_near(running_stats_variance(&s), 30, 1e-12);
    assert_near(running_stats_error(&s), sqrt(7.5), 1e-12);
}

static void gamma_functions_match_closed_forms(void **state)
{
    (void)state;
    for (double x = 0.01; x < 60; x *= 1.7) {
        assert_near(gamma_q(1, x), exp(-x), 1e-12);
        assert_near(gamma_p(0.5, x), erf(sqrt(x)), 1e-12);
        assert_near(gamma_q(3, x), exp(-x) * (1 + x + x * x / 2), 1e-11);
        assert_near(gamma_p(7.3, x) + gamma_q(7.3, x), 1, 1e-12);
    }
    /* The 95 % point of chi-square, from tables. */
    assert_near(chi_square_p_value(18.307038, 10), 0.05, 1e-6);
    assert_near(chi_square_p_value(124.342113, 100), 0.05, 1e-6);
}

static void quantiles_match_tables(void **state)
{
    (void)state;
    assert_near(normal_quantile(0.975), 1.959963984540054, 1e-12);
    assert_near(normal_quantile(0.001), -3.090232306167813, 1e-12);
    assert_near(student_quantile(0.975, 1), 12.706204736, 1e-9);
    assert_near(student_quantile(0.975, 10), 2.228138852, 1e-9);
    assert_near(student_quantile(0.995, 30), 2.749995654, 1e-9);
    assert_near(student_cdf(1, 1), 0.75, 1e-12);
    assert_near(beta_regularized(2, 3, 0.4), 0.5248, 1e-12);
}

static void sidak_keeps_the_family_level(void **state)
{
    (void)state;
    assert_near(sidak_alpha(0.05, 1), 0.05, 1e-15);
    assert_near(1 - pow(1 - sidak_alpha(0.01, 1000), 1000), 0.01, 1e-9);
}

static void mean_test_tells_a_shifted_mean(void **state)
{
    struct running_stats s = {0}, constant = {0};
    struct test_random random = {42};

    (void)state;
    for (int i = 0; i < 100000; i++)
        running_stats_add(&s, test_random_double(&random));
    assert_true(mean_test_p_value(&s, 0.5) > 0.01);
    assert_true(mean_test_p_value(&s, 0.51) < 1e-6);
    running_stats_add(&constant, 2);
    running_stats_add(&constant, 2);
    assert_true(mean_test_p_value(&constant, 2) == 1);
    assert_true(mean_test_p_value(&constant, 2.1) == 0);
}

static void random_numbers_stay_below_one(void **state)
{
    struct test_random random = {0};

    (void)state;
    for (int i = 0; i < 1000000; i++) {
        float f = test_random_float(&random);
        double d = test_random_double(&random);
        assert_true(f >= 0 && f < 1 && d >= 0 && d < 1);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(running_stats_match_the_definition),
        cmocka_unit_test(gamma_functions_match_closed_forms),
        cmocka_unit_test(quantiles_match_tables),
        cmocka_unit_test(sidak_keeps_the_family_level),
        cmocka_unit_test(mean_test_tells_a_shifted_mean),
        cmocka_unit_test(random_numbers_stay_below_one),
    };
    return cmocka_run_group_tests_name("statistics", tests, NULL, NULL);
}
