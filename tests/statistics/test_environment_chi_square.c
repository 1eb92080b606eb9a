/* Chi-square: the directions that the environment hands out follow the density that it
 * claims, on maps small enough that half a texel matters. Family-wise level 0.01, Sidak. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/math/elementary.h"
#include "tests/support/chi_square.h"
#include "tests/support/statistics.h"
#include "worker/render/light/environment/environment.h"

enum fill { FILL_CONSTANT, FILL_RANDOM, FILL_SPARSE, FILL_ONE, FILL_SUN };

struct map_case {
    const char *name;
    uint32_t width, height;
    enum fill fill;
    uint32_t column, row; /* of the lit texel; FILL_ONE, FILL_SUN */
    float rotate_deg;
    enum env_sampling sampling;
};

static const struct map_case cases[] = {
    {"1x1 constant", 1, 1, FILL_CONSTANT, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"3x2 constant", 3, 2, FILL_CONSTANT, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"4x2 random", 4, 2, FILL_RANDOM, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"2x1 random", 2, 1, FILL_RANDOM, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"1x7 random", 1, 7, FILL_RANDOM, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"100x10, one lit texel", 100, 10, FILL_ONE, 37, 4, 0, ENV_SAMPLING_IMPORTANCE},
    {"100x10, one lit texel at the seam", 100, 10, FILL_ONE, 99, 6, 100, ENV_SAMPLING_IMPORTANCE},
    {"16x8 random", 16, 8, FILL_RANDOM, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"16x8 random, turned", 16, 8, FILL_RANDOM, 0, 0, 71, ENV_SAMPLING_IMPORTANCE},
    {"17x9 sparse", 17, 9, FILL_SPARSE, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"16x8, hot texel in the first row", 16, 8, FILL_ONE, 5, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"16x8, hot texel in the last row", 16, 8, FILL_ONE, 12, 7, 0, ENV_SAMPLING_IMPORTANCE},
    {"7x4, hot texel in the last row", 7, 4, FILL_ONE, 6, 3, 10, ENV_SAMPLING_IMPORTANCE},
    {"512x256 sky, a sun at the seam", 512, 256, FILL_SUN, 511, 60, 0, ENV_SAMPLING_IMPORTANCE},
    {"512x256 sky, a sun", 512, 256, FILL_SUN, 200, 90, 40, ENV_SAMPLING_IMPORTANCE_ONLY},
    {"600x150 sky, a sun in the south", 600, 150, FILL_SUN, 7, 120, 0, ENV_SAMPLING_IMPORTANCE},
    {"300x140 random", 300, 140, FILL_RANDOM, 0, 0, 0, ENV_SAMPLING_IMPORTANCE},
    {"16x8 random, all of it", 16, 8, FILL_RANDOM, 0, 0, 0, ENV_SAMPLING_IMPORTANCE_ONLY},
    {"16x8 random, uniform", 16, 8, FILL_RANDOM, 0, 0, 0, ENV_SAMPLING_UNIFORM},
};
enum { CASES = sizeof cases / sizeof *cases };

static struct environment *environment_of_case(const struct map_case *c)
{
    struct environment *env;
    struct test_random random = {c->width * 1000 + c->height};
    struct error err = {0};
    struct image map;

