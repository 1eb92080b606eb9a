/* The elementary functions' errors, measured against the C library's in long double, and the
 * fingerprint by which two machines know that they compute the same. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "common/math/elementary.h"
#include "common/math/vec.h"
#include "tests/support/figure.h"
#include "worker/render/light/environment/environment.h"

/* The largest error that was seen, where, and of how many arguments. */
struct worst {
    const char *name;
    double ulp;
    double x, y;
    unsigned long count;
};

/* |got - exact| in units of the last place of a float near `exact`. */
static double error_ulp(float got, long double exact)
{
    int exponent;

    if (isinf(got) && fabsl(exact) > (long double)FLT_MAX)
        return 0;
    frexpl(exact, &exponent); /* 0.5 <= mantissa < 1 */
    if (exponent < FLT_MIN_EXP)
        exponent = FLT_MIN_EXP; /* subnormals are evenly spaced */
    return (double)ldexpl(fabsl((long double)got - exact), FLT_MANT_DIG - exponent);
}

static double error_ulp_d(double got, long double exact)
{
    int exponent;

    frexpl(exact, &exponent);
    if (exponent < DBL_MIN_EXP)
        exponent = DBL_MIN_EXP;
    return (double)ldexpl(fabsl((long double)got - exact), DBL_MANT_DIG - exponent);
}

static void note(struct worst *w, double ulp, double x, double y)
{
    w->count++;
    if (!(ulp <= w->ulp)) { /* NaN counts as worse than anything */
        w->ulp = ulp;
        w->x = x;
        w->y = y;
    }
}

static void judge(const struct worst *w, double bound)
{
    char what[64];

    print_message("%-10s %9lu arguments, largest error %.6f ulp at (%.9g, %.9g)\n", w->name, w->count, w->ulp, w->x,
                  w->y);
    assert_true(w->count > 10000);
    snprintf(what, sizeof what, "largest error of %s in ulp", w->name);
    figure_within(what, w->ulp, 0, bound, "against long double");
}

/* Every stride-th float from `low` up to `high`, both > 0: as many in every octave. */
#define SWEEP(x, low, high, stride)                                                              \
    for (uint32_t bits_ = float_bits(low); bits_ <= float_bits(high); bits_ += (stride))        \
        for (float x = float_from_bits(bits_), once_ = 1; once_ > 0; once_ = 0)

/* splitmix64 (Steele et al. 2014): arguments in two dimensions. */
static double uniform(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15ull;

    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return (double)((z ^ (z >> 31)) >> 11) * 0x1p-53;
}

static void test_sine_and_cosine(void **state)
{
    struct worst s = {.name = "det_sin"}, c = {.name = "det_cos"}, t = {.name = "det_tan"};

    (void)state;
    SWEEP(x, 1e-30f, 1e5f, 997)
    for (int sign = -1; sign <= 1; sign += 2) {
        float signed_x = (float)sign * x, sine, cosine;
        det_sincos(signed_x, &sine, &cosine);
        note(&s, error_ulp(sine, sinl((long double)signed_x)), (double)signed_x, 0);
        note(&c, error_ulp(cosine, cosl((long double)signed_x)), (double)signed_x, 0);
        if (sign > 0)
            note(&t, error_ulp(det_tan(signed_x), tanl((long double)signed_x)), (double)x, 0);
    }
    /* The floats nearest to multiples of pi/2, where the reduction cancels most. */
    for (int n = 1; n <= 63661; n++) {
        float near = (float)(n * (PI_D / 2));
        for (int step = -1; step <= 1; step++) {
            float x = float_from_bits(float_bits(near) + (uint32_t)step), sine, cosine;
            det_sincos(x, &sine, &cosine);
            note(&s, error_ulp(sine, sinl((long double)x)), (double)x, 0);
            note(&c, error_ulp(cosine, cosl((long double)x)), (double)x, 0);
        }
    }
    judge(&s, 0.502);
    judge(&c, 0.502);
    judge(&t, 2.0); /* a quotient of two rounded results */
}

