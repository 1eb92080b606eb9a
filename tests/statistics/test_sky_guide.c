/* The environment's guide: its samples follow the density that it claims (chi-square, family-wise level 0.01, Sidak), it
 * aims where light arrives, and it holds only where the pilot has been and where it helps. The pilot is made up here: light
 * arrives from a cone. */
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
#include "worker/render/light/environment/environment_light.h"

enum { POINTS = 400, SIDE = 20, TRIES = 20000 };

/* Points on a square of the floor, 2 m wide around the origin, and on its other side. */
struct made_up {
    struct pilot_point points[POINTS];
    struct vec3 axis; /* of the cone */
    real cosine;      /* of its opening, -1: all arrives */
    struct environment_light light;
};

static real arrives(void *user, uint32_t point, struct vec3 direction)
{
    const struct made_up *m = user;

    assert_true(vec3_dot(direction, m->points[point].n) > 0);
    return vec3_dot(direction, m->axis) >= m->cosine ? 1 : 0;
}

enum { MAP_CONSTANT, MAP_COARSE, MAP_SKY, MAP_SUN, MAPS };
static const struct {
    const char *name;
    int width, height;
} maps[MAPS] = {{"constant", 0, 0}, {"16x8", 16, 8}, {"a sky", 512, 256}, {"a sky with a sun", 512, 256}};
enum { SUN_ROW = 90 };

static void make(struct made_up *m, int map, real opening_deg)
{
    const int width = maps[map].width, height = maps[map].height;
    struct test_random random = {77};
    struct sky_pilot pilot = {m->points, POINTS, arrives, m, 3, 1};
    struct error err = {0};
    struct image image;

    memset(m, 0, sizeof *m);
    m->axis = vec3_normalize(vec3_make(1, 0.8f, 0.3f));
    m->cosine = (real)cos((double)opening_deg * PI_D / 180);
    for (int i = 0; i < POINTS; i++) {
        m->points[i].p = vec3_make((real)(i % SIDE) / SIDE * 2 - 1, 0, (real)(i / SIDE) / (POINTS / SIDE) * 2 - 1);
        m->points[i].n = vec3_make(0, 1, 0);
    }
    if (map == MAP_CONSTANT) {
        assert_int_equal(environment_new_constant((struct environment **)(void *)&m->light.map, vec3_splat(2),
                                                  ENV_SAMPLING_LEARNED, &err), STATUS_OK);
    } else {
        assert_int_equal(image_init(&image, (uint32_t)width, (uint32_t)height, 3, &err), STATUS_OK);
        for (int i = 0; i < width * height; i++)
            for (int c = 0; c < 3; c++)
                image.pixels[3 * i + c] = (float32)(0.5 + test_random_double(&random) + (i / width < height / 3 ? 1 : 0));
        for (int c = 0; c < 3 && map == MAP_SUN; c++) /* towards -x, above the horizon, out of the cone */
            image.pixels[3 * (SUN_ROW * width + width - 1) + c] = 3e5f;
        assert_int_equal(environment_new((struct environment **)(void *)&m->light.map, &image, NULL, 0, vec3_splat(1),
                                         ENV_SAMPLING_LEARNED, &err), STATUS_OK);
    }
    assert_int_equal(sky_guide_init(&m->light.guide, &m->light, &pilot, &err), STATUS_OK);
}

static void unmake(struct made_up *m)
{
    sky_guide_release(&m->light.guide);
    environment_free((struct environment *)m->light.map);
}

static const struct sky_region *region_at(const struct made_up *m, struct vec3 p, struct vec3 n)
{
    const struct light_context context = {.p = p, .n = n};

    return sky_guide_region(&m->light.guide, &context);
}

static const struct sky_region *middle(const struct made_up *m)
{
    return region_at(m, vec3_make(0.3f, 0, 0.3f), vec3_make(0, 1, 0));
}

static int sample(void *user, const float u[3], struct vec3 *direction)
{
    const struct made_up *m = user;
    real pdf;

    return sky_guide_aim(&m->light.guide, m->light.map, middle(m), u[0], u[1], direction, &pdf);
}

static double density(void *user, struct vec3 direction)
{
    const struct made_up *m = user;

    return (double)sky_guide_pdf(&m->light.guide, m->light.map, middle(m), direction);
}

static struct vec3 sun_direction(void)
{
    const double phi = 2 * PI_D * ((maps[MAP_SUN].width - 0.5) / maps[MAP_SUN].width - 0.5);
    const double theta = PI_D * (SUN_ROW + 0.5) / maps[MAP_SUN].height;

    return vec3_make((real)(sin(theta) * cos(phi)), (real)cos(theta), (real)(sin(theta) * sin(phi)));
}

static void test_follows_its_density(void **state)
{
    (void)state;
    for (int map = 0; map < MAPS; map++) {
        struct chi_square_setup setup = {.sample = sample, .pdf = density, .cos_cells = 17, .phi_cells = 29,
                                         .samples = 200000, .seed = (uint64_t)map};
        static struct made_up m;

        make(&m, map, 15);
        assert_non_null(middle(&m));
        setup.user = &m;
        setup.axis = map == MAP_SUN ? sun_direction() : vec3_make(0, 1, 0);
        setup.focus = map == MAP_SUN ? 3 : 0;
        if (!chi_square_accept(&setup, 0.01, MAPS, maps[map].name))
            fail_msg("%s: samples do not follow the density", maps[map].name);
        unmake(&m);
    }
}