    if (image_init(&map, c->width, c->height, 3, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    for (uint32_t i = 0; i < c->width * c->height; i++)
        for (int channel = 0; channel < 3; channel++) {
            double value = test_random_double(&random);

            if (c->fill == FILL_CONSTANT)
                value = 1;
            if (c->fill == FILL_SPARSE && (i * 7 + 3) % 5 > 0)
                value = 0;
            if (c->fill == FILL_ONE)
                value = i == c->row * c->width + c->column ? 100 : 0;
            if (c->fill == FILL_SUN && i == c->row * c->width + c->column)
                value = 2e4;
            map.pixels[3 * i + (uint32_t)channel] = (float)value;
        }
    if (environment_new(&env, &map, NULL, c->rotate_deg, vec3_splat(1), c->sampling, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return env;
}

static int sample(void *user, const float u[3], struct vec3 *direction)
{
    struct vec3 radiance;
    float pdf;

    return environment_sample(user, u[0], u[1], direction, &radiance, &pdf);
}

static double density(void *user, struct vec3 direction) { return (double)environment_pdf(user, direction); }

/* Samples of `from` counted in pieces of the sphere that are equal in azimuth and polar angle,
 * against the integral of the density of `against` over each; the p-value. */
enum { BINS_U = 24, BINS_V = 12, POINTS_U = 1152, POINTS_V = 1152, SAMPLES = 300000 };

static double binned_p_value(struct environment *from, struct environment *against, uint64_t seed)
{
    static double expected[BINS_V][BINS_U], hits[BINS_V][BINS_U];
    struct test_random random = {seed};
    double statistic = 0, pooled = 0, pooled_hits = 0, sum = 0;
    int cells = 0;

    memset(expected, 0, sizeof expected);
    memset(hits, 0, sizeof hits);
    for (int y = 0; y < POINTS_V; y++)
        for (int x = 0; x < POINTS_U; x++) {
            double theta = PI_D * (y + 0.5) / POINTS_V, phi = 2 * PI_D * (x + 0.5) / POINTS_U;
            struct vec3 d = {(float)(sin(theta) * cos(phi)), (float)cos(theta),
                             (float)(sin(theta) * sin(phi))};

            expected[y * BINS_V / POINTS_V][x * BINS_U / POINTS_U] +=
                density(against, d) * sin(theta) * 2 * PI_D * PI_D / POINTS_U / POINTS_V;
        }
    for (int i = 0; i < SAMPLES; i++) {
        float u[3] = {test_random_float(&random), test_random_float(&random), 0};
        struct vec3 d;
        double phi, theta;

        assert_true(sample(from, u, &d));
        phi = atan2((double)d.z, (double)d.x) / (2 * PI_D);
        theta = atan2(hypot((double)d.x, (double)d.z), (double)d.y) / PI_D;
        hits[(int)(theta * BINS_V) % BINS_V][(int)((phi < 0 ? phi + 1 : phi) * BINS_U) % BINS_U]++;
    }
    for (int y = 0; y < BINS_V; y++)
        for (int x = 0; x < BINS_U; x++) {
            double e = expected[y][x] * SAMPLES;

            sum += expected[y][x];
            if (e < 10) {
                pooled += e;
                pooled_hits += hits[y][x];
                continue;
            }
            statistic += (hits[y][x] - e) * (hits[y][x] - e) / e;
            cells++;
        }
    if (pooled >= 10) {
        statistic += (pooled_hits - pooled) * (pooled_hits - pooled) / pooled;
        cells++;
    } else if (pooled_hits > pooled + 6 * sqrt(pooled) + 12) {
        return 0;
    }
    if (fabs(sum - 1) > 3e-3)
        return 0;
    return cells > 1 ? chi_square_p_value(statistic, cells - 1) : 1;
}

/* Where the map's lit texel stands. */
static struct vec3 lit_direction(const struct map_case *c)
{
    double phi = 2 * PI_D * ((c->column + 0.5) / c->width - 0.5) - (double)c->rotate_deg * PI_D / 180;
    double theta = PI_D * (c->row + 0.5) / c->height;

    return vec3_make((float)(sin(theta) * cos(phi)), (float)cos(theta), (float)(sin(theta) * sin(phi)));
}

static void run_case(const struct map_case *c, struct chi_square_setup setup)
{
    struct environment *env = environment_of_case(c);

    setup.user = env;
    setup.cos_cells = 11;
    setup.phi_cells = 21;
    setup.samples = 100000;
    setup.seed = c->width * 31 + c->row;
    if (!chi_square_accept(&setup, 0.01, 2 * CASES, c->name))
        fail_msg("%s: samples do not follow the density", c->name);
    environment_free(env);
}

static void test_in_the_map(void **state)
{
    (void)state;
    /* One lit texel is too little for these bins: the other test has it. */
    for (int i = 0; i < CASES; i++)
        if (cases[i].fill < FILL_ONE) {
            struct environment *env = environment_of_case(&cases[i]);
            double p = binned_p_value(env, env, (uint64_t)i);

            if (!(p > sidak_alpha(0.01, 2 * CASES)))
                fail_msg("%s: samples do not follow the density, p = %.2g", cases[i].name, p);
            environment_free(env);
        }
}

/* Around a lit texel, finer there: where it is the only one, or a sun that has a window. */
static void test_around_a_texel(void **state)
{
    (void)state;
    for (int i = 0; i < CASES; i++)
        if (cases[i].fill >= FILL_ONE) {
            struct chi_square_setup setup = {.sample = sample, .pdf = density, .focus = 3,
                                             .axis = lit_direction(&cases[i])};

            run_case(&cases[i], setup);
        }
}

/* The test must see half a texel: samples of one map against the density of the same map
 * turned by half a texel are refused. */
static void test_sees_half_a_texel(void **state)
{
    struct map_case turned = cases[7];
    struct environment *straight, *askew;

    (void)state;
    turned.rotate_deg = 360.0f / 32;
    straight = environment_of_case(&cases[7]);
    askew = environment_of_case(&turned);
    assert_true(binned_p_value(straight, askew, 5) < 1e-6);
    environment_free(straight);
    environment_free(askew);
}

/* The mean of 1 / density over samples is the solid angle that the density covers: of a density that is some per cent
 * too high anywhere it is not. */
static void test_density_is_the_odds(void **state)
{
    (void)state;
    for (int i = 0; i < CASES; i++) {
        struct environment *env = environment_of_case(&cases[i]);
        struct test_random random = {(uint64_t)i + 70};
        struct running_stats sampled = {0}, covered = {0};
        double z;

        for (int k = 0; k < SAMPLES; k++) {
            double y = 2 * test_random_double(&random) - 1, phi = 2 * PI_D * test_random_double(&random);
            double radius = sqrt(1 - y * y);
            float u = test_random_float(&random), v = test_random_float(&random), pdf;
            struct vec3 d;

            assert_true(environment_aim(env, u, v, &d, &pdf));
            /* Where the density is below a hundredth of the uniform one, a few samples would decide. */
            running_stats_add(&sampled, (double)pdf > 0.01 / (4 * PI_D) ? 1 / (double)pdf : 0);
            d = vec3_make((float)(radius * cos(phi)), (float)y, (float)(radius * sin(phi)));
            running_stats_add(&covered, density(env, d) > 0.01 / (4 * PI_D) ? 4 * PI_D : 0);
        }
        z = (sampled.mean - covered.mean) /
            sqrt((running_stats_variance(&sampled) + running_stats_variance(&covered)) / SAMPLES + 1e-12);
        if (!(fabs(z) < 4.2))
            fail_msg("%s: 1 / density has mean %g, and the density covers %g sr", cases[i].name, sampled.mean, covered.mean);
        environment_free(env);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_in_the_map),
        cmocka_unit_test(test_around_a_texel),
        cmocka_unit_test(test_sees_half_a_texel),
        cmocka_unit_test(test_density_is_the_odds),
    };

    return cmocka_run_group_tests_name("environment chi-square", tests, NULL, NULL);
}
