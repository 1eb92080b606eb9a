/* The chi-square test itself: it accepts what is right and rejects what is wrong. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "tests/support/chi_square.h"
#include "tests/support/statistics.h"

static struct vec3 from_polar(double cosine, double phi)
{
    double sine = sqrt(fmax(0, 1 - cosine * cosine));
    return (struct vec3){(float)(sine * cos(phi)), (float)(sine * sin(phi)), (float)cosine};
}

static int sample_cosine(void *user, const float u[3], struct vec3 *wi)
{
    (void)user;
    *wi = from_polar(sqrt(1 - (double)u[0]), 2 * M_PI * u[1]);
    return 1;
}

/* *user: a factor on z's exponent that makes the density subtly wrong (1 is right). */
static double pdf_cosine_power(void *user, struct vec3 wi)
{
    double n = *(double *)user;
    return wi.z <= 0 ? 0 : (n + 1) / (2 * M_PI) * pow(wi.z, n);
}

static void accepts_cosine(void **state)
{
    double n = 1;
    struct chi_square_setup setup = {.sample = sample_cosine, .pdf = pdf_cosine_power, .user = &n};

    (void)state;
    for (setup.seed = 1; setup.seed <= 5; setup.seed++)
        assert_true(chi_square_accept(&setup, 0.01, 5, "cosine"));
    setup.axis = (struct vec3){0.6f, 0, 0.8f}; /* the horizon now cuts through cells */
    setup.focus = 3;
    setup.squeeze = 0.3;
    assert_true(chi_square_accept(&setup, 0.01, 1, "cosine, tilted and squeezed cells"));
}

static void rejects_an_exponent_5_percent_off(void **state)
{
    double n = 1.05;
    struct chi_square_setup setup = {.sample = sample_cosine, .pdf = pdf_cosine_power, .user = &n};
    struct chi_square_result r;

    (void)state;
    assert_true(chi_square_run(&setup, &r));
    assert_null(r.reason);
    assert_true(fabs(r.mass - 1) < 1e-4);
    assert_true(r.p_value < 1e-6);
    chi_square_result_release(&r);
}

static double pdf_half(void *user, struct vec3 wi) { return 0.99 * pdf_cosine_power(user, wi); }
static double pdf_double(void *user, struct vec3 wi) { return 1.01 * pdf_cosine_power(user, wi); }
static double pdf_nan(void *user, struct vec3 wi)
{
    (void)user;
    return wi.z > 0.5f ? NAN : 0.1;
}
static double pdf_quarter(void *user, struct vec3 wi) { return wi.x > 0 && wi.y > 0 ? 0 : pdf_cosine_power(user, wi); }

static double p_value_of(double (*pdf)(void *, struct vec3), const char **reason)
{
    double n = 1, p;
    struct chi_square_setup setup = {.sample = sample_cosine, .pdf = pdf, .user = &n};
    struct chi_square_result r;

    assert_true(chi_square_run(&setup, &r));
    p = r.p_value;
    *reason = r.reason;
    chi_square_result_release(&r);
    return p;
}

static void rejects_wrong_totals_and_broken_densities(void **state)
{
    const char *reason;

    (void)state;
    assert_true(p_value_of(pdf_half, &reason) < 1e-6);
    assert_true(p_value_of(pdf_double, &reason) == 0 && reason);
    assert_true(p_value_of(pdf_nan, &reason) == 0 && reason);
    assert_true(p_value_of(pdf_quarter, &reason) == 0 && reason);
}

/* A narrow lobe around `axis`: 1 - cos is exponential with mean `width`. */
struct narrow {
    struct vec3 axis;
    double width, claimed_width;
};

static int sample_narrow(void *user, const float u[3], struct vec3 *wi)
{
    const struct narrow *lobe = user;
    struct basis f = basis_from_normal(lobe->axis);
    double drop = -lobe->width * log1p(-(double)u[0] * (1 - exp(-2 / lobe->width)));
    double sine = sqrt(drop * (2 - drop)), phi = 2 * M_PI * u[1];

    if (u[2] < 0.25f)
        return 0; /* a quarter is "none" */
    *wi = basis_to_world(&f, (struct vec3){(float)(sine * cos(phi)), (float)(sine * sin(phi)),
                                           (float)(1 - drop)});
    return 1;
}

static double pdf_narrow(void *user, struct vec3 wi)
{
    const struct narrow *lobe = user;
    struct vec3 d = vec3_sub(wi, lobe->axis);
    double w = lobe->claimed_width, drop = vec3_dot(d, d) / 2;
    return 0.75 * exp(-drop / w) / (2 * M_PI * w * (1 - exp(-2 / w)));
}

static void resolves_a_narrow_lobe(void **state)
{
    struct narrow lobe = {{0.8f, 0, 0.6f}, 1e-5, 1e-5};
    struct chi_square_setup setup = {.sample = sample_narrow, .pdf = pdf_narrow, .user = &lobe,
                                     .axis = {0.8f, 0, 0.6f}, .focus = 8, .seed = 3};
    struct chi_square_result r;

    (void)state;
    assert_true(chi_square_accept(&setup, 0.01, 1, "narrow"));
    lobe.claimed_width *= 1.02;
    assert_true(chi_square_run(&setup, &r));
    assert_true(r.p_value < 1e-6);
    chi_square_result_release(&r);
}

/* Under a true hypothesis p-values are uniform: 200 of them in ten equal bins. */
static void p_values_are_uniform(void **state)
{
    double n = 1, deciles[10] = {0}, statistic = 0;
    struct chi_square_setup setup = {.sample = sample_cosine, .pdf = pdf_cosine_power, .user = &n,
                                     .samples = 4000};

    (void)state;
    for (int i = 0; i < 200; i++) {
        struct chi_square_result r;
        setup.seed = 1000 + (uint64_t)i;
        assert_true(chi_square_run(&setup, &r));
        deciles[(int)fmin(9, r.p_value * 10)] += 1;
        chi_square_result_release(&r);
    }
    for (int i = 0; i < 10; i++)
        statistic += (deciles[i] - 20) * (deciles[i] - 20) / 20;
    assert_true(chi_square_p_value(statistic, 9) > 0.01);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(accepts_cosine),
        cmocka_unit_test(rejects_an_exponent_5_percent_off),
        cmocka_unit_test(rejects_wrong_totals_and_broken_densities),
        cmocka_unit_test(resolves_a_narrow_lobe),
        cmocka_unit_test(p_values_are_uniform),
    };
    return cmocka_run_group_tests_name("chi_square", tests, NULL, NULL);
}
