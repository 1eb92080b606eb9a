/* The environment light: orientation, rotation, seam and poles against a slow reference;
 * sample, radiance and pdf against each other; odd maps, extreme numbers, hostile values. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "tests/support/statistics.h"
#include "worker/render/light/environment/environment.h"

static struct image make_map(uint32_t width, uint32_t height)
{
    struct image map;
    struct error err = {0};

    if (image_init(&map, width, height, 3, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    return map;
}

static void set_texel(struct image *map, uint32_t column, uint32_t row, float r, float g, float b)
{
    float *p = map->pixels + 3 * ((size_t)row * map->width + column);

    p[0] = r;
    p[1] = g;
    p[2] = b;
}

/* Random texels over six decades; `zeros` of 100 are black. */
static struct image random_map(uint32_t width, uint32_t height, uint64_t seed, int zeros)
{
    struct image map = make_map(width, height);
    struct test_random random = {seed};

    for (size_t i = 0; i < (size_t)width * height; i++)
        for (int c = 0; c < 3; c++) {
            double value = pow(10, -3 + 6 * test_random_double(&random));

            map.pixels[3 * i + (size_t)c] = (float)value;
            if (c == 2 && test_random_u64(&random) % 100 < (uint64_t)zeros)
                memset(map.pixels + 3 * i, 0, 3 * sizeof(float));
        }
    return map;
}

static struct environment *environment_of(struct image map, float rotate_deg, float strength,
                                          enum env_sampling sampling)
{
    struct environment *env;
    struct error err = {0};

