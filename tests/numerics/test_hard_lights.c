/* Hard cases of lamps and environment maps, as pictures or counts: each notices the loss of one
 * safeguard (common/base/safeguard.h; docs/NUMERICS.md).
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "common/math/elementary.h"
#include "tests/support/figure.h"
#include "tests/support/radiance.h"
#include "worker/render/light/emitters.h"
#include "worker/render/render_scene.h"

enum { COMPARISONS = 17 };

static const double albedo = 0.8;
/* Metres: how far inside its rim a hole in a room of 2 m may be taken for a gap: Embree's error 2.2 m
 * away, over the cosine to the hole's plane and the sine to its edge (docs/NUMERICS.md). */
#define HOLE_RIM 3e-6

static struct render_settings narrow(uint32_t spp)
{
    struct render_settings s = builder_settings(8, 8, spp);

    s.max_depth = 1;
    return s;
}

/* A floor of 20 m, and a camera 3 m above (x, 0, z) that looks down at it. */
static void floor_scene(struct scene_builder *b, float x, float z)
{
    builder_init(b);
    builder_lambert(b, (float)albedo);
    builder_place(b, builder_quad(b), 0, vec3_make(10, 1, 10), vec3_splat(0));
    builder_camera(b, vec3_make(x, 3, z), vec3_make(x, 0, z), 0.0005f);
}

/* The camera without perspective, so near that all its rays meet one point. */
static void look_at_one_point(struct scene_builder *b)
{
    b->scene.cameras[0].kind = CAMERA_ORTHOGRAPHIC;
    b->scene.cameras[0].xmag = b->scene.cameras[0].ymag = 1e-12f;
}

/* ---- maps ------------------------------------------------------------------------------------ */

enum { MAP_TEXELS_MAX = 512 * 256 };
static float map[MAP_TEXELS_MAX * 3];

static void map_fill(uint32_t texels, float value)
{
    for (uint32_t i = 0; i < 3 * texels; i++)
        map[i] = value;
}

static void map_set(uint32_t width, uint32_t column, uint32_t row, float value)
{
    for (uint32_t c = 0; c < 3; c++)
        map[3 * (row * width + column) + c] = value;
}

/* Irradiance of the floor: rows are bilinear in v, and up to their pole if they are the last. */
static double map_irradiance(uint32_t width, uint32_t height)
{
    enum { STEPS = 2000 };
    double sum = 0;

    for (uint32_t row = 0; row < height; row++) {
        double centre = (row + 0.5) / height, share = 0, luminance = 0;

        for (int i = 0; i < STEPS; i++) {
            double v = (i + 0.5) / STEPS / 2, apart = fabs(v - centre) * height;
            double weight = row == 0 && v < centre ? 1 : fmax(0, 1 - apart);

            share += weight * cos(M_PI * v) * sin(M_PI * v) * M_PI / 2 / STEPS;
        }
        for (uint32_t x = 0; x < width; x++)
            luminance += (double)map[3 * (row * width + x)];
        sum += luminance * 2 * M_PI / width * share;
    }
    return sum;
}

/* A sun 1e18 times as bright as its row: where the row's other texels begin rounds to the row's
 * end. */
static void test_map_row_end(void **state)
{
    struct render_settings settings = narrow(16);
    struct scene_builder b;

    (void)state;
    settings.env_sampling = ENV_SAMPLING_IMPORTANCE_ONLY;
    map_fill(16 * 8, 1);
    map_set(16, 2, 2, 1e18f);
    floor_scene(&b, 0, 0);
    builder_environment_map(&b, map, 16, 8);
    radiance_figure(&b, &settings, COMPARISONS, 0, albedo / M_PI * map_irradiance(16, 8),
                    "radiance of a floor under a sun of one texel");
    builder_release(&b);
}

/* A wall that turns its back to a sun of 1e9 sees the rest of the sun's rows. */
static void test_map_dark_cells(void **state)
{
    struct render_settings settings = narrow(64);
    struct scene_builder b;

    (void)state;
    settings.env_sampling = ENV_SAMPLING_IMPORTANCE_ONLY;
    map_fill(16 * 4, 1);
    map_set(16, 0, 1, 1e9f);
    map_set(16, 0, 2, 1e9f);
    floor_scene(&b, 0, 0);
    b.scene.instances[0].to_world = (struct transform_d){{{0, 1, 0, 0}, {-10, 0, 0, 0}, {0, 0, 10, 0}}};
    builder_camera(&b, vec3_make(3, 0, 0), vec3_splat(0), 0.0005f);
    settings.camera = 1;
    builder_environment_map(&b, map, 16, 4);
    radiance_figure(&b, &settings, COMPARISONS, 0, albedo, "radiance of a wall with its back to the sun");
    builder_release(&b);
}

