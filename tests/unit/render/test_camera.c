/* The camera's rays, lens, shutter, pixel filter, projection, and the bounding sphere. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "common/math/elementary.h"
#include "common/scene/effects.h"
#include "tests/support/statistics.h"
#include "worker/render/base/bounds.h"
#include "worker/render/camera/camera.h"

static struct scene_camera looking_down_z(enum scene_camera_kind kind)
{
    struct scene_camera c = {.name = "c", .kind = kind, .yfov_rad = 1, .xmag = 3, .ymag = 2};

    c.to_world = (struct transform_d){{{1, 0, 0, 5}, {0, 1, 0, 6}, {0, 0, 1, 7}}};
    return c;
}

static void camera_of(struct camera *camera, const struct scene_camera *description, uint32_t width, uint32_t height)
{
    struct render_settings settings;

    render_settings_default(&settings);
    settings.width = width;
    settings.height = height;
    camera_init(camera, description, &settings, NULL);
}

/* Mean ray of a pixel over many samples: the filter is symmetric, so it is the centre's. */
static struct ray mean_ray(const struct camera *camera, uint32_t x, uint32_t y)
{
    enum { N = 4096 };
    struct vec3 origin = {0, 0, 0}, direction = {0, 0, 0};
    struct ray ray;

    for (uint32_t i = 0; i < N; i++) {
        struct sampler s;
        sampler_start(&s, 1, 0, x, y, 0, i);
        camera_ray(camera, x, y, &s, &ray);
        assert_true(fabsf(vec3_length(ray.direction) - 1) < 1e-6f);
        assert_true(ray.t_max == INFINITY);
        origin = vec3_mad(origin, ray.origin, 1.0f / N);
        direction = vec3_mad(direction, vec3_scale(ray.direction, -1 / ray.direction.z), 1.0f / N);
    }
    return (struct ray){.origin = origin, .direction = direction};
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
    camera_of(&camera, &description, 200, 100);
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
    camera_of(&camera, &description, 300, 100);
    r = mean_ray(&camera, 0, 99);
    near_to(r.direction.x, 0, 1e-6);
    near_to(r.direction.y, 0, 1e-6);
    /* Height is the camera's own 2 * ymag, width follows the picture. */
    near_to(r.origin.x, 5 + (2 * 0.5 / 300 - 1) * 6, 1e-3);
    near_to(r.origin.y, 6 + (1 - 2 * 99.5 / 100) * 2, 1e-3);
}

/* A filter's weight at x of -1..1, by its definition; the Gaussian's standard deviation is a third. */
static double weight_by_definition(enum pixel_filter filter, double x)
{
    double turn = M_PI * (x + 1);

    if (filter == PIXEL_FILTER_BOX)
        return 1;
    if (filter == PIXEL_FILTER_TRIANGLE)
        return 1 - fabs(x);
    if (filter == PIXEL_FILTER_GAUSSIAN)
        return exp(-9 * x * x / 2) - exp(-4.5);
    return 0.35875 - 0.48829 * cos(turn) + 0.14128 * cos(2 * turn) - 0.01168 * cos(3 * turn);
}

enum { BINS = 60, FILTERS = 7 };

/* p of one axis' counts, of n in all. */
static double filter_p_value(const double count[BINS], enum pixel_filter filter, double n)
{
    double expected[BINS] = {0}, total = 0, statistic = 0, pooled_e = 0, pooled_n = 0;
    int cells = 0;

    for (int i = 0; i < BINS; i++) {
        for (int j = 0; j < 50; j++)
            expected[i] += weight_by_definition(filter, 2 * (i + (j + 0.5) / 50) / BINS - 1);
        total += expected[i];
    }
    for (int i = 0; i < BINS; i++) {
        double e = expected[i] / total * n;
        if (e < 5) {
            pooled_e += e;
            pooled_n += count[i];
            continue;
        }
        statistic += (count[i] - e) * (count[i] - e) / e;
        cells++;
    }
    if (pooled_e > 0) {
        statistic += (pooled_n - pooled_e) * (pooled_n - pooled_e) / pooled_e;
        cells++;
    }
    return chi_square_p_value(statistic, cells - 1);
}