    if (environment_new(&env, &map, NULL, rotate_deg, vec3_splat(strength), sampling, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_null(map.pixels);
    return env;
}

static struct vec3 random_direction(struct test_random *random)
{
    double y = 2 * test_random_double(random) - 1, phi = 2 * PI_D * test_random_double(random);
    double r = sqrt(1 - y * y);

    return vec3_make((float)(r * cos(phi)), (float)y, (float)(r * sin(phi)));
}

/* Direction of map coordinates, as environment.h documents them, without rotation. */
static struct vec3 direction_at(double u, double v)
{
    double phi = 2 * PI_D * (u - 0.5), theta = PI_D * v;

    return vec3_make((float)(sin(theta) * cos(phi)), (float)cos(theta), (float)(sin(theta) * sin(phi)));
}

static struct vec3 rotate_y(struct vec3 d, double degrees)
{
    double a = degrees * PI_D / 180, c = cos(a), s = sin(a);

    /* Counter-clockwise seen from +Y: +X goes to -Z. */
    return vec3_make((float)(c * (double)d.x + s * (double)d.z), d.y, (float)(-s * (double)d.x + c * (double)d.z));
}

static void assert_near(double got, double want, double tolerance)
{
    if (!(fabs(got - want) <= tolerance))
        fail_msg("%.9g is not %.9g +- %.3g", got, want, tolerance);
}

static void assert_vec3_near(struct vec3 got, struct vec3 want, double tolerance)
{
    assert_near((double)got.x, (double)want.x, tolerance);
    assert_near((double)got.y, (double)want.y, tolerance);
    assert_near((double)got.z, (double)want.z, tolerance);
}

/* ---- orientation -------------------------------------------------------------------------- */

static const struct vec3 axes[6] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0},
                                    {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
static const struct vec3 colors[6] = {{1, 0, 0}, {0, 1, 1}, {0, 1, 0},
                                      {1, 0, 1}, {0, 0, 1}, {1, 1, 0}};

/* Patches where the documented coordinates put the axes: +X at u 0.5, -Z at 0.25, +Z at 0.75,
 * -X at the seam, +Y in the top rows, -Y in the bottom ones. */
static struct image patch_map(void)
{
    struct image map = make_map(64, 32);

    for (uint32_t y = 0; y < 32; y++)
        for (uint32_t x = 0; x < 64; x++) {
            int axis = y < 6 ? 2 : y >= 26 ? 3 : x < 8 || x >= 56 ? 1 : x < 24 ? 5 : x < 40 ? 0 : 4;

            set_texel(&map, x, y, colors[axis].x, colors[axis].y, colors[axis].z);
        }
    return map;
}

static void test_six_patches(void **state)
{
    struct environment *env = environment_of(patch_map(), 0, 1, ENV_SAMPLING_IMPORTANCE);

    (void)state;
    for (int i = 0; i < 6; i++)
        assert_vec3_near(environment_radiance(env, axes[i]), colors[i], 1e-6);
    environment_free(env);

    /* Turned by 90 degrees counter-clockwise: what stood at +X stands at -Z, and so on round. */
    env = environment_of(patch_map(), 90, 1, ENV_SAMPLING_IMPORTANCE);
    assert_vec3_near(environment_radiance(env, vec3_make(0, 0, -1)), colors[0], 1e-6);
    assert_vec3_near(environment_radiance(env, vec3_make(-1, 0, 0)), colors[5], 1e-6);
    assert_vec3_near(environment_radiance(env, vec3_make(0, 0, 1)), colors[1], 1e-6);
    assert_vec3_near(environment_radiance(env, vec3_make(1, 0, 0)), colors[4], 1e-6);
    assert_vec3_near(environment_radiance(env, vec3_make(0, 1, 0)), colors[2], 1e-6);
    assert_vec3_near(environment_radiance(env, vec3_make(0, -1, 0)), colors[3], 1e-6);
    environment_free(env);
}

/* Any rotation, also beyond a turn and backwards: radiance and pdf in the turned direction
 * are those of the unturned map, and samples come from where the light is. */
static void test_rotation(void **state)
{
    static const float angles[] = {0, 37, 90, 180, 270, 360, -45, 725, 359.99f};
    struct environment *plain = environment_of(random_map(16, 8, 5, 0), 0, 1, ENV_SAMPLING_IMPORTANCE);

    (void)state;
    for (size_t a = 0; a < sizeof angles / sizeof *angles; a++) {
        struct environment *env = environment_of(random_map(16, 8, 5, 0), angles[a], 1, ENV_SAMPLING_IMPORTANCE);
        struct environment *patches = environment_of(patch_map(), angles[a], 1, ENV_SAMPLING_IMPORTANCE);
        struct test_random random = {7};
        int across = 0;

        for (int i = 0; i < 2000; i++) {
            struct vec3 d = random_direction(&random), turned = rotate_y(d, (double)angles[a]);
            struct vec3 sampled, radiance;
            float pdf, want = environment_pdf(plain, d);

            assert_vec3_near(environment_radiance(env, turned), environment_radiance(plain, d), 0.02);
            /* Rounding of the turned direction may lead over the edge of a cell. */
            across += fabsf(environment_pdf(env, turned) - want) > 1e-3f * want + 1e-5f;
            assert_true(environment_sample(patches, test_random_float(&random), test_random_float(&random), &sampled,
                                           &radiance, &pdf));
            sampled = rotate_y(sampled, -(double)angles[a]);
            if (sampled.x > 0.8f)
                assert_vec3_near(radiance, colors[0], 1e-5);
            if (sampled.z < -0.8f)
                assert_vec3_near(radiance, colors[5], 1e-5);
        }
        assert_true(across <= 4);
        environment_free(env);
        environment_free(patches);
    }
    environment_free(plain);
}

/* The map's own axes: a direction goes through the job's rotation backwards, then through the
 * matrix; what is not a rotation is refused. */
static void test_own_axes(void **state)
{
    /* World y is the map's z, world z is the map's x, world x the map's y. */
    static const float axes_of_map[3][3] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};
    static const float scaled[3][3] = {{1, 0, 0}, {0, 1.1f, 0}, {0, 0, 1}};
    struct image map = patch_map();
    struct environment *env;
    struct error err = {0};
    struct test_random random = {3};

    (void)state;
    assert_int_equal(environment_new(&env, &map, axes_of_map, 90, vec3_make(1, 2, 3), ENV_SAMPLING_IMPORTANCE, &err),
                     STATUS_OK);
    /* Turned by 90 degrees, +X stands at -Z: a ray along -Z sees what +X saw, the map's +Y. */
    assert_vec3_near(environment_radiance(env, vec3_make(0, 0, -1)), vec3_make(0, 2, 0), 1e-5);
    assert_vec3_near(environment_radiance(env, vec3_make(0, 1, 0)), vec3_make(0, 0, 3), 1e-5);
    assert_vec3_near(environment_radiance(env, vec3_make(1, 0, 0)), vec3_make(1, 0, 0), 1e-5);
    for (int k = 0; k < 2000; k++) {
        struct vec3 d, radiance;
        float pdf;

        assert_true(
            environment_sample(env, test_random_float(&random), test_random_float(&random), &d, &radiance, &pdf));
        assert_vec3_near(environment_radiance(env, d), radiance, 1e-2);
    }
    environment_free(env);
    map = patch_map();
    assert_int_equal(environment_new(&env, &map, scaled, 0, vec3_splat(1), ENV_SAMPLING_IMPORTANCE, &err),
                     STATUS_ERR_INPUT);
    assert_null(map.pixels);
}

/* ---- lookups ------------------------------------------------------------------------------ */

/* Texel of any column and row by the definition: periodic in u, over a pole to (u + 1/2,
 * mirrored v); half a column off where the width is odd. */
static double reference_texel(const float *pixels, long width, long height, double column, long row, int channel)
{
    long first;
    double t;

    if (row < 0 || row >= height) {
        row = row < 0 ? -1 - row : 2 * height - 1 - row;
        column += (double)width / 2;
    }
    first = (long)floor(column);
    t = column - (double)first;
    return (1 - t) * (double)pixels[3 * (row * width + (first % width + width) % width) + channel] +
           t * (double)pixels[3 * (row * width + ((first + 1) % width + width) % width) + channel];
}

static void test_lookup_against_reference(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {1, 6}, {6, 1}, {2, 1},
                                        {7, 3}, {8, 4}, {3, 8}, {5, 5}};
    struct test_random random = {11};

