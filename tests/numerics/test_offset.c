/* Rays that leave a surface do not meet it again, at any scale and place. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/render_scene.h"

/* A white plane (two coplanar triangles) under a constant environment, seen at a grazing
 * angle: with one bounce by the cosine every pixel is exactly its albedo, unless a ray that
 * leaves the plane meets it again and comes back black. */
static double plane_mean(float scale, struct vec3 shift)
{
    struct scene_builder b;
    struct render_settings settings = builder_settings(32, 32, 4);
    struct render_stats stats = {0};
    struct render_scene *scene;
    static double mean[32 * 32 * 3];
    double sum = 0;
    uint32_t quad;

    settings.max_depth = 1;
    settings.env_sampling = ENV_SAMPLING_BSDF; /* cosine sampling: no variance at all here */
    builder_init(&b);
    builder_lambert(&b, 1);
    quad = builder_quad(&b);
    builder_place(&b, quad, 0, vec3_make(scale, scale, scale), shift);
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_add(shift, vec3_scale(vec3_make(0.3f, 0.05f, 0.9f), scale)),
                   vec3_add(shift, vec3_scale(vec3_make(0.1f, 0, -0.1f), scale)), 0.02f);
    scene = builder_build(&b, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    for (size_t i = 0; i < 32 * 32 * 3; i++)
        sum += mean[i];
    render_scene_free(scene);
    builder_release(&b);
    return sum / (32 * 32 * 3);
}

static void test_scales(void **state)
{
    (void)state;
    for (int e = -6; e <= 6; e++) {
        double got = plane_mean((float)pow(10, e), vec3_splat(0));
        if (fabs(got - 1) > 1e-5)
            fail_msg("scale 1e%d: mean %.7f instead of 1", e, got);
    }
}

static void test_translations(void **state)
{
    (void)state;
    for (int e = 0; e <= 4; e++) {
        float d = (float)pow(10, e);
        double got = plane_mean(1, vec3_make(d, 0.37f * d, -0.71f * d));
        if (fabs(got - 1) > 1e-5)
            fail_msg("moved by 1e%d: mean %.7f instead of 1", e, got);
    }
}

/* A tilted pile of triangles: a fine sphere, moved and scaled; a convex white body in a
 * furnace is invisible, so any self-hit of the first bounce shows. */
static void test_sphere_places(void **state)
{
    static const struct { float scale, shift; } cases[] = {
        {1, 0}, {1, 1e3f}, {1e-3f, 0}, {1e3f, 1e4f}, {1e5f, 0}, {1e-5f, 1e-3f}};

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        struct scene_builder b;
        struct render_settings settings = builder_settings(24, 24, 16);
        struct render_stats stats = {0};
        struct render_scene *scene;
        static double mean[24 * 24 * 3];
        double low = 1e9, sum = 0;
        float s = cases[k].scale;
        struct vec3 at = vec3_make(cases[k].shift, -0.3f * cases[k].shift, 0.7f * cases[k].shift);

        settings.max_depth = 1; /* one bounce: a second hit would be black */
        settings.env_sampling = ENV_SAMPLING_BSDF;
        builder_init(&b);
        builder_lambert(&b, 1);
        builder_place(&b, builder_sphere(&b, 64, 0), 0, vec3_splat(s), at);
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_add(at, vec3_make(0, 0, 4 * s)), at, 0.45f);
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, mean, NULL, &stats);
        for (size_t i = 0; i < 24 * 24 * 3; i++) {
            sum += mean[i];
            low = fmin(low, mean[i]);
        }
        sum /= 24 * 24 * 3;
        if (fabs(sum - 1) > 1e-5 || low < 0.9999)
            fail_msg("sphere of radius %g at %g: mean %.6f, darkest pixel %.4f", (double)s, (double)cases[k].shift, sum,
                     low);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* The same plane as one of many instances, which Embree meets in object space. */