/* The filters' samples against their definitions: chi-square over 60 bins, two axes, family-wise level 0.01. */
static void test_filter(void **state)
{
    enum { N = 200000 };
    static const struct {
        enum pixel_filter filter;
        float width;   /* as it is set */
        double radius; /* as it should be */
    } cases[FILTERS] = {
        {PIXEL_FILTER_BLACKMAN_HARRIS, 0, 1.5}, {PIXEL_FILTER_BLACKMAN_HARRIS, 1.5f, 0.75}, {PIXEL_FILTER_BOX, 0, 0.5},
        {PIXEL_FILTER_BOX, 2, 1},               {PIXEL_FILTER_TRIANGLE, 0, 1},              {PIXEL_FILTER_TRIANGLE, 4, 2},
        {PIXEL_FILTER_GAUSSIAN, 0, 1.5},
    };
    struct scene_camera description = looking_down_z(CAMERA_ORTHOGRAPHIC);

    (void)state;
    description.ymag = 50; /* one pixel is one metre */
    description.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    for (int c = 0; c < FILTERS; c++) {
        double count[2][BINS] = {{0}}, radius = cases[c].radius;
        struct render_settings settings;
        struct camera camera;
        render_settings_default(&settings);
        settings.width = settings.height = 100;
        settings.pixel_filter = cases[c].filter;
        settings.filter_width = cases[c].width;
        assert_int_equal(render_settings_validate(&settings, 1, NULL), STATUS_OK);
        camera_init(&camera, &description, &settings, NULL);
        for (uint32_t i = 0; i < N; i++) {
            struct sampler s;
            struct ray ray;
            /* A frame each: independent samples, as the test wants them. */
            sampler_start(&s, 3 + (uint64_t)c, i, 50, 50, 0, 0);
            camera_ray(&camera, 50, 50, &s, &ray);
            for (int axis = 0; axis < 2; axis++) {
                double offset = axis ? -0.5 - (double)ray.origin.y : (double)ray.origin.x - 0.5;
                int bin = (int)floor((offset + radius) / (2 * radius) * BINS);
                assert_true(fabs(offset) <= radius + 0.0001);
                count[axis][bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin]++;
            }
        }
        for (int axis = 0; axis < 2; axis++) {
            double p = filter_p_value(count[axis], cases[c].filter, N);
            if (p < sidak_alpha(0.01, 2 * FILTERS))
                fail_msg("case %d, axis %d: p = %g", c, axis, p);
        }
    }
}

/* Of the rays of test_pinhole_bits, recorded before there were lenses. */
#define PINHOLE_HASH 0x4c02db8bu

/* Every bit of a pinhole camera's rays is as it was before there were lenses and shutters. */
static void test_pinhole_bits(void **state)
{
    struct scene_camera description = looking_down_z(CAMERA_PERSPECTIVE);
    struct render_settings settings;
    struct camera camera;
    uint32_t hash = 0;

    (void)state;
    render_settings_default(&settings);
    settings.width = 200;
    settings.height = 100;
    description.to_world = (struct transform_d){{{0.6f, 0, 0.8f, 1}, {0, 1, 0, 2}, {-0.8f, 0, 0.6f, 3}}};
    camera_init(&camera, &description, &settings, NULL);
    for (uint32_t i = 0; i < 1000; i++) {
        struct sampler s;
        struct ray ray;
        sampler_start(&s, 7, 0, i % 200, i / 10, 0, i);
        camera_ray(&camera, i % 200, i / 10, &s, &ray);
        assert_true(ray.time == 0);
        hash = hash_combine(hash, float_bits(ray.origin.x));
        hash = hash_combine(hash, float_bits(ray.direction.x));
        hash = hash_combine(hash, float_bits(ray.direction.y));
        hash = hash_combine(hash, float_bits(ray.direction.z));
    }
    if (hash != PINHOLE_HASH)
        fail_msg("the rays' hash is 0x%08x", hash);
}

