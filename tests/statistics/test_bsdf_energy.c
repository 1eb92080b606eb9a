/* Energy: no material sends out more than comes in, and what must add up exactly does.
 * Directional albedos are estimated by the sampler's own weights with fixed seeds;
 * one-sided tests at a family-wise level of 0.01, Sidak-corrected. Refraction's 1/eta^2
 * of radiance is taken out by eta_scale, which leaves power. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "common/math/elementary.h"
#include "tests/support/bsdf_checks.h"
#include "tests/support/statistics.h"
#include "worker/render/bsdf/bsdf.h"

#define SIGNIFICANCE 0.01
/* Float rounding of one weight. */
#define ROUNDING 5e-6
/* What giving back multiple scattering by a table may err by. */
#define TABLE 0.005

static const float COSINES[] = {1e-3f, 0.02f, 0.1f, 0.3f, 0.6f, 1.0f};
enum { COUNT_COSINES = sizeof COSINES / sizeof *COSINES };

static struct vec3 from_the_side(float cosine)
{
    float sine = sqrtf(1 - cosine * cosine);
    return (struct vec3){sine * 0.8f, sine * 0.6f, cosine};
}

static struct bsdf_params white(float metallic, float alpha, float ior, float transmission, int refractive, int inside)
{
    return (struct bsdf_params){.base_color = {1, 1, 1}, .metallic = metallic, .alpha = alpha,
                                .ior = ior, .specular = 1, .specular_color = {1, 1, 1},
                                .transmission = transmission, .refractive = refractive,
                                .inside = inside};
}

static void no_material_gains_energy(void **state)
{
    static const float ALPHAS[] = {0, 9.9e-4f, 1.01e-3f, 3e-3f, 0.01f, 0.05f, 0.2f, 0.5f, 1};
    static const float IORS[] = {0, 1, 1.0001f, 1.02f, 1.1f, 1.5f, 2.5f, 20};
    static const float SHARES[] = {0, 0.5f, 1};
    static const struct vec3 TINTS[] = {{1, 1, 1}, {3, 0.5f, 0.1f}};
    enum { COUNT_ALPHAS = 9, IOR_COUNT = 8, SHARE_COUNT = 3, TINT_COUNT = 2, SIDE_COUNT = 3 };
    const unsigned tests = COUNT_COSINES * COUNT_ALPHAS * IOR_COUNT * SHARE_COUNT * SHARE_COUNT * SIDE_COUNT *
                           TINT_COUNT * 2 /* single, all scattering */ * 3 /* components */;
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, tests));
    uint64_t seed = 0;

    (void)state;
    for (int c = 0; c < COUNT_COSINES; c++)
        for (int n = 0; n < COUNT_ALPHAS * IOR_COUNT; n++)
            for (int m = 0; m < SHARE_COUNT * SHARE_COUNT; m++)
                for (int side = 0; side < SIDE_COUNT * TINT_COUNT * 2; side++) {
                    /* side 0: thin, 1: refractive from outside, 2: from inside */
                    struct bsdf_params p =
                        white(SHARES[m % SHARE_COUNT], ALPHAS[n % COUNT_ALPHAS], IORS[n / COUNT_ALPHAS],
                              SHARES[m / SHARE_COUNT], side % SIDE_COUNT > 0, side % SIDE_COUNT > 1);
                    struct running_stats s;
                    double most;
                    p.specular_color = TINTS[side / SIDE_COUNT % TINT_COUNT];
                    p.single_scattering = side / SIDE_COUNT / TINT_COUNT;
                    /* A lobe that is chosen in 2 % of the samples gives means of 2000 too skewed a
                     * distribution for the normal quantile, where nothing else is allowed for. */
                    most = 1 + (p.single_scattering ? ROUNDING : TABLE);
                    s = bsdf_albedo_within(&p, from_the_side(COSINES[c]), p.single_scattering ? 4000 : 2000, ++seed,
                                           -INFINITY, most);
                    if (s.mean > most + z * running_stats_error(&s))
                        fail_msg("metallic %g alpha %g ior %g transmission %g side %d cos %g: "
                                 "%.5f +- %.5f",
                                 (double)p.metallic, (double)p.alpha, (double)p.ior, (double)p.transmission, side,
                                 (double)COSINES[c], s.mean, running_stats_error(&s));
                }
}

/* The hardest for the layered base, with more samples: white plastic. With single scattering
 * it lacks of 1 what its microfacets lose. */
