/* What is left out, from prices that are made up: intervals, sums, and what longer pilots may cost. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/study/effects_choose.h"

enum { A = EFFECT_BIT_SHEEN, B = EFFECT_BIT_CLEARCOAT, C = EFFECT_BIT_FOG };
#define BIT(b) ((uint64_t)1 << (b))
#define MOST 0.75

/* A farm of which everything is known. Intervals narrow as one over the root of the samples. */
struct lab {
    double bias[EFFECT_COUNT], width_at_32[EFFECT_COUNT], saved[EFFECT_COUNT], noise[EFFECT_COUNT];
    double together_bias[2]; /* of two effects, and of three */
    double render_s, cost_s; /* of one pilot of 32 samples, all rounds */
    double spent_s;          /* on pilots, the whole picture among them */
    double saved_width;
    int length[EFFECT_COUNT]; /* last measured; -1: never */
    int together_count;
};

static void price_of(const struct lab *lab, struct effects_price *out, double bias, double width, double saved,
                     double noise, int length)
{
    const double w = width * sqrt(32.0 / choose_lengths[length]);
    const double t = lab->saved_width * sqrt(32.0 / choose_lengths[length]);

    memset(out, 0, sizeof *out);
    out->bias.codes = (struct study_interval){bias, fmax(0, bias - w), bias + w};
    out->bias.rms_codes = (struct study_interval){bias / 3, 0, (bias + w) / 3};
    out->saved = (struct study_interval){saved, saved - t, saved + t};
    out->noise = noise;
}

static status alone(void *user, uint64_t bits, int length, struct error *err)
{
    struct lab *lab = user;

    (void)err;
    for (int b = 0; b < EFFECT_COUNT; b++)
        if (bits >> b & 1)
            lab->length[b] = length;
    lab->spent_s += lab->cost_s * (__builtin_popcountll(bits) + 1) * choose_lengths[length] / 32;
    return STATUS_OK;
}

static status price(void *user, int bit, struct effects_price *out, struct error *err)
{
    const struct lab *lab = user;

    (void)err;
    assert_true(lab->length[bit] >= 0);
    price_of(lab, out, lab->bias[bit], lab->width_at_32[bit], lab->saved[bit], lab->noise[bit], lab->length[bit]);
    return STATUS_OK;
}

static status together(void *user, uint64_t set, int length, struct effects_price *out, struct error *err)
{
    struct lab *lab = user;
    const int count = __builtin_popcountll(set);

    (void)err;
    assert_true(count >= 2);
    lab->together_count++;
    lab->spent_s += lab->cost_s * choose_lengths[length] / 32;
    price_of(lab, out, lab->together_bias[count - 2], 0.01, 0.2, 1, length);
    return STATUS_OK;
}

static double cost_s(void *user, unsigned effects, int length)
{
    return ((struct lab *)user)->cost_s * (effects + 1) * choose_lengths[length] / 32;
}

static double render_s(void *user) { return ((struct lab *)user)->render_s; }

static struct lab lab_of_hidden(void)
{
    struct lab lab = {.render_s = 1e6, .cost_s = 1, .saved_width = 0.005};

    for (int b = 0; b < EFFECT_COUNT; b++) {
        lab.bias[b] = 0.4;
        lab.width_at_32[b] = 0.1;
        lab.saved[b] = 0.1;
        lab.noise[b] = 1;
        lab.length[b] = -1;
    }
    lab.together_bias[0] = lab.together_bias[1] = 0.5;
    return lab;
}

static struct effects_choice choose(struct lab *lab, uint64_t set)
{
    const struct effects_pilots pilots = {lab, alone, price, together, cost_s, render_s};
    struct effects_choice out;
    struct error err = {0};

    assert_int_equal(effects_choose(&out, &pilots, set, MOST, &err), STATUS_OK);
    return out;
}

static void what_is_hidden_goes(void **state)
{
    struct lab lab = lab_of_hidden();

    (void)state;
    assert_int_equal(choose(&lab, BIT(A)).set, BIT(A));
    assert_int_equal(lab.length[A], 1);
    lab.bias[A] = 2;
    assert_int_equal(choose(&lab, BIT(A)).set, 0);
    assert_int_equal(lab.length[A], 0); /* the shortest pilots showed it */
    lab = lab_of_hidden();
    lab.saved[A] = 0.005;
    assert_int_equal(choose(&lab, BIT(A)).set, 0);
}

/* A bias that may be too large is one, until pilots are long enough. */
static void the_intervals_end_counts(void **state)
{
    struct lab lab = lab_of_hidden();

    (void)state;
    lab.width_at_32[A] = 0.6; /* at 128 samples 0.3: at most 0.7 */
    assert_int_equal(choose(&lab, BIT(A)).set, BIT(A));
    assert_int_equal(lab.length[A], 2);
    lab.width_at_32[A] = 2; /* at 512 samples still 0.5: at most 0.9 */
    assert_int_equal(choose(&lab, BIT(A)).set, 0);
    assert_int_equal(lab.length[A], 3);
}

static void time_must_be_sure(void **state)
{
    struct lab lab = lab_of_hidden();

    (void)state;
    lab.saved[A] = 0.03;
    lab.saved_width = 0.05; /* at 128 samples 0.025 */
    assert_int_equal(choose(&lab, BIT(A)).set, BIT(A));
    assert_int_equal(lab.length[A], 2);
    lab.saved_width = 0.2; /* at 512 samples 0.05 */
    assert_int_equal(choose(&lab, BIT(A)).set, 0);
}