/* A point in the sharp plane stays a point; one at another distance d becomes a disc of
 * diameter 2 R |1 - d / f|: the ray from the lens at q through s in the sharp plane is at
 * distance d at q + (s - q) d / f, so its spread is that of q (1 - d / f). Measured by second
 * moments: an axis of a uniform disc of radius R has variance R^2 / 4, of a regular polygon of
 * n corners R^2 (2 + cos(2 pi / n)) / 12. */
static void test_circle_of_confusion(void **state)
{
    enum { N = 1 << 14 };
    static const uint32_t blades[] = {0, 3, 5, 6, 8};

    (void)state;
    for (size_t k = 0; k < sizeof blades / sizeof *blades; k++)
        for (int kind = CAMERA_PERSPECTIVE; kind <= CAMERA_ORTHOGRAPHIC; kind++) {
            struct scene_camera description = looking_down_z((enum scene_camera_kind)kind);
            struct render_settings settings;
            struct camera camera;
            const double radius = 0.25, focus = 4, n = blades[k];
            double expected = n == 0 ? radius * radius / 4 : radius * radius * (2 + cos(2 * M_PI / n)) / 12;
            double distances[] = {2, 4, 10}, sum[3] = {0}, square[3] = {0};
            double furthest = 0;

            render_settings_default(&settings);
            settings.width = 200000; /* the pixel itself is a point */
            settings.height = 100000;
            description.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
            description.lens_radius = (float)radius;
            description.focus_distance = (float)focus;
            description.blades = blades[k];
            description.blade_rotation_rad = 0.3f;
            camera_init(&camera, &description, &settings, NULL);
            for (uint32_t i = 0; i < N; i++) {
                struct sampler s;
                struct ray ray;
                sampler_start(&s, 1, 0, 100000, 50000, 0, i);
                camera_ray(&camera, 100000, 50000, &s, &ray);
                assert_true(fabsf(ray.origin.z) < 1e-6f);
                furthest = fmax(furthest, hypot((double)ray.origin.x, (double)ray.origin.y));
                for (int d = 0; d < 3; d++) {
                    double t = -distances[d] / (double)ray.direction.z;
                    double x = (double)ray.origin.x + t * (double)ray.direction.x;
                    sum[d] += x / N;
                    square[d] += x * x / N;
                }
            }
            assert_true(furthest <= radius * 1.001 && furthest > radius * 0.95);
            for (int d = 0; d < 3; d++) {
                double variance = square[d] - sum[d] * sum[d];
                double scale = 1 - distances[d] / focus;
                double wanted = expected * scale * scale;
                if (fabs(variance - wanted) > 0.01 * expected * fabs(scale) + 1e-8)
                    fail_msg("%u blades, kind %d, distance %g: variance %g instead of %g", blades[k], kind,
                             distances[d], variance, wanted);
            }
        }
}

/* What is sharp lies in a plane across the axis, not on a sphere around the lens: from every point of the
 * lens, rays of a pixel at the picture's corner meet where the pinhole's ray pierces that plane. On the
 * sphere they would meet at 0.63 of that depth. */
static void test_focus_is_a_plane(void **state)
{
    enum { WIDE = 200000, HIGH = 100000, N = 256 };

    (void)state;
    for (int kind = CAMERA_PERSPECTIVE; kind <= CAMERA_ORTHOGRAPHIC; kind++) {
        struct scene_camera description = looking_down_z((enum scene_camera_kind)kind);
        struct render_settings settings;
        struct camera camera;
        const double focus = 4, half = kind == CAMERA_PERSPECTIVE ? tan(0.5) * focus : 2;

        render_settings_default(&settings);
        settings.width = WIDE; /* the pixel itself is a point */
        settings.height = HIGH;
        description.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
        description.lens_radius = 0.25f;
        description.focus_distance = (float)focus;
        camera_init(&camera, &description, &settings, NULL);
        for (uint32_t i = 0; i < N; i++) {
            struct sampler s;
            struct ray ray;
            double t;

            sampler_start(&s, 1, 0, WIDE - 1, 0, 0, i);
            camera_ray(&camera, WIDE - 1, 0, &s, &ray);
            t = -focus / (double)ray.direction.z;
            near_to((float)((double)ray.origin.x + t * (double)ray.direction.x), 2 * half, 1e-3);
            near_to((float)((double)ray.origin.y + t * (double)ray.direction.y), half, 1e-3);
        }
    }
}

