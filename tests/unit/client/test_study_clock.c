/* What a study's times are worth on a machine that becomes slower, and on which equal pictures take unequal times. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "client/study/study_clock.h"

enum { STUDIES = 400, WAYS = 24 };
#define NOISE 0.04 /* of ln of a time */
#define SLOWER 0.5 /* ln, from the first to the last way */

static uint64_t state_of_chance;

static double uniform(void)
{
    state_of_chance = state_of_chance * 6364136223846793005u + 1442695040888963407u;
    return ((double)(state_of_chance >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(void) { return sqrt(-2 * log(uniform())) * cos(6.283185307179586 * uniform()); }

/* A picture of this work when so much of the study is over. */
static double time_of(double work, double done, double slower) { return work * exp(slower * done + NOISE * normal()); }

/* The share of ways, all as fast as the usual one, whose interval holds 1, and their mean width. */
static double held(double slower, int probes, double *width)
{
    unsigned good = 0;

    *width = 0;
    for (int i = 0; i < STUDIES; i++) {
        struct study_clock clock = {0};
        const double a = time_of(1, 0, slower), b = time_of(1, 0, slower);
        for (int k = 0; k < 4; k++) /* the main curve */
            study_clock_pair(&clock, time_of(2, 0, slower), time_of(2, 0, slower));
        study_clock_pair(&clock, a, b);
        study_clock_probe(&clock, a);
        for (int way = 1; way <= WAYS; way++) {
            const double done = (double)way / WAYS, first = time_of(1, done, slower);
            double drift = 1, ratio;
            if (probes) {
                study_clock_probe(&clock, time_of(1, done, slower));
                drift = study_clock_drift(&clock);
            }
            ratio = log((a + b) / (first + time_of(1, done, slower)) * drift);
            good += fabs(ratio) <= study_clock_width(&clock, probes);
            *width += study_clock_width(&clock, probes) / (STUDIES * WAYS);
        }
    }
    return good / (double)(STUDIES * WAYS);
}

static void test_drift_is_no_finding(void **state)
{
    double width, steady;

    (void)state;
    state_of_chance = 1;
    assert_true(held(SLOWER, 1, &width) > 0.94);
    assert_true(width < 3.5 * NOISE);
    assert_true(held(SLOWER, 0, &steady) < 0.6); /* what probes are for */
    assert_true(held(0, 1, &steady) > 0.94);
    assert_true(steady < width * 1.05);
}

static void test_nothing_known(void **state)
{
    struct study_clock clock = {0};

    (void)state;
    assert_true(isnan(study_clock_width(&clock, 0)) && isnan(study_clock_noise(&clock)));
    assert_true(study_clock_drift(&clock) == 1);
    study_clock_pair(&clock, 0.01, 5); /* a tick of the kernel */
    study_clock_probe(&clock, 0);
    assert_true(isnan(study_clock_width(&clock, 1)) && study_clock_drift(&clock) == 1);
    study_clock_probe(&clock, 1);
    study_clock_probe(&clock, 1.5);
    assert_float_equal(study_clock_drift(&clock), 1.5, 1e-12);
    assert_float_equal(study_clock_noise(&clock), log(1.5) / M_SQRT2, 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_drift_is_no_finding),
        cmocka_unit_test(test_nothing_known),
    };

    return cmocka_run_group_tests_name("client/study_clock", tests, NULL, NULL);
}
