/* Rooms with walls of a millimetre: those that stand far from the scene's middle keep the light out,
 * and through a door that is ajar comes what geometry says.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/radiance.h"

enum { COMPARISONS = 46 };

static const double wall = 1e-3;

/* ---- rooms far from the scene's middle ---------------------------------------------------- */

static const float shifts[] = {0, 1e3f, 1e4f, 1e5f};
enum { SHIFTS = sizeof shifts / sizeof *shifts };
enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT * 3 };

static const uint32_t box_faces[36] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                                       2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};

static uint32_t shell_box(struct scene_builder *b, const struct vec3 axes[3], struct vec3 at, double more)
{
    static const double inner[3] = {2, 1.5, 2.5};
    float p[24];

    for (int i = 0; i < 8; i++) {
        struct vec3 v = at;
        for (int a = 0; a < 3; a++)
            v = vec3_mad(v, axes[a], (float)(i >> a & 1 ? inner[a] + more : -inner[a] - more));
        p[3 * i] = v.x;
        p[3 * i + 1] = v.y;
        p[3 * i + 2] = v.z;
    }
    return builder_mesh(b, p, NULL, 8, box_faces, 12, 1);
}

/* A square of 2 m, a centimetre before the outside of a wall, and a small light before another. */
static void add_lamps(struct scene_builder *b, const struct vec3 axes[3], struct vec3 at)
{
    static const uint32_t faces[6] = {0, 1, 2, 0, 2, 3};
    struct scene_material *m = builder_lambert(b, 0);
    struct scene_light *light;
    float p[12];

    for (int i = 0; i < 4; i++) {
        struct vec3 v = vec3_mad(at, axes[2], 2.511f);
        v = vec3_mad(v, axes[0], i == 1 || i == 2 ? 1 : -1);
        v = vec3_mad(v, axes[1], i > 1 ? 1 : -1);
        p[3 * i] = v.x;
        p[3 * i + 1] = v.y;
        p[3 * i + 2] = v.z;
    }
    m->emission[0] = m->emission[1] = m->emission[2] = 1e6f;
    builder_place(b, builder_mesh(b, p, NULL, 4, faces, 2, 0), builder_last_material(b), vec3_splat(1), vec3_splat(0));
    at = vec3_mad(at, axes[0], 2.011f);
    light = builder_light(b, LIGHT_POINT);
    light->position[0] = at.x;
    light->position[1] = at.y;
    light->position[2] = at.z;
    light->intensity[0] = light->intensity[1] = light->intensity[2] = 1e3f;
}

/* Here floats are what the walls are made of: at 10 km both sides of one are a float apart, at 100 km
 * they coincide. A box of shared corners is closed all the same. From some 200 km on rays slip
 * through: Embree's error is a tenth of the room (docs/NUMERICS.md). */