/* The numbers of a pair lie evenly over the square, and so must what is made of them: for pixel and lens,
 * position along x must say nothing about position along y, nor the place on the lens about the moment.
 * Correlations of N independent samples: five two-sided tests, family-wise level 0.01. */
static void test_dimensions_are_independent(void **state)
{
    enum { N = 20000, WIDE = 100000, TESTS = 5 };
    static const struct transform steps[2] = {{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                              {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}}};
    const struct camera_motion motion = {1, 2, steps};
    struct scene_camera description = looking_down_z(CAMERA_ORTHOGRAPHIC);
    struct running_stats value[5] = {{0}}, product[TESTS] = {{0}};
    struct render_settings settings;
    struct camera camera;

    (void)state;
    render_settings_default(&settings);
    settings.width = settings.height = WIDE;
    description.ymag = WIDE / 2; /* a pixel is a metre, as the lens is */
    description.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    description.lens_radius = 1;
    description.focus_distance = 1;
    camera_init(&camera, &description, &settings, &motion);
    for (uint32_t i = 0; i < N; i++) {
        static const int pairs[TESTS][2] = {{0, 1}, {2, 3}, {0, 2}, {2, 4}, {3, 4}};
        struct sampler s;
        struct ray ray;
        double v[5];

        sampler_start(&s, 5, i, WIDE / 2, WIDE / 2, 0, 0);
        camera_ray(&camera, WIDE / 2, WIDE / 2, &s, &ray);
        /* Where it is in focus, the place on the film; of the origin, the rest. */
        v[0] = (double)(ray.origin.x - ray.direction.x / ray.direction.z) - 0.5;
        v[1] = (double)(ray.origin.y - ray.direction.y / ray.direction.z) + 0.5;
        v[2] = (double)ray.origin.x - v[0] - 0.5;
        v[3] = (double)ray.origin.y - v[1] + 0.5;
        v[4] = (double)ray.time - 0.5;
        for (int k = 0; k < 5; k++)
            running_stats_add(&value[k], v[k]);
        for (int k = 0; k < TESTS; k++) /* all means are 0 */
            running_stats_add(&product[k], v[pairs[k][0]] * v[pairs[k][1]]);
    }
    for (int k = 0; k < 5; k++)
        assert_true(running_stats_variance(&value[k]) > 0.01);
    for (int k = 0; k < TESTS; k++)
        if (mean_test_p_value(&product[k], 0) < sidak_alpha(0.01, TESTS))
            fail_msg("pair %d: mean product %g", k, product[k].mean);
}

/* Uniform over the polygon: chi-square over its triangular sectors cut by radius into parts of
 * equal area; and nothing outside. Independent samples; family-wise level 0.01. */
static void test_blades(void **state)
{
    enum { RINGS = 8, N = 100000, CASES = 4 };
    static const uint32_t blades[CASES] = {3, 4, 6, 9};

    (void)state;
    for (int k = 0; k < CASES; k++) {
        struct scene_camera description = looking_down_z(CAMERA_ORTHOGRAPHIC);
        struct render_settings settings;
        struct camera camera;
        uint32_t n = blades[k];
        static double count[9 * 2 * RINGS];
        double statistic = 0, p, e = (double)N / (n * 2 * RINGS), half = M_PI / n;

        memset(count, 0, sizeof count);
        render_settings_default(&settings);
        settings.width = settings.height = 1000000;
        description.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
        description.ymag = 1e-6f;
        description.blades = n;
        description.blade_rotation_rad = 0.7f;
        settings.lens_radius = 2; /* the job's own */
        settings.focus_distance = 5;
        camera_init(&camera, &description, &settings, NULL);
        for (uint32_t i = 0; i < N; i++) {
            struct sampler s;
            struct ray ray;
            double angle, reach, ring;
            int sector;
            sampler_start(&s, 11, i, 500000, 500000, 0, 0);
            camera_ray(&camera, 500000, 500000, &s, &ray);
            angle = atan2((double)ray.origin.y, (double)ray.origin.x) - (double)0.7f;
            angle -= 2 * M_PI * floor(angle / (2 * M_PI));
            /* Half sectors: their boundaries are the corners and the middles of the edges. */
            sector = (int)(angle / half) % (int)(2 * n);
            reach = sqrt((double)ray.origin.x * (double)ray.origin.x + (double)ray.origin.y * (double)ray.origin.y) *
                    cos(angle - (2 * floor(angle / (2 * half)) + 1) * half) / (2 * cos(half));
            assert_true(reach <= 1 + 1e-5);
            ring = floor(reach * reach * RINGS);
            count[sector * RINGS + (ring >= RINGS ? RINGS - 1 : (int)ring)]++;
        }
        for (uint32_t i = 0; i < n * 2 * RINGS; i++)
            statistic += (count[i] - e) * (count[i] - e) / e;
        p = chi_square_p_value(statistic, (int)(n * 2 * RINGS) - 1);
        if (p < sidak_alpha(0.01, CASES))
            fail_msg("%u blades: chi-square %g, p = %g", n, statistic, p);
    }
}

