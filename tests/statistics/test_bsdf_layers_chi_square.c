/* bsdf_sample follows bsdf_pdf where surfaces have layers: chi-square tests of each lobe and of
 * mixtures by chance. Family-wise significance level 0.01, Sidak-corrected over all the tests
 * of this program; fixed seeds. */
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

#define SIGNIFICANCE 0.01

static const float COSINES[] = {1e-3f, 0.05f, 0.3f, 0.7f, 1.0f};
enum {
    COUNT_COSINES = sizeof COSINES / sizeof *COSINES,
    COUNT_KINDS = 14,
    COUNT_MIXTURES = 60,
    COUNT_GRID = BSDF_MAKER_KINDS * 2 /* alphas */ * 2 /* cosines */,
    TESTS = (COUNT_COSINES * COUNT_KINDS + COUNT_MIXTURES + COUNT_GRID) * 2 /* sides */,
    SAMPLES = 30000,
};

static unsigned tests_run;

static void check(const struct bsdf_params *params, struct vec3 wo)
{
    for (float side = 1; side >= -1; side -= 2) {
        struct bsdf_subject s = {.wo = wo, .side = side};
        struct chi_square_setup setup = {.sample = bsdf_subject_sample, .pdf = bsdf_subject_pdf, .user = &s,
                                         .samples = SAMPLES, .seed = ++tests_run};
        bsdf_init(&s.bsdf, params, wo);
        if (!chi_square_accept(&setup, SIGNIFICANCE, TESTS, bsdf_maker_describe(params)))
            fail_msg("cos %g side %g: %s: samples do not follow the density (tables above)", (double)wo.z, (double)side,
                     bsdf_maker_describe(params));
    }
}

static struct bsdf_params kind_of(int k)
{
    struct bsdf_params p = bsdf_maker_plain(0, 0.3f);

    p.base_color = (struct vec3){0.9f, 0.6f, 0.3f};
    switch (k) {
    case 0: case 1: case 2: /* coats: rough, rougher, smooth */
        p.clearcoat = 1;
        p.clearcoat_alpha = k == 0 ? 0.15f : k == 1 ? 1 : 0;
        p.clearcoat_ior = 1.5f;
        p.clearcoat_normal = vec3_normalize((struct vec3){0.2f, 0.1f, 1});
        break;
    case 3: case 4: /* sheens */
        p.sheen_color = (struct vec3){1, 0.5f, 0.5f};
        p.sheen_alpha = k == 3 ? 0.05f : 0.6f;
        break;
    case 5: case 6: /* stretched: metal, and glass */
        p.alpha = 0.12f;
        p.alpha_stretched = 0.7f;
        p.metallic = k == 5;
        p.transmission = 1;
        p.refractive = 1;
        break;
    case 7: case 8:
        p.conductor = 1;
        p.eta = (struct vec3){0.2f, 0.9f, 1.3f};
        p.k = (struct vec3){4, 2.4f, 1.9f};
        p.alpha_stretched = k == 8 ? 0.9f : 0;
        break;
    case 9: case 10: /* films */
        p.iridescence = 1;
        p.iridescence_ior = 1.8f;
        p.iridescence_thickness_nm = 400;
        p.transmission = k == 10;
        p.refractive = 1;
        break;
    case 11:
        p.diffuse_transmission = 0.5f;
        p.diffuse_transmission_color = (struct vec3){0.3f, 0.9f, 0.3f};
        break;
    case 12: /* rough glass in something denser */
        p.transmission = 1;
        p.refractive = 1;
        p.ior_outside = 2;
        p.clearcoat = 1; /* (a kind with layers) */
        p.clearcoat_alpha = 0.3f;
        p.clearcoat_ior = 1.2f;
        p.clearcoat_normal = (struct vec3){0, 0, 1};
        break;
    default: /* a rough slab */
        p.transmission = 1;
        p.thin_slab = 1;
        break;
    }
    return p;
}

static void each_lobe(void **state)
{
    (void)state;
    for (int k = 0; k < COUNT_KINDS; k++)
        for (int c = 0; c < COUNT_COSINES; c++) {
            struct bsdf_params p = kind_of(k);
            float sine = sqrtf(1 - COSINES[c] * COSINES[c]);
            check(&p, (struct vec3){sine * 0.6f, sine * -0.8f, COSINES[c]});
        }
}

static void every_kind(void **state)
{
    (void)state;
    for (int i = 0; i < COUNT_GRID; i++) {
        struct bsdf_params p = bsdf_maker_kind(i / 4, i & 1 ? 0.7f : 0.15f);
        float z = i & 2 ? 0.5f : 0.15f, sine = sqrtf(1 - z * z);
        check(&p, (struct vec3){sine * 0.6f, sine * 0.8f, z});
    }
}

static void mixtures(void **state)
{
    struct test_random r = {17};

    (void)state;
    for (int i = 0; i < COUNT_MIXTURES; i++) {
        struct bsdf_params p = bsdf_maker_random(&r, 0.1f);
        float z = 0.02f + 0.98f * test_random_float(&r), sine = sqrtf(1 - z * z);
        float turn = 6.28f * test_random_float(&r);
        if (p.refractive && p.ior < 1.2f) /* its refraction is too narrow for these cells */
            p.ior = 1.5f;
        if (p.refractive && p.ior_outside > 1 && fabsf(p.ior / p.ior_outside - 1) < 0.1f)
            p.ior_outside = 1;
        check(&p, (struct vec3){sine * cosf(turn), sine * sinf(turn), z});
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
        cmocka_unit_test(each_lobe),
        cmocka_unit_test(every_kind),
        cmocka_unit_test(mixtures),
        cmocka_unit_test(every_test_of_the_family_ran),
    };
    return cmocka_run_group_tests_name("bsdf_layers_chi_square", tests, NULL, NULL);
}
