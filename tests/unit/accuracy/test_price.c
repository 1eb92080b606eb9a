/* Prices: the start of the programs is paid once, and the price is that of the work that is left. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "common/accuracy/price.h"

enum { POINTS = 6 };
#define START_S 8.0
#define RAY_S 1e-6

static void assert_near(double value, double expected, double share)
{
    if (!(fabs(value - expected) <= share * fabs(expected)))
        fail_msg("%.9g instead of %.9g", value, expected);
}

/* Errors that fall as the root of the rays; the processor time has eight seconds of start in it. Samples mislead: they
 * become dearer, as where adaptive sampling goes to the dear tiles. */
static void make_points(struct price_point *points)
{
    for (int i = 0; i < POINTS; i++) {
        double rays = 1e6 * pow(2, i), error = 32 / sqrt(pow(2, i));
        points[i] = (struct price_point){.core_s = START_S + RAY_S * rays, .samples = pow(rays, 0.8), .rays = rays,
                                         .figures = {.known = 1, .display_error = error, .display_lo = 0.98 * error,
                                                     .display_hi = 1.02 * error}};
    }
}

static void start_up_is_paid_once(void **state)
{
    struct price_point points[POINTS];
    struct prices prices;
    double last_error, truth;

    (void)state;
    make_points(points);
    prices_fit(&prices, points, POINTS, ALLOCATION_DISPLAY);
    last_error = points[POINTS - 1].figures.display_error;
    truth = START_S + RAY_S * points[POINTS - 1].rays * 16;
    assert_near(prices_cost(&prices, last_error / 4).value, truth, 0.01);
    assert_near(prices_error(&prices, truth).value, last_error / 4, 0.01);
    assert_near(prices_cost(&prices, points[0].figures.display_error).value, points[0].core_s, 0.01);
    /* Old histories have no rays. */
    for (int i = 0; i < POINTS; i++)
        points[i].rays = 0;
    prices_fit(&prices, points, POINTS, ALLOCATION_DISPLAY);
    assert_true(!prices.by_rays && prices_cost(&prices, last_error / 4).value > points[POINTS - 1].core_s);
}

/* A frame that ends by a target ends below it. */
static void a_target_costs_more_than_its_error(void **state)
{
    const struct allocation_target target = {ALLOCATION_DISPLAY, 2};
    struct price_point points[POINTS];
    struct prices prices;

    (void)state;
    make_points(points);
    prices_fit(&prices, points, POINTS, ALLOCATION_DISPLAY);
    assert_near(prices_target(&prices, &target).value, prices_cost(&prices, 2 * PRICE_STOP).value, 1e-12);
    assert_true(prices_target(&prices, &target).value > 1.2 * prices_cost(&prices, 2).value);
}

/* A picture whose tiles are not equally far says less: the slope follows the others. */
static void uneven_pictures_count_less(void **state)
{
    struct price_point points[POINTS];
    struct prices prices;
    double even, uneven, truth;

    (void)state;
    make_points(points);
    truth = START_S + RAY_S * points[POINTS - 1].rays * 16;
    points[POINTS - 2].figures.display_error *= 1.3; /* the tiles that stay behind make the 95 % quantile */
    points[POINTS - 2].figures.display_lo *= 1.3;
    points[POINTS - 2].figures.display_hi *= 1.3;
    prices_fit(&prices, points, POINTS, ALLOCATION_DISPLAY);
    even = prices_cost(&prices, points[POINTS - 1].figures.display_error / 4).value;
    points[POINTS - 2].uneven = 0.17;
    prices_fit(&prices, points, POINTS, ALLOCATION_DISPLAY);
    uneven = prices_cost(&prices, points[POINTS - 1].figures.display_error / 4).value;
    assert_true(fabs(log(uneven / truth)) < fabs(log(even / truth)) / 2);
    assert_near(uneven, truth, 0.3);
}

static void a_wide_interval_tells_no_number(void **state)
{
    (void)state;
    assert_true(prices_are_known((struct accuracy_estimate){3, 1, 9}));
    assert_false(prices_are_known((struct accuracy_estimate){3, 1, 11}));
    assert_false(prices_are_known((struct accuracy_estimate){3, 0, 9}));
    assert_false(prices_are_known((struct accuracy_estimate){NAN, NAN, NAN}));
    assert_false(prices_are_known((struct accuracy_estimate){3, 1, INFINITY}));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(start_up_is_paid_once), cmocka_unit_test(a_target_costs_more_than_its_error),
        cmocka_unit_test(uneven_pictures_count_less), cmocka_unit_test(a_wide_interval_tells_no_number)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