/* A job can do without: the pinhole's rays come out. And a round lens is uniform: the mean
 * of r^2 is R^2 / 2. */
static void test_round_lens(void **state)
{
    enum { N = 4096 };
    struct scene_camera description = looking_down_z(CAMERA_PERSPECTIVE), pinhole = description;
    struct render_settings settings;
    struct camera camera, without, plain;
    double square = 0;

    (void)state;
    render_settings_default(&settings);
    settings.width = settings.height = 1000;
    description.to_world = pinhole.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    description.lens_radius = 0.5f;
    description.focus_distance = 3;
    camera_init(&camera, &description, &settings, NULL);
    camera_init(&plain, &pinhole, &settings, NULL);
    settings.without = EFFECT_DEPTH_OF_FIELD;
    camera_init(&without, &description, &settings, NULL);
    settings.without = 0;
    for (uint32_t i = 0; i < N; i++) {
        struct sampler s;
        struct ray ray, a = {0}, b = {0}; /* compared as bytes */
        sampler_start(&s, 1, 0, 10, 10, 0, i);
        camera_ray(&camera, 10, 10, &s, &ray);
        camera_ray(&without, 10, 10, &s, &a);
        camera_ray(&plain, 10, 10, &s, &b);
        assert_memory_equal(&a, &b, sizeof a);
        square += (double)ray.origin.x * (double)ray.origin.x + (double)ray.origin.y * (double)ray.origin.y;
    }
    near_to((float)(square / N), 0.125, 1e-3);
    settings.lens_radius = 0; /* the job asks for a pinhole */
    camera_init(&camera, &description, &settings, NULL);
    assert_true(camera.lens_radius == 0);
}

/* The six axes: -Z in the middle, +X a quarter to the right, -X to the left, +Z at both edges,
 * +Y at the top, -Y at the bottom. */
