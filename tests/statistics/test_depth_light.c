/* The share of the light that --max-depth takes (common/film/depth_light.h), against closed forms and against
 * pictures of deeper paths. All shares are of means over RADIANCE_FRAMES frames; the bounds are 4 standard errors
 * of their mean (of normal figures, 1 in 16,000 is outside) and `slack`, where the form is not exact. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/radiance.h"

enum { SIDE = 12 };

struct seen {
    struct running_stats share, mean; /* of the frames: the share; luminance of the picture */
    struct depth_report all;          /* of all frames together */
};

static struct seen look(struct scene_builder *b, uint32_t max_depth, uint32_t spp)
{
    struct render_settings settings = builder_settings(SIDE, SIDE, spp);
    double picture[SIDE * SIDE * 3];
    struct render_scene *scene;
    struct render_stats sum = {0};
    struct seen seen = {.all = {0}};

    settings.max_depth = max_depth;
    scene = builder_build(b, &settings);
    for (uint32_t frame = 0; frame < RADIANCE_FRAMES; frame++) {
        struct render_stats stats = {0};
        builder_render(scene, &settings, frame, picture, NULL, &stats);
        assert_true(depth_light_is_valid(&stats.work.depth));
        running_stats_add(&seen.share, depth_light_report(&stats.work.depth, stats.work.samples, max_depth).share);
        running_stats_add(&seen.mean, stats.work.depth.sum[DEPTH_SEEN] / (double)stats.work.samples);
        sum.work.samples += stats.work.samples;
        depth_light_add(&sum.work.depth, &stats.work.depth);
    }
    render_scene_free(scene);
    seen.all = depth_light_report(&sum.work.depth, sum.work.samples, max_depth);
    return seen;
}

static void expect_near(const char *what, double value, double expected, double within, const char *how)
{
    figure_within(what, value, expected - within, expected + within, how);
}

static void expect_share(const struct seen *seen, double expected, double slack, const char *what, uint32_t max_depth)
{
    char text[128], how[64];
    const double within = 4 * running_stats_error(&seen->share) + slack;

    snprintf(text, sizeof text, "light ended by depth %u, %s", max_depth, what);
    snprintf(how, sizeof how, "4 standard errors and %g", slack);
    expect_near(text, seen->share.mean, expected, within, how);
}

