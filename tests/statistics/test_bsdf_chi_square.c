/* bsdf_sample follows bsdf_pdf: chi-square tests over a grid of materials and angles.
 * Family-wise significance level 0.01, Sidak-corrected over all the tests of this program;
 * fixed seeds. Reflection and transmission are tested apart (what goes the other way
 * counts as "none"), with the cells focused on the lobe where it is narrow. What a narrow
 * lobe's microfacets give back crowds at the horizon instead, where those cells do not resolve
 * it: it is left out there and tested by itself. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>

#include "tests/support/bsdf_checks.h"
#include "tests/support/chi_square.h"
#include "tests/support/statistics.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/bsdf/lobe_diffuse.h"

#define SIGNIFICANCE 0.01
/* A lobe narrower than this (radians, roughly) gets cells of its own size. */
#define FOCUS_BELOW 0.04f

static const float COSINES[] = {1e-3f, 0.05f, 0.3f, 0.7f, 1.0f};
static const float ALPHAS[] = {1e-3f, 0.02f, 0.2f, 1.0f};
static const float IORS[] = {1.05f, 1.5f, 2.5f};
enum {
    COUNT_COSINES = sizeof COSINES / sizeof *COSINES,
    COUNT_ALPHAS = sizeof ALPHAS / sizeof *ALPHAS,
    COUNT_IORS = sizeof IORS / sizeof *IORS,
    COUNT_OPAQUE = 3,   /* metallic 0, 0.5, 1 */
    COUNT_CLEAR = 3,    /* thin; refractive from outside and from inside */
    COUNT_MIXED = 1,    /* half of everything */
    SIDES = 2,
    /* Opaque surfaces are tested at one ior and on one side, mixed ones at one ior. */
    COUNT_WIDE = 4,
    TESTS = COUNT_COSINES * COUNT_ALPHAS *
            (COUNT_OPAQUE + COUNT_MIXED * SIDES + COUNT_IORS * COUNT_CLEAR * SIDES) + COUNT_WIDE,
    SAMPLES = 30000,
};

static unsigned tests_run;

static void check(const struct bsdf_params *params, float cos_o, float side)
{
    float sin_o = sqrtf(1 - cos_o * cos_o), sin_t, width = params->alpha;
    struct bsdf_subject s = {.wo = {sin_o * 0.6f, sin_o * -0.8f, cos_o}, .side = side};
    struct chi_square_setup setup = {.sample = bsdf_subject_sample, .pdf = bsdf_subject_pdf, .user = &s, .samples = SAMPLES,
                                     .seed = ++tests_run};
    struct bsdf_params single;
    char name[200];

    single = *params;
    single.single_scattering = width <= FOCUS_BELOW;
    bsdf_init(&s.bsdf, &single, s.wo);
    setup.axis = (struct vec3){-s.wo.x, -s.wo.y, cos_o * side};
    if (side < 0 && !params->refractive)
        width = s.bsdf.thin_wall.spread.shape.y;
    if (side < 0 && params->refractive) {
        sin_t = sin_o / s.bsdf.eta;
        width *= fabsf(s.bsdf.eta - 1);
        setup.axis = (struct vec3){-s.wo.x / s.bsdf.eta, -s.wo.y / s.bsdf.eta,
                                   -sqrtf(fmaxf(0, 1 - sin_t * sin_t))};
    }
    if (width > FOCUS_BELOW)
        setup.axis = (struct vec3){0, 0, 1};
    else /* the lobe's edge, (1 - cos) / 2 near width^2, at about 0.4 of the way */
        setup.focus = 2 * log(width) / log(0.4);
    /* A reflection is foreshortened across the plane of incidence. */
    if (width <= FOCUS_BELOW && !(side < 0 && params->refractive))
        setup.squeeze = fmax(cos_o, width);
    snprintf(name, sizeof name, "metallic %g, alpha %g, ior %g, transmission %g%s%s, cos %g, %s",
             (double)params->metallic, (double)params->alpha, (double)params->ior, (double)params->transmission,
             params->refractive ? " refractive" : "", params->inside ? " inside" : "", (double)cos_o,
             side > 0 ? "above" : "below");
    if (!chi_square_accept(&setup, SIGNIFICANCE, TESTS, name))
        fail_msg("%s: samples do not follow the density (tables above)", name);
}

static struct bsdf_params material(float metallic, float alpha, float ior, float transmission, int refractive,
                                   int inside)
{
    return (struct bsdf_params){.base_color = {0.9f, 0.6f, 0.3f}, .metallic = metallic,
                                .alpha = alpha, .ior = ior, .specular = 1,
                                .specular_color = {1, 1, 1}, .transmission = transmission,
                                .refractive = refractive, .inside = inside};
}