static void test_panorama(void **state)
{
    static const struct { uint32_t x, y; double d[3]; } axes[] = {
        {200, 100, {0, 0, -1}}, {300, 100, {1, 0, 0}},  {100, 100, {-1, 0, 0}},
        {0, 100, {0, 0, 1}},    {400, 100, {0, 0, 1}},  {200, 0, {0, 1, 0}},
        {200, 200, {0, -1, 0}}, {37, 200, {0, -1, 0}},
    };
    struct scene_camera description = looking_down_z(CAMERA_PANORAMA);
    struct camera camera;

    (void)state;
    description.to_world = (struct transform_d){{{1, 0, 0, 1}, {0, 1, 0, 2}, {0, 0, 1, 3}}};
    camera_of(&camera, &description, 400, 200);
    for (size_t k = 0; k < sizeof axes / sizeof *axes; k++) {
        double mean[3] = {0};
        enum { N = 4096 };
        /* The mean of four pixels that meet in the point; beyond the picture's edge they are
         * those of the other side, or none is needed: the filter is symmetric. */
        for (int corner = 0; corner < 4; corner++)
            for (uint32_t i = 0; i < N; i++) {
                struct sampler s;
                struct ray ray;
                uint32_t x = axes[k].x + (uint32_t)(corner & 1) - 1, y = axes[k].y + (uint32_t)(corner >> 1) - 1;
                x = (x + 400) % 400;
                y = y == UINT32_MAX ? 0 : y == 200 ? 199 : y;
                sampler_start(&s, 1, 0, x, y, 0, i);
                camera_ray(&camera, x, y, &s, &ray);
                assert_true(ray.origin.x == 1 && ray.origin.y == 2 && ray.origin.z == 3);
                assert_true(fabsf(vec3_length(ray.direction) - 1) < 1e-6f);
                mean[0] += (double)ray.direction.x / (4 * N);
                mean[1] += (double)ray.direction.y / (4 * N);
                mean[2] += (double)ray.direction.z / (4 * N);
            }
        for (int a = 0; a < 3; a++)
            if (fabs(mean[a] - axes[k].d[a]) > (axes[k].d[1] != 0 ? 2e-2 : 1e-3))
                fail_msg("(%u, %u): axis %d is %g instead of %g", axes[k].x, axes[k].y, a, mean[a], axes[k].d[a]);
    }
}

/* What a ray sees is projected back to where the ray came from, by every kind of camera, at
 * any moment. */
static void test_project(void **state)
{
    static const struct transform steps[3] = {
        {{{1, 0, 0, 5}, {0, 1, 0, 6}, {0, 0, 1, 7}}},
        {{{0.8f, 0, 0.6f, 5.5f}, {0, 1, 0, 6}, {-0.6f, 0, 0.8f, 7}}},
        {{{0.6f, 0, 0.8f, 6}, {0, 1, 0, 7}, {-0.8f, 0, 0.6f, 7}}},
    };
    const struct camera_motion motion = {1, 3, steps};

    (void)state;
    for (int kind = 0; kind < CAMERA_KIND_COUNT; kind++) {
        struct scene_camera description = looking_down_z((enum scene_camera_kind)kind);
        struct render_settings settings;
        struct camera camera;
        double earliest = 1, latest = 0;

        render_settings_default(&settings);
        settings.width = 120;
        settings.height = 60;
        camera_init(&camera, &description, &settings, &motion);
        for (uint32_t i = 0; i < 2000; i++) {
            uint32_t x = i % 120, y = i * 7 % 60;
            struct sampler s;
            struct ray ray;
            float pixel[2], wrapped;
            sampler_start(&s, 2, 0, x, y, 0, i);
            camera_ray(&camera, x, y, &s, &ray);
            earliest = fmin(earliest, (double)ray.time);
            latest = fmax(latest, (double)ray.time);
            assert_true(ray.time >= 0 && ray.time < 1);
            assert_true(camera_project(&camera, vec3_mad(ray.origin, ray.direction, 9), ray.time, pixel));
            wrapped = pixel[0];
            if (kind == CAMERA_PANORAMA && fabsf(wrapped - ((float)x + 0.5f)) > 60)
                wrapped += wrapped > 60 ? -120.0f : 120.0f;
            if (kind == CAMERA_PANORAMA && (y < 3 || y > 56))
                continue; /* the filter crosses the pole */
            if (fabsf(wrapped - ((float)x + 0.5f)) > 1.51f || fabsf(pixel[1] - ((float)y + 0.5f)) > 1.51f)
                fail_msg("kind %d, pixel (%u, %u): projected to (%g, %g)", kind, x, y, (double)pixel[0],
                         (double)pixel[1]);
        }
        assert_true(earliest < 0.01 && latest > 0.99);
        if (kind != CAMERA_PANORAMA) {
            float pixel[2];
            assert_int_equal(camera_project(&camera, vec3_make(5, 6, 8), 0, pixel), 0);
        }
    }
}

/* At a step the camera is at the step's own place; in between its frame stays orthonormal and its
 * place is on the chord. */