    (void)state;
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        uint32_t width = sizes[s][0], height = sizes[s][1];
        struct image map = random_map(width, height, s, 30), copy = make_map(width, height);
        struct environment *env;

        memcpy(copy.pixels, map.pixels, (size_t)width * height * 3 * sizeof(float));
        env = environment_of(map, 0, 1, ENV_SAMPLING_UNIFORM);
        for (int i = 0; i < 5000; i++) {
            double u = test_random_double(&random), v = test_random_double(&random);
            double x = u * width - 0.5, y, ty, want[3];
            long row;
            struct vec3 got;

            if (i % 4 == 0) /* near a pole, and at it */
                v = i % 8 == 0 ? v * 1e-4 : 1 - v * 1e-4;
            y = v * height - 0.5;
            row = (long)floor(y);
            ty = y - (double)row;
            got = environment_radiance(env, direction_at(u, v));
            for (int c = 0; c < 3; c++) {
                double a = reference_texel(copy.pixels, width, height, floor(x), row, c);
                double b = reference_texel(copy.pixels, width, height, floor(x) + 1, row, c);
                double d = reference_texel(copy.pixels, width, height, floor(x), row + 1, c);
                double e = reference_texel(copy.pixels, width, height, floor(x) + 1, row + 1, c);
                double tx = x - floor(x);

                want[c] = (1 - ty) * ((1 - tx) * a + tx * b) + ty * ((1 - tx) * d + tx * e);
            }
            /* Texels reach 1000 and a direction in float is good to some 1e-7 of a turn (at the
             * nadir v itself is only good to 1e-4 of its distance). */
            assert_near((double)got.x, want[0], 0.01);
            assert_near((double)got.y, want[1], 0.01);
            assert_near((double)got.z, want[2], 0.01);
        }
        environment_free(env);
        image_release(&copy);
    }
}

/* A step over the pole along a great circle, and a step over the seam, change little. (Columns
 * of an odd width do not face columns; the pole then joins two slightly different mixtures.) */
static void test_poles_and_seam_are_continuous(void **state)
{
    static const uint32_t widths[] = {1, 2, 6, 8, 34};
    struct test_random random = {3};

    (void)state;
    for (size_t w = 0; w < sizeof widths / sizeof *widths; w++) {
        struct environment *env = environment_of(random_map(widths[w], 6, w, 0), 20, 1, ENV_SAMPLING_IMPORTANCE);

        for (int i = 0; i < 500; i++) {
            double phi = 2 * PI_D * test_random_double(&random), e = 1e-6;
            float c = (float)(e * cos(phi)), s = (float)(e * sin(phi));
            float y = test_random_float(&random) * 1.8f - 0.9f;
            struct vec3 seam = rotate_y(vec3_normalize(vec3_make(-1, y, 0)), 20);
            struct vec3 across = rotate_y(vec3_normalize(vec3_make(-1, y, 4e-7f)), 20);
            struct vec3 before = rotate_y(vec3_normalize(vec3_make(-1, y, -4e-7f)), 20);

            for (int pole = -1; pole <= 1; pole += 2)
                assert_vec3_near(environment_radiance(env, vec3_make(c, (float)pole, s)),
                                 environment_radiance(env, vec3_make(-c, (float)pole, -s)), 0.02);
            assert_vec3_near(environment_radiance(env, seam), environment_radiance(env, across), 0.05);
            assert_vec3_near(environment_radiance(env, seam), environment_radiance(env, before), 0.05);
        }
        environment_free(env);
    }
}

