/* Irradiance of a plane by uniform and by importance sampling agree, and a hot texel at a
 * pole gives the irradiance that its lookup integrates to. Family-wise level 0.01, Sidak. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/math/elementary.h"
#include "tests/support/statistics.h"
#include "worker/render/light/environment/environment.h"

enum { SAMPLES = 400000, NORMALS = 4 };

static const struct vec3 normals[NORMALS] = {
    {0, 1, 0}, {0, -1, 0}, {0.6f, 0, -0.8f}, {-0.48f, 0.6f, 0.64f}};

/* Four maps: a gradient, random texels over three decades, one hot texel in the dark, and a
 * sky with a small bright sun. */
enum { MAPS = 4 };

static struct environment *environment_of(int which, enum env_sampling sampling)
{
    struct environment *env;
    struct test_random random = {31};
    struct error err = {0};
    struct image map;
    uint32_t width = which == 3 ? 128 : 20, height = which == 3 ? 64 : 9;

    if (image_init(&map, width, height, 3, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            for (int c = 0; c < 3; c++) {
                float *p = map.pixels + 3 * (y * width + x) + c;

                switch (which) {
                case 0: *p = (float)(1 + x % 7 + y) * 0.1f; break;
                case 1: *p = (float)pow(1000, test_random_double(&random)); break;
                case 2: *p = y == 3 && x == 19 ? 500.0f : 0.01f; break;
                default: *p = y == 20 && x >= 90 && x < 92 ? 2000.0f : y < 32 ? 1.0f : 0.2f;
                }
            }
    if (environment_new(&env, &map, NULL, 25, vec3_splat(1), sampling, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return env;
}

/* Irradiance (luminance) of a plane: one sample of the environment and one by the cosine, joined
 * by the power heuristic as the path tracer does. */
static struct running_stats irradiance(const struct environment *env, struct vec3 normal, uint64_t seed)
{
    struct running_stats stats = {0};
    struct test_random random = {seed};
    struct basis frame = basis_from_normal(normal);

    for (int i = 0; i < SAMPLES; i++) {
        float u = test_random_float(&random), v = test_random_float(&random), pdf;
        double value = 0, cosine, ratio, radius, angle;
        struct vec3 d, radiance;

        if (environment_sample(env, u, v, &d, &radiance, &pdf)) {
            cosine = fmax(0, (double)vec3_dot(d, normal));
            ratio = cosine / PI_D / (double)pdf;
            value = (double)vec3_luminance(radiance) * cosine / (double)pdf / (1 + ratio * ratio);
        }
        radius = sqrt(test_random_double(&random));
        angle = 2 * PI_D * test_random_double(&random);
        cosine = sqrt(1 - radius * radius);
        d = basis_to_world(&frame,
                           vec3_make((float)(radius * cos(angle)), (float)(radius * sin(angle)), (float)cosine));
        radiance = environment_radiance_pdf(env, d, &pdf);
        ratio = cosine > 0 ? (double)pdf * PI_D / cosine : INFINITY;
        value += (double)vec3_luminance(radiance) * PI_D / (1 + ratio * ratio);
        running_stats_add(&stats, value);
    }
    return stats;
}

/* Two-sided p-value that two means are equal. */
static double equal_p_value(const struct running_stats *a, const struct running_stats *b)
{
    double error = hypot(running_stats_error(a), running_stats_error(b));

    return 2 * normal_cdf(-fabs(a->mean - b->mean) / error);
}

static void test_strategies_agree(void **state)
{
    double level = sidak_alpha(0.01, MAPS * NORMALS);

    (void)state;
    for (int map = 0; map < MAPS; map++) {
        struct environment *uniform = environment_of(map, ENV_SAMPLING_UNIFORM);
        struct environment *importance = environment_of(map, ENV_SAMPLING_IMPORTANCE);
        double ratio = 0;

        for (int n = 0; n < NORMALS; n++) {
            struct running_stats a = irradiance(uniform, normals[n], 100 + (uint64_t)n);
            struct running_stats b = irradiance(importance, normals[n], 200 + (uint64_t)n);
            double p = equal_p_value(&a, &b);

            assert_true(a.mean > 0 && running_stats_error(&a) < 0.2 * a.mean);
            if (p < level)
                fail_msg("map %d, normal %d: uniform %.5g +- %.2g, importance %.5g +- %.2g, p = %.2g", map, n, a.mean,
                         running_stats_error(&a), b.mean, running_stats_error(&b), p);
            ratio += running_stats_variance(&a) / running_stats_variance(&b) / NORMALS;
        }
        print_message("# map %d: variance of uniform over importance %.3g\n", map, ratio);
        assert_true(map < 2 || ratio > 10);
        environment_free(uniform);
        environment_free(importance);
    }
}

/* Antiderivatives of sin(pi v) cos(pi v) and of v times that. */
static double moment0(double v) { return -cos(2 * PI_D * v) / (4 * PI_D); }
static double moment1(double v) { return -v * cos(2 * PI_D * v) / (4 * PI_D) + sin(2 * PI_D * v) / (8 * PI_D * PI_D); }

/* One texel of the first or last row lit, radiance 1. Averaged over u the bilinear lookup is
 * 1/W from the pole to the row's centre at v = h/2 (half of what the texel lacks over the pole
 * shows on the other side of it) and falls to 0 at the next row's, 3h/2. */
static double pole_texel_irradiance(uint32_t width, uint32_t height)
{
    double h = 1.0 / height, a = 0.5 * h, b = 1.5 * h;
    double near = moment0(a) - moment0(0);
    double far = (moment0(b) - moment0(a)) * (1 + a / h) - (moment1(b) - moment1(a)) / h;

    return 2 * PI_D * PI_D / width * (near + far);
}

static void test_hot_texel_at_a_pole(void **state)
{
    static const uint32_t sizes[][2] = {{8, 4}, {7, 5}, {64, 32}, {1, 3}};
    enum { SIZES = sizeof sizes / sizeof *sizes };
    double level = sidak_alpha(0.01, 2 * 2 * SIZES);

    (void)state;
    for (int s = 0; s < SIZES; s++)
        for (int south = 0; south < 2; south++)
            for (int mode = 0; mode < 2; mode++) {
                uint32_t width = sizes[s][0], height = sizes[s][1];
                uint32_t row = south ? height - 1 : 0;
                double want = pole_texel_irradiance(width, height);
                struct environment *env;
                struct running_stats got;
                struct error err = {0};
                struct image map;

                assert_int_equal(image_init(&map, width, height, 3, &err), STATUS_OK);
                for (int c = 0; c < 3; c++)
                    map.pixels[3 * (row * width + width / 3) + (uint32_t)c] = 1;
                assert_int_equal(environment_new(&env, &map, NULL, 0, vec3_splat(1),
                                                 mode ? ENV_SAMPLING_IMPORTANCE : ENV_SAMPLING_UNIFORM, &err),
                                 STATUS_OK);
                got = irradiance(env, normals[south], (uint64_t)(s * 10 + south * 2 + mode));
                if (mean_test_p_value(&got, want) < level)
                    fail_msg("%ux%u %s: %.6g +- %.2g, closed form %.6g", width, height, mode ? "importance" : "uniform",
                             got.mean, running_stats_error(&got), want);
                assert_true(running_stats_error(&got) < (mode ? 0.005 : 0.25) * want);
                environment_free(env);
            }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_strategies_agree),
        cmocka_unit_test(test_hot_texel_at_a_pole),
    };

    return cmocka_run_group_tests_name("environment irradiance", tests, NULL, NULL);
}
