/* BSDFs: limits, reciprocity, agreement of the functions with each other, hostile input. */
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

static struct bsdf_params material(float metallic, float alpha, float ior, float transmission, int refractive,
                                   int inside)
{
    return (struct bsdf_params){.base_color = {0.8f, 0.5f, 0.3f}, .metallic = metallic,
                                .alpha = alpha, .ior = ior, .specular = 1,
                                .specular_color = {1, 1, 1}, .transmission = transmission,
                                .refractive = refractive, .inside = inside};
}

/* ---- Fresnel ------------------------------------------------------------------------------- */

static double fresnel_by_snell(double cos_i, double eta)
{
    double sin2_t = (1 - cos_i * cos_i) / (eta * eta), cos_t, s, p;

    if (sin2_t >= 1)
        return 1;
    cos_t = sqrt(1 - sin2_t);
    s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    return 0.5 * (s * s + p * p);
}

static void fresnel_follows_snell_and_its_limits(void **state)
{
    static const float ETAS[] = {1 / 2.5f, 1 / 1.5f, 0.99f, 1.0001f, 1.05f, 1.5f, 2.5f, 30};

    (void)state;
    for (int i = 0; i < 8; i++) {
        float eta = ETAS[i], normal = (eta - 1) / (eta + 1);
        for (float c = 0.01f; c <= 1; c += 0.01f)
            if (fabs(fresnel_dielectric(c, eta) - fresnel_by_snell(c, eta)) > 2e-6)
                fail_msg("eta %g cos %g: %g", (double)eta, (double)c, (double)fresnel_dielectric(c, eta));
        assert_true(is_near(fresnel_dielectric(1, eta), normal * normal, 1e-4f));
        assert_true(is_near(fresnel_dielectric(0, eta), 1, 1e-6f));
    }
    for (float c = 0; c <= 1; c += 0.125f)
        assert_true(fresnel_dielectric(c, 1) == 0);
    /* The critical angle of 1 / 1.5 is at cos = 0.74536. */
    assert_true(fresnel_dielectric(0.7453f, 1 / 1.5f) == 1);
    assert_true(fresnel_dielectric(0.7455f, 1 / 1.5f) < 1);
    assert_true(fresnel_dielectric(NAN, 1.5f) >= 0 && fresnel_dielectric(NAN, 1.5f) <= 1);
}

/* ---- exact cases ---------------------------------------------------------------------------- */

static void without_reflection_it_is_exactly_lambert(void **state)
{
    struct test_random r = {1};

    (void)state;
    for (int i = 0; i < 10000; i++) {
        struct bsdf_params p = material(0, test_random_float(&r), i & 1 ? 1.0f : 1.5f, 0, 0, 0);
        struct vec3 wo = random_direction(&r, 1e-3f), wi = random_direction(&r, -1), f;
        struct bsdf_sample s;
        struct bsdf b;
        float cosine = fmaxf(wi.z, 0);
        p.specular = i & 1 ? 1.0f : 0.0f;
        bsdf_init(&b, &p, wo);
        f = bsdf_eval(&b, wo, wi);
        assert_true(f.x == p.base_color.x * INV_PI_F * cosine);
        assert_true(f.z == p.base_color.z * INV_PI_F * cosine);
        assert_true(bsdf_pdf(&b, wo, wi) == cosine * INV_PI_F);
        assert_true(b.has_smooth && !b.has_delta);
        assert_true(bsdf_sample(&b, wo, 0.5f, test_random_float(&r), test_random_float(&r), &s));
        assert_true(s.weight.x == p.base_color.x && s.weight.y == p.base_color.y);
    }
}

static void smooth_metal_is_a_mirror(void **state)
{
    struct bsdf_params p = material(1, 0, 1.5f, 0, 0, 0);
    struct bsdf_sample s;
    struct bsdf b;

    (void)state;
    for (float c = 0.01f; c <= 1; c += 0.03f) {
        struct vec3 wo = direction(c, 2);
        float weight = powf(1 - c, 5);
        bsdf_init(&b, &p, wo);
        assert_true(b.has_delta && !b.has_smooth);
        assert_true(bsdf_sample(&b, wo, 0.9f, 0.1f, 0.8f, &s));
        assert_true(s.flags == BSDF_DELTA && s.pdf == 0 && s.eta_scale == 1);
        assert_true(s.wi.x == -wo.x && s.wi.y == -wo.y && s.wi.z == wo.z);
        assert_true(is_near(s.weight.y, 0.5f + 0.5f * weight, 1e-5f));
        assert_true(vec3_is_black(bsdf_eval(&b, wo, s.wi)) && bsdf_pdf(&b, wo, s.wi) == 0);
    }
}