/* ---- density ------------------------------------------------------------------------------ */

struct density_case {
    const char *name;
    uint32_t width, height;
    int zeros;            /* of 100; -1: one lit texel, -2: constant */
    uint32_t column, row; /* of the lit texel */
};

static const struct density_case density_cases[] = {
    {"1x1", 1, 1, -2, 0, 0},       {"1x6", 1, 6, 0, 0, 0},       {"6x1", 6, 1, 0, 0, 0},
    {"2x1", 2, 1, 0, 0, 0},        {"3x2 constant", 3, 2, -2, 0, 0}, {"4x2", 4, 2, 0, 0, 0},
    {"16x8", 16, 8, 0, 0, 0},      {"17x9 sparse", 17, 9, 80, 0, 0}, {"7x20", 7, 20, 50, 0, 0},
    {"equator", 100, 10, -1, 30, 5}, {"zenith", 8, 6, -1, 2, 0},   {"nadir", 7, 6, -1, 6, 5},
    {"one of two", 2, 1, -1, 1, 0},
};
enum { DENSITY_CASES = sizeof density_cases / sizeof *density_cases };

static struct environment *density_environment(int i, float rotate_deg)
{
    const struct density_case *c = &density_cases[i];
    struct image map;

    if (c->zeros >= 0) {
        map = random_map(c->width, c->height, (uint64_t)i + 100, c->zeros);
    } else {
        map = make_map(c->width, c->height);
        if (c->zeros == -1)
            set_texel(&map, c->column, c->row, 2, 3, 4);
        for (uint32_t t = 0; c->zeros == -2 && t < c->width * c->height; t++)
            set_texel(&map, t % c->width, t / c->width, 1, 2, 3);
    }
    return environment_of(map, rotate_deg, 1, ENV_SAMPLING_IMPORTANCE);
}

/* What sample() says of its direction is what radiance() and pdf() say of it. */
static void test_sample_agrees(void **state)
{
    (void)state;
    for (int i = 0; i < DENSITY_CASES; i++) {
        struct environment *env = density_environment(i, 30.0f * (float)i);
        struct test_random random = {(uint64_t)i};
        int drawn = 0, across = 0;

        for (int k = 0; k < 40000; k++) {
            float u = test_random_float(&random), v = test_random_float(&random), pdf, again;
            struct vec3 d, radiance, seen;
            double scale;

            if (!environment_sample(env, u, v, &d, &radiance, &pdf))
                continue;
            drawn++;
            assert_true(pdf > 0 && isfinite(pdf) && vec3_is_finite(radiance));
            assert_near((double)vec3_length(d), 1, 3e-7);
            again = environment_pdf(env, d);
            across += fabsf(again - pdf) > 1e-4f * pdf; /* the edge of a cell */
            seen = environment_radiance_pdf(env, d, &again);
            assert_true(again == environment_pdf(env, d));
            assert_true(memcmp(&seen, &(struct vec3){0, 0, 0}, sizeof seen) == 0 || vec3_luminance(radiance) > 0);
            scale = fmax((double)vec3_max(radiance), 1);
            assert_vec3_near(seen, radiance, 1e-4 * scale + 2e-5 * 1000);
            seen = environment_radiance(env, d);
            assert_vec3_near(seen, radiance, 1e-4 * scale + 2e-5 * 1000);
        }
        assert_true(drawn > 39990 && across < 40);
        environment_free(env);
    }
}

/* The integral of the density over the sphere is 1: midpoints of a 2000 x 1000 grid. */
static void test_density_integrates_to_one(void **state)
{
    enum { U = 1000, V = 2000 };

    (void)state;
    for (int i = 0; i < DENSITY_CASES; i++) {
        struct environment *env = density_environment(i, 0);
        double sum = 0;

        for (int a = 0; a < V; a++)
            for (int b = 0; b < U; b++) {
                double u = (b + 0.5) / U, v = (a + 0.5) / V;

                sum += (double)environment_pdf(env, direction_at(u, v)) * sin(PI_D * v);
            }
        sum *= 2 * PI_D * PI_D / U / V;
        if (fabs(sum - 1) > 3e-3) /* the grid of midpoints cuts cells unevenly */
            fail_msg("%s: the density integrates to %.6f", density_cases[i].name, sum);
        environment_free(env);
    }
}

/* No direction that is much brighter than the mean has density 0, at the poles and next to lit
 * texels neither; none at all where the map is constant. */
