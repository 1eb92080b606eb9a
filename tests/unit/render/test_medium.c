/* Media: what must come out exactly, or as an average over evenly spread numbers; and inputs
 * that no sane file holds. Monte Carlo's share is in tests/statistics/test_medium.c. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "tests/support/statistics.h"
#include "worker/render/medium/null_collisions.h"

static struct scene_medium medium_of(float absorption, float scattering, float g)
{
    struct scene_medium m = {.name = "test", .g = g};

    for (int c = 0; c < 3; c++) {
        m.absorption[c] = absorption;
        m.scattering[c] = scattering;
    }
    return m;
}

static void set_rgb(float out[3], float r, float g, float b)
{
    out[0] = r;
    out[1] = g;
    out[2] = b;
}

static struct render_medium *medium_made(const struct scene_medium *source, const float *grid)
{
    struct render_medium *medium;
    struct error err = {0};

    if (medium_new(&medium, source, (const uint8_t *)(const void *)grid, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return medium;
}

static void assert_near(double got, double want, double tolerance)
{
    if (!(fabs(got - want) <= tolerance))
        fail_msg("%.9g is not %.9g +- %g", got, want, tolerance);
}

static struct ray ray_along_x(float from, float length)
{
    return (struct ray){.origin = {from, 0.5f, 0.5f}, .direction = {1, 0, 0}, .t_max = length};
}

static void test_transmittance_is_beer_lamberts(void **state)
{
    struct scene_medium source = medium_of(0, 0, 0);
    struct sampler sampler = {.seed = 1, .index = 2, .index_reversed = 3};
    struct medium_random random = {&sampler, 0, 0};
    struct render_medium *medium;

    (void)state;
    set_rgb(source.absorption, 0.5f, 2, 0);
    set_rgb(source.scattering, 0.25f, 1, 0);
    medium = medium_made(&source, NULL);
    for (float length = 1e-3f; length < 100; length *= 1.7f) {
        struct ray ray = ray_along_x(0, length);
        struct vec3 t = medium_transmittance(medium, &ray, &random);

        assert_near((double)t.x, exp(-0.75 * (double)length), 2e-6);
        assert_near((double)t.y, exp(-3.0 * (double)length), 2e-6);
        assert_true(t.z == 1.0f);
    }
    struct ray endless = ray_along_x(0, INFINITY);
    struct vec3 t = medium_transmittance(medium, &endless, &random);
    assert_true(t.x == 0.0f && t.y == 0.0f && t.z == 1.0f);
    assert_int_equal(random.drawn, 0);
    medium_free(medium);
}

/* What only absorbs has no event: the closed form itself. */
static void test_absorber_never_scatters(void **state)
{
    struct scene_medium source = medium_of(2, 0, 0);
    struct render_medium *medium = medium_made(&source, NULL);
    struct sampler sampler = {.seed = 1, .index = 2, .index_reversed = 3};
    struct medium_random random = {&sampler, 0, 0};
    struct ray ray = ray_along_x(0, 0.7f);
    struct medium_event event;

    (void)state;
    assert_false(medium_scatters(medium));
    for (int k = 0; k < 16; k++) {
        medium_sample(medium, &ray, (float)k / 16, &random, &event);
        assert_false(event.scattered);
        assert_true(event.distance == ray.t_max);
        assert_near((double)event.weight.y, exp(-1.4), 1e-6);
        assert_true(event.emitted.x == 0.0f);
    }
    medium_free(medium);
}

/* Grey: the free path is -log(1 - u) / extinction, the weight is the albedo. */
static void test_grey_free_path(void **state)
{
    struct scene_medium source = medium_of(0.5f, 1.5f, 0);
    struct render_medium *medium = medium_made(&source, NULL);
    struct sampler sampler = {.seed = 1, .index = 2, .index_reversed = 3};
    struct medium_random random = {&sampler, 0, 0};
    struct ray ray = ray_along_x(0, 0.8f);
    struct medium_event event;

    (void)state;
    for (int k = 0; k < 1000; k++) {
        double u = k / 1000.0, want = -log(1 - (double)(float)u) / 2;

        medium_sample(medium, &ray, (float)u, &random, &event);
        assert_int_equal(event.scattered, want < 0.8);
        assert_near((double)event.distance, want < 0.8 ? want : (double)ray.t_max, 1e-6);
        assert_near((double)event.weight.x, event.scattered ? 0.75 : 1, 1e-6);
        assert_true(event.weight.x == event.weight.y && event.weight.y == event.weight.z);
    }
    medium_free(medium);
}