static void test_moving_camera(void **state)
{
    struct transform steps[5];
    struct camera_motion motion = {1, 5, steps};
    struct scene_camera description = looking_down_z(CAMERA_PERSPECTIVE);
    struct render_settings settings;
    struct camera camera, still;
    float shift[2];

    (void)state;
    for (int i = 0; i < 5; i++) {
        double a = 0.4 * i;
        steps[i] = (struct transform){{{(float)cos(a), 0, (float)sin(a), (float)i},
                                       {0, 1, 0, (float)(i * i)},
                                       {(float)-sin(a), 0, (float)cos(a), 0}}};
    }
    render_settings_default(&settings);
    settings.width = settings.height = 100;
    camera_init(&camera, &description, &settings, &motion);
    for (int i = 0; i <= 4; i++) {
        struct transform at = camera_to_world_at(&camera, (float)i / 4);
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 4; c++)
                near_to(at.m[r][c], (double)steps[i].m[r][c], 1e-6);
    }
    for (int i = 0; i <= 100; i++) {
        struct transform at = camera_to_world_at(&camera, (float)i / 100);
        double place = i / 25.0, low = floor(place), f = place - low;
        for (int a = 0; a < 3; a++)
            for (int b = a; b < 3; b++)
                near_to(at.m[0][a] * at.m[0][b] + at.m[1][a] * at.m[1][b] + at.m[2][a] * at.m[2][b], a == b, 1e-6);
        near_to(at.m[0][3], place, 1e-5);
        near_to(at.m[1][3], low * low * (1 - f) + (low + 1) * (low + 1) * f, 1e-4);
        /* The turn is that of the angle, but for the chord's own: below 0.02 of a step. */
        near_to(at.m[0][2], sin(0.1 * i * 0.16), 2e-3);
    }
    /* A closed shutter: the opening's place for every ray. */
    motion.shutter_open = 0;
    camera_init(&still, &description, &settings, &motion);
    assert_int_equal(still.motion_steps, 0);
    assert_true(camera_motion_vector(&still, vec3_make(5, 6, -3), vec3_make(5, 6, -3), shift));
    assert_true(shift[0] == 0 && shift[1] == 0);
    /* Moved by one metre to the right ten metres away: so many pixels. */
    assert_true(camera_motion_vector(&still, vec3_make(5, 6, -3), vec3_make(6, 5, -3), shift));
    near_to(shift[0], 50 / (10 * tan(0.5)), 1e-3);
    near_to(shift[1], 50 / (10 * tan(0.5)), 1e-3);
}

/* The filter of a pixel at the panorama's seam reaches over to the other edge: its rays spread as far to both
 * sides as those of any other pixel. */
static void test_panorama_seam(void **state)
{
    enum { N = 4096, WIDE = 400, HIGH = 200 };
    static const uint32_t columns[] = {0, WIDE - 1, WIDE / 2};
    struct scene_camera description = looking_down_z(CAMERA_PANORAMA);
    double spread[3][2] = {{0}};
    struct camera camera;

    (void)state;
    description.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    camera_of(&camera, &description, WIDE, HIGH);
    for (size_t k = 0; k < 3; k++)
        for (uint32_t i = 0; i < N; i++) {
            struct sampler s;
            struct ray ray;
            double turn;

            sampler_start(&s, 1, 0, columns[k], HIGH / 2, 0, i);
            camera_ray(&camera, columns[k], HIGH / 2, &s, &ray);
            /* Pixels from the middle of this one, to the right. */
            turn = (atan2((double)ray.direction.x, -(double)ray.direction.z) / (2 * M_PI) + 0.5) * WIDE;
            turn -= (double)columns[k] + 0.5;
            turn -= WIDE * rint(turn / WIDE);
            spread[k][turn > 0] += turn * turn / N;
        }
    for (size_t k = 0; k < 3; k++)
        for (int side = 0; side < 2; side++)
            near_to((float)spread[k][side], spread[2][side], 0.01 * spread[2][side]);
}