static void test_density_covers_radiance(void **state)
{
    int lit = 0;

    (void)state;
    for (int i = 0; i < DENSITY_CASES; i++) {
        struct environment *env = density_environment(i, 0);
        struct test_random random = {(uint64_t)i + 50};

        for (int k = 0; k < 60000; k++) {
            struct vec3 d = random_direction(&random), radiance;
            float pdf;

            if (k % 3 == 0) { /* around a pole, down to it */
                float r = powf(10.0f, -8.0f * test_random_float(&random));

                d = vec3_normalize(vec3_make(d.x * r, k % 2 ? 1.0f : -1.0f, d.z * r));
            }
            if (k < 4)
                d = vec3_make(0, k % 2 ? 1.0f : -1.0f, 0);
            radiance = environment_radiance_pdf(env, d, &pdf);
            assert_true(isfinite(pdf) && pdf >= 0);
            if (density_cases[i].zeros == -2 || vec3_luminance(radiance) > 5 * environment_mean_luminance(env)) {
                assert_true(pdf > 0);
                lit++;
            }
        }
        environment_free(env);
    }
    assert_true(lit > 10000);
}

/* One lit texel of 100 x 10: radiance / pdf hardly varies between samples, and its mean is the
 * light above the mean, which is nearly all. */
static void test_weight_of_one_lit_texel(void **state)
{
    struct image map = make_map(100, 10);
    struct environment *env;
    struct test_random random = {1};
    struct running_stats stats = {0};
    double total;

    (void)state;
    set_texel(&map, 30, 4, 1, 1, 1);
    env = environment_of(map, 0, 1, ENV_SAMPLING_IMPORTANCE);
    total = 4 * PI_D * (double)environment_mean_luminance(env);
    for (int k = 0; k < 50000; k++) {
        struct vec3 d, radiance;
        float pdf, u = test_random_float(&random), v = test_random_float(&random);

        assert_true(environment_sample(env, u, v, &d, &radiance, &pdf));
        assert_true((double)radiance.x / (double)pdf < 4 * total);
        running_stats_add(&stats, (double)radiance.x / (double)pdf);
    }
    assert_near(stats.mean, total, 0.01 * total);
    assert_true(running_stats_variance(&stats) < 0.05 * total * total);
    environment_free(env);
}

/* A sun of two by two texels in a sky of 1024 x 512: it gets a window of its own, in which a
 * sample's weight hardly varies, and the sky a coarse grid. */
static void test_sun_has_a_window(void **state)
{
    struct image map = make_map(1024, 512);
    struct test_random random = {4};
    struct environment *env;
    struct running_stats stats = {0};
    uint32_t columns, windows;

    (void)state;
    for (uint32_t y = 0; y < 512; y++)
        for (uint32_t x = 0; x < 1024; x++)
            set_texel(&map, x, y, 1, 1, y < 256 ? 1.5f : 0.5f);
    for (uint32_t k = 0; k < 4; k++) /* across the seam */
        set_texel(&map, (1023 + k % 2) % 1024, 100 + k / 2, 1e5f, 1e5f, 1e5f);
    env = environment_of(map, 77, 1, ENV_SAMPLING_IMPORTANCE);
    environment_importance(env, &columns, &windows);
    assert_int_equal(windows, 1);
    assert_true(columns <= 256);
    for (int k = 0; k < 20000; k++) {
        struct vec3 d, radiance;
        float pdf;

        assert_true(
            environment_sample(env, test_random_float(&random), test_random_float(&random), &d, &radiance, &pdf));
        if (radiance.x > 1e4f)
            running_stats_add(&stats, (double)radiance.x / (double)pdf);
    }
    assert_true(stats.count > 5000);
    assert_true(running_stats_variance(&stats) < 0.03 * stats.mean * stats.mean);
    environment_free(env);
}

/* ---- modes and odd maps ------------------------------------------------------------------- */

static void test_modes(void **state)
{
    struct test_random random = {21};
    struct environment *uniform = environment_of(random_map(8, 4, 1, 0), 45, 1, ENV_SAMPLING_UNIFORM);
    struct environment *bsdf = environment_of(random_map(8, 4, 1, 0), 45, 1, ENV_SAMPLING_BSDF);

    (void)state;
    for (int k = 0; k < 5000; k++) {
        float u = test_random_float(&random), v = test_random_float(&random), pdf;
        struct vec3 d, radiance;

        assert_true(environment_sample(uniform, u, v, &d, &radiance, &pdf));
        assert_near((double)vec3_length(d), 1, 3e-7);
        assert_near((double)pdf, 1 / (4 * PI_D), 1e-8);
        assert_true(environment_pdf(uniform, d) == pdf);
        assert_vec3_near(environment_radiance(uniform, d), radiance, 0);
        assert_false(environment_sample(bsdf, u, v, &d, &radiance, &pdf));
        assert_true(environment_pdf(bsdf, random_direction(&random)) == 0);
    }
    assert_true(environment_radiance(bsdf, axes[0]).x > 0);
    assert_true(environment_bytes(bsdf) < environment_bytes(uniform) + 1);
    environment_free(uniform);
    environment_free(bsdf);
}