/* Evenly spread first numbers integrate the estimator: what passes is exp(-extinction t), what
 * scatters albedo * (1 - that), in every channel, colourless channels included. */
static void test_chromatic_weights_add_up(void **state)
{
    enum { N = 300000 };
    static const float ABSORPTION[3] = {0.1f, 3, 0}, SCATTERING[3] = {0.4f, 2, 0};
    static const float LENGTHS[] = {0.05f, 0.4f, 2, 12, INFINITY};
    struct scene_medium source = medium_of(0, 0, 0);
    struct sampler sampler = {.seed = 1, .index = 2, .index_reversed = 3};
    struct medium_random random = {&sampler, 0, 0};
    struct render_medium *medium;

    (void)state;
    memcpy(source.absorption, ABSORPTION, sizeof ABSORPTION);
    memcpy(source.scattering, SCATTERING, sizeof SCATTERING);
    medium = medium_made(&source, NULL);
    for (size_t l = 0; l < sizeof LENGTHS / sizeof *LENGTHS; l++) {
        struct ray ray = ray_along_x(0, LENGTHS[l]);
        double passed[3] = {0}, scattered[3] = {0}, most = 0;

        for (int k = 0; k < N; k++) {
            struct medium_event event;
            double *sum;

            medium_sample(medium, &ray, ((float)k + 0.5f) / N, &random, &event);
            sum = event.scattered ? scattered : passed;
            sum[0] += (double)event.weight.x / N;
            sum[1] += (double)event.weight.y / N;
            sum[2] += (double)event.weight.z / N;
            most = fmax(most, (double)vec3_max(event.weight));
        }
        assert_true(most <= 3.00001);
        for (int c = 0; c < 3; c++) {
            double extinction = (double)ABSORPTION[c] + (double)SCATTERING[c];
            double t = extinction > 0 ? exp(-extinction * (double)LENGTHS[l]) : 1;

            assert_near(passed[c], t, 5e-5);
            assert_near(scattered[c], extinction > 0 ? (double)SCATTERING[c] / extinction * (1 - t) : 0, 5e-5);
        }
    }
    assert_int_equal(random.drawn, 0);
    medium_free(medium);
}

static void test_emission_is_closed_form(void **state)
{
    static const float LENGTHS[] = {1e-6f, 1e-3f, 0.5f, 7};
    struct sampler sampler = {.seed = 1, .index = 2, .index_reversed = 3};
    struct medium_random random = {&sampler, 0, 0};
    struct medium_event event;

    (void)state;
    for (int scatters = 0; scatters < 2; scatters++) {
        struct scene_medium source = medium_of(0, 0, 0);
        struct render_medium *medium;

        set_rgb(source.absorption, 0.5f, 1e-4f, 0);
        set_rgb(source.scattering, scatters ? 0.25f : 0, 0, 0);
        set_rgb(source.emission, 3, 5, 7);
        medium = medium_made(&source, NULL);
        for (size_t l = 0; l < sizeof LENGTHS / sizeof *LENGTHS; l++) {
            struct ray ray = ray_along_x(0, LENGTHS[l]);
            double length = (double)LENGTHS[l], red = scatters ? 0.75 : 0.5;

            medium_sample(medium, &ray, 0.4f, &random, &event);
            assert_near((double)event.emitted.x / length, -3 * expm1(-red * length) / red / length, 1e-5);
            assert_near((double)event.emitted.y / length, -5 * expm1(-1e-4 * length) / 1e-4 / length, 1e-5);
            assert_near((double)event.emitted.z / length, 7, 1e-5);
        }
        struct ray endless = ray_along_x(0, INFINITY);
        medium_sample(medium, &endless, 0.4f, &random, &event);
        assert_near((double)event.emitted.x, scatters ? 4 : 6, 1e-5);
        assert_true(event.emitted.z == 0.0f);
        medium_free(medium);
    }
}