static void test_far_off(void **state)
{
    static const struct vec3 straight[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    static const struct vec3 odd[3] = {{0.76484f, 0.25088f, -0.59337f}, {0, 0.92106f, 0.38942f},
                                       {0.64422f, -0.29785f, 0.70447f}};

    (void)state;
    for (int i = 0; i < 2 * SHIFTS; i++) {
        const struct vec3 *axes = i & 1 ? odd : straight;
        struct render_settings settings = builder_settings(WIDTH, HEIGHT, 32);
        float far = shifts[i / 2];
        struct vec3 at = vec3_make(far, -0.75f * far, 0.5f * far);
        static double mean[PIXELS];
        struct render_stats stats = {0};
        struct render_scene *scene;
        struct scene_builder b;

        settings.max_depth = 12;
        builder_init(&b);
        builder_lambert(&b, 0.8f);
        builder_place(&b, shell_box(&b, axes, at, 0), 0, vec3_splat(1), vec3_splat(0));
        builder_place(&b, shell_box(&b, axes, at, wall), 0, vec3_splat(1), vec3_splat(0));
        add_lamps(&b, axes, at);
        builder_environment_constant(&b, vec3_splat(1e6f));
        builder_camera(&b, at, vec3_mad(at, axes[2], -1), 1.4f);
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, mean, NULL, &stats);
        for (int k = 0; k < PIXELS; k++)
            if (mean[k] != 0)
                fail_msg("a room at %g m%s: light inside, %g at number %d", (double)far, i & 1 ? ", turned" : "",
                         mean[k], k);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* ---- a door ajar -------------------------------------------------------------------------- */

/* A gap of 1 mm between door and frame, in a front wall of 1 mm, from the floor up to 2 m. */
static const double gap = 1e-3, door_height = 2;

static void add_block(struct scene_builder *b, uint32_t material, const double low[3], const double high[3],
                      double scale)
{
    float p[24];

    for (int i = 0; i < 24; i++)
        p[i] = (float)(scale * ((i / 3) >> (i % 3) & 1 ? high[i % 3] : low[i % 3]));
    builder_place(b, builder_mesh(b, p, NULL, 8, box_faces, 12, 1), material, vec3_splat(1), vec3_splat(0));
}

/* The front wall lies between z = 0 (inside) and -wall, the gap between x = 0 and `gap`; the other
 * walls overlap. The floor is white, the walls have `albedo`. */
static void door_scene(struct scene_builder *b, float albedo, double scale)
{
    const double g = gap, t = wall, h = door_height, top = 3;

    builder_init(b);
    builder_lambert(b, 0.5f);
    builder_lambert(b, albedo);
    add_block(b, 0, (double[3]){-2, -t, -2 * t}, (double[3]){2, 0, 4}, scale);
    add_block(b, 1, (double[3]){-2, 0, -t}, (double[3]){0, top, 0}, scale); /* beside it */
    add_block(b, 1, (double[3]){g, 0, -t}, (double[3]){2, top, 0}, scale);  /* the door */
    add_block(b, 1, (double[3]){-1, h, -t}, (double[3]){1, top, 0}, scale); /* above */
    add_block(b, 1, (double[3]){-2, -t, -t}, (double[3]){-2 + t, top, 4}, scale);
    add_block(b, 1, (double[3]){2 - t, -t, -t}, (double[3]){2, top, 4}, scale);
    add_block(b, 1, (double[3]){-2, -t, 4}, (double[3]){2, top, 4 + t}, scale);
    add_block(b, 1, (double[3]){-2, top, -t}, (double[3]){2, top + t, 4 + t}, scale);
    builder_environment_constant(b, vec3_splat(1));
}

/* Where a ray from (x, 0, z) may go through the gap, its direction's tangent sideways lies between
 * those to the edges of both of its mouths. The floor sees so much of the sky, times pi. */
static double irradiance(double x, double z)
{
    const double depth[2] = {z, z + wall};
    double from = -INFINITY, to = INFINITY, sum = 0;
    enum { STEPS = 1000 };

    for (int k = 0; k < 2; k++) {
        from = fmax(from, atan(-x / depth[k]));
        to = fmin(to, atan((gap - x) / depth[k]));
    }
    for (int i = 0; from < to && i < STEPS; i++) {
        double azimuth = from + (i + 0.5) / STEPS * (to - from);
        double away = depth[1] / cos(azimuth); /* above, the outer mouth is what ends the view */
        sum += door_height * door_height / (door_height * door_height + away * away) / 2;
    }
    return sum / STEPS * fmax(to - from, 0);
}

static void test_gap(void **state)
{
    static const double places[][2] = {{0.5e-3, 3e-3}, {0.5e-3, 15e-3}, {2e-3, 2e-3}, {-4e-3, 7e-3},
                                       {3e-3, 1e-3}};
    static const double scales[] = {1, 1000, 1e-3};

    (void)state;
    for (size_t k = 0; k < sizeof scales / sizeof *scales; k++)
        for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
            struct render_settings settings = builder_settings(8, 8, 128);
            double scale = scales[k], x = places[i][0], z = places[i][1];
            struct scene_builder b;
            char what[96];
            settings.max_depth = 1;
            door_scene(&b, 0, scale);
            builder_camera(&b, vec3_make((float)(scale * x), (float)(scale * 0.5), (float)(scale * z)),
                           vec3_make((float)(scale * x), 0, (float)(scale * z)), 2e-5f);
            snprintf(what, sizeof what, "scale %g, floor at %g %g", scale, x, z);
            radiance_expect(&b, &settings, COMPARISONS, 0.5 * irradiance(x, z) / M_PI, what);
            builder_release(&b);
        }
}

/* The whole room by the light of the gap, with all that the walls throw back: the same at 1000
 * times the size. */
static void test_scaled_room(void **state)
{
    struct running_stats small[3], large[3];

    (void)state;
    for (int k = 0; k < 2; k++) {
        struct render_settings settings = builder_settings(16, 16, 64);
        double scale = k ? 1000 : 1;
        struct scene_builder b;
        settings.max_depth = 6;
        settings.seed += (uint64_t)k;
        door_scene(&b, 0.8f, scale);
        builder_camera(&b, vec3_make(0, (float)(scale * 0.4), (float)(scale * 0.5)),
                       vec3_make(0, 0, (float)(scale * 0.02)), 0.3f);
        radiance_measure(&b, &settings, k ? large : small);
        builder_release(&b);
    }
    {
        double error = hypot(running_stats_error(&small[0]), running_stats_error(&large[0]));
        if (!(small[0].mean > 0) || fabs(small[0].mean - large[0].mean) > 4 * error)
            fail_msg("%.6g in the room, %.6g in that of a thousand times its size, +- %.2g", small[0].mean,
                     large[0].mean, error);
        print_message("room %.6g and %.6g +- %.2g\n", small[0].mean, large[0].mean, error);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_far_off),
        cmocka_unit_test(test_gap),
        cmocka_unit_test(test_scaled_room),
    };

    return cmocka_run_group_tests_name("doors", tests, NULL, NULL);
}