/* What a light sample reads after its shadow ray arrived is what the sample would have read at once; a map
 * with a black texel is read at once. */
static void test_late_reading(void **state)
{
    struct test_random random = {25};

    (void)state;
    for (int mode = 0; mode < ENV_SAMPLING_COUNT; mode++)
        for (int zeros = 0; zeros < 2; zeros++) {
            struct image map = random_map(16, 8, 3, 0);
            struct environment *env;

            if (zeros)
                set_texel(&map, 15, 7, 0, 1e-40f, 0); /* times a weight, it may be 0 */
            env = environment_of(map, 30, 1, mode);
            assert_int_equal(environment_has_black(env), zeros);
            for (int k = 0; k < 1000; k++) {
                float u = test_random_float(&random), v = test_random_float(&random), pdf, late_pdf;
                struct vec3 d, late_d, radiance;
                int found = environment_sample(env, u, v, &d, &radiance, &pdf);

                assert_int_equal(environment_aim(env, u, v, &late_d, &late_pdf), found);
                assert_true(late_pdf == pdf);
                if (found) {
                    assert_vec3_near(late_d, d, 0);
                    assert_vec3_near(environment_radiance(env, late_d), radiance, 0);
                    assert_false(vec3_is_black(radiance));
                }
            }
            environment_free(env);
        }
}

static void test_constant(void **state)
{
    struct error err = {0};

    (void)state;
    for (int mode = 0; mode < ENV_SAMPLING_COUNT; mode++) {
        struct environment *env;
        struct vec3 d, radiance;
        float pdf;
        int sampled;

        assert_int_equal(environment_new_constant(&env, vec3_make(1, 2, 3), mode, &err), STATUS_OK);
        assert_false(environment_is_black(env));
        sampled = environment_sample(env, 0.3f, 0.7f, &d, &radiance, &pdf);
        assert_int_equal(sampled, mode != ENV_SAMPLING_BSDF);
        if (sampled) {
            assert_near((double)pdf, 1 / (4 * PI_D), 1e-8);
            assert_vec3_near(radiance, vec3_make(1, 2, 3), 0);
        }
        assert_true(environment_pdf(env, axes[3]) == pdf);
        assert_vec3_near(environment_radiance(env, axes[2]), vec3_make(1, 2, 3), 0);
        assert_near((double)environment_mean_luminance(env), (double)vec3_luminance(vec3_make(1, 2, 3)), 1e-6);
        environment_free(env);

        assert_int_equal(environment_new_constant(&env, vec3_splat(0), mode, &err), STATUS_OK);
        assert_true(environment_is_black(env));
        assert_false(environment_sample(env, 0.3f, 0.7f, &d, &radiance, &pdf));
        assert_true(environment_pdf(env, axes[0]) == 0);
        environment_free(env);
    }
}

static void assert_black(struct environment *env)
{
    struct vec3 d, radiance;
    float pdf;

    assert_true(environment_is_black(env));
    assert_false(environment_sample(env, 0.5f, 0.5f, &d, &radiance, &pdf));
    assert_true(environment_pdf(env, axes[1]) == 0);
    assert_true(vec3_is_black(environment_radiance(env, axes[1])));
    assert_true(environment_mean_luminance(env) == 0);
    environment_free(env);
}

static void test_black_and_strength(void **state)
{
    (void)state;
    for (int mode = 0; mode < ENV_SAMPLING_COUNT; mode++) {
        struct environment *one, *five;

        assert_black(environment_of(make_map(4, 2), 10, 1, mode));
        assert_black(environment_of(random_map(4, 2, 1, 0), 10, 0, mode));
        one = environment_of(random_map(4, 2, 1, 0), 10, 1, mode);
        five = environment_of(random_map(4, 2, 1, 0), 10, 5, mode);
        for (int a = 0; a < 6; a++) {
            double want = 5 * (double)environment_radiance(one, axes[a]).y;
            double pdf = (double)environment_pdf(one, axes[a]);

            assert_near((double)environment_radiance(five, axes[a]).y, want, 1e-6 * want);
            assert_near((double)environment_pdf(five, axes[a]), pdf, 1e-6 * pdf);
        }
        environment_free(one);
        environment_free(five);
    }
}