/* The phase function over the sphere, and the mean cosine, which is g. */
static void test_phase_integrates_to_one(void **state)
{
    static const float GS[] = {0, 1e-7f, -1e-4f, 0.3f, -0.7f, 0.9f, -0.99f};

    (void)state;
    for (size_t i = 0; i < sizeof GS / sizeof *GS; i++) {
        struct scene_medium source = medium_of(0, 1, GS[i]);
        struct render_medium *medium = medium_made(&source, NULL);
        double sum = 0, moment = 0, lost = 0;
        enum { N = 400000 };

        /* Midpoints in s, cosine = 1 - 2 s^3 from the peak: they crowd where it is. */
        for (int k = 0; k < N; k++) {
            double s = (k + 0.5) / N, c = 1 - 2 * s * s * s, width = 6 * s * s / N;
            float cosine = (float)(GS[i] < 0 ? -c : c);
            double value = 2 * acos(-1.0) * (double)medium_phase(medium, cosine) * width;

            sum += value;
            moment += value * (double)cosine;
            lost = fmax(lost, fabs((double)cosine) - 1);
        }
        assert_near(sum, 1, 2e-3);
        assert_near(moment, (double)GS[i], 2e-3);
        medium_free(medium);
    }
}

/* Sampled cosines: a share u of them lies below the sampled one, for all g. */
static void test_phase_sampling_inverts_the_distribution(void **state)
{
    static const float GS[] = {0, 1e-9f, 1e-4f, -0.2f, 0.6f, -0.95f, 0.999f, 0.99999994f,
                               -0.99999994f};
    struct vec3 direction = vec3_normalize((struct vec3){0.3f, -0.5f, -0.8f});

    (void)state;
    for (size_t i = 0; i < sizeof GS / sizeof *GS; i++) {
        struct scene_medium source = medium_of(0, 1, GS[i]);
        struct render_medium *medium = medium_made(&source, NULL);
        double g = fmin(fmax((double)GS[i], -(double)0.999f), (double)0.999f);

        for (int k = 0; k < 1000; k++) {
            float u = (float)k / 1000;
            struct vec3 d = medium_phase_sample(medium, direction, u, 0.37f);
            double cosine = (double)vec3_dot(d, direction), below;

            assert_near((double)vec3_length(d), 1, 1e-6);
            below = fabs(g) < 1e-3
                        ? (1 + cosine) / 2 + 0.75 * g * (cosine * cosine - 1)
                        : (1 - g * g) / (2 * g) * (1 / sqrt(fmax(1 + g * g - 2 * g * cosine, 1e-12)) - 1 / (1 + g));
            /* A float's cosine resolves the narrowest peaks no better. */
            assert_near(below, (double)u, fabs(g) > 0.99 ? 0.2 : fabs(g) > 0.9 ? 2e-3 : 1e-5);
        }
        medium_free(medium);
    }
}

/* A grid whose cells are all equal is the homogeneous medium inside its box, and nothing outside;
 * with the majorant equal to the density, the free path is the same for the same number. */
