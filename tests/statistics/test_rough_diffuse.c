/* The rough diffuse base (EON, lobe_diffuse.h) against the model written again in double, with the
 * directional albedo integrated numerically instead of by its closed form; its energy, reciprocity
 * and colour; how much its sampling varies; a lit plane in a picture.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/bsdf_maker.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/bsdf/bsdf.h"

#define SIGNIFICANCE 0.01
static const float ROUGHNESSES[] = {0.001f, 0.1f, 0.3f, 0.6f, 1};
static const float COSINES[] = {0.003f, 0.05f, 0.2f, 0.5f, 0.8f, 1};
enum {
    COUNT_ROUGHNESSES = sizeof ROUGHNESSES / sizeof *ROUGHNESSES,
    COUNT_COSINES = sizeof COSINES / sizeof *COSINES,
    COMPARISONS = 400,
};

/* ---- the paper's model in double --------------------------------------------------------------- */

struct double3 {
    double x, y, z;
};

static double dot(struct double3 a, struct double3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

/* Single scattering of a white base: Fujii's form of Oren and Nayar's model. */
static double single(double r, struct double3 o, struct double3 i)
{
    double s = dot(o, i) - o.z * i.z, t = s > 0 ? fmax(o.z, i.z) : 1;
    return (1 + r * s / t) / (1 + (0.5 - 2 / (3 * M_PI)) * r) / M_PI;
}

/* Its directional albedo, by the midpoint rule in mu^(1/3) and the azimuth. */
static double albedo(double r, double mu)
{
    enum { STEPS = 200, TURNS = 128 };
    struct double3 o = {sqrt(1 - mu * mu), 0, mu};
    double sum = 0;

    for (int i = 0; i < STEPS; i++)
        for (int k = 0; k < TURNS; k++) {
            double t = (i + 0.5) / STEPS, z = t * t * t, turn = 2 * M_PI * (k + 0.5) / TURNS;
            double sine = sqrt(1 - z * z);
            struct double3 w = {sine * cos(turn), sine * sin(turn), z};
            sum += single(r, o, w) * z * 3 * t * t / STEPS * 2 * M_PI / TURNS;
        }
    return sum;
}

static double albedo_mean(double r)
{
    enum { STEPS = 100 };
    double sum = 0;

    for (int i = 0; i < STEPS; i++)
        sum += 2 * ((i + 0.5) / STEPS) * albedo(r, (i + 0.5) / STEPS) / STEPS;
    return sum;
}

static double multiple(double color, double mean) { return color * color * mean / (1 - color * (1 - mean)); }

static double model(double r, double color, struct double3 o, struct double3 i, double mean)
{
    return color * single(r, o, i) +
           multiple(color, mean) / M_PI * (1 - albedo(r, o.z)) * (1 - albedo(r, i.z)) / (1 - mean);
}

/* ---- the renderer's ---------------------------------------------------------------------------- */

static struct bsdf_params rough(float roughness, float red, float green, float blue)
{
    struct bsdf_params p = bsdf_maker_plain(0, 1);

    p.specular = 0;
    p.base_color = (struct vec3){red, green, blue};
    p.diffuse_roughness = roughness;
    return p;
}

static struct vec3 direction(float mu, float turn)
{
    float sine = sqrtf(1 - mu * mu);
    return (struct vec3){sine * cosf(turn), sine * sinf(turn), mu};
}

static struct double3 in_double(struct vec3 v) { return (struct double3){(double)v.x, (double)v.y, (double)v.z}; }

/* f(wo, wi) mu_i. */
static struct vec3 value(const struct bsdf_params *p, struct vec3 wo, struct vec3 wi)
{
    struct bsdf b;

    bsdf_init(&b, p, wo);
    return bsdf_eval(&b, wo, wi);
}

/* What the surface sends out of light from everywhere, by the midpoint rule. */
static struct vec3 sent_out(const struct bsdf_params *p, struct vec3 wo)
{
    enum { STEPS = 400, TURNS = 128 };
    double sum[3] = {0};
    struct bsdf b;

    bsdf_init(&b, p, wo);
    for (int i = 0; i < STEPS; i++)
        for (int k = 0; k < TURNS; k++) {
            float t = ((float)i + 0.5f) / STEPS;
            double weight = 3 * (double)(t * t) / STEPS * 2 * M_PI / TURNS;
            struct vec3 f = bsdf_eval(&b, wo, direction(t * t * t, 6.2831853f * ((float)k + 0.5f) / TURNS));
            sum[0] += (double)f.x * weight;
            sum[1] += (double)f.y * weight;
            sum[2] += (double)f.z * weight;
        }
    return (struct vec3){(float)sum[0], (float)sum[1], (float)sum[2]};
}

/* ---- values ------------------------------------------------------------------------------------ */

static void values_are_the_models(void **state)
{
    static const float COLORS[] = {0.1f, 0.5f, 1};
    struct test_random random = {7};

    (void)state;
    for (int k = 1; k < COUNT_ROUGHNESSES; k++) {
        double r = (double)ROUGHNESSES[k], mean = albedo_mean(r);
        struct bsdf_params p = rough(ROUGHNESSES[k], COLORS[0], COLORS[1], COLORS[2]);
        for (int i = 0; i < 60; i++) {
            float mu_o = 0.01f + 0.99f * test_random_float(&random);
            struct vec3 wo = direction(mu_o, 6.28f * test_random_float(&random));
            float mu_i = 0.01f + 0.99f * test_random_float(&random);
            struct vec3 wi = direction(mu_i, 6.28f * test_random_float(&random));
            struct vec3 got = value(&p, wo, wi), back = value(&p, wi, wo);
            const float f[3] = {got.x, got.y, got.z}, reverse[3] = {back.x, back.y, back.z};
            for (int c = 0; c < 3; c++) {
                double expected = model(r, (double)COLORS[c], in_double(wo), in_double(wi), mean);
                if (fabs((double)(f[c] / mu_i) - expected) > 1e-3 * expected + 1e-5)
                    fail_msg("r %g, mu %g to %g: %g, not %g", r, (double)mu_o, (double)mu_i, (double)(f[c] / mu_i),
                             expected);
                if (fabsf(f[c] / mu_i - reverse[c] / mu_o) > 1e-4f * f[c] / mu_i)
                    fail_msg("r %g, mu %g to %g: not reciprocal", r, (double)mu_o, (double)mu_i);
            }
        }
    }
}

/* Without roughness it is Lambert's to the bit, and near it almost. */
static void no_roughness_is_lambert(void **state)
{
    const struct vec3 wo = direction(0.3f, 1), wi = direction(0.6f, 2);
    struct bsdf_params p = rough(0, 0.8f, 0.5f, 0.2f);
    struct bsdf_sample out;
    struct vec3 smooth, near;
    struct bsdf b;

    (void)state;
    bsdf_init(&b, &p, wo);
    assert_int_equal(b.kind, BSDF_KIND_LAMBERT);
    assert_true(bsdf_sample(&b, wo, 0.5f, 0.5f, 0.5f, &out));
    assert_true(out.weight.x == 0.8f && out.weight.y == 0.5f && out.weight.z == 0.2f);
    smooth = value(&p, wo, wi);
    p.diffuse_roughness = 1e-6f;
    near = value(&p, wo, wi);
    assert_float_equal(near.x, smooth.x, 1e-5f * smooth.x);
    p.diffuse_roughness = 1;
    assert_true(fabsf(value(&p, wo, wi).x - smooth.x) > 0.05f * smooth.x);
}

/* ---- energy ------------------------------------------------------------------------------------ */

/* The albedo is exact: what is left is this test's quadrature and float's rounding. */
static void white_sends_out_all(void **state)
{
    (void)state;
    for (int k = 0; k < COUNT_ROUGHNESSES; k++)
        for (int i = 0; i < COUNT_COSINES; i++) {
            struct bsdf_params p = rough(ROUGHNESSES[k], 1, 1, 1);
            float e = sent_out(&p, direction(COSINES[i], 0.4f)).x;
            if (fabsf(e - 1) > 1e-4f)
                fail_msg("r %g, mu %g: white sends out %.6f", (double)ROUGHNESSES[k], (double)COSINES[i], (double)e);
        }
}

/* A colour c sends out c E + c_ms (1 - E): darker and more saturated as roughness grows, most so
 * where E is small, that is along the normal; not at all at the horizon, where E is 1. */
static void multiple_scattering_saturates(void **state)
{
    (void)state;
    for (int k = 1; k < COUNT_ROUGHNESSES; k++) {
        double r = (double)ROUGHNESSES[k], mean = albedo_mean(r);
        struct bsdf_params p = rough(ROUGHNESSES[k], 0.9f, 0.3f, 0.1f);
        float before = 0;
        for (int i = 0; i < COUNT_COSINES; i++) {
            struct vec3 e = sent_out(&p, direction(COSINES[i], 2));
            double one = albedo(r, (double)COSINES[i]);
            assert_float_equal(e.x, 0.9 * one + multiple(0.9, mean) * (1 - one), 3e-4);
            assert_float_equal(e.y, 0.3 * one + multiple(0.3, mean) * (1 - one), 3e-4);
            assert_float_equal(e.z, 0.1 * one + multiple(0.1, mean) * (1 - one), 3e-4);
            assert_true(e.x / e.y > before);
            before = e.x / e.y;
        }
        assert_float_equal(sent_out(&p, direction(COSINES[0], 2)).y, 0.3f, 2e-3f);
        assert_true(before > 3 * (1 + 0.1f * ROUGHNESSES[k]));
    }
}

/* White plastic, white under a coat, both: what the layers leave has a higher mean over what a
 * rough base sends out than over a hemisphere (eon_rest_spread). */
static void layers_over_it_gain_nothing(void **state)
{
    static const float ALPHAS[] = {0, 0.1f, 0.4f, 1}, IORS[] = {1.2f, 1.5f, 2.5f};

    (void)state;
    for (int k = 0; k < 3 * 4 * 3 * COUNT_COSINES; k++) {
        float mu = COSINES[k % COUNT_COSINES], ior = IORS[k / COUNT_COSINES % 3];
        float alpha = ALPHAS[k / COUNT_COSINES / 3 % 4];
        int layers = k / COUNT_COSINES / 12 + 1;
        struct bsdf_params p = rough(1, 1, 1, 1);
        struct running_stats sum = {0};
        struct test_random random = {(uint64_t)k + 1};
        struct vec3 wo = direction(mu, 1);
        struct bsdf b;

        p.specular = layers & 1 ? 1 : 0;
        p.alpha = alpha;
        p.ior = ior;
        p.clearcoat = layers & 2 ? 1 : 0;
        p.clearcoat_alpha = alpha;
        p.clearcoat_ior = ior;
        p.clearcoat_normal = (struct vec3){0, 0, 1};
        bsdf_init(&b, &p, wo);
        for (int i = 0; i < 20000; i++) {
            float u = test_random_float(&random), v = test_random_float(&random);
            struct bsdf_sample s;
            int got = bsdf_sample(&b, wo, test_random_float(&random), u, v, &s);
            running_stats_add(&sum, got ? (double)s.weight.x : 0);
        }
        if (sum.mean > 1 + 0.003 + 4 * running_stats_error(&sum))
            fail_msg("layers %d, alpha %g, ior %g, mu %g: sends out %.4f +- %.4f", layers, (double)alpha, (double)ior,
                     (double)mu, sum.mean, running_stats_error(&sum));
    }
}

/* ---- sampling ---------------------------------------------------------------------------------- */

/* The variance of white's weight: cosine sampling's is 1.78, 0.93 and 0.29 at the first cosines for
 * roughness 1. */
static void sampling_varies_little(void **state)
{
    static const struct { float mu; double most; } cases[] = {
        {0.003f, 0.55}, {0.05f, 0.52}, {0.4f, 0.29}, {1, 0.01}};
    enum { SAMPLES = 200000 };

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        struct bsdf_params p = rough(1, 1, 1, 1);
        struct vec3 wo = direction(cases[k].mu, 0.3f);
        struct test_random random = {k + 1};
        struct running_stats weight = {0};
        struct bsdf b;

        bsdf_init(&b, &p, wo);
        for (int i = 0; i < SAMPLES; i++) {
            float u = test_random_float(&random), v = test_random_float(&random);
            struct bsdf_sample s;
            assert_true(bsdf_sample(&b, wo, 0.5f, u, v, &s));
            running_stats_add(&weight, (double)s.weight.x);
        }
        if (running_stats_variance(&weight) > cases[k].most)
            fail_msg("mu %g: variance %.4f", (double)cases[k].mu, running_stats_variance(&weight));
        assert_true(mean_test_p_value(&weight, 1) > sidak_alpha(SIGNIFICANCE, COMPARISONS));
    }
}

