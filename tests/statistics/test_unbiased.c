/* unbiased: the rounds and stops of an adaptive frame leave its mean alone, on a picture where
 * deciding wrongly costs a tenth of the light. The long version is `make accuracy-unbiased`;
 * tests/unit/accuracy/test_allocate.c sums over all outcomes of a toy, for the ways to go wrong
 * that are too faint for a few hundred pictures.
 * Family-wise significance of each way's tests: 1 %, Sidak. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "tests/support/unbiased.h"

#define SIGNIFICANCE 0.01

static struct unbiased_result result;

static int measure(void **state)
{
    static const struct unbiased_study study = {
        .path = "tests/accuracy/scenes/lamp-in-bulb.pbrt",
        .width = 16,
        .height = 16,
        .samples = 32,
        .last_level = 3,
        .target = {ALLOCATION_RMSE, 300},
        .first_seed = 1,
        .seeds = 300,
    };
    (void)state;

    unbiased_measure(&study, &result);
    return 0;
}

static void expect(int way, int biased)
{
    double p = unbiased_p_value(&result, way), level = sidak_alpha(SIGNIFICANCE, result.tests);

    if ((p < level) != biased)
        fail_msg("%s: frame's mean is off by %.4f +- %.4f (p = %.2g, level %.2g)", unbiased_names[way],
                 result.ways[way].frame.mean, running_stats_error(&result.ways[way].frame), p, level);
}

static void test_the_mean_is_that_of_uniform_samples(void **state)
{
    (void)state;
    expect(REPLAY_RIGHT, 0);
    /* The target did decide: pictures ended at different counts, before the cap. */
    assert_true(running_stats_variance(&result.ways[REPLAY_RIGHT].samples) > 4);
    assert_true(result.ways[REPLAY_RIGHT].samples.mean < 28);
}

static void test_own_samples_are_noticed(void **state)
{
    (void)state;
    expect(REPLAY_OWN_SAMPLES, 1);
}

static void test_an_ended_group_that_grows_is_noticed(void **state)
{
    (void)state;
    expect(REPLAY_ENDED_GROWS, 1);
}

static void test_groups_joined_by_counts_are_noticed(void **state)
{
    (void)state;
    expect(UNBIASED_BY_COUNTS, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_mean_is_that_of_uniform_samples),
        cmocka_unit_test(test_own_samples_are_noticed),
        cmocka_unit_test(test_an_ended_group_that_grows_is_noticed),
        cmocka_unit_test(test_groups_joined_by_counts_are_noticed),
    };

    return cmocka_run_group_tests(tests, measure, NULL);
}