static void opaque_surfaces(void **state)
{
    (void)state;
    for (int c = 0; c < COUNT_COSINES; c++)
        for (int a = 0; a < COUNT_ALPHAS; a++)
            for (int m = 0; m < COUNT_OPAQUE; m++) {
                struct bsdf_params p = material(0.5f * (float)m, ALPHAS[a], 1.5f, 0, 0, 0);
                check(&p, COSINES[c], 1);
            }
}

static void clear_surfaces(void **state)
{
    (void)state;
    for (int c = 0; c < COUNT_COSINES; c++)
        for (int a = 0; a < COUNT_ALPHAS; a++)
            for (int i = 0; i < COUNT_IORS; i++)
                for (float side = 1; side >= -1; side -= 2) {
                    struct bsdf_params thin = material(0, ALPHAS[a], IORS[i], 1, 0, 0);
                    struct bsdf_params outside = material(0, ALPHAS[a], IORS[i], 1, 1, 0);
                    struct bsdf_params inside = material(0, ALPHAS[a], IORS[i], 1, 1, 1);
                    check(&thin, COSINES[c], side);
                    check(&outside, COSINES[c], side);
                    check(&inside, COSINES[c], side);
                }
}

static void mixed_surfaces(void **state)
{
    (void)state;
    for (int c = 0; c < COUNT_COSINES; c++)
        for (int a = 0; a < COUNT_ALPHAS; a++)
            for (float side = 1; side >= -1; side -= 2) {
                struct bsdf_params p = material(0.5f, ALPHAS[a], 1.5f, 0.5f, 1, 0);
                check(&p, COSINES[c], side);
            }
}

/* The wide lobe of narrow distributions, over cells equal in log(mu). */
static void what_is_given_back(void **state)
{
    static const float NARROW[COUNT_WIDE] = {1e-3f, 5e-3f, 0.02f, 0.049f};

    (void)state;
    for (int k = 0; k < COUNT_WIDE; k++) {
        struct bsdf_params p = material(k & 1 ? 1 : 0.5f, NARROW[k], 1.5f, 0, 0, 0);
        struct vec3 wo = {0.8f, 0, 0.6f};
        struct test_random r = {++tests_run};
        enum { CELLS = 30, STEPS = 2000, HITS = 200000 };
        double hits[CELLS] = {0}, pooled = 0, found = 0, statistic = 0, total = 0, range = log(1e4);
        int degrees = -1;
        struct bsdf b;

        bsdf_init(&b, &p, wo);
        assert_true(b.compensation.graze > 0);
        for (int i = 0; i < HITS; i++) {
            float u = test_random_float(&r), v = test_random_float(&r);
            double cell = (log((double)wide_sample(&b, u, v).z) / range + 1) * CELLS; /* 1e-4..1 */
            hits[cell < 0 ? 0 : cell < CELLS ? (int)cell : CELLS - 1]++;
        }
        for (int c = 0; c < CELLS; c++) {
            double expected = 0, low = c > 0 ? exp(range * ((double)c / CELLS - 1)) : 0;
            double high = exp(range * ((c + 1.0) / CELLS - 1));
            for (int i = 0; i < STEPS; i++) {
                double mu = low + (high - low) * (i + 0.5) / STEPS;
                expected += 2 * M_PI * (double)wide_density(&b, (float)mu) * (high - low) / STEPS;
            }
            total += expected;
            pooled += expected * HITS;
            found += hits[c];
            if (pooled < 5 && c + 1 < CELLS)
                continue;
            statistic += (found - pooled) * (found - pooled) / pooled;
            degrees++;
            pooled = found = 0;
        }
        assert_true(fabs(total - 1) < 1e-3);
        if (chi_square_p_value(statistic, degrees) < sidak_alpha(SIGNIFICANCE, TESTS))
            fail_msg("alpha %g: chi-square %g", (double)NARROW[k], statistic);
    }
}

static void every_test_of_the_family_ran(void **state)
{
    (void)state;
    assert_int_equal(tests_run, TESTS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(opaque_surfaces),
        cmocka_unit_test(clear_surfaces),
        cmocka_unit_test(mixed_surfaces),
        cmocka_unit_test(what_is_given_back),
        cmocka_unit_test(every_test_of_the_family_ran),
    };
    return cmocka_run_group_tests_name("bsdf_chi_square", tests, NULL, NULL);
}