/* ---- pictures ---------------------------------------------------------------------------------- */

/* A plane below a point light, looked at from its side and from across. */
static void lit_plane_is_the_models(void **state)
{
    static const float EYES[][3] = {{-3, 1, 0.5f}, {3, 1, 0.5f}, {0.1f, 3, 0}};
    static const double COLORS[3] = {0.8, 0.4, 0.1};
    static double picture[8 * 8 * 3];

    (void)state;
    for (int k = 0; k < COUNT_ROUGHNESSES; k++)
        for (int e = 0; e < 3; e++) {
            const float *at = EYES[e];
            double r = (double)ROUGHNESSES[k], mean = albedo_mean(r), expected[3];
            double length = sqrt((double)(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]));
            struct double3 o = {(double)at[0] / length, (double)at[2] / length,
                                (double)at[1] / length};
            struct double3 i = {-1.5 / 2.5, 0, 2 / 2.5};
            struct render_settings settings = builder_settings(8, 8, 4);
            struct render_stats stats = {0};
            struct render_scene *scene;
            struct scene_material *m;
            struct scene_light *l;
            struct scene_builder b;

            settings.max_depth = 1;
            builder_init(&b);
            m = builder_lambert(&b, 0);
            m->diffuse_roughness = ROUGHNESSES[k];
            for (int c = 0; c < 3; c++) {
                m->base_color[c] = (float)COLORS[c];
                expected[c] = model(r, COLORS[c], o, i, mean) * i.z * 10 / (2.5 * 2.5);
            }
            builder_place(&b, builder_quad(&b), 0, vec3_make(10, 1, 10), vec3_splat(0));
            builder_camera(&b, vec3_make(at[0], at[1], at[2]), vec3_splat(0), 1e-4f);
            l = builder_light(&b, LIGHT_POINT);
            l->position[0] = -1.5f;
            l->position[1] = 2;
            for (int c = 0; c < 3; c++)
                l->intensity[c] = 10;
            scene = builder_build(&b, &settings);
            builder_render(scene, &settings, 0, picture, NULL, &stats);
            for (int c = 0; c < 3; c++) /* any pixel: nothing is random here */
                if (fabs(picture[3 * 20 + c] - expected[c]) > 5e-4 * expected[c])
                    fail_msg("r %g, eye %d, channel %d: %g, not %g", r, e, c, picture[3 * 20 + c], expected[c]);
            render_scene_free(scene);
            builder_release(&b);
        }
}