/* Beyond what a float holds. */
static void test_map_radiance(void **state)
{
    struct render_settings settings = narrow(16);
    struct render_stats stats = {0};
    static double picture[8 * 8 * 3];
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    settings.env_strength = 4;
    map_fill(16 * 8, 1);
    map_set(16, 2, 2, 3e38f);
    floor_scene(&b, 0, 0);
    builder_environment_map(&b, map, 16, 8);
    scene = builder_build(&b, &settings);
    builder_render(scene, &settings, 0, picture, NULL, &stats);
    figure_within("samples dropped under a map with a texel of 1.2e39", (double)stats.work.dropped_samples, 0, 0, "exact");
    assert_true(picture[0] > 1e20);
    render_scene_free(scene);
    builder_release(&b);
}

/* A map of one column whose radiance is the row's number near the zenith, seen 2.4e-4 rad beside it. */
static void test_map_pole(void **state)
{
    enum { ROWS = 16384 };
    const double angle = 2.4e-4;
    struct render_settings settings = narrow(4);
    struct scene_builder b;

    (void)state;
    settings.env_sampling = ENV_SAMPLING_BSDF;
    for (uint32_t row = 0; row < ROWS; row++)
        map_set(1, 0, row, row < 8 ? (float)row : 8);
    floor_scene(&b, 0, 0);
    builder_camera(&b, vec3_make(0, 2, 0), vec3_make((float)angle, 3, 0), 1e-5f);
    settings.camera = 1;
    builder_environment_map(&b, map, 1, ROWS);
    radiance_figure(&b, &settings, COMPARISONS, 0, angle / M_PI * ROWS - 0.5, "row that is seen beside the zenith");
    builder_release(&b);
}

/* A sun beside the map's first column: its window of finer importance crosses the seam. */
static void test_map_seam(void **state)
{
    struct render_settings settings = narrow(16);
    struct scene_builder b;

    (void)state;
    map_fill(512 * 256, 0.1f);
    for (uint32_t x = 1; x < 3; x++)
        for (uint32_t y = 100; y < 103; y++)
            map_set(512, x, y, 1e5f);
    floor_scene(&b, 0, 0);
    builder_environment_map(&b, map, 512, 256);
    radiance_figure(&b, &settings, COMPARISONS, 0, albedo / M_PI * map_irradiance(512, 256),
                    "radiance of a floor under a sun beside the seam");
    builder_release(&b);
}

/* ---- lamps ------------------------------------------------------------------------------------ */

/* A lamp exactly on the floor lights nothing there, and that is sound. */
static void test_lamp_distance(void **state)
{
    struct render_settings settings = narrow(16);
    struct render_stats stats = {0};
    static double picture[8 * 8 * 3];
    struct render_scene *scene;
    struct scene_light *lamp;
    struct scene_builder b;

    (void)state;
    floor_scene(&b, 1, 1);
    look_at_one_point(&b);
    lamp = builder_light(&b, LIGHT_POINT);
    lamp->position[0] = lamp->position[2] = 1;
    lamp->intensity[0] = 1;
    builder_environment_constant(&b, vec3_splat(1));
    render_keep_origin(1); /* from the camera's, the floor's point is not exactly the lamp's */
    scene = builder_build(&b, &settings);
    render_keep_origin(0);
    builder_render(scene, &settings, 0, picture, NULL, &stats);
    figure_within("bad densities where a lamp touches the floor", (double)stats.work.bad_densities, 0, 0, "exact");
    render_scene_free(scene);
    builder_release(&b);
}