/* The inside of a ball of one albedo that shines everywhere, seen from its middle. */
static void furnace(struct scene_builder *b, float albedo)
{
    struct scene_material *wall;

    builder_init(b);
    wall = builder_lambert(b, albedo);
    for (int c = 0; c < 3; c++)
        wall->emission[c] = 1;
    builder_place(b, builder_sphere(b, 4, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(b, vec3_splat(0), vec3_make(0, 0, 1), 1);
}

/* What the depth N sees is 1 + a + ... + a^N: the share that is lost is a^(N+1). */
static void radiance_that_is_geometric(void **state)
{
    static const uint32_t depths[] = {1, 2, 3, 4, 7, 8, 16};
    static const float albedos[] = {0.3f, 0.8f};

    (void)state;
    for (size_t i = 0; i < sizeof depths / sizeof *depths; i++)
        for (size_t k = 0; k < sizeof albedos / sizeof *albedos; k++) {
            const double expected = pow((double)albedos[k], depths[i] + 1.0);
            struct scene_builder b;
            struct seen seen;
            char what[64];
            furnace(&b, albedos[k]);
            seen = look(&b, depths[i], 32);
            snprintf(what, sizeof what, "in a furnace of albedo %g", (double)albedos[k]);
            expect_share(&seen, expected, 0.01 * expected + 2e-5, what, depths[i]);
            builder_release(&b);
        }
}

/* The depth that is recommended takes at most a hundredth, and half of it takes more. */
static void a_depth_that_is_enough(void **state)
{
    const uint32_t depth = 8;
    struct scene_builder b;
    struct seen seen;
    double expected;

    (void)state;
    furnace(&b, 0.9f);
    seen = look(&b, depth, 64);
    assert_int_equal(seen.all.deeper, 64); /* .9^33 is .031, .9^65 is .001 */
    expected = pow(0.9, 65);
    expect_near("share that a depth of 64 would leave, albedo 0.9, told at 8", seen.all.deeper_share, expected,
                0.3 * expected, "30 %");
    builder_release(&b);
}

/* Nothing ends in it: whatever was seen, there is infinitely more. */
static void a_mirror_box(void **state)
{
    struct scene_material *wall;
    struct scene_builder b;
    struct seen seen;

    (void)state;
    furnace(&b, 1);
    wall = &b.scene.materials[0];
    wall->metallic = 1;
    wall->roughness = 0;
    seen = look(&b, 16, 8);
    expect_near("luminance of a mirror box of depth 16", seen.mean.mean, 17, 1e-4, "rounding");
    expect_share(&seen, 1, 1e-3, "in a mirror box", 16);
    assert_int_equal(seen.all.deeper, SETTINGS_DEPTH_MAX);
    assert_true(seen.all.deeper_share > 0.99);
    builder_release(&b);
}

/* ---- white furnaces: what is missing to 1 is what the depth took --------------------------------- */

static void expect_missing(struct scene_builder *b, uint32_t max_depth, uint32_t spp, double least, const char *what)
{
    struct seen seen = look(b, max_depth, spp);
    const double missing = 1 - seen.mean.mean;

    assert_true(missing > least); /* else it shows nothing */
    expect_share(&seen, missing, 0.05 * missing, what, max_depth);
}

/* Six panes of clear glass, one behind the other: twelve faces, under a white sky. */
static void panes(struct scene_builder *b, float specular)
{
    struct scene_material *glass;

    builder_init(b);
    glass = builder_lambert(b, 1);
    glass->specular = specular;
    glass->transmission = 1;
    glass->roughness = 0;
    glass->refractive = 1;
    glass->ior = 1.5f;
    for (int pane = 0; pane < 6; pane++)
        builder_place(b, builder_slab(b), 0, vec3_make(50, 0.05f, 50), vec3_make(0, 0.5f * (float)pane, 0));
    builder_camera(b, vec3_make(0, 10, 0.1f), vec3_splat(0), 0.5f);
    builder_environment_constant(b, vec3_splat(1));
}

static void a_stack_of_glass(void **state)
{
    static const uint32_t depths[] = {3, 6, 10, 16};

    (void)state;
    for (size_t i = 0; i < sizeof depths / sizeof *depths; i++) {
        struct scene_builder b;
        panes(&b, 1);
        expect_missing(&b, depths[i], 32, 0.01, "in a stack of clear glass");
        builder_release(&b);
    }
}

/* Faces that reflect nothing: at a depth of 3 the picture is black, and it lacks everything. */
static void a_black_picture(void **state)
{
    struct scene_builder b;
    struct seen seen;

    (void)state;
    panes(&b, 0);
    seen = look(&b, 3, 4);
    assert_true(seen.mean.mean == 0);
    expect_share(&seen, 1, 1e-3, "in a picture that is black for it", 3);
    seen = look(&b, 12, 4);
    expect_near("luminance behind twelve faces", seen.mean.mean, 1, 1e-5, "rounding");
    expect_share(&seen, 0, 0, "behind twelve faces", 12);
    builder_release(&b);
}

/* A ball of a medium in a white sky. */
static void ball(struct scene_builder *b, float scattering, float absorption, float g)
{
    struct scene_material *wall;
    struct scene_medium *medium;

    builder_init(b);
    medium = builder_medium(b);
    for (int c = 0; c < 3; c++) {
        medium->scattering[c] = scattering;
        medium->absorption[c] = absorption;
    }
    medium->g = g;
    wall = builder_lambert(b, 0);
    wall->kind = MATERIAL_INTERFACE;
    wall->medium = 0;
    builder_place(b, builder_sphere(b, 8, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(b, vec3_make(0, 0, 4), vec3_splat(0), 0.6f);
    builder_environment_constant(b, vec3_splat(1));
}

static void a_forward_scattering_medium(void **state)
{
    static const uint32_t depths[] = {64};

    (void)state;
    for (size_t i = 0; i < sizeof depths / sizeof *depths; i++) {
        struct scene_builder b;
        ball(&b, 1000, 0, 0.999f);
        expect_missing(&b, depths[i], 2, 0.3, "in a medium of 1000 a metre that scatters forwards");
        builder_release(&b);
    }
}

static void a_dense_medium(void **state)
{
    struct scene_builder b;

    (void)state;
    ball(&b, 20, 0, 0);
    expect_missing(&b, 12, 16, 0.05, "in a dense medium");
    builder_release(&b);
}

/* ---- pictures that have no closed form: against deeper paths ------------------------------------- */

/* `within` is the factor by which the estimate may be off, as docs/NUMERICS.md says. */
static void expect_deep(struct scene_builder *b, uint32_t max_depth, uint32_t deep, double factor, const char *what)
{
    struct seen seen = look(b, max_depth, 32), all = look(b, deep, 32);
    const double missing = 1 - seen.mean.mean / all.mean.mean;

    assert_true(missing > 0.01);
    expect_share(&seen, missing, (factor - 1) * missing, what, max_depth);
}

static void a_room(void **state)
{
    struct scene_builder b;

    (void)state;
    builder_room(&b, NULL);
    expect_deep(&b, 1, 64, 1.5, "in a room");
    builder_release(&b);
}

static void a_medium_that_absorbs(void **state)
{
    struct scene_builder b;

    (void)state;
    ball(&b, 18, 2, 0.5f);
    expect_deep(&b, 4, 256, 1.5, "in a medium that absorbs a tenth");
    builder_release(&b);
}

/* ---- nothing to tell ----------------------------------------------------------------------------- */

static void nothing_is_ended(void **state)
{
    struct scene_builder b;
    struct seen seen;

    (void)state;
    furnace(&b, 0);
    seen = look(&b, 64, 8);
    assert_true(seen.all.share < 1e-3 && seen.all.deeper == 0);
    builder_release(&b);
    builder_init(&b); /* every ray reaches the sky */
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_splat(0), vec3_make(0, 0, 1), 1);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_quad(&b), 0, vec3_splat(1), vec3_make(0, 0, -5));
    seen = look(&b, 1, 8);
    assert_true(seen.all.share == 0 && seen.mean.mean > 0);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(radiance_that_is_geometric),
        cmocka_unit_test(a_depth_that_is_enough),
        cmocka_unit_test(a_mirror_box),
        cmocka_unit_test(a_stack_of_glass),
        cmocka_unit_test(a_black_picture),
        cmocka_unit_test(a_forward_scattering_medium),
        cmocka_unit_test(a_dense_medium),
        cmocka_unit_test(a_room),
        cmocka_unit_test(a_medium_that_absorbs),
        cmocka_unit_test(nothing_is_ended),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
