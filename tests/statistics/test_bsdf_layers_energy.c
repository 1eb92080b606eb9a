/* Energy of surfaces with layers: none sends out more than comes in, what must add up does, and
 * sampling finds all that is evaluated. Fixed seeds; one-sided tests at a family-wise level of
 * 0.01, Sidak-corrected. Refraction's 1/eta^2 of radiance is taken out by eta_scale. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "common/math/elementary.h"
#include "tests/support/bsdf_checks.h"
#include "tests/support/statistics.h"

#define SIGNIFICANCE 0.01
/* What the tables may err by. */
#define TABLE 0.005

static void no_layers_gain_energy(void **state)
{
    enum { MATERIALS = 3000 };
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, MATERIALS * 3));
    struct test_random r = {1};

    (void)state;
    for (int i = 0; i < MATERIALS; i++) {
        static const float COSINES[] = {1e-3f, 0.02f, 0.1f, 0.3f, 0.6f, 1};
        struct bsdf_params p = bsdf_maker_white(&r, 0);
        struct vec3 wo = direction(COSINES[i % 6], 6.28f * test_random_float(&r));
        struct running_stats s;
        if (p.refractive && p.diffuse_transmission > 0)
            p.transmission = 0; /* eta_scale would not tell power from radiance */
        s = bsdf_albedo_within(&p, wo, 20000, (uint64_t)i + 1, -INFINITY, 1 + TABLE);
        if (s.mean > 1 + TABLE + z * running_stats_error(&s))
            fail_msg("cos %g: %.5f +- %.5f: %s", (double)wo.z, s.mean, running_stats_error(&s),
                     bsdf_maker_describe(&p));
    }
}

/* Each kind by itself, in white, over a grid of alphas and directions. */
static void no_kind_gains_energy(void **state)
{
    static const float COSINES[] = {1e-3f, 0.1f, 0.3f, 0.7f}, ALPHAS[] = {0, 0.01f, 0.1f, 0.4f, 1};
    enum { TESTS = BSDF_MAKER_KINDS * 4 * 5 * 2 };
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, TESTS * 3));
    uint64_t seed = 0;

    (void)state;
    for (int i = 0; i < TESTS; i++) {
        struct bsdf_params p = bsdf_maker_kind(i / 40, ALPHAS[i / 8 % 5]);
        struct running_stats s;
        p.base_color = p.diffuse_transmission_color = vec3_splat(1);
        p.sheen_color = vec3_splat(p.sheen_color.x);
        p.single_scattering = i & 1;
        s = bsdf_albedo_within(&p, direction(COSINES[i / 2 % 4], 0.9f), 20000, ++seed, 0, 1 + TABLE);
        if (s.mean > 1 + TABLE + z * running_stats_error(&s) || !(s.mean > 0))
            fail_msg("%s, alpha %g, cos %g: %.5f +- %.5f", bsdf_maker_kind_name(i / 40), (double)ALPHAS[i / 8 % 5],
                     (double)COSINES[i / 2 % 4], s.mean, running_stats_error(&s));
    }
}