/* Where the texture is 0 the plane is Lambert's to the bit. */
static void texture_makes_it_rough(void **state)
{
    /* the red channel counts */
    static const float none[3] = {0, 1, 1}, half[3] = {0.5f, 0, 0}, *texels[] = {NULL, none, half};
    static double picture[4][8 * 8 * 3];

    (void)state;
    for (int k = 0; k < 4; k++) {
        struct render_settings settings = builder_settings(8, 8, 8);
        struct render_stats stats = {0};
        struct scene_material *m;
        struct render_scene *scene;
        struct scene_builder b;

        builder_init(&b);
        m = builder_lambert(&b, 0.8f);
        builder_place(&b, builder_quad(&b), 0, vec3_make(10, 1, 10), vec3_splat(0));
        builder_camera(&b, vec3_make(2, 1, 0), vec3_splat(0), 0.5f);
        builder_environment_constant(&b, vec3_make(1, 0.5f, 0.2f));
        m->diffuse_roughness = k == 0 ? 0 : k == 3 ? 0.5f : 1;
        if (k == 1 || k == 2) {
            m->diffuse_roughness_texture = (struct scene_texture_slot){.uv_transform = {{1, 0, 0}, {0, 1, 0}}};
            m->diffuse_roughness_texture.texture = (int32_t)builder_texture(&b, texels[k], 1, 1);
        }
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, picture[k], NULL, &stats);
        render_scene_free(scene);
        builder_release(&b);
    }
    assert_memory_equal(picture[0], picture[1], sizeof picture[0]);
    assert_memory_equal(picture[2], picture[3], sizeof picture[0]);
    assert_memory_not_equal(picture[0], picture[2], sizeof picture[0]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_are_the_models),
        cmocka_unit_test(no_roughness_is_lambert),
        cmocka_unit_test(white_sends_out_all),
        cmocka_unit_test(multiple_scattering_saturates),
        cmocka_unit_test(layers_over_it_gain_nothing),
        cmocka_unit_test(sampling_varies_little),
        cmocka_unit_test(lit_plane_is_the_models),
        cmocka_unit_test(texture_makes_it_rough),
    };
    return cmocka_run_group_tests_name("rough_diffuse", tests, NULL, NULL);
}