/* Numbers at the ends of [0, 1) on maps with black borders give a sample in the light, or
 * none where it would fall on a node of density 0. */
static void test_extreme_numbers(void **state)
{
    static const float extremes[] = {0.0f, 0x1p-149f, 0x1p-32f, 0x1p-24f, 0.5f, 0.99999f,
                                     ONE_MINUS_EPSILON};

    (void)state;
    for (int i = 0; i < DENSITY_CASES; i++) {
        struct environment *env = density_environment(i, 0);

        for (int a = 0; a < 7; a++)
            for (int b = 0; b < 7; b++) {
                struct vec3 d, radiance;
                float pdf;

                if (environment_sample(env, extremes[a], extremes[b], &d, &radiance, &pdf)) {
                    assert_true(pdf > 0 && isfinite(pdf) && vec3_is_finite(radiance));
                    assert_near((double)vec3_length(d), 1, 3e-7);
                } else { /* only at the very edge */
                    assert_true(a == 0 || b == 0 || a == 1 || b == 1 || a == 6 || b == 6);
                }
            }
        environment_free(env);
    }
}

/* 8192 x 4096, a hundred million floats: indices, precision and the table hold. */
static void test_large_map(void **state)
{
    struct image map = make_map(8192, 4096);
    struct environment *env;
    struct test_random random = {2};
    struct vec3 sun = direction_at(7000.5 / 8192, 4001.5 / 4096);
    double sum = 0;

    (void)state;
    set_texel(&map, 7000, 4001, 1e6f, 1e6f, 1e6f);
    env = environment_of(map, 0, 1, ENV_SAMPLING_IMPORTANCE);
    assert_near((double)environment_radiance(env, sun).x, 1e6, 2e3);
    for (int k = 0; k < 1000; k++) {
        struct vec3 d, radiance;
        float pdf, u = test_random_float(&random), v = test_random_float(&random);

        assert_true(environment_sample(env, u, v, &d, &radiance, &pdf));
        assert_true(vec3_length(vec3_sub(d, sun)) < 2 * PI_F / 4096);
        sum += (double)radiance.x / (double)pdf / 1000;
    }
    assert_near(sum / (4 * PI_D * (double)environment_mean_luminance(env)), 1, 0.05);
    environment_free(env);
}

/* The mean luminance is the integral of the bilinear radiance over the sphere. */
static void test_mean_luminance(void **state)
{
    enum { U = 500, V = 2000 };

    (void)state;
    for (int i = 0; i < DENSITY_CASES; i++) {
        struct environment *env = density_environment(i, 0);
        double sum = 0, norm = 0;

        for (int a = 0; a < V; a++)
            for (int b = 0; b < U; b++) {
                double v = (a + 0.5) / V, u = (b + 0.5) / U;

                sum += (double)vec3_luminance(environment_radiance(env, direction_at(u, v))) * sin(PI_D * v);
                norm += sin(PI_D * v);
            }
        sum /= norm;
        assert_near((double)environment_mean_luminance(env), sum, 1e-3 * sum);
        if (density_cases[i].zeros == -2) /* constant: exact for any size */
            assert_near((double)environment_mean_luminance(env), (double)vec3_luminance(vec3_make(1, 2, 3)), 1e-6);
        environment_free(env);
    }
}

/* ---- hostile values ----------------------------------------------------------------------- */

static void test_texels_that_are_no_radiance(void **state)
{
    struct test_random random = {77};
    struct image map = make_map(6, 3);
    struct environment *env;

    (void)state;
    for (uint32_t i = 0; i < 18; i++)
        set_texel(&map, i % 6, i / 6, 1, 1, 1);
    set_texel(&map, 0, 0, NAN, 1, 1);
    set_texel(&map, 1, 1, -5, -INFINITY, 1);
    set_texel(&map, 2, 2, INFINITY, FLT_MAX, FLT_MAX);
    env = environment_of(map, 0, 10, ENV_SAMPLING_IMPORTANCE);
    assert_true(isfinite(environment_mean_luminance(env)));
    for (int k = 0; k < 20000; k++) {
        float u = test_random_float(&random), v = test_random_float(&random), pdf;
        struct vec3 d = random_direction(&random), radiance = environment_radiance_pdf(env, d, &pdf);

        assert_true(vec3_is_finite(radiance) && vec3_min(radiance) >= 0);
        assert_true(isfinite(pdf) && pdf >= 0);
        if (environment_sample(env, u, v, &d, &radiance, &pdf))
            assert_true(vec3_is_finite(radiance) && isfinite(pdf) && pdf > 0);
    }
    environment_free(env);

    /* The smallest floats are light too. */
    map = make_map(4, 4);
    set_texel(&map, 2, 1, 0x1p-149f, 0x1p-149f, 0x1p-149f);
    env = environment_of(map, 0, 1, ENV_SAMPLING_IMPORTANCE);
    assert_false(environment_is_black(env));
    assert_true(environment_pdf(env, direction_at(2.5 / 4, 1.5 / 4)) > 0);
    environment_free(env);
}