/* What crosses the panorama's seam goes the short way. */
static void test_motion_across_the_seam(void **state)
{
    struct scene_camera description = looking_down_z(CAMERA_PANORAMA);
    struct camera camera;
    float motion[2];

    (void)state;
    description.to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
    camera_of(&camera, &description, 360, 180); /* a pixel is a degree */
    for (int k = 0; k < 4; k++) {
        double degrees = k < 2 ? 175 : 20, turned = k % 2 ? -10 : 10, a = degrees * M_PI / 180,
               b = (degrees + turned) * M_PI / 180;

        assert_true(camera_motion_vector(&camera, vec3_make((float)sin(a), 0, (float)-cos(a)),
                                         vec3_make((float)sin(b), 0, (float)-cos(b)), motion));
        near_to(motion[0], turned, 1e-3);
        near_to(motion[1], 0, 1e-3);
    }
}

/* With a lens as without, a ray begins where the camera is at the ray's own moment, and its place on the lens
 * is as far from there as the lens reaches; and what stands still moves on the picture as the camera travels. */
static void test_moving_lens(void **state)
{
    static const struct transform steps[2] = {{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                              {{{1, 0, 0, 8}, {0, 1, 0, 0}, {0, 0, 1, 0}}}};
    const struct camera_motion motion = {1, 2, steps};
    struct scene_camera description = looking_down_z(CAMERA_PERSPECTIVE);
    struct render_settings settings;
    struct camera camera;
    float shift[2];

    (void)state;
    render_settings_default(&settings);
    settings.width = settings.height = 100;
    description.lens_radius = 0.25f;
    description.focus_distance = 3;
    camera_init(&camera, &description, &settings, &motion);
    for (uint32_t i = 0; i < 500; i++) {
        struct sampler s;
        struct ray ray;

        sampler_start(&s, 1, 0, 20, 20, 0, i);
        camera_ray(&camera, 20, 20, &s, &ray);
        assert_true(fabsf(ray.origin.x - 8 * ray.time) < 0.2501f);
    }
    /* 8 metres to the left, seen 10 metres away. */
    assert_true(camera_motion_vector(&camera, vec3_make(0, 0, -10), vec3_make(0, 0, -10), shift));
    near_to(shift[0], -8 * 50 / (10 * tan(0.5)), 1e-3);
    near_to(shift[1], 0, 1e-4);
    assert_true(camera_motion_vector(&camera, vec3_make(0, 0, -10), vec3_make(8, 0, -10), shift));
    near_to(shift[0], 0, 1e-4); /* it moves with the camera */
}

/* The beam of a pixel's ray is half a pixel wide wherever it is met. */
static void test_cone(void **state)
{
    struct scene_camera description = looking_down_z(CAMERA_PERSPECTIVE);
    struct camera camera;
    struct camera_cone cone;

    (void)state;
    camera_of(&camera, &description, 200, 100);
    cone = camera_cone(&camera);
    near_to(cone.width, 0, 0);
    near_to(cone.spread, tan(0.5) / 100, 1e-7);
    description.kind = CAMERA_ORTHOGRAPHIC;
    camera_of(&camera, &description, 200, 100);
    cone = camera_cone(&camera);
    near_to(cone.width, 0.02, 1e-7);
    near_to(cone.spread, 0, 0);
    description.kind = CAMERA_PANORAMA;
    camera_of(&camera, &description, 200, 100);
    cone = camera_cone(&camera);
    near_to(cone.spread, M_PI / 200, 1e-7);
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
            points[i] = vec3_make(shift + scale * test_random_float(&random), scale * test_random_float(&random),
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
        cmocka_unit_test(test_pinhole_bits),
        cmocka_unit_test(test_circle_of_confusion),
        cmocka_unit_test(test_focus_is_a_plane),
        cmocka_unit_test(test_dimensions_are_independent),
        cmocka_unit_test(test_blades),
        cmocka_unit_test(test_round_lens),
        cmocka_unit_test(test_panorama),
        cmocka_unit_test(test_project),
        cmocka_unit_test(test_moving_camera),
        cmocka_unit_test(test_panorama_seam),
        cmocka_unit_test(test_motion_across_the_seam),
        cmocka_unit_test(test_moving_lens),
        cmocka_unit_test(test_cone),
        cmocka_unit_test(test_sphere),
    };
    return cmocka_run_group_tests_name("camera", tests, NULL, NULL);
}