static void test_instances(void **state)
{
    struct scene_builder b;
    struct render_settings settings = builder_settings(32, 32, 4);
    struct render_stats stats = {0};
    struct render_scene *scene;
    static double mean[32 * 32 * 3];
    double sum = 0;
    uint32_t sphere;

    (void)state;
    settings.max_depth = 1;
    settings.env_sampling = ENV_SAMPLING_BSDF; /* cosine sampling: no variance at all here */
    builder_init(&b);
    builder_lambert(&b, 1);
    sphere = builder_sphere(&b, 128, 0); /* 65 024 triangles: two of them stay instances */
    builder_place(&b, sphere, 0, vec3_splat(1), vec3_make(1000, 0, 0));
    builder_place(&b, sphere, 0, vec3_make(2, 3, 1), vec3_make(1000, 300, -700));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(1000, 300, -690), vec3_make(1000, 300, -700), 0.3f);
    scene = builder_build(&b, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    for (size_t i = 0; i < 32 * 32 * 3; i++)
        sum += mean[i];
    sum /= 32 * 32 * 3;
    render_scene_free(scene);
    builder_release(&b);
    figure_within("white instance 1 km away, in a furnace", sum, 1 - 1e-5, 1 + 1e-5, "closed form, tolerance 1e-5");
}

/* A ball of 2 km that a matrix makes of one of 2 m, its pole at the origin, seen from 4 mm: Embree's
 * error there is that of the ball's edges of 50 m, not of the mesh's. */
static void test_large_instance(void **state)
{
    struct render_settings settings = builder_settings(32, 32, 16);
    struct render_stats stats = {0};
    static const double turn[3][3] = {{0.6, -0.48, 0.64}, {0.8, 0.36, -0.48}, {0, 0.8, 0.6}};
    static double mean[32 * 32 * 3];
    struct render_scene *scene;
    struct scene_builder b;
    double sum = 0;
    uint32_t ball;

    (void)state;
    settings.max_depth = 1;
    settings.env_sampling = ENV_SAMPLING_BSDF;
    builder_init(&b);
    builder_lambert(&b, 1);
    ball = builder_sphere(&b, 128, 0);
    for (int k = 0; k < 2; k++) { /* one alone would be copied into the world */
        struct scene_instance *instance = builder_place(&b, ball, 0, vec3_splat(1), vec3_splat(0));
        for (int r = 0; r < 3; r++) {
            for (int c = 0; c < 3; c++)
                instance->to_world.m[r][c] = 1000 * turn[r][c];
            instance->to_world.m[r][3] = (k ? -1e5 : -1000) * turn[r][1];
        }
    }
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make((float)turn[0][1] * 0.004f, (float)turn[1][1] * 0.004f, (float)turn[2][1] * 0.004f),
                   vec3_splat(0), 0.3f);
    scene = builder_build(&b, &settings);
    assert_null(scene->instances[0].instance_positions);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    for (size_t i = 0; i < 32 * 32 * 3; i++)
        sum += mean[i] / (32 * 32 * 3);
    render_scene_free(scene);
    builder_release(&b);
    figure_within("pole of a white ball of 2 km, an instance of one of 2 m, in a furnace", sum, 1 - 1e-5, 1 + 1e-5,
                  "closed form, tolerance 1e-5");
}

/* A plane that moves, turns, spins or bends while the shutter is open, seen at a grazing angle
 * by a camera that rides along: at every moment the rays that leave it must not meet it again. */
enum mover { BY_TRANSLATION, BY_TURNING, BY_SPINNING, BY_BENDING, MOVERS };