static void test_no_direction(void **state)
{
    static const struct vec3 none[] = {{0, 0, 0}, {NAN, 0, 1}, {0, INFINITY, 0}, {1, 1, -INFINITY},
                                       {NAN, NAN, NAN}};
    struct environment *env = environment_of(random_map(6, 3, 9, 0), 0, 1, ENV_SAMPLING_IMPORTANCE);

    (void)state;
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        float pdf = 1;

        assert_true(vec3_is_black(environment_radiance(env, none[i])));
        assert_true(vec3_is_black(environment_radiance_pdf(env, none[i], &pdf)));
        assert_true(pdf == 0);
    }
    environment_free(env);
}

static void test_bad_arguments(void **state)
{
    static const float bad[][2] = {{NAN, 1}, {INFINITY, 1}, {0, NAN}, {0, -1}, {0, INFINITY}};
    struct environment *env;
    struct error err = {0};
    struct image map;
    int succeeded = 0;

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        map = make_map(2, 2);
        assert_int_equal(environment_new(&env, &map, NULL, bad[i][0], vec3_splat(bad[i][1]), ENV_SAMPLING_UNIFORM,
                                         &err),
                         STATUS_ERR_INPUT);
        assert_null(env);
        assert_null(map.pixels);
    }
    assert_int_equal(image_init(&map, 2, 2, 4, &err), STATUS_OK);
    assert_int_equal(environment_new(&env, &map, NULL, 0, vec3_splat(1), ENV_SAMPLING_UNIFORM, &err),
                     STATUS_ERR_INPUT);
    assert_null(map.pixels);
    assert_int_equal(
        environment_new_constant(&env, vec3_make(1, -1, 0), ENV_SAMPLING_UNIFORM, &err),
        STATUS_ERR_INPUT);
    assert_int_equal(
        environment_new_constant(&env, vec3_make(1, NAN, 0), ENV_SAMPLING_UNIFORM, &err),
        STATUS_ERR_INPUT);

    for (long n = 0; n < 100 && !succeeded; n++) {
        status st;

        map = random_map(4, 2, 1, 0);
        mem_fault_arm(n, 1);
        st = environment_new(&env, &map, NULL, 0, vec3_splat(1), ENV_SAMPLING_IMPORTANCE, &err);
        succeeded = mem_fault_count() == 0;
        mem_fault_arm(-1, 0);
        assert_int_equal(st, succeeded ? STATUS_OK : STATUS_ERR_NO_MEMORY);
        assert_null(map.pixels);
    }
    assert_true(succeeded);
    environment_free(env);
    environment_free(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_six_patches),
        cmocka_unit_test(test_rotation),
        cmocka_unit_test(test_lookup_against_reference),
        cmocka_unit_test(test_poles_and_seam_are_continuous),
        cmocka_unit_test(test_sample_agrees),
        cmocka_unit_test(test_density_integrates_to_one),
        cmocka_unit_test(test_density_covers_radiance),
        cmocka_unit_test(test_weight_of_one_lit_texel),
        cmocka_unit_test(test_sun_has_a_window),
        cmocka_unit_test(test_own_axes),
        cmocka_unit_test(test_modes),
        cmocka_unit_test(test_late_reading),
        cmocka_unit_test(test_constant),
        cmocka_unit_test(test_black_and_strength),
        cmocka_unit_test(test_extreme_numbers),
        cmocka_unit_test(test_large_map),
        cmocka_unit_test(test_mean_luminance),
        cmocka_unit_test(test_texels_that_are_no_radiance),
        cmocka_unit_test(test_no_direction),
        cmocka_unit_test(test_bad_arguments),
    };

    return cmocka_run_group_tests_name("environment", tests, NULL, NULL);
}