static void white_plastic_keeps_nearly_all(void **state)
{
    static const float ALPHAS[] = {0, 1.01e-3f, 4e-3f, 0.02f, 0.1f, 0.3f, 0.6f, 1};
    enum { COUNT_ALPHAS = 8 };
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, COUNT_ALPHAS * COUNT_COSINES * 4));

    (void)state;
    for (int a = 0; a < COUNT_ALPHAS * 2; a++)
        for (int c = 0; c < COUNT_COSINES; c++) {
            struct bsdf_params p = white(0, ALPHAS[a % COUNT_ALPHAS], 1.5f, 0, 0, 0);
            int single = a < COUNT_ALPHAS;
            struct running_stats s;
            double error, slack = single ? ROUNDING : TABLE, most = 1 + slack, least;
            p.single_scattering = single;
            least = (a % COUNT_ALPHAS == 0 || !single ? 1 : COSINES[c] >= 0.3f ? 0.96 : 0.85) - slack;
            s = bsdf_albedo_within(&p, from_the_side(COSINES[c]), 100000, 1000 + (uint64_t)(a * COUNT_COSINES + c),
                                   least, most);
            error = z * running_stats_error(&s);
            if (s.mean > most + error || s.mean < least - error)
                fail_msg("alpha %g cos %g: %.5f +- %.5f", (double)p.alpha, (double)COSINES[c], s.mean, error);
        }
}

/* What microfacets throw to each other comes back: white metal is white at every angle and
 * roughness, and so is white plastic without a base that could take the light (F = 1). */
static void white_metal_keeps_everything(void **state)
{
    static const float ALPHAS[] = {1.01e-3f, 2e-3f, 5e-3f, 0.013f, 0.03f, 0.07f, 0.14f, 0.25f,
                                   0.38f, 0.5f, 0.64f, 0.81f, 0.93f, 1};
    static const float MU[] = {1e-3f, 3e-3f, 0.01f, 0.03f, 0.08f, 0.15f, 0.3f, 0.5f, 0.75f, 1};
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, 14 * 10 * 2 * 2));

    (void)state;
    for (int a = 0; a < 14; a++)
        for (int m = 0; m < 10; m++) {
            struct bsdf_params p = white(1, ALPHAS[a], 1.5f, 0, 0, 0);
            struct bsdf_params q = white(0, ALPHAS[a], 0, 0, 0, 0);
            struct running_stats metal, plastic;
            metal = bsdf_albedo_within(&p, from_the_side(MU[m]), 100000, (uint64_t)(a * 10 + m), 1 - TABLE, 1 + TABLE);
            plastic = bsdf_albedo_within(&q, from_the_side(MU[m]), 100000, (uint64_t)(a * 10 + m) + 1000, 1 - TABLE,
                                         1 + TABLE);
            if (fabs(metal.mean - 1) > TABLE + z * running_stats_error(&metal) ||
                fabs(plastic.mean - 1) > TABLE + z * running_stats_error(&plastic))
                fail_msg("alpha %g mu %g: metal %.5f, plastic %.5f", (double)ALPHAS[a], (double)MU[m], metal.mean,
                         plastic.mean);
        }
}

/* A coloured one's colour deepens: F^2 E + ... of what is lost. Against the series itself. */
static void colored_metal_follows_the_series(void **state)
{
    struct bsdf_params p = white(1, 0.5f, 1.5f, 0, 0, 0), single;
    double kept = 0.7003 /* hemispherical mean of E */, f = 0.5 + 0.5 / 21, expected;

    (void)state;
    p.base_color = (struct vec3){0.5f, 0.5f, 0.5f};
    single = p;
    single.single_scattering = 1;
    expected = (1 - 0.6983) * f * f * kept / (1 - f * (1 - kept));
    assert_true(fabs(bsdf_albedo(&p, from_the_side(0.5f), 1000000, 1).mean -
                     bsdf_albedo(&single, from_the_side(0.5f), 1000000, 2).mean - expected) < 2e-3);
}