static double moving_plane_mean(enum mover mover, float scale, float distance)
{
    static const float no_yes[2] = {0, 1};
    static const float square[12] = {-1, 0, -1, -1, 0, 1, 1, 0, 1, 1, 0, -1};
    static const float lifted[12] = {0, 2, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0}; /* stays a plane */
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    static double mean[32 * 32 * 3];
    struct render_settings settings = builder_settings(32, 32, 4);
    struct render_stats stats = {0};
    struct scene_instance *instance;
    struct render_scene *scene;
    struct scene_builder b;
    float path[6] = {0}, turns[4 * 9], times[9];
    double sum = 0;

    settings.max_depth = 1;
    settings.env_sampling = ENV_SAMPLING_BSDF;
    settings.fps = 1;
    settings.shutter = 1;
    builder_init(&b);
    builder_lambert(&b, 1);
    instance = builder_place(
        &b, mover == BY_BENDING ? builder_mesh_deforming(&b, square, 4, indices, 2, NULL, lifted, 1) : builder_quad(&b),
        0, vec3_splat(1), vec3_splat(0));
    builder_node(&b, -1, 0); /* where it all is, and how large */
    b.scene.nodes[0].translation[0] = distance;
    b.scene.nodes[0].translation[2] = -0.7f * distance;
    b.scene.nodes[0].scale[0] = b.scene.nodes[0].scale[1] = b.scene.nodes[0].scale[2] = scale;
    builder_node(&b, 0, mover == BY_BENDING);
    builder_node(&b, mover == BY_TRANSLATION ? 1 : 0, 0); /* the camera's */
    instance->node = 1;
    path[3] = 5;
    path[4] = 3;
    for (int k = 0; k < 9; k++) {
        double angle = (mover == BY_SPINNING ? 60 : 0.5) * k / 8;
        times[k] = (float)k / 8;
        turns[4 * k] = turns[4 * k + 2] = 0;
        turns[4 * k + 1] = (float)sin(angle / 2); /* in its own plane */
        turns[4 * k + 3] = (float)cos(angle / 2);
    }
    if (mover == BY_TRANSLATION)
        builder_channel(&b, 1, PATH_TRANSLATION, 2, no_yes, path);
    else if (mover == BY_BENDING)
        builder_channel(&b, 1, PATH_WEIGHTS, 2, no_yes, no_yes);
    else
        builder_channel(&b, 1, PATH_ROTATION, 9, times, turns);
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_splat(0), vec3_make(0, 0, -1), 0.02f);
    b.scene.nodes[2].translation[0] = 0.1f;
    b.scene.nodes[2].translation[1] = mover == BY_BENDING ? 4 : 0.05f;
    b.scene.nodes[2].translation[2] = mover == BY_BENDING ? 0 : 0.3f;
    b.scene.nodes[2].rotation[0] = (float)-sin(mover == BY_BENDING ? M_PI / 4 : 0.07);
    b.scene.nodes[2].rotation[3] = (float)cos(mover == BY_BENDING ? M_PI / 4 : 0.07);
    b.scene.cameras[0].node = 2;
    scene = builder_build(&b, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    for (size_t i = 0; i < 32 * 32 * 3; i++)
        sum += mean[i];
    /* Every sample met the plane: one ray to it, one that left it. */
    assert_int_equal(stats.work.rays, 2 * stats.work.samples);
    render_scene_free(scene);
    builder_release(&b);
    return sum / (32 * 32 * 3);
}

static void test_moving(void **state)
{
    static const struct { float scale, distance; } places[] = {
        {1, 0}, {1, 1e3f}, {1e-3f, 0}, {1e3f, 1e4f}, {1, 1e4f}};

    (void)state;
    for (int mover = 0; mover < MOVERS; mover++)
        for (size_t k = 0; k < sizeof places / sizeof *places; k++) {
            double got = moving_plane_mean((enum mover)mover, places[k].scale, places[k].distance);
            if (fabs(got - 1) > 1e-5)
                fail_msg("mover %d, scale %g at %g: mean %.7f instead of 1", mover, (double)places[k].scale,
                         (double)places[k].distance, got);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scales),
        cmocka_unit_test(test_translations),
        cmocka_unit_test(test_sphere_places),
        cmocka_unit_test(test_instances),
        cmocka_unit_test(test_large_instance),
        cmocka_unit_test(test_moving),
    };
    return cmocka_run_group_tests_name("offset", tests, NULL, NULL);
}