/* ior 1: nothing reflects, light passes straight, whatever the roughness. */
static void ior_1_passes_straight(void **state)
{
    static const float ALPHAS[] = {0, 0.001f, 0.2f, 1};

    (void)state;
    for (int k = 0; k < 12; k++) {
        int refractive = k % 3 > 0, flags = BSDF_DELTA | BSDF_TRANSMISSION;
        struct bsdf_params p = material(0, ALPHAS[k / 3], 1, 1, refractive, k % 3 > 1);
        flags |= refractive ? BSDF_REFRACTION : 0;
        for (float c = 0.01f; c <= 1; c += 0.09f)
            for (float u = 0; u < 1; u += 0.07f) {
                struct vec3 wo = direction(c, 1);
                struct bsdf_sample s;
                struct bsdf b;
                bsdf_init(&b, &p, wo);
                assert_true(b.eta == 1 && b.has_delta);
                if (!bsdf_sample(&b, wo, u, 0.3f, 0.6f, &s))
                    describe_and_fail(&p, wo, wo, "no sample");
                if (s.flags != flags || s.wi.x != -wo.x || s.wi.z != -wo.z || s.eta_scale != 1 ||
                    !is_near_vec(s.weight, p.base_color, 1e-6f))
                    describe_and_fail(&p, wo, s.wi, "bent, reflected or wrongly weighted");
            }
    }
}

/* ior 0: Fresnel is 1, so the base never shows. */
static void ior_0_reflects_everything(void **state)
{
    struct vec3 wo = direction(0.4f, 1);
    struct bsdf_sample s;
    struct bsdf b;

    (void)state;
    for (int k = 0; k < 6; k++) {
        struct bsdf_params p = material(0, k & 1 ? 0.3f : 0, 0, k / 2 > 0, k / 2 > 1, 0);
        bsdf_init(&b, &p, wo);
        for (float u = 0; u < 1; u += 0.01f)
            if (bsdf_sample(&b, wo, u, 0.4f, 0.2f, &s)) {
                assert_true(s.wi.z > 0);
                assert_true((k & 1) || is_near_vec(s.weight, (struct vec3){1, 1, 1}, 1e-6f));
            }
        assert_true(vec3_is_black(bsdf_eval(&b, wo, vec3_neg(wo))));
    }
}

/* Smooth glass bends by Snell's law, its medium flag and scale are set; a thin wall's not. */
static void smooth_glass_obeys_snell(void **state)
{
    (void)state;
    for (int inside = 0; inside < 2; inside++)
        for (float c = 0.05f; c <= 1; c += 0.05f) {
            struct bsdf_params p = material(0, 0, 1.5f, 1, 1, inside);
            struct vec3 wo = direction(c, 0.5f);
            float eta = inside ? 1 / 1.5f : 1.5f, sine = sqrtf(1 - c * c) / eta;
            int transmitted = 0;
            struct bsdf b;
            bsdf_init(&b, &p, wo);
            assert_true(is_near(b.eta, eta, 1e-6f));
            for (float u = 0; u < 1; u += 0.003f) {
                struct bsdf_sample s;
                assert_true(bsdf_sample(&b, wo, u, 0.5f, 0.5f, &s));
                if (s.wi.z > 0)
                    continue;
                transmitted++;
                assert_true(s.flags == (BSDF_DELTA | BSDF_TRANSMISSION | BSDF_REFRACTION));
                assert_true(is_near(hypotf(s.wi.x, s.wi.y), sine, 1e-5f));
                assert_true(fabsf(s.wi.x * wo.y - s.wi.y * wo.x) < 1e-6f); /* in the plane */
                assert_true(s.wi.x * wo.x <= 0);
                assert_true(is_near(s.eta_scale, eta * eta, 1e-6f));
            }
            assert_true((transmitted > 0) == (sine < 1)); /* none beyond the critical angle */
        }
}

static void thin_walls_do_not_change_the_medium(void **state)
{
    struct vec3 wo = direction(0.6f, 0.5f);
    struct bsdf_sample s;
    struct bsdf b;
    int through = 0;

    (void)state;
    for (int rough = 0; rough < 2; rough++) {
        struct bsdf_params p = material(0, rough ? 0.2f : 0, 1.5f, 1, 0, 0);
        bsdf_init(&b, &p, wo);
        for (float u = 0; u < 1; u += 0.01f)
            if (bsdf_sample(&b, wo, u, 0.2f, 0.2f, &s) && s.wi.z < 0) {
                assert_true(s.flags == (BSDF_TRANSMISSION | (rough ? 0 : BSDF_DELTA)));
                assert_true(s.eta_scale == 1);
                assert_true(rough || (s.wi.x == -wo.x && s.wi.z == -wo.z));
                through++;
            }
    }
    assert_true(through > 100);
}