/* White rough glass: what the interface loses comes back too, on both sides. */
static void white_rough_glass_keeps_nearly_all(void **state)
{
    static const float ALPHAS[] = {0.06f, 0.1f, 0.25f, 0.5f, 0.8f, 1};
    static const float MU[] = {0.02f, 0.1f, 0.3f, 0.6f, 1};
    static const float IORS[] = {1.05f, 1.125f, 1.2f, 1.33f, 1.5f, 1.8f, 2.5f, 4};
    double z = normal_quantile(1 - sidak_alpha(SIGNIFICANCE, 6 * 5 * 8 * 2 * 2));
    uint64_t seed = 500;

    (void)state;
    for (int a = 0; a < 6; a++)
        for (int m = 0; m < 5; m++)
            for (int n = 0; n < 8; n++)
                for (int inside = 0; inside < 2; inside++) {
                    struct bsdf_params p = white(0, ALPHAS[a], IORS[n], 1, 1, inside);
                    struct running_stats s =
                        bsdf_albedo_within(&p, from_the_side(MU[m]), 60000, ++seed, 0.98, 1 + TABLE);
                    double sum = s.mean, error = z * running_stats_error(&s);
                    if (sum > 1 + TABLE + error || sum < 0.98 - error)
                        fail_msg("alpha %g mu %g ior %g inside %d: %.5f", (double)ALPHAS[a], (double)MU[m],
                                 (double)IORS[n], inside, sum);
                }
}

/* Directional albedo of GGX with F = 1 and height-correlated Smith shadowing, computed
 * independently of this code by quadrature, good to 1e-4. */
static void metal_matches_known_albedos(void **state)
{
    static const float ALPHAS[6] = {0.0625f, 0.25f, 0.5f, 0.64f, 0.81f, 1};
    static const float MU[6] = {0.05f, 0.1f, 0.25f, 0.5f, 0.75f, 1};
    static const double KNOWN[6][6] = {
        {0.8941, 0.8968, 0.9616, 0.9884, 0.9938, 0.9957},
        {0.9331, 0.8916, 0.8401, 0.8573, 0.8915, 0.9158},
        {0.9126, 0.8601, 0.7652, 0.6983, 0.6821, 0.6879},
        {0.8950, 0.8331, 0.7181, 0.6212, 0.5755, 0.5552},
        {0.8727, 0.7985, 0.6598, 0.5353, 0.4647, 0.4200},
        {0.8478, 0.7602, 0.5976, 0.4507, 0.3645, 0.3069},
    };
    enum { POINTS = 100000 };

    (void)state;
    for (int a = 0; a < 6; a++)
        for (int m = 0; m < 6; m++) {
            struct bsdf_params p = white(1, ALPHAS[a], 1.5f, 0, 0, 0);
            struct vec3 wo = from_the_side(MU[m]);
            struct bsdf b;
            double sum = 0;
            p.single_scattering = 1;
            bsdf_init(&b, &p, wo);
            /* An additive recurrence (Roberts's R2) converges faster than a grid here. */
            for (int i = 0; i < POINTS; i++) {
                double u = fmod(0.5 + i * 0.7548776662466927, 1);
                double v = fmod(0.5 + i * 0.5698402909980532, 1);
                struct bsdf_sample s;
                if (bsdf_sample(&b, wo, 0.5f, fminf((float)u, ONE_MINUS_EPSILON), fminf((float)v, ONE_MINUS_EPSILON),
                                &s))
                    sum += s.weight.y;
            }
            sum /= POINTS;
            if (fabs(sum - KNOWN[a][m]) > 2e-4)
                fail_msg("alpha %g mu %g: %.5f, should be %.4f", (double)ALPHAS[a], (double)MU[m], sum, KNOWN[a][m]);
        }
}

/* White smooth glass: every single sample carries weight 1 (once radiance is turned back
 * into power), and reflection happens as often as Fresnel says. Also thin. */
static void smooth_glass_adds_up_to_one(void **state)
{
    static const float IORS[] = {1.05f, 1.33f, 1.5f, 2.5f, 10};
    enum { STEPS = 4096 };

    (void)state;
    for (int i = 0; i < 5; i++)
        for (int c = 0; c < COUNT_COSINES; c++)
            for (int side = 0; side < 3; side++) {
                struct bsdf_params p = white(0, 0, IORS[i], 1, side > 0, side > 1);
                struct vec3 wo = from_the_side(COSINES[c]);
                struct bsdf b;
                double reflected = 0, expected;
                bsdf_init(&b, &p, wo);
                for (int k = 0; k < STEPS; k++) {
                    struct bsdf_sample s;
                    assert_true(bsdf_sample(&b, wo, ((float)k + 0.5f) / STEPS, 0.3f, 0.7f, &s));
                    assert_true(s.flags & BSDF_DELTA);
                    reflected += s.wi.z > 0 ? s.weight.x : 0;
                    if (side > 0)
                        assert_true(fabsf(s.weight.y * s.eta_scale - 1) < 2e-6f);
                    if (s.wi.z < 0 && side > 0) /* radiance is compressed in the denser side */
                        assert_true(fabsf(s.weight.x - (side == 2 ? IORS[i] * IORS[i] : 1 / (IORS[i] * IORS[i]))) <
                                    2e-6f * s.weight.x);
                }
                if (side > 0) {
                    expected = fresnel_dielectric(COSINES[c], side > 1 ? 1 / IORS[i] : IORS[i]);
                    assert_true(fabs(reflected / STEPS - expected) < 1.0 / STEPS);
                } else {
                    struct running_stats s = bsdf_albedo(&p, wo, 20000, 5);
                    assert_true(fabs(s.mean - 1) < ROUNDING + 5 * running_stats_error(&s));
                }
            }
}