/* Each layer over white, and how much of white it may keep at least. */
static void white_stays_nearly_white(void **state)
{
    static const float COSINES[] = {0.05f, 0.2f, 0.5f, 0.8f, 1};
    static const float ALPHAS[] = {0, 0.02f, 0.1f, 0.3f, 0.6f, 1};
    enum { KINDS = 9 };
    static const struct { const char *name; double least; } EXPECT[KINDS] = {
        {"coat over Lambert", 0.99},     {"coat over plastic", 0.965}, {"coat over white metal", 0.90},
        {"sheen over Lambert", 0.80},    {"stretched white metal", 0.93}, {"conductor, k 1e4", 0.99},
        {"film over white metal", 0.995}, {"plastic that lets through", 0.99},
        {"coated and lets through", 0.965},
    };
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, KINDS * 5 * 6 * 2));
    uint64_t seed = 0;

    (void)state;
    for (int k = 0; k < KINDS; k++)
        for (int c = 0; c < 5; c++)
            for (int a = 0; a < 6; a++) {
                struct bsdf_params p = bsdf_maker_plain(k == 2 || k == 4 || k == 6, 0.3f);
                struct running_stats s;
                double error;
                p.base_color = p.diffuse_transmission_color = (struct vec3){1, 1, 1};
                p.specular = k == 0 || k == 3 ? 0 : 1;
                p.clearcoat_alpha = ALPHAS[a];
                p.clearcoat = k <= 2 || k == 8;
                p.clearcoat_ior = 1.5f;
                p.clearcoat_normal = (struct vec3){0, 0, 1};
                p.sheen_alpha = ALPHAS[a];
                if (k == 3)
                    p.sheen_color = (struct vec3){1, 1, 1};
                if (k == 4) {
                    p.alpha = ALPHAS[a] * 0.2f;
                    p.alpha_stretched = ALPHAS[a];
                }
                if (k == 5) {
                    p.conductor = 1;
                    p.alpha = ALPHAS[a];
                    p.eta = vec3_splat(1);
                    p.k = vec3_splat(1e4f);
                }
                if (k == 6) {
                    p.iridescence = 1;
                    p.iridescence_ior = 1.4f;
                    p.iridescence_thickness_nm = 300;
                    p.base_color = vec3_splat(0.9999f);
                }
                if (k >= 7)
                    p.diffuse_transmission = 0.5f;
                s = bsdf_albedo_within(&p, direction(COSINES[c], 0.4f), 40000, ++seed, EXPECT[k].least, 1 + TABLE);
                error = z * running_stats_error(&s);
                if (s.mean > 1 + TABLE + error || s.mean < EXPECT[k].least - error)
                    fail_msg("%s: alpha %g cos %g: %.5f +- %.5f", EXPECT[k].name, (double)ALPHAS[a], (double)COSINES[c],
                             s.mean, error);
            }
}

/* Stretched white metal over the whole range of both alphas and of azimuths. */
static void stretched_metal_gives_back_without_gain(void **state)
{
    enum { COUNT = 1200 };
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, COUNT * 2));
    struct test_random r = {3};
    double sum = 0;

    (void)state;
    for (int i = 0; i < COUNT; i++) {
        struct bsdf_params p = bsdf_maker_plain(1, 0);
        float t = test_random_float(&r), mu = test_random_float(&r);
        struct running_stats s;
        p.base_color = (struct vec3){1, 1, 1};
        p.alpha_stretched = 0.01f + 0.99f * t * t;
        p.alpha = p.alpha_stretched * test_random_float(&r);
        s = bsdf_albedo_within(&p, direction(0.01f + 0.99f * mu * mu, 6.28f * test_random_float(&r)), 20000,
                               (uint64_t)i, 0.9, 1 + TABLE);
        sum += s.mean;
        if (s.mean > 1 + TABLE + z * running_stats_error(&s) || s.mean < 0.9 - z * running_stats_error(&s))
            fail_msg("alphas %g %g, mu %g: %.5f +- %.5f", (double)p.alpha_stretched, (double)p.alpha,
                     (double)(0.01f + 0.99f * mu * mu), s.mean, running_stats_error(&s));
    }
    assert_true(sum / COUNT > 0.975 && sum / COUNT < 1.001);
}

/* Seen across the stretch the mean Fresnel term is above that of either alpha alone: the base
 * must not get what was reflected. */
static void stretched_plastic_gains_nothing(void **state)
{
    static const float WIDE[] = {0.05f, 0.367f, 0.7f, 1}, RATIOS[] = {0.02f, 0.2f, 0.45f, 0.8f};
    static const float MU[] = {1e-3f, 0.02f, 0.1f, 0.3f, 0.7f};
    enum { TESTS = 4 * 4 * 5 * 3 * 2 };
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, TESTS));
    uint64_t seed = 0;

    (void)state;
    for (int i = 0; i < TESTS; i++) {
        struct bsdf_params p = bsdf_maker_plain(0, 0);
        float mu = MU[i / 16 % 5], azimuth = 0.5f * (float)M_PI * (0.5f * (float)(i / 80 % 3));
        struct running_stats s;
        p.base_color = (struct vec3){1, 1, 1};
        p.alpha_stretched = WIDE[i % 4];
        p.alpha = p.alpha_stretched * RATIOS[i / 4 % 4];
        p.single_scattering = i / 240;
        s = bsdf_albedo_within(&p, direction(mu, azimuth), 60000, ++seed, -INFINITY, 1 + TABLE);
        if (s.mean > 1 + TABLE + z * running_stats_error(&s))
            fail_msg("alphas %g %g, mu %g, azimuth %g: %.5f +- %.5f", (double)p.alpha_stretched, (double)p.alpha,
                     (double)mu, (double)azimuth, s.mean, running_stats_error(&s));
    }
}