/* Reflectance at normal incidence as KHR_materials_ior and _specular define it. */
static void reflectance_at_normal_incidence_follows_gltf(void **state)
{
    static const struct { float ior, specular; struct vec3 color, f0; } CASES[] = {
        {1.5f, 1, {1, 1, 1}, {0.04f, 0.04f, 0.04f}},
        {1.5f, 0.5f, {1, 0.5f, 0}, {0.02f, 0.01f, 0}},
        {1.5f, 1, {30, 2, 1}, {1, 0.08f, 0.04f}},
        {2.5f, 0.25f, {9, 1, 1}, {0.25f, 0.0459184f, 0.0459184f}},
        {0, 0.5f, {1, 0.5f, 0.1f}, {0.5f, 0.25f, 0.05f}},
    };
    struct vec3 wo = {0, 0, 1};

    (void)state;
    for (int i = 0; i < 5; i++)
        for (int refractive = 0; refractive < 2; refractive++) {
            struct bsdf_params p = material(0, 0, CASES[i].ior, (float)refractive, refractive, 0);
            struct vec3 sum = {0, 0, 0};
            struct bsdf b;
            enum { STEPS = 10000 };
            p.specular = CASES[i].specular;
            p.specular_color = CASES[i].color;
            bsdf_init(&b, &p, wo);
            for (int k = 0; k < STEPS; k++) {
                struct bsdf_sample s;
                if (bsdf_sample(&b, wo, ((float)k + 0.5f) / STEPS, 0.5f, 0.2f, &s) && (s.flags & BSDF_DELTA) &&
                    s.wi.z > 0)
                    sum = vec3_add(sum, vec3_scale(s.weight, 1.0f / STEPS));
            }
            if (vec3_length(vec3_sub(sum, CASES[i].f0)) > 2e-3f)
                fail_msg("case %d, refractive %d: %g %g %g", i, refractive, (double)sum.x, (double)sum.y,
                         (double)sum.z);
        }
}

/* ---- agreement ------------------------------------------------------------------------------ */

static struct bsdf_params random_material(struct test_random *r, float alpha_min)
{
    static const float SHARES[] = {0, 0, 1, 1, 0.5f};
    static const float IORS[] = {1, 1.05f, 1.33f, 1.5f, 2.5f};
    struct bsdf_params p =
        material(SHARES[test_random_u64(r) % 5], test_random_float(r), IORS[test_random_u64(r) % 5],
                 SHARES[test_random_u64(r) % 5], (int)(test_random_u64(r) % 2), (int)(test_random_u64(r) % 2));

    p.alpha = fmaxf(p.alpha * p.alpha, alpha_min);
    p.specular = test_random_u64(r) % 3 ? 1.0f : test_random_float(r);
    p.specular_color = (struct vec3){2 * test_random_float(r), test_random_float(r), 1};
    p.base_color = (struct vec3){test_random_float(r), test_random_float(r), 1};
    return p;
}

static void functions_agree_with_each_other(void **state)
{
    struct test_random r = {2};
    int checked = 0;

    (void)state;
    for (int i = 0; i < 300000; i++) {
        struct bsdf_params p = random_material(&r, 0);
        checked += check_agreement(&p, &r);
    }
    assert_true(checked > 100000);
}

static void scattering_is_reciprocal(void **state)
{
    struct test_random r = {3};
    int counts[WAY_NONE + 1] = {0};

    (void)state;
    for (int i = 0; i < 400000; i++) {
        struct bsdf_params p = random_material(&r, 0.05f);
        counts[check_reciprocity(&p, &r, i & 1, 1e-3f, 0.02f)]++;
    }
    assert_true(counts[WAY_REFLECTED] > 10000 && counts[WAY_THROUGH] > 5000 && counts[WAY_REFRACTED] > 5000);
}

/* ---- continuity ----------------------------------------------------------------------------- */