static void white_lambert_is_exactly_one(void **state)
{
    struct bsdf_params p = white(0, 0.3f, 1.5f, 0, 0, 0);
    struct test_random random = {9};

    (void)state;
    p.specular = 0;
    for (int i = 0; i < 100000; i++) {
        struct vec3 wo = from_the_side(COSINES[i % COUNT_COSINES]);
        struct bsdf_sample s;
        struct bsdf b;
        float u = test_random_float(&random), v = test_random_float(&random);
        bsdf_init(&b, &p, wo);
        assert_true(bsdf_sample(&b, wo, 0, u, v, &s));
        assert_true(s.weight.x == 1 && s.weight.y == 1 && s.weight.z == 1);
    }
}

/* The sampler's albedo against plain integration of bsdf_eval over the sphere: a lobe that
 * is evaluated but never sampled would show. Two-sided, Sidak-corrected. */
static void sampling_finds_all_that_is_evaluated(void **state)
{
    static const float ALPHAS[] = {0.1f, 0.4f, 1};
    enum { SAMPLES = 60000, TESTS = 3 * 4 * 5 };
    double level = sidak_alpha(SIGNIFICANCE, TESTS);
    struct test_random random = {77};

    (void)state;
    for (int a = 0; a < 3; a++)
        for (int c = 1; c < 5; c++)
            for (int kind = 0; kind < 5; kind++) {
                struct bsdf_params p = white(kind == 4 ? 1 : 0.3f * (float)(kind == 3), ALPHAS[a], 1.4f,
                                             kind == 0 ? 0 : 0.8f, kind >= 2, kind == 2);
                struct vec3 wo = from_the_side(COSINES[c]);
                struct running_stats difference = {0};
                struct bsdf b;
                p.base_color = (struct vec3){0.2f, 0.9f, 0.5f};
                bsdf_init(&b, &p, wo);
                for (int i = 0; i < SAMPLES; i++) {
                    float u = test_random_float(&random), v = test_random_float(&random);
                    float w = test_random_float(&random);
                    float z = 2 * u - 1, r = sqrtf(1 - z * z), turn = 2 * (float)M_PI * v;
                    struct vec3 wi = {r * cosf(turn), r * sinf(turn), z};
                    struct bsdf_sample s;
                    double uniform = bsdf_eval(&b, wo, wi).y * 4 * M_PI, sampled = 0;
                    if (bsdf_sample(&b, wo, w, u, v, &s) && !(s.flags & BSDF_DELTA))
                        sampled = s.weight.y;
                    running_stats_add(&difference, uniform - sampled);
                }
                if (mean_test_p_value(&difference, 0) < level)
                    fail_msg("alpha %g cos %g kind %d: evaluated minus sampled is %.5f +- %.5f", (double)ALPHAS[a],
                             (double)COSINES[c], kind, difference.mean, running_stats_error(&difference));
            }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_material_gains_energy),
        cmocka_unit_test(white_plastic_keeps_nearly_all),
        cmocka_unit_test(white_metal_keeps_everything),
        cmocka_unit_test(colored_metal_follows_the_series),
        cmocka_unit_test(white_rough_glass_keeps_nearly_all),
        cmocka_unit_test(metal_matches_known_albedos),
        cmocka_unit_test(smooth_glass_adds_up_to_one),
        cmocka_unit_test(white_lambert_is_exactly_one),
        cmocka_unit_test(sampling_finds_all_that_is_evaluated),
    };
    return cmocka_run_group_tests_name("bsdf_energy", tests, NULL, NULL);
}