static void test_inverse(void **state)
{
    struct worst a = {.name = "det_acos"}, s = {.name = "det_asin"}, t = {.name = "det_atan2"};
    uint64_t random = 1;

    (void)state;
    SWEEP(x, 1e-30f, 1.0f, 1009)
    for (int sign = -1; sign <= 1; sign += 2) {
        float signed_x = (float)sign * x;
        note(&a, error_ulp(det_acos(signed_x), acosl((long double)signed_x)), (double)signed_x, 0);
        note(&s, error_ulp(det_asin(signed_x), asinl((long double)signed_x)), (double)signed_x, 0);
    }
    for (uint32_t i = 1; i < 200000; i++) { /* the floats just below 1, one by one */
        float x = float_from_bits(float_bits(1.0f) - i);
        note(&a, error_ulp(det_acos(x), acosl((long double)x)), (double)x, 0);
        note(&s, error_ulp(det_asin(x), asinl((long double)x)), (double)x, 0);
    }
    for (int i = 0; i < 1000000; i++) { /* all directions, lengths and their quotients over decades */
        double angle = 2 * PI_D * uniform(&random), squash = exp(-30 * uniform(&random));
        float y = (float)(sin(angle) * (i % 2 ? squash : 1));
        float x = (float)(cos(angle) * (i % 3 ? 1 : squash));
        note(&t, error_ulp(det_atan2(y, x), atan2l((long double)y, (long double)x)), (double)y, (double)x);
    }
    judge(&a, 0.502);
    judge(&s, 0.502);
    judge(&t, 0.502);
}

static void test_exponential(void **state)
{
    struct worst e = {.name = "det_exp"}, l = {.name = "det_log"}, p = {.name = "det_pow"};
    uint64_t random = 2;

    (void)state;
    SWEEP(x, 1e-30f, 104.0f, 499)
    for (int sign = -1; sign <= 1; sign += 2) {
        float signed_x = (float)sign * x;
        note(&e, error_ulp(det_exp(signed_x), expl((long double)signed_x)), (double)signed_x, 0);
    }
    SWEEP(x, 1e-45f, FLT_MAX, 1009) /* subnormals too */
    note(&l, error_ulp(det_log(x), logl((long double)x)), (double)x, 0);
    for (int i = 0; i < 1000000; i++) {
        float x = (float)exp(60 * uniform(&random) - 40), y = (float)(8 * uniform(&random) - 3);
        if (i % 4 == 0) /* near 1, with large exponents */
            x = (float)(0.9 + 0.2 * uniform(&random)), y *= 100;
        note(&p, error_ulp(det_pow(x, y), powl((long double)x, (long double)y)), (double)x, (double)y);
    }
    judge(&e, 0.502);
    judge(&l, 0.502);
    judge(&p, 0.502);
}

/* Needs a long double that is longer than a double. */
static void test_double(void **state)
{
    struct worst e = {.name = "det_exp_d"}, l = {.name = "det_log_d"}, p = {.name = "det_pow_d"};
    uint64_t random = 3;

    (void)state;
    if (LDBL_MANT_DIG < 64)
        skip();
    for (int i = 0; i < 1000000; i++) {
        double x = 1400 * uniform(&random) - 700, y, exponent;
        note(&e, error_ulp_d(det_exp_d(x), expl((long double)x)), x, 0);
        x = exp(1400 * uniform(&random) - 700);
        if (i % 2)
            x = 0.5 + uniform(&random);
        note(&l, error_ulp_d(det_log_d(x), logl((long double)x)), x, 0);
        /* The error of pow grows with its exponent, y log x, as the header says. */
        x = exp(20 * uniform(&random) - 10);
        y = 8 * uniform(&random) - 4;
        exponent = fabs(y * log(x));
        note(&p, error_ulp_d(det_pow_d(x, y), powl((long double)x, (long double)y)) / (1 + exponent), x, y);
    }
    judge(&e, 4);
    judge(&l, 4);
    judge(&p, 4);
}

static void test_double_angles(void **state)
{
    struct worst s = {.name = "det_sin_d"}, a = {.name = "det_atan2_d"};
    uint64_t random = 4;

    (void)state;
    assert_true(LDBL_MANT_DIG >= 64); /* else nothing is measured */
    for (int i = 0; i < 1000000; i++) {
        double x = (2 * uniform(&random) - 1) * PI_D, y;
        /* In units of 1e-16: what is absolute has no last place. */
        note(&s, (double)fabsl((long double)det_sin_d(x) - sinl((long double)x)) / 1e-16, x, 0);
        x = 2 * uniform(&random) - 1;
        y = (2 * uniform(&random) - 1) * (i % 2 ? 1 : exp(-30 * uniform(&random)));
        note(&a, error_ulp_d(det_atan2_d(y, x), atan2l((long double)y, (long double)x)), y, x);
    }
    judge(&s, 2);
    judge(&a, 4);
}

static void assert_float(float got, float expected)
{
    if (isnan(expected))
        assert_true(isnan(got));
    else if (float_bits(got) != float_bits(expected))
        fail_msg("%.9g (%08x) instead of %.9g (%08x)", (double)got, (unsigned)float_bits(got), (double)expected,
                 (unsigned)float_bits(expected));
}

