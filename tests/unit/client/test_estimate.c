/* An estimate from pilots whose error follows a known law: the curve through their points, and what the cap
 * will cost. */
#include <jansson.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <unistd.h>

#include <cmocka.h>

#include "client/views/estimate.h"

enum { POINTS = 4, PILOT_SPP = 32, CAP_SPP = 512 };

static void assert_near(double value, double expected, double share)
{
    if (!(fabs(value - expected) <= share * fabs(expected)))
        fail_msg("%.9g instead of %.9g", value, expected);
}

/* A frame's history: twice the samples each, errors that fall as the square root of the cost. */
struct pilot {
    Azulejo__Wire__Envelope envelope;
    Azulejo__Wire__History history;
    Azulejo__Wire__HistoryPoint points[POINTS], *pointers[POINTS];
    Azulejo__Wire__Figures figures[POINTS];
};

static double cost_s(int i) { return 10 * ldexp(1, i); }
static double error_codes(int i) { return 24 / sqrt(ldexp(1, i)); }

static void pilot_init(struct pilot *p, double worse)
{
    p->envelope = (Azulejo__Wire__Envelope)AZULEJO__WIRE__ENVELOPE__INIT;
    p->history = (Azulejo__Wire__History)AZULEJO__WIRE__HISTORY__INIT;
    p->envelope.history = &p->history;
    p->history.points = p->pointers;
    p->history.n_points = POINTS;
    for (int i = 0; i < POINTS; i++) {
        Azulejo__Wire__Figures *f = &p->figures[i];
        double error = worse * error_codes(i);

        *f = (Azulejo__Wire__Figures)AZULEJO__WIRE__FIGURES__INIT;
        f->display = error;
        f->display_low = error * 0.9;
        f->display_high = error * 1.1;
        f->rmse_percent = error / 2;
        f->rmse_low = error * 0.4;
        f->rmse_high = error * 0.6;
        p->points[i] = (Azulejo__Wire__HistoryPoint)AZULEJO__WIRE__HISTORY_POINT__INIT;
        p->points[i].core_seconds = cost_s(i);
        p->points[i].samples = (uint64_t)ldexp(1000, i);
        p->points[i].figures = f;
        p->pointers[i] = &p->points[i];
    }
}

static const struct estimate plain = {
    .price = -1, .seconds_to_deadline = -1, .spp = CAP_SPP, .pilot_spp = PILOT_SPP, .frame_count = 10,
    .target = {ALLOCATION_RMSE, 1}, .cores = 4,
};

/* Each of a pilot's points counts once, for the display error and in the target's measure. */
static void the_curve_has_each_point_once(void **state)
{
    struct estimate e = plain;
    struct price_point points[POINTS] = {0};
    struct prices expected;
    struct pilot pilot;

    (void)state;
    pilot_init(&pilot, 1);
    e.frames[0].history = &pilot.envelope;
    e.count = 1;
    for (int i = 0; i < POINTS; i++) {
        double error = error_codes(i);
        points[i].core_s = cost_s(i);
        points[i].samples = ldexp(1000, i);
        points[i].figures = (struct accuracy_figures){
            .known = 1, .display_error = error, .display_lo = error * 0.9, .display_hi = error * 1.1,
            .rmse_percent = error / 2, .rmse_lo = error * 0.4, .rmse_hi = error * 0.6};
    }
    estimate_fit(&e);
    prices_fit(&expected, points, POINTS, ALLOCATION_DISPLAY);
    assert_int_equal(e.frames[0].prices.curve.points, POINTS);
    assert_memory_equal(&e.frames[0].prices, &expected, sizeof expected);
    prices_fit(&expected, points, POINTS, ALLOCATION_RMSE);
    assert_memory_equal(&e.frames[0].target_prices, &expected, sizeof expected);
    pilot.history.n_points = 1; /* the first point alone is the pilot */
    estimate_fit(&e);
    prices_fit(&expected, points, 1, ALLOCATION_DISPLAY);
    assert_memory_equal(&e.frames[0].prices, &expected, sizeof expected);
}

/* What estimate --json prints. */
static json_t *printed(const struct estimate *e)
{
    FILE *file = tmpfile();
    struct error err = {0};
    json_t *root;
    int out;

    assert_non_null(file);
    fflush(stdout);
    out = dup(STDOUT_FILENO);
    assert_true(out >= 0 && dup2(fileno(file), STDOUT_FILENO) >= 0);
    assert_int_equal(estimate_print_json(e, &err), STATUS_OK);
    fflush(stdout);
    assert_true(dup2(out, STDOUT_FILENO) >= 0);
    close(out);
    rewind(file);
    root = json_loadf(file, 0, NULL);
    fclose(file);
    assert_non_null(root);
    return root;
}

/* A number of the report; -1: there is none. */
static double number_of(json_t *object, const char *key)
{
    json_t *value = json_object_get(object, key);

    return json_is_number(value) ? json_number_value(value) : -1;
}

/* Two of ten frames stand for five each. Sixteen times the samples cost sixteen times the time; the error is
 * the worse frame's, a quarter of its pilot's. */
static void the_cap_costs_its_samples(void **state)
{
    Azulejo__Wire__JobInfo info = AZULEJO__WIRE__JOB_INFO__INIT;
    struct pilot pilots[2];
    struct estimate e = plain;
    json_t *root, *row;

    (void)state;
    e.info = &info;
    e.count = 2;
    for (int i = 0; i < 2; i++) {
        pilot_init(&pilots[i], 1 + i);
        e.frames[i].number = (uint32_t)(1 + 9 * i);
        e.frames[i].history = &pilots[i].envelope;
    }
    estimate_fit(&e);
    root = printed(&e);
    row = json_object_get(root, "cap");
    assert_near(number_of(row, "core_seconds"), 10 * cost_s(POINTS - 1) * CAP_SPP / PILOT_SPP, 1e-9);
    assert_near(number_of(row, "display"), 2 * error_codes(POINTS - 1) / 4, 1e-3);
    /* Half of the first row's error costs four times as much. */
    row = json_object_get(root, "curve");
    assert_near(number_of(json_array_get(row, 1), "core_seconds"),
                4 * number_of(json_array_get(row, 0), "core_seconds"), 1e-3);
    json_decref(root);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_curve_has_each_point_once),
        cmocka_unit_test(the_cap_costs_its_samples),
    };
    return cmocka_run_group_tests_name("estimate", tests, NULL, NULL);
}
