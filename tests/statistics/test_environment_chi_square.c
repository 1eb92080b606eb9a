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
#include "worker/render/light/environment.h"

enum fill { FILL_CONSTANT, FILL_RANDOM, FILL_SPARSE, FILL_ONE };

struct map_case {
    const char *name;
    uint32_t width, height;
    enum fill fill;
    uint32_t column, row; /* of the lit texel; FILL_ONE */
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

static double density(void *user, struct vec3 direction)
{
    return (double)environment_pdf(user, direction);
}

/* The map's own coordinates as an equal-area sphere, y = 1 - 2 theta / pi: there cells around
 * +Y are equal pieces of (u, v). */
static int sample_map(void *user, const float u[3], struct vec3 *direction)
{
    struct vec3 d;
    double y, scale;

    if (!sample(user, u, &d))
        return 0;
    y = 1 - 2 / PI_D * atan2(hypot((double)d.x, (double)d.z), (double)d.y);
    scale = sqrt((1 - y * y) / ((double)d.x * (double)d.x + (double)d.z * (double)d.z));
    *direction = vec3_make((float)((double)d.x * scale), (float)y, (float)((double)d.z * scale));
    return 1;
}

static double density_map(void *user, struct vec3 direction)
{
    double y = (double)direction.y, theta = PI_D / 2 * (1 - fmin(fmax(y, -1), 1));
    double scale = sin(theta) / sqrt(fmax(1 - y * y, 1e-30));

    /* d omega / d omega' = pi / 2 sin(theta). */
    return PI_D / 2 * sin(theta) *
           density(user, vec3_make((float)((double)direction.x * scale), (float)cos(theta),
                                   (float)((double)direction.z * scale)));
}

/* Where the map's lit texel stands. */
static struct vec3 lit_direction(const struct map_case *c)
{
    double phi = 2 * PI_D * ((c->column + 0.5) / c->width - 0.5) -
                 (double)c->rotate_deg * PI_D / 180;
    double theta = PI_D * (c->row + 0.5) / c->height;

    return vec3_make((float)(sin(theta) * cos(phi)), (float)cos(theta),
                     (float)(sin(theta) * sin(phi)));
}

static void run_case(const struct map_case *c, struct chi_square_setup setup)
{
    struct environment *env = environment_of_case(c);

    setup.user = env;
    setup.cos_cells = 11;
    setup.phi_cells = 21;
    setup.samples = 400000;
    setup.seed = c->width * 31 + c->row;
    if (!chi_square_accept(&setup, 0.01, 2 * CASES, c->name))
        fail_msg("%s: samples do not follow the density", c->name);
    environment_free(env);
}

static void test_in_the_map(void **state)
{
    struct chi_square_setup setup = {.sample = sample_map, .pdf = density_map, .axis = {0, 1, 0}};

    (void)state;
    /* One lit texel is too little for this test's cells: it has the other test's, around it. */
    for (int i = 0; i < CASES; i++)
        if (cases[i].fill != FILL_ONE)
            run_case(&cases[i], setup);
}

/* On the sphere, around the lit texel where there is only one, finer there; else around an
 * axis that no row or column is aligned with. */
static void test_on_the_sphere(void **state)
{
    (void)state;
    for (int i = 0; i < CASES; i++) {
        int one = cases[i].fill == FILL_ONE;
        struct chi_square_setup setup = {
            .sample = sample, .pdf = density, .focus = one ? 3 : 1,
            .axis = one ? lit_direction(&cases[i]) : vec3_normalize(vec3_make(1, 0.4f, -0.7f)),
        };

        run_case(&cases[i], setup);
    }
}

/* The test must see half a texel: samples of one map against the density of the same map
 * turned by half a texel are refused. */
static int sample_other(void *user, const float u[3], struct vec3 *direction)
{
    return sample(((struct environment **)user)[0], u, direction);
}

static double density_other(void *user, struct vec3 direction)
{
    return density(((struct environment **)user)[1], direction);
}

static void test_sees_half_a_texel(void **state)
{
    struct map_case turned = cases[7];
    struct environment *pair[2];
    struct chi_square_setup setup = {
        .sample = sample_other, .pdf = density_other, .user = pair, .cos_cells = 11,
        .phi_cells = 21, .samples = 500000, .seed = 5, .axis = {0, 1, 0},
    };
    struct chi_square_result result;

    (void)state;
    turned.rotate_deg = 360.0f / 32;
    pair[0] = environment_of_case(&cases[7]);
    pair[1] = environment_of_case(&turned);
    assert_true(chi_square_run(&setup, &result));
    assert_true(result.p_value < 1e-6);
    chi_square_result_release(&result);
    environment_free(pair[0]);
    environment_free(pair[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_in_the_map),
        cmocka_unit_test(test_on_the_sphere),
        cmocka_unit_test(test_sees_half_a_texel),
    };

    return cmocka_run_group_tests_name("environment chi-square", tests, NULL, NULL);
}