static void looks_are_continuous(void **state)
{
    (void)state;
    for (int k = 0; k < 5; k++) { /* opaque, thin, refractive, from inside, half of each */
        struct bsdf_params p = material(k == 4 ? 0.5f : 0, 9e-4f, 1.5f, k == 0 ? 0 : k == 4 ?
                                        0.5f : 1, k >= 2, k == 3), q = p;
        q.alpha = 1.1e-3f;
        assert_same_look(&p, &q, 0.15f, 0.01, "smooth and nearly smooth");
        p.alpha = q.alpha = 0.3f;
        q.metallic = p.metallic + 1e-4f;
        assert_same_look(&p, &q, 0.15f, 0.01, "metallic");
        q.metallic = p.metallic;
        q.transmission = fabsf(p.transmission - 1e-4f);
        assert_same_look(&p, &q, 0.15f, 0.01, "transmission");
        q.transmission = p.transmission;
        q.ior = 1;
        p.ior = 1.0004f; /* still a rough refraction */
        assert_same_look(&p, &q, 0.15f, 0.01, "ior 1 and nearly 1");
        p.alpha = q.alpha = 0;
        assert_same_look(&p, &q, 0.15f, 0.01, "smooth, ior 1 and nearly 1");
        p.ior = q.ior = 1.5f;
        p.specular = 0;
        q.specular = 1e-3f;
        if (k != 3) /* from inside, total reflection is not scaled by specular */
            assert_same_look(&p, &q, 0.15f, 0.01, "specular");
    }
    {
        struct bsdf_params p = material(1, 0.2f, 1.5f, 0, 0, 0), q = p;
        q.metallic = 0.9999f;
        assert_same_look(&p, &q, 0.15f, 0.01, "metal and nearly metal");
    }
    /* Delta and rough refraction meet where the spread is BSDF_SPREAD_MIN. */
    for (int inside = 0; inside < 2; inside++) {
        struct bsdf_params p = material(0, 0.01f, 1.0099f, 1, 1, inside), q = p;
        q.ior = 1.0103f;
        assert_same_look(&p, &q, 0.15f, 0.01, "refraction spread");
    }
}

/* ---- hostile input -------------------------------------------------------------------------- */

static void hostile_parameters_do_no_harm(void **state)
{
    struct test_random r = {4};
    int sampled = 0;

    (void)state;
    for (int i = 0; i < 1000000; i++) {
        struct bsdf_params p = {.base_color = hostile_color(&r),
                                .metallic = hostile_float(&r),
                                .alpha = hostile_float(&r),
                                .ior = hostile_float(&r),
                                .specular = hostile_float(&r),
                                .specular_color = hostile_color(&r),
                                .transmission = hostile_float(&r),
                                .refractive = (int)(test_random_u64(&r) % 3),
                                .inside = (int)(test_random_u64(&r) % 3)};
        sampled += check_harmless(&p, &r, 200);
    }
    assert_true(sampled > 400000);
}

static void broken_directions_scatter_nothing(void **state)
{
    const struct vec3 bad[] = {{NAN, 0, 1}, {0, 0, NAN}, {0, 0, 0}, {1, 0, 0}, {0, 0, -1},
                               {INFINITY, 0, 1}, {0, 0, 1e20f}};
    struct vec3 good = {0.6f, 0, 0.8f};
    float pdf;

    (void)state;
    for (int i = 0; i < 7; i++)
        for (int k = 0; k < 4; k++) {
            struct bsdf_params p = material(k == 1, 0.2f, 1.5f, k > 1, k > 2, 0);
            struct bsdf_sample s;
            struct bsdf b;
            bsdf_init(&b, &p, bad[i]);
            assert_false(bsdf_sample(&b, bad[i], 0.5f, 0.5f, 0.5f, &s));
            assert_true(vec3_is_black(bsdf_eval_pdf(&b, bad[i], good, &pdf)) && pdf == 0);
            bsdf_init(&b, &p, good);
            if (i < 4) {
                struct vec3 f = bsdf_eval_pdf(&b, good, bad[i], &pdf);
                assert_true(vec3_is_finite(f) && pdf >= 0 && pdf < INFINITY);
            }
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fresnel_follows_snell_and_its_limits),
        cmocka_unit_test(without_reflection_it_is_exactly_lambert),
        cmocka_unit_test(smooth_metal_is_a_mirror),
        cmocka_unit_test(ior_1_passes_straight),
        cmocka_unit_test(ior_0_reflects_everything),
        cmocka_unit_test(smooth_glass_obeys_snell),
        cmocka_unit_test(thin_walls_do_not_change_the_medium),
        cmocka_unit_test(reflectance_at_normal_incidence_follows_gltf),
        cmocka_unit_test(functions_agree_with_each_other),
        cmocka_unit_test(scattering_is_reciprocal),
        cmocka_unit_test(looks_are_continuous),
        cmocka_unit_test(hostile_parameters_do_no_harm),
        cmocka_unit_test(broken_directions_scatter_nothing),
    };
    return cmocka_run_group_tests_name("bsdf", tests, NULL, NULL);
}