/* A third less time a sample, twice the noise: the target is reached later. */
static void noise_costs_time(void **state)
{
    struct lab lab = lab_of_hidden();

    (void)state;
    lab.saved[A] = 0.33;
    lab.noise[A] = 2;
    assert_int_equal(choose(&lab, BIT(A)).set, 0);
    lab.saved[A] = 0; /* and less noise is time that is saved */
    lab.noise[A] = 0.9;
    assert_int_equal(choose(&lab, BIT(A)).set, BIT(A));
}

/* Longer pilots must pay, and leave nine tenths of the time to the render. */
static void longer_pilots_must_pay(void **state)
{
    struct lab lab = lab_of_hidden();
    struct effects_choice c;

    (void)state;
    lab.width_at_32[A] = 0.6;
    lab.cost_s = 10;     /* 8, 32, 128 samples: (1 + 1) * 10 * (1/4 + 1 + 4) = 105 */
    lab.render_s = 1000; /* of which a tenth is 100, and saves 100 */
    c = choose(&lab, BIT(A));
    assert_int_equal(c.set, 0);
    assert_int_equal(lab.length[A], 1);
    assert_int_equal(c.open_count, 1);
    assert_int_equal(c.open[0].bit, A);
    lab.render_s = 1100;
    assert_int_equal(choose(&lab, BIT(A)).set, BIT(A));
    lab.saved[A] = 0.05; /* 55 of 1100: less than 80 */
    assert_int_equal(choose(&lab, BIT(A)).set, 0);
    /* The better bargain first: there is room for one of two. */
    lab = lab_of_hidden();
    lab.width_at_32[A] = lab.width_at_32[B] = 0.6;
    lab.saved[A] = 0.2;
    lab.saved[B] = 0.3;
    lab.cost_s = 10;
    lab.render_s = 1300; /* 37.5 for both up to 32 samples, 80 for one at 128 */
    c = choose(&lab, BIT(A) | BIT(B));
    assert_int_equal(c.set, BIT(B));
    assert_int_equal(c.open_count, 1);
    assert_int_equal(lab.length[A], 1);
}

/* Whatever is measured, all of it is within a tenth of the render; what is not measured stays, and is named. */
static void never_more_than_a_tenth(void **state)
{
    (void)state;
    for (double render_s = 1; render_s < 1e5; render_s *= 1.07) {
        struct lab lab = lab_of_hidden();
        struct effects_choice c;
        lab.width_at_32[A] = lab.width_at_32[B] = 0.6;
        lab.cost_s = 10;
        lab.render_s = render_s;
        c = choose(&lab, BIT(A) | BIT(B) | BIT(C));
        assert_true(lab.spent_s <= 0.1 * render_s);
        for (int b = 0; b < EFFECT_COUNT; b++)
            if (c.unmeasured >> b & 1)
                assert_true(lab.length[b] == -1 && !(c.set >> b & 1));
        if (render_s < 49)
            assert_int_equal(c.unmeasured, BIT(A) | BIT(B) | BIT(C));
        if (render_s > 1e4)
            assert_int_equal(c.set, BIT(A) | BIT(B) | BIT(C));
    }
}

/* Upper ends of 0.5 each: added up they are above 0.75, measured together they are below. */
static void a_sum_proves_nothing(void **state)
{
    struct lab lab = lab_of_hidden();

    (void)state;
    assert_int_equal(choose(&lab, BIT(A) | BIT(B)).set, BIT(A) | BIT(B));
    assert_int_equal(lab.together_count, 1);
    lab.together_bias[1] = 0.7;
    assert_int_equal(choose(&lab, BIT(A) | BIT(B) | BIT(C)).set, BIT(A) | BIT(B) | BIT(C));
}

/* Each is hidden, and so is their sum, but not the two together: one goes, the better bargain. */
static void together_is_measured(void **state)
{
    struct lab lab = lab_of_hidden();
    struct effects_choice c;

    (void)state;
    lab.bias[A] = 0.2;
    lab.bias[B] = 0.3;
    lab.width_at_32[A] = lab.width_at_32[B] = 0.02;
    lab.together_bias[0] = 0.9;
    c = choose(&lab, BIT(A) | BIT(B));
    assert_int_equal(c.set, BIT(A));
    assert_true(c.together.bias.codes.value < 0.3);
    lab.together_bias[1] = 0.9; /* three do not go, two do */
    lab.together_bias[0] = 0.5;
    c = choose(&lab, BIT(A) | BIT(B) | BIT(C));
    assert_int_equal(c.count, 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_hidden_goes),
        cmocka_unit_test(the_intervals_end_counts),
        cmocka_unit_test(time_must_be_sure),
        cmocka_unit_test(noise_costs_time),
        cmocka_unit_test(longer_pilots_must_pay),
        cmocka_unit_test(never_more_than_a_tenth),
        cmocka_unit_test(a_sum_proves_nothing),
        cmocka_unit_test(together_is_measured),
    };

    return cmocka_run_group_tests_name("client/effects_choose", tests, NULL, NULL);
}
