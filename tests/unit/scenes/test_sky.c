/* The sky generator: the sun's light must not depend on the map's size, and the sky must be
 * one that could be. The generator is no library, so its sources are compiled in here. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "scenes/sky/atmosphere.c"
#undef PI
#define split sky_split /* both files have a private one of this name */
#include "scenes/sky/sky.c"

static const struct sky_settings noon = {.width = 256, .height = 128, .sun_elevation_deg = 50,
                                         .sun_azimuth_deg = 30, .turbidity = 2.5,
                                         .ground_albedo = 0.2};

static double texel_solid_angle(const struct image *m, uint32_t y)
{
    return 2 * PI / m->width * (cos(PI * y / m->height) - cos(PI * (y + 1.0) / m->height));
}

/* Luminance times solid angle over the texels brighter than `above`. */
static double flux(const struct image *m, double above)
{
    double sum = 0;

    for (uint32_t y = 0; y < m->height; y++)
        for (uint32_t x = 0; x < m->width; x++) {
            const float *p = m->pixels + 3 * ((size_t)y * m->width + x);
            const double rgb[3] = {(double)p[0], (double)p[1], (double)p[2]};

            if (luminance(rgb) > above)
                sum += luminance(rgb) * texel_solid_angle(m, y);
        }
    return sum;
}

/* The sun alone: the map with it less the map without. */
static double sun_flux(struct sky_settings s, struct sky_report *report)
{
    struct image with, without;
    double result;

    assert_int_equal(sky_make(&with, &s, report, NULL), STATUS_OK);
    s.no_sun = 1;
    assert_int_equal(sky_make(&without, &s, NULL, NULL), STATUS_OK);
    result = flux(&with, 0) - flux(&without, 0);
    image_release(&with);
    image_release(&without);
    return result;
}

static void test_sun_is_conserved(void **state)
{
    static const uint32_t sizes[][2] = {{64, 32}, {333, 171}, {512, 256}};
    static const double elevations[] = {90, 12};

    (void)state;
    for (size_t e = 0; e < 2; e++) {
        struct sky_settings s = noon;
        struct sky_report report;
        double first = 0;

        s.sun_elevation_deg = elevations[e];
        for (size_t i = 0; i < 3; i++) {
            double here;

            s.width = sizes[i][0];
            s.height = sizes[i][1];
            here = sun_flux(s, &report);
            if (i == 0)
                first = here;
            assert_true(fabs(here / first - 1) < 0.002);
        }
        /* And it is what the report says falls on the ground. */
        assert_true(fabs(first * SKY_CANDELAS_PER_UNIT * sin(elevations[e] * PI / 180) / report.sun_lux - 1) < 0.01);
    }
}

static void test_sun_stands_where_it_should(void **state)
{
    static const double azimuths[] = {0, 90, 200};

    (void)state;
    for (size_t i = 0; i < sizeof azimuths / sizeof *azimuths; i++) {
        struct sky_settings s = noon;
        struct image map;
        double mean[3] = {0, 0, 0}, length, a = azimuths[i] * PI / 180, e = 50 * PI / 180, cosine;

        s.sun_azimuth_deg = azimuths[i];
        assert_int_equal(sky_make(&map, &s, NULL, NULL), STATUS_OK);
        for (uint32_t y = 0; y < map.height; y++)
            for (uint32_t x = 0; x < map.width; x++) {
                double light = (double)map.pixels[3 * (y * map.width + x) + 1];
                /* The renderer's own convention (worker/render/light/environment/environment.h). */
                double phi = 2 * PI * ((x + 0.5) / map.width - 0.5);
                double theta = PI * (y + 0.5) / map.height;

                if (light < 100)
                    continue;
                mean[0] += light * sin(theta) * cos(phi);
                mean[1] += light * cos(theta);
                mean[2] += light * sin(theta) * sin(phi);
            }
        length = sqrt(mean[0] * mean[0] + mean[1] * mean[1] + mean[2] * mean[2]);
        assert_true(length > 0);
        cosine = (mean[0] * cos(e) * cos(a) + mean[1] * sin(e) + mean[2] * cos(e) * sin(a)) / length;
        assert_true(acos(fmin(cosine, 1)) < 1.5 * PI / 180); /* a texel is 1.4 degrees */
        image_release(&map);
    }
}

/* Clear-sky values of daylight: tens of kilolux from the sun, 5 to 30 from the sky, which is
 * bluer than the sun; a low sun is weaker and redder. */
static void test_light_is_plausible(void **state)
{
    struct sky_settings s = noon;
    struct sky_report high, low, clean;
    struct image map;
    const float *zenith;

    (void)state;
    assert_int_equal(sky_make(&map, &s, &high, NULL), STATUS_OK);
    zenith = map.pixels;
    assert_true(zenith[2] > 1.3f * zenith[0]);
    assert_true(zenith[1] > 0.1f && zenith[1] < 1.5f);
    assert_true(high.sun_lux > 50e3 && high.sun_lux < 100e3);
    assert_true(high.sky_lux > 5e3 && high.sky_lux < 30e3);
    image_release(&map);
    s.sun_elevation_deg = 3;
    assert_int_equal(sky_make(&map, &s, &low, NULL), STATUS_OK);
    assert_true(low.sun_lux < 0.1 * high.sun_lux);
    image_release(&map);
    s = noon;
    s.turbidity = 1;
    assert_int_equal(sky_make(&map, &s, &clean, NULL), STATUS_OK);
    assert_true(clean.sun_lux > high.sun_lux && clean.sky_lux < high.sky_lux);
    image_release(&map);
}

static void test_every_value_is_light(void **state)
{
    static const double elevations[] = {-5, 0, 0.1, 90};
    static const uint32_t sizes[][2] = {{1, 1}, {1, 7}, {9, 1}, {65, 33}};

    (void)state;
    for (size_t e = 0; e < 4; e++) {
        struct sky_settings s = noon;
        struct image map;

        s.sun_elevation_deg = elevations[e];
        s.width = sizes[e][0];
        s.height = sizes[e][1];
        s.turbidity = e == 1 ? 1 : 10;
        assert_int_equal(sky_make(&map, &s, NULL, NULL), STATUS_OK);
        for (size_t k = 0; k < (size_t)map.width * map.height * 3; k++)
            assert_true(map.pixels[k] >= 0.0f && map.pixels[k] < 1e6f);
        image_release(&map);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sun_is_conserved),
        cmocka_unit_test(test_sun_stands_where_it_should),
        cmocka_unit_test(test_light_is_plausible),
        cmocka_unit_test(test_every_value_is_light),
    };
    return cmocka_run_group_tests_name("sky", tests, NULL, NULL);
}
