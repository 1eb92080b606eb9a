/* The cost of accuracy from known laws, and the tail index of known tails. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "common/accuracy/curve.h"
#include "common/accuracy/tail.h"
#include "common/accuracy/target.h"
#include "common/accuracy/word.h"
#include "common/scene/effects.h"

static uint64_t random_state;

static double uniform(void)
{
    random_state = random_state * 6364136223846793005ull + 1442695040888963407ull;
    return ((double)(random_state >> 33) + 0.5) / 2147483648.0;
}

static void assert_near(double value, double expected, double share)
{
    if (!(fabs(value - expected) <= share * fabs(expected)))
        fail_msg("%.9g instead of %.9g", value, expected);
}

static size_t law(struct accuracy_point *points, size_t count, double slope, double noise)
{
    for (size_t i = 0; i < count; i++) {
        double cost = 10 * pow(2, (double)i), error = 8 * pow(cost / 10, -slope);
        error *= exp(noise * (uniform() * 2 - 1) * 1.7);
        points[i] = (struct accuracy_point){cost, error, error * exp(-2 * noise - 0.01),
                                            error * exp(2 * noise + 0.01)};
    }
    return count;
}

static void test_exact_law(void **state)
{
    struct accuracy_point points[8];
    struct accuracy_curve curve;
    struct accuracy_estimate cost;

    (void)state;
    accuracy_curve_fit(&curve, points, law(points, 8, 0.5, 0));
    assert_near(accuracy_curve_exponent(&curve).value, 0.5, 1e-6);
    cost = accuracy_curve_cost(&curve, points[7].error * pow(4, -0.5)); /* four times the cost */
    assert_near(cost.value, 4 * points[7].cost, 1e-5);
    assert_true(cost.lo < cost.value && cost.value < cost.hi && cost.hi < 2.5 * cost.value);
    assert_near(accuracy_curve_error(&curve, points[3].cost).value, points[3].error, 1e-5);
    /* Eight good points outweigh what is known beforehand. */
    accuracy_curve_fit(&curve, points, law(points, 8, 0.4, 0));
    assert_near(accuracy_curve_exponent(&curve).value, 0.4, 0.05);
}

/* Points of a half-done frame can look steeper, or flatter, than any picture's error falls. */
static void test_slope_stays_plausible(void **state)
{
    static const double slopes[2][2] = {{1.6, 1}, {0.02, 0.25}};
    struct accuracy_point points[4];
    struct accuracy_curve curve;

    (void)state;
    for (int i = 0; i < 2; i++) {
        accuracy_curve_fit(&curve, points, law(points, 4, slopes[i][0], 0));
        assert_near(accuracy_curve_exponent(&curve).value, slopes[i][1], 1e-12);
        assert_near(accuracy_curve_error(&curve, points[3].cost).value, points[3].error, 0.1);
    }
}

/* One point says nothing of the slope: the cost of a tenth of its error is 100 times its own by the prior alone, and no
 * single number is told (price.h). */
static void test_one_point_promises_little(void **state)
{
    struct accuracy_point point = {1, 40, 39.9, 40.1};
    struct accuracy_curve curve;
    struct accuracy_estimate cost;

    (void)state;
    accuracy_curve_fit(&curve, &point, 1);
    cost = accuracy_curve_cost(&curve, 4);
    assert_near(cost.value, 100, 0.01);
    assert_true(cost.lo > 10 && cost.hi < 10000 && cost.hi > 10 * cost.lo);
}

/* Codes that saturate at first: the last doublings, not the first, tell how the error falls on. */
static void test_last_points_count_most(void **state)
{
    struct accuracy_point points[6];
    struct accuracy_curve curve;
    double error = 80;

    (void)state;
    for (int i = 0; i < 6; i++) {
        points[i] = (struct accuracy_point){pow(2, i), error, error * 0.98, error * 1.02};
        error *= pow(2, i < 3 ? -0.75 : -0.35);
    }
    accuracy_curve_fit(&curve, points, 6);
    assert_near(accuracy_curve_cost(&curve, points[5].error * pow(4, -0.35)).value, 4 * 32, 0.25);
}

/* A cost 8 times the last point's lies in its interval about as often as it says: of 300 at least 276, which a
 * share of 95 % misses with a chance below 1 %. */
static void test_intervals_hold(void **state)
{
    int held = 0;

    (void)state;
    random_state = 5;
    for (int i = 0; i < 300; i++) {
        struct accuracy_point points[5];
        struct accuracy_curve curve;
        struct accuracy_estimate cost;
        double slope = 0.44 + 0.12 * uniform(), truth = 160 * 8;
        law(points, 5, slope, 0.04);
        accuracy_curve_fit(&curve, points, 5);
        cost = accuracy_curve_cost(&curve, 8 * pow(truth / 10, -slope));
        held += cost.lo <= truth && truth <= cost.hi;
    }
    assert_true(held >= 276);
}

/* The slope goes back to 1/2: far beyond the last point, a factor 16 of cost is worth a factor 4 of error again, whatever
 * the last doublings showed. */