static void test_even_grid_is_homogeneous_in_its_box(void **state)
{
    enum { X = 11, Y = 3, Z = 20 };
    static float cells[X * Y * Z];
    struct scene_medium source = medium_of(0.5f, 1.5f, 0), even = source;
    struct sampler sampler = {.seed = 1, .index = 2, .index_reversed = 3};
    struct medium_random random = {&sampler, 0, 0};
    struct render_medium *grid, *same;

    (void)state;
    for (int i = 0; i < X * Y * Z; i++)
        cells[i] = 2;
    source.has_grid = 1;
    source.grid_size[0] = X, source.grid_size[1] = Y, source.grid_size[2] = Z;
    /* The box reaches from (1, -2, 0) to (5, 1, 8). */
    source.grid_to_world = (struct transform_d){{{4, 0, 0, 1}, {0, 3, 0, -2}, {0, 0, 8, 0}}};
    for (int c = 0; c < 3; c++) {
        even.absorption[c] *= 2;
        even.scattering[c] *= 2;
    }
    grid = medium_made(&source, cells);
    same = medium_made(&even, NULL);
    assert_true(medium_bytes(grid) > medium_bytes(same));
    for (int k = 0; k < 500; k++) {
        struct ray outside = ray_along_x(-2, INFINITY), inside = ray_along_x(0, 4);
        struct medium_event got, want;

        medium_sample(same, &inside, (float)k / 500, &random, &want);
        medium_sample(grid, &outside, (float)k / 500, &random, &got);
        assert_int_equal(got.scattered, want.scattered);
        assert_near((double)got.weight.x, (double)want.weight.x, 1e-5);
        if (got.scattered)
            assert_near((double)got.distance - 3, (double)want.distance, 1e-5);
        else
            assert_true(got.distance == INFINITY);
    }
    struct ray past = {.origin = {0, 1.5f, 0.5f}, .direction = {1, 0, 0}, .t_max = INFINITY};
    struct ray away = {.origin = {0, 0.5f, 0.5f}, .direction = {-1, 0, 0}, .t_max = INFINITY};
    struct ray before = {.origin = {0, 0.5f, 0.5f}, .direction = {1, 0, 0}, .t_max = 1};
    assert_true(medium_transmittance(grid, &past, &random).y == 1.0f);
    assert_true(medium_transmittance(grid, &away, &random).y == 1.0f);
    assert_true(medium_transmittance(grid, &before, &random).y == 1.0f);
    medium_free(grid);
    medium_free(same);
}

/* The same sampler and key: the same bits; another key: other numbers. */
static void test_pure_function_of_its_numbers(void **state)
{
    static const float cells[2] = {1, 5};
    struct scene_medium source = medium_of(0.1f, 0.1f, 0);
    struct render_medium *medium;
    struct sampler sampler = {.seed = 77, .index = 2, .index_reversed = 3};
    struct ray ray = ray_along_x(-1, INFINITY);
    int differ = 0;

    (void)state;
    source.has_grid = 1;
    source.grid_size[0] = 2, source.grid_size[1] = source.grid_size[2] = 1;
    source.grid_to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    medium = medium_made(&source, cells);
    for (uint32_t key = 0; key < 50; key++) {
        struct medium_random a = {&sampler, key, 0}, b = a, other = {&sampler, key + 1000, 0};
        struct vec3 x = medium_transmittance(medium, &ray, &a);
        struct vec3 y = medium_transmittance(medium, &ray, &b);
        struct vec3 z = medium_transmittance(medium, &ray, &other);

        assert_memory_equal(&x, &y, sizeof x);
        assert_int_equal(a.drawn, b.drawn);
        assert_true(a.drawn > 0);
        differ += x.x != z.x;
    }
    assert_true(differ > 5);
    medium_free(medium);
}

static void assert_sane(struct vec3 v, float most)
{
    assert_true(v.x >= 0.0f && v.x <= most);
    assert_true(v.y >= 0.0f && v.y <= most);
    assert_true(v.z >= 0.0f && v.z <= most);
}

