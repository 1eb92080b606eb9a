/* The camera's rays, the pixel filter and the bounding sphere. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/statistics.h"
#include "worker/render/bounds.h"
#include "worker/render/camera.h"

static struct scene_camera looking_down_z(enum scene_camera_kind kind)
{
    struct scene_camera c = {.name = "c", .kind = kind, .yfov_rad = 1, .xmag = 3, .ymag = 2};

    c.to_world = (struct transform){{{1, 0, 0, 5}, {0, 1, 0, 6}, {0, 0, 1, 7}}};
    return c;
}

/* Mean ray of a pixel over many samples: the filter is symmetric, so it is the centre's. */
static struct ray mean_ray(const struct camera *camera, uint32_t x, uint32_t y)
{
    enum { N = 4096 };
    struct vec3 origin = {0, 0, 0}, direction = {0, 0, 0};
    struct ray ray;

    for (uint32_t i = 0; i < N; i++) {
        struct sampler s;
        sampler_start(&s, 1, 0, x, y, i);
        camera_ray(camera, x, y, &s, &ray);
        assert_true(fabsf(vec3_length(ray.direction) - 1) < 1e-6f);
        assert_true(ray.t_max == INFINITY);
        origin = vec3_mad(origin, ray.origin, 1.0f / N);
        direction = vec3_mad(direction, vec3_scale(ray.direction, -1 / ray.direction.z), 1.0f / N);
    }
    return (struct ray){origin, direction, 0, 0};
}

static void near_to(float got, double expected, double tolerance)
{
    if (fabs((double)got - expected) > tolerance)
        fail_msg("%g instead of %g", (double)got, expected);
}

static void test_perspective(void **state)
{
    struct scene_camera description = looking_down_z(CAMERA_PERSPECTIVE);
    struct camera camera;
    struct ray r;
    double half = tan(0.5);

    (void)state;
    camera_init(&camera, &description, 200, 100);
    /* Pixel (0, 0) is the upper left one: to the left (-x) and up (+y). */
    r = mean_ray(&camera, 0, 0);
    near_to(r.direction.x, (2 * 0.5 / 200 - 1) * half * 2, 1e-4);
    near_to(r.direction.y, (1 - 2 * 0.5 / 100) * half, 1e-4);
    near_to(r.origin.x, 5, 1e-4);
    near_to(r.origin.y, 6, 1e-4);
    near_to(r.origin.z, 7, 1e-4);
    r = mean_ray(&camera, 199, 99);
    near_to(r.direction.x, (2 * 199.5 / 200 - 1) * half * 2, 1e-4);
    near_to(r.direction.y, (1 - 2 * 99.5 / 100) * half, 1e-4);
}

static void test_orthographic(void **state)
{
    struct scene_camera description = looking_down_z(CAMERA_ORTHOGRAPHIC);
    struct camera camera;
    struct ray r;

    (void)state;
    camera_init(&camera, &description, 300, 100);
    r = mean_ray(&camera, 0, 99);
    near_to(r.direction.x, 0, 1e-6);
    near_to(r.direction.y, 0, 1e-6);
    /* Height is the camera's own 2 * ymag, width follows the picture. */
    near_to(r.origin.x, 5 + (2 * 0.5 / 300 - 1) * 6, 1e-3);
    near_to(r.origin.y, 6 + (1 - 2 * 99.5 / 100) * 2, 1e-3);
}

/* The filter's samples against the Blackman-Harris window: chi-square over 60 bins, two
 * axes, family-wise level 0.01. */
static void test_filter(void **state)
{
    enum { BINS = 60, N = 200000 };
    static double expected[BINS], count[2][BINS];
    struct scene_camera description = looking_down_z(CAMERA_ORTHOGRAPHIC);
    struct camera camera;
    double total = 0;

    (void)state;
    description.ymag = 50; /* one pixel is one metre */
    description.to_world = (struct transform){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    camera_init(&camera, &description, 100, 100);
    for (int i = 0; i < BINS; i++)
        for (int j = 0; j < 50; j++) {
            double turn = 2 * M_PI * (i + (j + 0.5) / 50) / BINS;
            expected[i] += 0.35875 - 0.48829 * cos(turn) + 0.14128 * cos(2 * turn) -
                           0.01168 * cos(3 * turn);
        }
    for (int i = 0; i < BINS; i++)
        total += expected[i];
    for (uint32_t i = 0; i < N; i++) {
        struct sampler s;
        struct ray ray;
        /* A frame each: independent samples, as the test wants them. */
        sampler_start(&s, 3, i, 50, 50, 0);
        camera_ray(&camera, 50, 50, &s, &ray);
        for (int axis = 0; axis < 2; axis++) {
            double offset = axis ? -0.5 - (double)ray.origin.y : (double)ray.origin.x - 0.5;
            int bin = (int)floor((offset + 1.5) / 3 * BINS);
            assert_true(offset >= -1.5001 && offset <= 1.5001);
            count[axis][bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin]++;
        }
    }
    for (int axis = 0; axis < 2; axis++) {
        double statistic = 0, pooled_e = 0, pooled_n = 0, p;
        int cells = 0;
        for (int i = 0; i < BINS; i++) {
            double e = expected[i] / total * N;
            if (e < 5) {
                pooled_e += e;
                pooled_n += count[axis][i];
                continue;
            }
            statistic += (count[axis][i] - e) * (count[axis][i] - e) / e;
            cells++;
        }
        if (pooled_e > 0) {
            statistic += (pooled_n - pooled_e) * (pooled_n - pooled_e) / pooled_e;
            cells++;
        }
        p = chi_square_p_value(statistic, cells - 1);
        if (p < sidak_alpha(0.01, 2))
            fail_msg("axis %d: chi-square %g with %d cells, p = %g", axis, statistic, cells, p);
    }
}

static void test_sphere(void **state)
{
    struct test_random random = {5};

    (void)state;
    assert_true(sphere_around(NULL, 0).radius == 0);
    for (int set = 0; set < 200; set++) {
        struct vec3 points[40];
        int n = 1 + set % 40;
        float scale = (float)pow(10, set % 11 - 5), shift = set % 3 ? 0 : 100 * scale;
        struct sphere s;

        for (int i = 0; i < n; i++)
            points[i] = vec3_make(shift + scale * test_random_float(&random),
                                  scale * test_random_float(&random),
                                  scale * test_random_float(&random) - shift);
        s = sphere_around(points, (size_t)n);
        for (int i = 0; i < n; i++)
            assert_true(vec3_length(vec3_sub(points[i], s.centre)) <= s.radius);
        /* The points lie in a cube: no sphere need be larger than 1.2 of the cube's. */
        assert_true(s.radius <= 1.2f * scale * 0.8661f + 1e-5f * shift);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_perspective),
        cmocka_unit_test(test_orthographic),
        cmocka_unit_test(test_filter),
        cmocka_unit_test(test_sphere),
    };
    return cmocka_run_group_tests_name("camera", tests, NULL, NULL);
}