static void test_special_values(void **state)
{
    float s, c;

    (void)state;
    det_sincos(0, &s, &c);
    assert_float(s, 0);
    assert_float(c, 1);
    assert_float(det_atan2(0, 0), 0);
    assert_float(det_atan2(0, 1), 0);
    assert_float(det_atan2(0, -1), PI_F);
    assert_float(det_atan2(1, 0), PI_F / 2);
    assert_float(det_atan2(-1, 0), -PI_F / 2);
    assert_float(det_acos(1), 0);
    assert_float(det_acos(-1), PI_F);
    assert_float(det_acos(1.5f), 0); /* clamped */
    assert_float(det_acos(-7), PI_F);
    assert_float(det_asin(1), PI_F / 2);
    assert_float(det_exp(0), 1);
    assert_float(det_exp(88.73f), INFINITY);
    assert_float(det_exp(-105), 0);
    assert_float(det_exp(NAN), NAN);
    assert_float(det_log(1), 0);
    assert_float(det_log(0), -INFINITY);
    assert_float(det_log(-1), NAN);
    assert_float(det_log(INFINITY), INFINITY);
    assert_float(det_pow(0, 0), 1);
    assert_float(det_pow(0, 2), 0);
    assert_float(det_pow(0, -1), INFINITY);
    assert_float(det_pow(7, 0), 1);
    assert_float(det_pow(1, 1e30f), 1);
}

/* ---- where a naive function gives NaN, or any number ---------------------------------------- */

/* The largest size of e^-depth over depths from `low` to `high`, where it is 0 in float. A NaN is infinite. */
static double most_through(float low, float high)
{
    double most = 0;

    SWEEP(depth, low, high, 9973) {
        double through = fabs((double)det_exp(-depth));
        most = through <= most ? most : isnan(through) ? (double)INFINITY : through;
    }
    return most;
}

static void test_deep_media_are_black(void **state)
{
    (void)state;
    figure_within("largest share of light through an optical depth of 104 to 745", most_through(104, 745), 0, 0,
                  "exact");
}

static void test_bottomless_media_are_black(void **state)
{
    (void)state;
    figure_within("largest share of light through an optical depth of 746 to 3e38", most_through(746, 3e38f), 0, 0,
                  "exact");
}

/* A sky that is 1 everywhere, seen straight up and straight down. */
static void test_poles_of_a_sky(void **state)
{
    struct environment *sky;
    struct error err = {0};
    struct image map;

    (void)state;
    assert_int_equal(image_init(&map, 8, 4, 3, &err), STATUS_OK);
    for (int i = 0; i < 8 * 4 * 3; i++)
        map.pixels[i] = 1;
    map.pixels[0] = 1.5f; /* a map of one colour is not looked up */
    assert_int_equal(environment_new(&sky, &map, NULL, 0, vec3_splat(1), ENV_SAMPLING_IMPORTANCE, &err), STATUS_OK);
    figure_within("radiance straight up", (double)environment_radiance(sky, vec3_make(0, 1, 0)).y, 1, 1.2, "of the map");
    figure_within("radiance straight down", (double)environment_radiance(sky, vec3_make(0, -1, 0)).y, 1, 1, "exact");
    environment_free(sky);
}

/* Where a unit vector's cosine with itself rounds to more than 1. */
static void test_angle_of_equal_directions(void **state)
{
    unsigned beyond = 0, lost = 0;
    uint64_t random = 1;

    (void)state;
    for (int i = 0; i < 100000; i++) {
        struct vec3 d = vec3_normalize(vec3_make((float)(uniform(&random) - 0.5), (float)(uniform(&random) - 0.5),
                                                 (float)(uniform(&random) - 0.5)));
        float cosine = vec3_dot(d, d);
        beyond += cosine > 1;
        lost += !(det_acos(cosine) < 1e-3f);
    }
    assert_true(beyond > 1000);
    figure_within("directions of 1e5 whose angle to themselves is not 0", lost, 0, 0, "exact");
}

/* What workers and coordinators of one farm must agree on. It changes only with the
 * functions: then old and new programs must not work on one job, and this number moves. */
static void test_fingerprint(void **state)
{
    (void)state;
    assert_true(elementary_fingerprint() == 0x5c7b1a12d5d9479dull);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sine_and_cosine), cmocka_unit_test(test_inverse),
        cmocka_unit_test(test_exponential),     cmocka_unit_test(test_double),
        cmocka_unit_test(test_double_angles),
        cmocka_unit_test(test_deep_media_are_black), cmocka_unit_test(test_bottomless_media_are_black),
        cmocka_unit_test(test_poles_of_a_sky), cmocka_unit_test(test_angle_of_equal_directions),
        cmocka_unit_test(test_special_values),  cmocka_unit_test(test_fingerprint),
    };
    return cmocka_run_group_tests_name("elementary", tests, NULL, NULL);
}
