/* The wheat field that make_sky --field paints into a clear sky: the sky's light, and no more. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "scenes/sky/land.h"
#include "scenes/sky/sky.h"

#define PI 3.14159265358979323846
#define RAD(degrees) ((degrees) * (PI / 180))

static const struct sky_settings summer = {.width = 360,
                                           .height = 180,
                                           .sun_elevation_deg = 40,
                                           .sun_azimuth_deg = 325,
                                           .turbidity = 2.5,
                                           .ground_albedo = 0.2,
                                           .field = 1,
                                           .seed = 5};

static void make(struct image *map, struct sky_settings s)
{
    assert_int_equal(sky_make(map, &s, NULL, NULL), STATUS_OK);
}

static const float *texel(const struct image *map, uint32_t x, uint32_t y)
{
    return map->pixels + 3 * ((size_t)y * map->width + x);
}

static size_t bytes_of(const struct image *map) { return 3 * sizeof(float) * map->width * map->height; }

static void test_the_seed_is_the_field(void **state)
{
    struct sky_settings one = summer, other;
    struct image a, b, c;

    (void)state;
    one.width = 120;
    one.height = 60;
    other = one;
    other.seed = 6;
    make(&a, one);
    make(&b, one);
    make(&c, other);
    assert_memory_equal(a.pixels, b.pixels, bytes_of(&a));
    assert_true(memcmp(a.pixels, c.pixels, bytes_of(&a)) != 0);
    image_release(&a);
    image_release(&b);
    image_release(&c);
}

/* Rays are shared out to threads by chance: none may find anything that another one left. They look along the rows,
 * where some meet no plant for long. */
static void test_the_order_of_rays_does_not_matter(void **state)
{
    enum { RAYS = 6000 };
    static const struct daylight light = {.to_sun = {0.6, 0.8, 0}, .sun_lux = {5, 5, 5}, .sky_lux = {1, 1, 2}};
    static struct wheat wheat;
    static double forwards[RAYS][3];

    (void)state;
    wheat_init(&wheat, &light, 5);
    for (int n = 0; n < 2 * RAYS; n++) {
        int i = n < RAYS ? n : 2 * RAYS - 1 - n;
        double azimuth = RAD(92 + 10 * (i * 0.618 - floor(i * 0.618))), below = RAD(1.8 + 3.0 * i / RAYS), rgb[3];
        const double direction[3] = {cos(below) * cos(azimuth), -sin(below), cos(below) * sin(azimuth)};

        wheat_light(&wheat, direction, (WHEAT_EYE_M - WHEAT_TOP_M) / tan(below), 0, rgb);
        if (n < RAYS)
            memcpy(forwards[i], rgb, sizeof rgb);
        else
            assert_memory_equal(forwards[i], rgb, sizeof rgb);
    }
}

/* Also under a sun on the horizon, and below it. */
static void test_light_is_finite_and_positive(void **state)
{
    static const double elevations[] = {12, -3};

    (void)state;
    for (size_t e = 0; e < 2; e++) {
        struct sky_settings s = summer;
        struct image map;

        s.sun_elevation_deg = elevations[e];
        s.width = 120;
        s.height = 60;
        make(&map, s);
        for (size_t i = 0; i < 3 * (size_t)map.width * map.height; i++)
            assert_true(isfinite(map.pixels[i]) && map.pixels[i] > 0);
        image_release(&map);
    }
}

/* The field reflects a part of the light that falls on it: ripe wheat, about a fifth to a third,
 * redder than it comes. */
static void test_the_land_reflects_what_wheat_does(void **state)
{
    struct sky_settings s = summer;
    struct sky_report report;
    struct image map;
    double up[3] = {0, 0, 0}, lux;

    (void)state;
    assert_int_equal(sky_make(&map, &s, &report, NULL), STATUS_OK);
    for (uint32_t y = map.height / 2; y < map.height; y++)
        for (uint32_t x = 0; x < map.width; x++) {
            double below = PI * ((y + 0.5) / map.height - 0.5);
            double weight = sin(below) * cos(below) * (PI / map.height) * (2 * PI / map.width);

            for (int c = 0; c < 3; c++)
                up[c] += weight * (double)texel(&map, x, y)[c] * SKY_CANDELAS_PER_UNIT;
        }
    lux = 0.212656 * up[0] + 0.715158 * up[1] + 0.072186 * up[2];
    assert_true(lux / (report.sun_lux + report.sky_lux) > 0.08);
    assert_true(lux / (report.sun_lux + report.sky_lux) < 0.4);
    assert_true(up[0] > up[1] && up[1] > 1.5 * up[2]);
    image_release(&map);
}

/* Seen from the zenith: land below the horizon everywhere, somewhere 3.5 degrees over it, none over LAND_HIGHEST_RAD. */
static void test_the_land_ends_where_it_says(void **state)
{
    static struct land land;
    static struct daylight light;
    const double over[] = {LAND_HIGHEST_RAD, LAND_HIGHEST_RAD + RAD(0.3), LAND_HIGHEST_RAD + RAD(1), RAD(12)};
    double rgb[3];
    int high = 0;

    (void)state;
    light.to_sun[1] = 1;
    for (uint32_t seed = 1; seed < 40; seed++) {
        land = (struct land){.wheat = {.light = &light, .seed = seed, .along = {1, 0}}, .seed = seed};
        for (int i = 0; i < 720; i++) {
            double azimuth = RAD(i * 0.5);

            assert_true(land_light(&land, azimuth, RAD(-0.3), rgb));
            high += land_light(&land, azimuth, RAD(3.5), rgb) != 0;
            for (size_t k = 0; k < sizeof over / sizeof *over; k++)
                assert_false(land_light(&land, azimuth, over[k], rgb));
        }
    }
    assert_true(high > 0);
}

static void test_clouds_leave_the_sun_free(void **state)
{
    static const double azimuths[] = {0, 215};
    size_t covered = 0, sky = 0;

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        struct sky_settings s = summer, clear;
        struct image with, without;

        s.sun_azimuth_deg = azimuths[k];
        s.no_sun = 1;
        clear = s;
        clear.field = 0;
        make(&with, s);
        make(&without, clear);
        for (uint32_t y = 0; y < 70; y++) /* 20 degrees over the horizon */
            for (uint32_t x = 0; x < with.width; x++) {
                double e = RAD(90 - (y + 0.5)), a = RAD(x + 0.5 - 180), se = RAD(40);
                double cosine = sin(e) * sin(se) + cos(e) * cos(se) * cos(a - RAD(azimuths[k]));
                double change = fabs((double)texel(&with, x, y)[0] / (double)texel(&without, x, y)[0] - 1);

                if (cosine > cos(RAD(5)))
                    assert_true(change < 1e-5);
                covered += change > 0.02;
                sky++;
            }
        image_release(&with);
        image_release(&without);
    }
    /* Fair weather: some clouds, more sky. */
    assert_true(covered > 0.02 * (double)sky && covered < 0.5 * (double)sky);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_seed_is_the_field),
        cmocka_unit_test(test_the_order_of_rays_does_not_matter),
        cmocka_unit_test(test_light_is_finite_and_positive),
        cmocka_unit_test(test_the_land_reflects_what_wheat_does),
        cmocka_unit_test(test_the_land_ends_where_it_says),
        cmocka_unit_test(test_clouds_leave_the_sun_free),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