/* At grazing angles along the stretch much is lost (docs/NUMERICS.md), of the hemisphere's light
 * little. */
static void stretched_plastic_loses_little(void **state)
{
    static const float WIDE[] = {0.1f, 0.4f, 1}, RATIOS[] = {0.02f, 0.2f, 0.6f};
    enum { TESTS = 3 * 3, SAMPLES = 60000 };
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, TESTS));
    struct test_random r = {11};

    (void)state;
    for (int i = 0; i < TESTS; i++) {
        struct bsdf_params p = bsdf_maker_plain(0, WIDE[i / 3] * RATIOS[i % 3]);
        struct running_stats s = {0};
        p.base_color = (struct vec3){1, 1, 1};
        p.alpha_stretched = WIDE[i / 3];
        for (int k = 0; k < SAMPLES; k++) {
            float mu = sqrtf(1 - test_random_float(&r)), u = test_random_float(&r);
            struct vec3 wo = direction(mu, 2 * PI_F * test_random_float(&r));
            float v = test_random_float(&r), w = test_random_float(&r);
            struct bsdf_sample out;
            struct bsdf b;
            bsdf_init(&b, &p, wo);
            running_stats_add(&s, bsdf_sample(&b, wo, w, u, v, &out) ? (double)out.weight.y : 0);
        }
        if (s.mean < 0.95 - z * running_stats_error(&s))
            fail_msg("alphas %g %g: %.5f +- %.5f", (double)p.alpha_stretched, (double)p.alpha, s.mean,
                     running_stats_error(&s));
    }
}

/* The sampler's albedo against plain integration of bsdf_eval over the sphere. Two-sided. */
static void sampling_finds_all_that_is_evaluated(void **state)
{
    enum { MATERIALS = 80, SAMPLES = 60000 };
    double level = sidak_alpha(SIGNIFICANCE, MATERIALS);
    struct test_random r = {5}, random = {77};

    (void)state;
    for (int k = 0; k < MATERIALS; k++) {
        struct bsdf_params p = bsdf_maker_random(&r, 0.15f);
        struct vec3 wo = direction(0.1f + 0.9f * test_random_float(&r), 6.28f * test_random_float(&r));
        struct running_stats difference = {0};
        struct bsdf b;
        if (p.ior < 1.3f) /* transmission with less spread is not found by chance */
            p.ior = 1.5f;
        p.ior_outside = 0;
        bsdf_init(&b, &p, wo);
        for (int i = 0; i < SAMPLES; i++) {
            float u = test_random_float(&random), v = test_random_float(&random);
            float w = test_random_float(&random);
            struct vec3 wi = direction(2 * u - 1, 2 * PI_F * v);
            struct bsdf_sample s;
            double uniform = (double)bsdf_eval(&b, wo, wi).y * 4 * M_PI, sampled = 0;
            if (bsdf_sample(&b, wo, w, v, u, &s) && !(s.flags & BSDF_DELTA))
                sampled = (double)s.weight.y;
            running_stats_add(&difference, uniform - sampled);
        }
        if (mean_test_p_value(&difference, 0) < level)
            fail_msg("evaluated minus sampled is %.5f +- %.5f: %s", difference.mean, running_stats_error(&difference),
                     bsdf_maker_describe(&p));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_layers_gain_energy),
        cmocka_unit_test(no_kind_gains_energy),
        cmocka_unit_test(white_stays_nearly_white),
        cmocka_unit_test(stretched_metal_gives_back_without_gain),
        cmocka_unit_test(stretched_plastic_gains_nothing),
        cmocka_unit_test(stretched_plastic_loses_little),
        cmocka_unit_test(sampling_finds_all_that_is_evaluated),
    };
    return cmocka_run_group_tests_name("bsdf_layers_energy", tests, NULL, NULL);
}