/* The density of a direction is the one that it was chosen with, and the radiance is the map's. */
static void test_same_density(void **state)
{
    (void)state;
    for (int map = 0; map < MAPS; map++) {
        struct test_random random = {9};
        static struct made_up m;
        int apart = 0;

        make(&m, map, 15);
        for (int i = 0; i < TRIES; i++) {
            const real u = test_random_float(&random), v = test_random_float(&random);
            struct vec3 direction, radiance, again;
            real chosen, known, third;

            assert_true(sky_guide_aim(&m.light.guide, m.light.map, middle(&m), u, v, &direction, &chosen));
            known = sky_guide_pdf(&m.light.guide, m.light.map, middle(&m), direction);
            radiance = sky_guide_radiance(&m.light.guide, m.light.map, middle(&m), direction, &third);
            again = environment_radiance(m.light.map, direction);
            assert_true(third == known);
            assert_true(radiance.x == again.x && radiance.y == again.y && radiance.z == again.z);
            apart += !(real_abs(known - chosen) <= 1e-3f * chosen); /* at a cell's edge it may be the neighbour's */
        }
        assert_true(apart < TRIES / 200);
        unmake(&m);
    }
}

/* What share of the choices arrives? */
static double arriving(struct made_up *m, int guided)
{
    struct test_random random = {5};
    int good = 0;

    for (int i = 0; i < TRIES; i++) {
        const real u = test_random_float(&random), v = test_random_float(&random);
        struct vec3 direction = {0, 1, 0};
        real pdf;

        if (guided)
            (void)sky_guide_aim(&m->light.guide, m->light.map, middle(m), u, v, &direction, &pdf);
        else
            (void)environment_aim(m->light.map, u, v, &direction, &pdf);
        good += direction.y > 0 && arrives(m, 0, direction) > 0;
    }
    return good / (double)TRIES;
}

static void test_aims_where_light_arrives(void **state)
{
    static struct made_up m;

    (void)state;
    make(&m, MAP_SKY, 15); /* 2 % of the sphere */
    assert_true(arriving(&m, 0) < 0.06);
    assert_true(arriving(&m, 1) > 0.35);
    unmake(&m);
}

/* Every direction from which light comes has a density, on coarse maps, too: a hole would leave it to scattering alone. */
static void test_no_holes(void **state)
{
    (void)state;
    for (int map = 0; map < MAP_SUN; map++) {
        struct test_random random = {4};
        static struct made_up m;

        make(&m, map, 15);
        for (int i = 0; i < TRIES; i++) {
            const double y = test_random_double(&random), phi = 2 * PI_D * test_random_double(&random);
            const double radius = sqrt(1 - y * y);
            const struct vec3 d = {(real)(radius * cos(phi)), (real)y, (real)(radius * sin(phi))};

            if (y > 0.3)
                assert_true(sky_guide_pdf(&m.light.guide, m.light.map, middle(&m), d) > 0);
        }
        unmake(&m);
    }
}

static void test_holds_where_the_pilot_was(void **state)
{
    const struct vec3 up = {0, 1, 0}, down = {0, -1, 0}, none = {0, 0, 0};
    static struct made_up m;

    (void)state;
    make(&m, MAP_SKY, 15);
    assert_non_null(region_at(&m, vec3_make(-0.7f, 0, 0.2f), up));
    assert_null(region_at(&m, vec3_make(-0.7f, 0, 0.2f), down));
    assert_null(region_at(&m, vec3_make(-0.7f, 0, 0.2f), none)); /* in a medium */
    assert_null(region_at(&m, vec3_make(-0.7f, 3, 0.2f), up));
    assert_null(region_at(&m, vec3_make(90, 0, 0.2f), up));
    assert_null(region_at(&m, vec3_make(-0.7f, -3, 0.2f), up));
    assert_null(region_at(&m, vec3_make(-0.7f, 0, -90), up));
    unmake(&m);
    make(&m, MAP_SKY, 180); /* all arrives: the map does as well */
    assert_int_equal(m.light.guide.at.count, 0);
    assert_null(middle(&m));
    unmake(&m);
    make(&m, MAP_SKY, 0); /* nothing does */
    assert_int_equal(m.light.guide.at.count, 0);
    unmake(&m);
}

/* A sun that no ray of the pilot met keeps a share: it may shine through a hole. */
static void test_a_missed_sun(void **state)
{
    struct test_random random = {6};
    static struct made_up m;
    int sun = 0;

    (void)state;
    make(&m, MAP_SUN, 15);
    assert_non_null(middle(&m));
    for (int i = 0; i < TRIES; i++) {
        const real u = test_random_float(&random), v = test_random_float(&random);
        struct vec3 direction;
        real pdf;

        (void)sky_guide_aim(&m.light.guide, m.light.map, middle(&m), u, v, &direction, &pdf);
        sun += environment_radiance(m.light.map, direction).x > 100;
    }
    print_message("# the sun: %.3f of the choices\n", sun / (double)TRIES);
    assert_true(sun > TRIES / 10 && sun < TRIES / 2);
    unmake(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_follows_its_density),     cmocka_unit_test(test_same_density),
        cmocka_unit_test(test_aims_where_light_arrives), cmocka_unit_test(test_holds_where_the_pilot_was),
        cmocka_unit_test(test_a_missed_sun),            cmocka_unit_test(test_no_holes),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