static void test_slope_returns(void **state)
{
    struct accuracy_point points[6];
    struct accuracy_curve curve;
    double near, far;

    (void)state;
    accuracy_curve_fit(&curve, points, law(points, 6, 0.3, 0));
    near = accuracy_curve_error(&curve, 2 * points[5].cost).value / points[5].error;
    assert_near(near, pow(2, -0.33), 0.05);
    far = accuracy_curve_error(&curve, 1e9 * points[5].cost).value / accuracy_curve_error(&curve, 16e9 * points[5].cost).value;
    assert_near(far, 4, 0.01);
    assert_near(accuracy_curve_cost(&curve, accuracy_curve_error(&curve, 1e4).value).value, 1e4, 1e-6);
}

static void test_few_points(void **state)
{
    struct accuracy_point one = {10, 4, 0, 0}, none = {10, 0, 0, 0};
    struct accuracy_curve curve;

    (void)state;
    accuracy_curve_fit(&curve, &one, 1); /* what is known beforehand is all */
    assert_near(accuracy_curve_cost(&curve, 2).value, 10 * pow(2, 1 / 0.5), 1e-6);
    assert_true(accuracy_curve_cost(&curve, 2).hi > 50);
    accuracy_curve_fit(&curve, &none, 1);
    assert_true(curve.points == 0 && isnan(accuracy_curve_cost(&curve, 2).value));
    assert_true(isnan(accuracy_curve_exponent(&curve).value));
    assert_true(isnan(accuracy_curve_error(&curve, 2).value));
}

/* A point of each measure; decibels fall as codes grow, so their interval's ends change places. */
static void test_target_points(void **state)
{
    const struct accuracy_figures f = {.known = 1, .display_error = 3, .display_lo = 2, .display_hi = 5,
                                       .psnr_db = 40, .psnr_lo = 34, .psnr_hi = 46,
                                       .rmse_percent = 7, .rmse_lo = 6, .rmse_hi = 9};
    static const double expected[][3] = {
        [ALLOCATION_DISPLAY] = {3, 2, 5}, [ALLOCATION_PSNR] = {2.55, 1.27802, 5.08791}, [ALLOCATION_RMSE] = {7, 6, 9}};

    (void)state;
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        struct accuracy_point p = target_point(&f, 11, (enum allocation_measure)i);
        struct allocation_target target = {(enum allocation_measure)i, i == ALLOCATION_PSNR ? 40 : 3};

        assert_near(p.cost, 11, 0);
        assert_near(p.error, expected[i][0], 1e-5);
        assert_near(p.lo, expected[i][1], 1e-5);
        assert_near(p.hi, expected[i][2], 1e-5);
        assert_near(target_error(&target), i == ALLOCATION_PSNR ? 2.55 : 3, 1e-9);
    }
    assert_true(target_point(&(struct accuracy_figures){.known = 0}, 11, ALLOCATION_RMSE).error == 0);
}

/* Excesses ((1 - u)^-k - 1) / k have index k. */
static void test_tail_index(void **state)
{
    static float values[2000];
    static const double truths[3] = {0.1, 0.5, 0.9};

    (void)state;
    for (int t = 0; t < 3; t++) {
        random_state = 9;
        for (size_t i = 0; i < 2000; i++)
            values[i] = (float)(3 + (pow(1 - uniform(), -truths[t]) - 1) / truths[t]);
        assert_true(fabs(tail_index_of(values, 2000, 3) - truths[t]) < 0.1);
    }
    assert_true(isnan(tail_index_of(values, 4, 3)));
    assert_near(tail_index_limit(100), 0.5, 1e-12);
    assert_near(tail_index_limit(1e9), 0.7, 1e-12);
}

/* A list that is full hides what is below its last entry: only what is above counts. */
static void test_tail_lists(void **state)
{
    enum { LISTS = 200, LENGTH = 16 };
    static float values[LISTS * LENGTH];
    struct accuracy_tails tails = {values, LISTS, LENGTH, 1000000};

    (void)state;
    random_state = 3;
    for (size_t l = 0; l < LISTS; l++)
        for (size_t i = 0; i < LENGTH; i++) {
            float value = (float)pow(1 - uniform(), -0.8);
            size_t at = i;
            for (; at > 0 && values[l * LENGTH + at - 1] < value; at--)
                values[l * LENGTH + at] = values[l * LENGTH + at - 1];
            values[l * LENGTH + at] = value;
        }
    assert_true(fabs(accuracy_tails_index(&tails) - 0.8) < 0.2);
    memset(values, 0, sizeof values);
    assert_true(isnan(accuracy_tails_index(&tails)));
}

static void test_causes(void **state)
{
    (void)state;
    assert_non_null(strstr(accuracy_cause(EFFECT_CAUSTICS | EFFECT_NESTED_DIELECTRIC | EFFECT_EMISSIVE_MESH), "lamps inside glass"));
    assert_non_null(strstr(accuracy_cause(EFFECT_CAUSTICS | EFFECT_ENVIRONMENT), "small sun"));
    assert_non_null(strstr(accuracy_cause(EFFECT_FOG | EFFECT_MEDIUM), "volume"));
    assert_non_null(strstr(accuracy_cause(0), "few samples"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slope_stays_plausible), cmocka_unit_test(test_one_point_promises_little),
        cmocka_unit_test(test_exact_law), cmocka_unit_test(test_last_points_count_most), cmocka_unit_test(test_intervals_hold),
        cmocka_unit_test(test_slope_returns),
        cmocka_unit_test(test_few_points), cmocka_unit_test(test_target_points),
        cmocka_unit_test(test_tail_index),
        cmocka_unit_test(test_tail_lists), cmocka_unit_test(test_causes),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