/* A ceiling 1 m above the floor hides the bright part of the sky but for a hole of 1 mm. */
static void test_small_window(void **state)
{
    const float x = -0.6123f, z = 0.5943f, h = x + 1e-3f, k = z + 1e-3f;
    const float quads[4][4][3] = {{{-9, 1, -9}, {x, 1, -9}, {x, 1, 9}, {-9, 1, 9}},
                                  {{h, 1, -9}, {9, 1, -9}, {9, 1, 9}, {h, 1, 9}},
                                  {{x, 1, -9}, {h, 1, -9}, {h, 1, z}, {x, 1, z}},
                                  {{x, 1, k}, {h, 1, k}, {h, 1, 9}, {x, 1, 9}}};
    static const uint32_t indices[24] = {0, 1, 2,  0, 2,  3,  4,  5,  6,  4,  6,  7,
                                         8, 9, 10, 8, 10, 11, 12, 13, 14, 12, 14, 15};
    struct scene_portal portal = {{(double)x, 1, (double)z}, {h - x, 0, 0}, {0, 0, k - z}};
    struct render_settings settings = narrow(32);
    double aside = (double)(x + h) / 2 - 0.3, along = (double)(z + k) / 2 + 0.2;
    double distance2 = 1 + aside * aside + along * along, expected;
    struct running_stats seen[3];
    struct scene_builder b;

    (void)state;
    map_fill(16 * 8, 0);
    for (uint32_t i = 0; i < 48; i++)
        map_set(16, i % 16, i / 16, 1e6f);
    floor_scene(&b, 0.3f, -0.2f);
    b.scene.instances[0].to_world.m[0][0] = b.scene.instances[0].to_world.m[2][2] = 1;
    b.scene.cameras[0].to_world.m[1][3] = 0.5;
    builder_place(&b, builder_mesh(&b, &quads[0][0][0], NULL, 16, indices, 8, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_map(&b, map, 16, 8);
    b.scene.environment.portal_count = 1;
    b.scene.environment.portals = &portal;
    radiance_measure(&b, &settings, seen);
    expected = albedo / M_PI * 1e6 * (double)portal.edge1[0] * (double)portal.edge2[2] / (distance2 * distance2);
    figure_within("radiance of a floor lit through a hole of 1 mm, over the closed form", seen[0].mean / expected, 0.99,
                  1.01, "tolerance 1 %");
    builder_release(&b);
}

/* The cube -1..1 with a hole of `size` metres in the wall at x = 1, on the level of y = 0. */
static void room_with_hole(struct scene_builder *b, float size)
{
    const float h = size / 2;
    const float quads[9][4][3] = {
        {{-1, -1, -1}, {1, -1, -1}, {1, -1, 1}, {-1, -1, 1}},
        {{-1, 1, -1}, {1, 1, -1}, {1, 1, 1}, {-1, 1, 1}},
        {{-1, -1, -1}, {-1, 1, -1}, {-1, 1, 1}, {-1, -1, 1}},
        {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}},
        {{-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}},
        {{1, -1, -1}, {1, -h, -1}, {1, -h, 1}, {1, -1, 1}},
        {{1, h, -1}, {1, 1, -1}, {1, 1, 1}, {1, h, 1}},
        {{1, -h, -1}, {1, h, -1}, {1, h, -h}, {1, -h, -h}},
        {{1, -h, h}, {1, h, h}, {1, h, 1}, {1, -h, 1}},
    };

    builder_init(b);
    builder_lambert(b, (float)albedo);
    builder_place(b, builder_quads(b, quads, 9), 0, vec3_splat(1), vec3_splat(0));
}

/* Irradiance by a sky of radiance 1, seen through that hole, of the floor at (0, -1, z). */
static double irradiance_through_hole(double size, double z)
{
    enum { STEPS = 64 };
    double sum = 0;

    for (int i = 0; i < STEPS; i++)
        for (int k = 0; k < STEPS; k++) {
            double up = 1 + ((i + 0.5) / STEPS - 0.5) * size;
            double along = ((k + 0.5) / STEPS - 0.5) * size - z, d2 = 1 + up * up + along * along;

            sum += up / (d2 * d2);
        }
    return sum * size * size / STEPS / STEPS;
}

static const float hole_sizes[] = {0.1f, 0.03f, 0.01f, 3e-3f, 1e-3f}; /* metres */

/* A room whose hole few rays find counts as closed. The light through the hole must arrive all the same,
 * except in the band along the rim in which rounding decides. */
static void test_hole_of_a_room(void **state)
{
    const float *size = *state, z = -0.3f;
    double side = (double)*size, expected, noise, rim = 4 * HOLE_RIM / side;
    struct scene_portal hole = {{1, -side / 2, -side / 2}, {0, *size, 0}, {0, 0, *size}};
    struct render_settings settings = narrow(64);
    struct running_stats seen[3];
    struct scene_builder b;
    char what[96], level[96];

    room_with_hole(&b, *size);
    builder_camera(&b, vec3_make(-0.9f, 0.6f, 0.7f), vec3_make(0, -1, z), 0.0005f);
    look_at_one_point(&b);
    builder_environment_constant(&b, vec3_splat(1e6f));
    b.scene.environment.portal_count = 1;
    b.scene.environment.portals = &hole;
    radiance_measure(&b, &settings, seen);
    expected = albedo / M_PI * 1e6 * irradiance_through_hole(side, (double)z);
    noise = 1e-4 + running_stats_error(&seen[0]) / expected *
                       student_quantile(1 - sidak_alpha(RADIANCE_SIGNIFICANCE, COMPARISONS) / 2, RADIANCE_FRAMES - 1);
    snprintf(what, sizeof what, "light through a hole of %g mm in a room, over the closed form", 1000 * side);
    snprintf(level, sizeof level, "significance %g over %d tests, rim of %g um", RADIANCE_SIGNIFICANCE, COMPARISONS,
             1e6 * HOLE_RIM);
    figure_within(what, seen[0].mean / expected, 1 - rim - noise, 1 + noise, level);
    builder_release(&b);
}

/* Camera rays through the hole, in the middle of a picture 32 times as wide: as many as if the room did
 * not count as closed, but for those at the rim. */
static void test_hole_in_sight(void **state)
{
    const float size = 1e-3f, away = 1.9f;
    struct render_settings settings = narrow(1024);
    static double picture[8 * 8 * 3];
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct scene_builder b;
    double seen[2] = {0, 0};

    (void)state;
    room_with_hole(&b, size);
    builder_camera(&b, vec3_make(1 - away, 0, 0), vec3_make(1, 0, 0), 32 * size / away);
    builder_environment_constant(&b, vec3_splat(1));
    scene = builder_build(&b, &settings);
    assert_true(scene->enclosed);
    for (int closed = 1; closed >= 0; closed--) {
        scene->enclosed = closed;
        for (uint32_t frame = 0; frame < RADIANCE_FRAMES; frame++) {
            builder_render(scene, &settings, frame, picture, NULL, &stats);
            for (int i = 0; i < 8 * 8; i++)
                seen[closed] += picture[3 * i];
        }
    }
    assert_true(seen[0] > 0);
    figure_within("camera rays through a hole of 1 mm in a room, over those of an open scene", seen[1] / seen[0],
                  1 - 4 * HOLE_RIM / (double)size, 1, "the rim");
    render_scene_free(scene);
    builder_release(&b);
}

/* ---- the choice of lamps ---------------------------------------------------------------------- */

/* Two beams of a third of a milliradian from 1 km: as much light is seen however they are chosen. */
static void test_narrow_beam(void **state)
{
    struct render_settings settings = narrow(64);
    struct running_stats seen[2][3];
    struct scene_builder b;

    (void)state;
    floor_scene(&b, 0.2f, 0.1f);
    b.scene.cameras[0].yfov_rad = 0.3f;
    for (int i = 0; i < 2; i++) {
        struct scene_light *spot = builder_light(&b, LIGHT_SPOT);
        float aside = i ? 0.4f : -0.1f;

        spot->position[0] = 3.7f * (float)i;
        spot->position[1] = 1000;
        spot->position[2] = 2.3f;
        spot->direction[0] = (aside - (float)spot->position[0]) / 1000;
        spot->direction[2] = -(float)spot->position[2] / 1000;
        spot->direction[1] =
            -sqrtf(1 - spot->direction[0] * spot->direction[0] - spot->direction[2] * spot->direction[2]);
        spot->outer_cone_rad = 3.45e-4f;
        spot->inner_cone_rad = 1e-5f;
        spot->falloff = FALLOFF_SMOOTHSTEP;
        spot->intensity[0] = 1e6f;
    }
    radiance_measure(&b, &settings, seen[0]);
    settings.light_choice = LIGHT_CHOICE_POWER;
    radiance_measure(&b, &settings, seen[1]);
    assert_true(seen[1][0].mean > 1e-3);
    figure_within("light of two narrow beams, chosen by the tree over chosen by power",
                  seen[0][0].mean / seen[1][0].mean, 0.98, 1.02, "tolerance 2 %");
    builder_release(&b);
}

/* A faint lamp at hand, and a strong one above the ceiling. */
static void hidden_lamp(struct scene_builder *b, float strong)
{
    struct scene_light *lamp;

    floor_scene(b, 0, 0);
    builder_place(b, 0, 0, vec3_make(100, 1, 100), vec3_make(0, 10, 0));
    lamp = builder_light(b, LIGHT_POINT);
    lamp->position[1] = 50;
    lamp->intensity[0] = strong;
    lamp = builder_light(b, LIGHT_POINT);
    lamp->position[1] = 4;
    lamp->intensity[0] = 16;
}

static void test_faint_lamp(void **state)
{
    static const enum light_choice choices[2] = {LIGHT_CHOICE_TREE, LIGHT_CHOICE_POWER};
    static const char *const what[2] = {"radiance by a faint lamp, chosen by the tree",
                                        "radiance by a faint lamp, chosen by power"};
    struct render_settings settings = narrow(512);

    (void)state;
    for (int i = 0; i < 2; i++) {
        struct scene_builder b;

        hidden_lamp(&b, i ? 1e18f : 1e13f);
        settings.light_choice = choices[i];
        radiance_figure(&b, &settings, COMPARISONS, 0, albedo / M_PI, what[i]);
        builder_release(&b);
    }
}

static struct vec3 random_vec(struct test_random *random)
{
    return vec3_make(2 * test_random_float(random) - 1, 2 * test_random_float(random) - 1,
                     2 * test_random_float(random) - 1);
}

/* The largest random numbers, and lamps all around of which many are below each point's horizon. */
static void test_largest_numbers(void **state)
{
    struct render_settings settings = narrow(4);
    struct test_random random = {5};
    struct render_scene *scene;
    struct scene_builder b;
    int lost = 0;

    (void)state;
    floor_scene(&b, 0, 0);
    for (int i = 0; i < 48; i++) {
        struct scene_light *lamp = builder_light(&b, LIGHT_POINT);
        struct vec3 at = random_vec(&random);

        lamp->position[0] = (double)at.x;
        lamp->position[1] = (double)at.y;
        lamp->position[2] = (double)at.z;
        lamp->intensity[0] = 0.1f + test_random_float(&random);
    }
    scene = builder_build(&b, &settings);
    for (int i = 0; i < 100000; i++) {
        struct light_context context = {.p = random_vec(&random)};
        struct light_sample sample;

        context.n = vec3_normalize(random_vec(&random));
        sample.pdf = 1;
        (void)emitters_sample(scene, &context, ONE_MINUS_EPSILON, ONE_MINUS_EPSILON, &sample);
        lost += sample.pdf == 0;
    }
    figure_within("points of 100000 at which the largest random numbers choose a lamp without odds", lost, 0, 0,
                  "exact");
    render_scene_free(scene);
    builder_release(&b);
}

/* A slide of 192 x 192 whose one lit texel is between the points at which its mean is measured. */
static void test_spot_on_slide(void **state)
{
    enum { SIDE = 192, LIT = 99 };
    const double half = 2 * tan(0.5), at = ((LIT + 0.5) / SIDE * 2 - 1) * half;
    struct render_settings settings = narrow(4);
    static float slide[SIDE * SIDE * 3];
    double distance2 = 4 + 2 * at * at;
    struct scene_light *lamp;
    struct scene_builder b;

    (void)state;
    for (int c = 0; c < 3; c++)
        slide[3 * (LIT * SIDE + LIT) + c] = 1;
    floor_scene(&b, (float)at, (float)at);
    look_at_one_point(&b);
    lamp = builder_light(&b, LIGHT_PROJECTION);
    lamp->position[1] = 2;
    lamp->intensity[0] = 100;
    lamp->to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 0, 1, 2}, {0, -1, 0, 0}}};
    lamp->projection_yfov_rad = 1;
    lamp->projection_aspect = 1;
    lamp->image = (int32_t)b.scene.textures[builder_texture(&b, slide, SIDE, SIDE)].image;
    radiance_figure(&b, &settings, COMPARISONS, 0, albedo / M_PI * 100 * 2 / (distance2 * sqrt(distance2)),
                    "radiance of a slide's one bright spot");
    builder_release(&b);
}

#define HOLE_TEST(name, i) {name, test_hole_of_a_room, NULL, NULL, (void *)(uintptr_t)&hole_sizes[i]}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_map_row_end),   cmocka_unit_test(test_map_dark_cells),
        cmocka_unit_test(test_map_radiance),  cmocka_unit_test(test_map_pole),
        cmocka_unit_test(test_map_seam),      cmocka_unit_test(test_lamp_distance),
        cmocka_unit_test(test_small_window),  cmocka_unit_test(test_narrow_beam),
        cmocka_unit_test(test_faint_lamp),    cmocka_unit_test(test_largest_numbers),
        cmocka_unit_test(test_spot_on_slide), cmocka_unit_test(test_hole_in_sight),
        HOLE_TEST("test_hole_of_100_mm", 0),  HOLE_TEST("test_hole_of_30_mm", 1),
        HOLE_TEST("test_hole_of_10_mm", 2),   HOLE_TEST("test_hole_of_3_mm", 3),
        HOLE_TEST("test_hole_of_1_mm", 4),
    };

    return cmocka_run_group_tests_name("hard lights", tests, NULL, NULL);
}