/* Everything a hostile file may say: all results finite, none negative, none endless. */
static void test_hostile_values(void **state)
{
    static const float VALUES[] = {0, 1e-45f, 1e-20f, 1, 1e18f, FLT_MAX};
    static const float CELLS[] = {0, 1, -1, 1e-45f, 1e-30f, 1e30f, FLT_MAX, INFINITY, -INFINITY};
    enum { VALUE_COUNT = 6, SIDE = 9 };
    float cells[SIDE * SIDE * SIDE];
    struct test_random random = {5};
    struct sampler sampler = {.seed = 77, .index = 2, .index_reversed = 3};

    (void)state;
    for (int i = 0; i < SIDE * SIDE * SIDE; i++)
        cells[i] = CELLS[test_random_u64(&random) % 9];
    cells[17] = NAN;
    for (int i = 0; i < 1000; i++) {
        struct scene_medium source = medium_of(0, 0, i & 1 ? 0.99999f : -0.99999f);
        struct medium_random numbers = {&sampler, (uint32_t)i, 0};
        struct ray ray = {.origin = {0.4f, 0.5f, 0.6f}, .direction = {0, 0, 1}, .t_max = INFINITY};
        struct render_medium *medium;
        struct medium_event event;
        float scale;

        for (int c = 0; c < 3; c++) {
            source.absorption[c] = VALUES[test_random_u64(&random) % VALUE_COUNT];
            source.scattering[c] = VALUES[test_random_u64(&random) % VALUE_COUNT];
            source.emission[c] = VALUES[test_random_u64(&random) % VALUE_COUNT];
        }
        if (i % 3)
            ray.direction = vec3_normalize((struct vec3){test_random_float(&random) - 0.5f,
                                                         test_random_float(&random) - 0.5f,
                                                         test_random_float(&random) - 0.5f});
        if (i % 5 == 0)
            ray.t_max = VALUES[i / 5 % VALUE_COUNT];
        source.has_grid = i % 4 != 0;
        scale = i % 7 == 0 ? 1e-20f : i % 7 == 1 ? 1e15f : i % 7 == 2 ? 0.0f : 1.0f;
        for (int axis = 0; axis < 3; axis++) {
            source.grid_size[axis] = i % 11 == 0 ? 1 : SIDE;
            source.grid_to_world.m[axis][axis] = scale;
        }
        medium = medium_made(&source, cells);
        medium_sample(medium, &ray, test_random_float(&random), &numbers, &event);
        assert_sane(event.weight, 3.0001f);
        assert_sane(event.emitted, 1e30f);
        assert_true(event.distance >= 0.0f && event.distance <= ray.t_max);
        assert_true(!event.scattered || event.distance < INFINITY);
        assert_sane(medium_transmittance(medium, &ray, &numbers), 1.0f);
        assert_true(isfinite(medium_phase(medium, 1)) && medium_phase(medium, 1) > 0);
        assert_true(isfinite(medium_phase(medium, -1.00001f)) && medium_phase(medium, -1) > 0);
        medium_free(medium);
    }
}

/* Optical depths of free paths, in float, against the C library in double. */
static void test_free_path_logarithm(void **state)
{
    (void)state;
    assert_true(medium_depth_of(0) == 0);
    for (uint32_t i = 1; i < 1u << 24; i += i < 4096 || i > (1u << 24) - 4096 ? 1 : 61) {
        const double u = ldexp((double)i, -24), depth = -log1p(-u);

        assert_true(fabs((double)medium_depth_of((float)u) - depth) <= 3e-7 * depth);
    }
}

static void test_out_of_memory(void **state)
{
    static const float cells[1] = {1};
    struct scene_medium source = medium_of(1, 1, 0);
    struct error err = {0};

    (void)state;
    source.has_grid = 1;
    source.grid_size[0] = source.grid_size[1] = source.grid_size[2] = 1;
    for (long n = 0; n < 2; n++) {
        struct render_medium *medium = (void *)&source;

        mem_fault_arm(n, 1);
        assert_int_equal(medium_new(&medium, &source, (const uint8_t *)(const void *)cells, &err),
                         STATUS_ERR_NO_MEMORY);
        mem_fault_arm(-1, 0);
        assert_null(medium);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_transmittance_is_beer_lamberts),
        cmocka_unit_test(test_absorber_never_scatters),
        cmocka_unit_test(test_free_path_logarithm),
        cmocka_unit_test(test_grey_free_path),
        cmocka_unit_test(test_chromatic_weights_add_up),
        cmocka_unit_test(test_emission_is_closed_form),
        cmocka_unit_test(test_phase_integrates_to_one),
        cmocka_unit_test(test_phase_sampling_inverts_the_distribution),
        cmocka_unit_test(test_even_grid_is_homogeneous_in_its_box),
        cmocka_unit_test(test_pure_function_of_its_numbers),
        cmocka_unit_test(test_hostile_values),
        cmocka_unit_test(test_out_of_memory),
    };

    return cmocka_run_group_tests_name("medium", tests, NULL, NULL);
}
