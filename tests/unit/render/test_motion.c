/* What moves while the shutter is open: hits at every moment, steps, deformation, rest. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "common/base/memory.h"
#include "common/scene/scene_effects.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"
#include "worker/render/surface/render_motion.h"

static const float no_yes[2] = {0, 1};

/* One second a frame, the shutter open for all of it. */
static struct render_settings open_shutter(void)
{
    struct render_settings s = builder_settings(16, 16, 16);

    s.fps = 1;
    s.shutter = 1;
    return s;
}

static uint32_t triangle_mesh(struct scene_builder *b)
{
    static const float positions[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0};
    static const uint32_t indices[3] = {0, 1, 2};

    return builder_mesh(b, positions, NULL, 3, indices, 1, 0);
}

/* A ray from z = 5 down on (x, y) at `time`: where it meets the scene; 0 if it escapes. */
static int shoot(const struct render_scene *scene, float x, float y, float time, struct surface *s)
{
    const struct ray ray = {.origin = {x, y, 5}, .direction = {0, 0, -1}, .t_max = INFINITY,
                            .time = time};
    struct hit hit;

    if (!accel_intersect(scene->accel, &ray, NULL, &hit))
        return 0;
    surface_from_hit(scene, &ray, &hit, s);
    return 1;
}

static int inside_triangle(double x, double y) { return y > -1 && y < 1 - 2 * fabs(x); }

/* A triangle that moves by (3, -1, 2) in a second: hit where it then is, and nowhere else. */
static void test_moving_triangle(void **state)
{
    static const float path[6] = {0, 0, 0, 3, -1, 2};
    struct render_settings settings = open_shutter();
    struct test_random random = {3};
    struct render_scene *scene;
    struct scene_builder b;
    int hits = 0;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, triangle_mesh(&b), 0, vec3_splat(1), vec3_splat(0))->node = 0;
    builder_node(&b, -1, 0);
    builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, path);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->instances[0].motion_steps, 2);
    assert_true(scene->effects & EFFECT_MOTION_BLUR);
    assert_true(scene->camera.shutter_open);
    assert_int_equal(scene->camera.motion_steps, 0);
    for (int i = 0; i < 20000; i++) {
        float time = i % 100 == 0 ? 0 : i % 100 == 1 ? 1 : test_random_float(&random);
        float x = 8 * test_random_float(&random) - 3, y = 6 * test_random_float(&random) - 4;
        double dx = (double)x - 3 * (double)time, dy = (double)y + (double)time;
        int expected = inside_triangle(dx, dy);
        double margin = fmin(fabs(dy + 1), fabs(dy - 1 + 2 * fabs(dx)));
        struct surface s;
        int met = shoot(scene, x, y, time, &s);
        if (margin < 1e-5)
            continue;
        if (met != expected)
            fail_msg("(%g, %g) at %g: %s", (double)x, (double)y, (double)time, met ? "met" : "missed");
        if (!met)
            continue;
        hits++;
        assert_true(fabs((double)s.p.x - (double)x) < 1e-6);
        assert_true(fabs((double)s.p.y - (double)y) < 1e-6);
        assert_true(fabs((double)s.p.z - 2 * (double)time) < 1e-6);
        assert_true(fabs((double)s.t - (5 - 2 * (double)time)) < 1e-6);
        assert_true(s.ng.z == 1);
    }
    assert_true(hits > 500);
    render_scene_free(scene);
    builder_release(&b);
}

/* Quaternion of a turn about +Y. */
static void turn_y(double angle, float out[4])
{
    out[0] = out[2] = 0;
    out[1] = (float)sin(angle / 2);
    out[3] = (float)cos(angle / 2);
}

/* Rays at points of every triangle where it is said to be at that moment meet just these. */
static void hits_agree(const struct render_scene *scene, uint32_t triangles)
{
    struct test_random random = {5};
    int hits = 0;

    for (int i = 0; i < 5000; i++) {
        float time = test_random_float(&random);
        uint32_t triangle = (uint32_t)(test_random_float(&random) * (float)triangles);
        float u = 0.05f + 0.4f * test_random_float(&random);
        float v = 0.05f + 0.4f * test_random_float(&random);
        struct vec3 corner[3], at, n, origin;
        struct surface s;
        struct hit hit;
        struct ray ray;
        triangle_of_instance(scene, &scene->instances[0], triangle, time, corner);
        at = vec3_add(vec3_scale(corner[0], 1 - u - v), vec3_add(vec3_scale(corner[1], u), vec3_scale(corner[2], v)));
        n = vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
        if (vec3_length(n) < 1e-2f)
            continue; /* edge on, or collapsed */
        n = vec3_normalize(n);
        origin = vec3_mad(at, n, 0.01f);
        ray = (struct ray){.origin = origin, .direction = vec3_neg(n), .t_max = INFINITY,
                           .time = time};
        if (!accel_intersect(scene->accel, &ray, NULL, &hit))
            fail_msg("triangle %u at %g is not where it is", triangle, (double)time);
        assert_int_equal(hit.triangle, triangle);
        surface_from_hit(scene, &ray, &hit, &s);
        assert_true(vec3_length(vec3_sub(s.p, at)) < 1e-5f);
        assert_true(fabsf(s.t - 0.01f) < 1e-5f);
        hits++;
    }
    assert_true(hits > 2000);
}

/* A wing that turns: as many steps as keep its tips within a thousandth of its size, and the
 * hits are those of the chords. */
static void turning_scene(struct scene_builder *b, double angle)
{
    enum { KEYS = 65 };
    float times[KEYS], turns[4 * KEYS];

    builder_init(b);
    builder_lambert(b, 0.5f);
    builder_place(b, triangle_mesh(b), 0, vec3_splat(1), vec3_splat(0))->node = 0;
    builder_node(b, -1, 0);
    for (int k = 0; k < KEYS; k++) {
        times[k] = (float)k / (KEYS - 1);
        turn_y(angle * k / (KEYS - 1), turns + 4 * k);
    }
    builder_channel(b, 0, PATH_ROTATION, KEYS, times, turns);
    builder_camera(b, vec3_make(0, 0, 9), vec3_splat(0), 1);
}

static void test_turning(void **state)
{
    static const struct { double angle; uint32_t steps; } cases[] = {
        {0.05, 2}, {0.2, 3}, {M_PI / 3, 9}, {M_PI, 17}};
    struct render_settings settings = open_shutter();

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        struct render_scene *scene;
        struct scene_builder b;
        double worst = 0;
        turning_scene(&b, cases[k].angle);
        scene = builder_build(&b, &settings);
        assert_int_equal(scene->instances[0].motion_steps, cases[k].steps);
        assert_null(scene->instances[0].motion_positions);
        for (int i = 0; i <= 200; i++) {
            double t = i / 200.0, a = cases[k].angle * t;
            struct vec3 corner[3];
            triangle_of_instance(scene, &scene->instances[0], 0, (float)t, corner);
            worst = fmax(worst, hypot((double)corner[1].x - cos(a), (double)corner[1].z + sin(a)));
        }
        /* The cap of 17 steps leaves half a turn a chord of 1/200 at most. */
        if (worst > (cases[k].angle > 3 ? 0.005 : 0.003))
            fail_msg("turn of %g: a corner misses its path by %g", cases[k].angle, worst);
        hits_agree(scene, 1);
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* Twenty turns a frame: matrices mixed between such steps collapse, so the vertices are given;
 * the hits still are what corners_of_triangle says. */
static void test_spinning(void **state)
{
    struct render_settings settings = open_shutter();
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    turning_scene(&b, 23.3 * 2 * M_PI / 3);
    scene = builder_build(&b, &settings);
    assert_non_null(scene->instances[0].motion_positions);
    assert_true(scene->instances[0].instance_positions == scene->instances[0].motion_positions[0]);
    assert_int_equal(scene->instances[0].motion_steps, 17);
    hits_agree(scene, 1);
    render_scene_free(scene);
    builder_release(&b);
}

/* Two morph targets whose weights change at different speeds: vertex i is at
 * base + t * a + 0.5 t * b. Moved by a node at the same time. */
static void test_morphing(void **state)
{
    static const float base[12] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    static const float morphs[24] = {0, 0, 1, 0, 0, 0, 0,  0, 2, 0, 0, 0,
                                     2, 0, 0, 0, 2, 0, -1, 0, 0, 0, 0, 1};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    static const float weights[4] = {0, 0, 1, 0.5f}, path[6] = {0, 0, 0, 0, 4, 0};
    struct render_settings settings = open_shutter();
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_mesh_deforming(&b, base, 4, indices, 2, NULL, morphs, 2), 0, vec3_splat(1), vec3_splat(0))
        ->node = 0;
    builder_node(&b, -1, 2);
    builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, path);
    builder_channel(&b, 0, PATH_WEIGHTS, 2, no_yes, weights);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->instances[0].motion_steps, 2);
    assert_non_null(scene->instances[0].motion_positions);
    for (int i = 0; i <= 10; i++) {
        struct vec3 corner[3];
        double t = i / 10.0;
        for (uint32_t triangle = 0; triangle < 2; triangle++) {
            triangle_of_instance(scene, &scene->instances[0], triangle, (float)t, corner);
            for (int k = 0; k < 3; k++) {
                uint32_t v = 3 * indices[3 * triangle + (uint32_t)k];
                double x = (double)base[v] + t * (double)morphs[v] + 0.5 * t * (double)morphs[12 + v];
                double y = (double)base[v + 1] + t * (double)morphs[v + 1] + 0.5 * t * (double)morphs[13 + v] + 4 * t;
                double z = (double)base[v + 2] + t * (double)morphs[v + 2] + 0.5 * t * (double)morphs[14 + v];
                assert_true(fabs((double)corner[k].x - x) < 1e-6);
                assert_true(fabs((double)corner[k].y - y) < 1e-6);
                assert_true(fabs((double)corner[k].z - z) < 1e-6);
            }
        }
    }
    hits_agree(scene, 2);
    /* The bounding sphere holds it at both ends. */
    for (float t = 0; t <= 1; t++) {
        struct vec3 corner[3];
        triangle_of_instance(scene, &scene->instances[0], 1, t, corner);
        for (int k = 0; k < 3; k++)
            assert_true(vec3_length(vec3_sub(corner[k], scene->bounds_centre)) <= scene->bounds_radius);
    }
    render_scene_free(scene);
    builder_release(&b);
}

/* A strip whose far end hangs on a joint that turns a right angle about +Y: the near edge rests,
 * the far one goes round, the middle, which both hold by halves, goes half that way. */
static void test_skin(void **state)
{
    static const float base[18] = {0, -1, 0, 0, 1, 0, 1, -1, 0, 1, 1, 0, 2, -1, 0, 2, 1, 0};
    static const uint32_t indices[12] = {0, 2, 3, 0, 3, 1, 2, 4, 5, 2, 5, 3};
    static const struct mesh_influence influences[6] = {
        {{1, 0, 0, 0}, {0, 0, 0, 0}},       {{1, 0, 0, 0}, {0, 0, 0, 0}},
        {{0.5f, 0.5f, 0, 0}, {0, 1, 0, 0}}, {{0.5f, 0.5f, 0, 0}, {0, 1, 0, 0}},
        {{1, 0, 0, 0}, {1, 0, 0, 0}},       {{1, 0, 0, 0}, {1, 0, 0, 0}}};
    static const uint32_t joints[2] = {0, 1};
    struct render_settings settings = open_shutter();
    struct scene_instance *instance;
    struct render_scene *scene;
    struct scene_builder b;
    float turns[8];

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    instance = builder_place(&b, builder_mesh_deforming(&b, base, 6, indices, 4, influences, NULL, 0), 0, vec3_splat(7),
                             vec3_splat(9)); /* not used: the skin's joints are */
    instance->skin = builder_skin(&b, joints, 2);
    builder_node(&b, -1, 0);
    builder_node(&b, -1, 0);
    turn_y(0, turns);
    turn_y(M_PI / 2, turns + 4);
    builder_channel(&b, 1, PATH_ROTATION, 2, no_yes, turns);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_true(scene->instances[0].motion_steps > 4);
    assert_true(scene->instances[0].skinned && !scene->instances[0].flipped);
    for (int i = 0; i <= 16; i++) {
        double a = M_PI / 2 * i / 16;
        struct vec3 corner[3];
        triangle_of_instance(scene, &scene->instances[0], 2, (float)i / 16, corner);
        assert_true(fabs((double)corner[1].x - 2 * cos(a)) < 2e-3);
        assert_true(fabs((double)corner[1].z + 2 * sin(a)) < 2e-3);
        assert_true(fabs((double)corner[0].x - 0.5 * (1 + cos(a))) < 2e-3);
        assert_true(fabs((double)corner[0].z + 0.5 * sin(a)) < 2e-3);
        triangle_of_instance(scene, &scene->instances[0], 0, (float)i / 16, corner);
        assert_true(corner[0].x == 0 && corner[0].y == -1 && corner[0].z == 0);
    }
    hits_agree(scene, 4);
    render_scene_free(scene);
    builder_release(&b);
}

/* The shading normal where the ray down the Z axis meets the scene. */
static struct vec3 normal_at(const struct render_scene *scene, float time)
{
    struct bsdf_params params;
    struct surface s;

    assert_true(shoot(scene, 0, 0, time, &s));
    surface_shade(scene, &s, vec3_make(0, 0, 1), &params);
    return s.basis.n;
}

/* Vertex normals go along: with a joint that turns by 40 degrees, and with
 * a morph target that tilts nothing else. */
static void test_normals(void **state)
{
    static const float base[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0};
    static const float normals[9] = {0, 0, 1, 0, 0, 1, 0, 0, 1}, tilt[9] = {1, 0, 0, 1, 0, 0, 1, 0, 0};
    static const float still[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    static const uint32_t indices[3] = {0, 1, 2}, joint = 0;
    static const struct mesh_influence influences[3] = {
        {{1, 0, 0, 0}, {0, 0, 0, 0}}, {{1, 0, 0, 0}, {0, 0, 0, 0}}, {{1, 0, 0, 0}, {0, 0, 0, 0}}};
    static const float weights[2] = {0, 0.25f};
    const double last = 0.7;

    (void)state;
    for (int skin = 0; skin < 2; skin++) {
        struct render_settings settings = open_shutter();
        struct scene_instance *instance;
        struct render_scene *scene;
        struct scene_builder b;
        float turns[8];
        builder_init(&b);
        builder_lambert(&b, 0.5f);
        instance = builder_place(&b,
                                 builder_mesh_deforming_smooth(&b, base, normals, 3, indices, 1,
                                                               skin ? influences : NULL, still, tilt, !skin),
                                 0, vec3_splat(1), vec3_splat(0));
        builder_node(&b, -1, !skin);
        turn_y(0, turns);
        turn_y(last, turns + 4);
        if (skin) {
            instance->skin = builder_skin(&b, &joint, 1);
            builder_channel(&b, 0, PATH_ROTATION, 2, no_yes, turns);
        } else {
            instance->node = 0;
            builder_channel(&b, 0, PATH_WEIGHTS, 2, no_yes, weights);
        }
        builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
        scene = builder_build(&b, &settings);
        assert_non_null(scene->instances[0].motion_normals);
        for (int i = 0; i <= 10; i++) {
            double t = i / 10.0, angle = skin ? last * t : atan(0.25 * t);
            struct vec3 n = normal_at(scene, (float)t);
            assert_true(fabs((double)n.x - sin(angle)) < 2e-3);
            assert_true(fabs((double)n.y) < 1e-6);
            assert_true(fabs((double)n.z - cos(angle)) < 2e-3);
        }
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* A rigid instance turns its vertices' normals, which lean, at each moment of the shutter. */
static void test_rigid_normals(void **state)
{
    static const float base[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0};
    static const uint32_t indices[3] = {0, 1, 2};
    const double lean = 0.3, last = 0.7;
    const float x = (float)sin(lean), z = (float)cos(lean);
    const float normals[9] = {x, 0, z, x, 0, z, x, 0, z};
    struct render_settings settings = open_shutter();
    struct render_scene *scene;
    struct scene_builder b;
    float turns[8];

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_mesh(&b, base, normals, 3, indices, 1, 0), 0, vec3_splat(1), vec3_splat(0))->node =
        (int32_t)builder_node(&b, -1, 0);
    turn_y(0, turns);
    turn_y(last, turns + 4);
    builder_channel(&b, 0, PATH_ROTATION, 2, no_yes, turns);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    for (int i = 0; i <= 10; i++) {
        struct vec3 n = normal_at(scene, (float)i / 10);
        double angle = lean + last * i / 10;

        assert_true(fabs((double)n.x - sin(angle)) < 2e-3 && fabs((double)n.z - cos(angle)) < 2e-3);
    }
    render_scene_free(scene);
    builder_release(&b);
}

/* All of a frame's floats. */
static void frame_bits(const struct render_scene *scene, uint32_t frame, float *out)
{
    struct render_stats stats = {0};

    render_tile(scene, frame, 0, 0, 0, out, NULL, &stats);
}

/* With a closed shutter an animated frame is, bit by bit, the scene as it stands then; in
 * another frame it is another; and an open shutter without motion blur is a closed one. */
static void test_closed_shutter(void **state)
{
    enum { FLOATS = 2 * 16 * 16 * 3 };
    static const float path[6] = {0, 0, 0, 2, 1, -4};
    static float moving[3][FLOATS], standing[FLOATS], other[FLOATS];

    (void)state;
    for (int k = 0; k < 3; k++) {
        struct render_settings settings = open_shutter();
        struct render_scene *scene;
        struct scene_builder b;
        struct error err = {0};
        int animated = k > 0;

        settings.fps = 4;
        settings.shutter = k == 2 ? 0.5f : 0;
        settings.without = k == 2 ? EFFECT_MOTION_BLUR : 0;
        builder_init(&b);
        builder_lambert(&b, 0.5f);
        builder_place(&b, builder_sphere(&b, 6, 1), 0, vec3_splat(1),
                      animated ? vec3_splat(0) : vec3_make(0.5f, 0.25f, -1))->node = animated ? 0 : -1;
        if (animated) {
            builder_node(&b, -1, 0);
            builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, path);
        }
        builder_place(&b, builder_quad(&b), 0, vec3_splat(3), vec3_make(0, -1.5f, 0));
        builder_environment_constant(&b, vec3_make(1, 2, 3));
        builder_camera(&b, vec3_make(0, 1, 9), vec3_splat(0), 0.5f);
        assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 1, builder_source(&b), &err), STATUS_OK);
        assert_int_equal(scene->animated, animated);
        assert_int_equal(scene->effects & EFFECT_MOTION_BLUR ? 1 : 0, 0);
        frame_bits(scene, 1, animated ? moving[k] : standing);
        render_scene_free(scene);
        if (k == 1) {
            assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 2, builder_source(&b), &err), STATUS_OK);
            frame_bits(scene, 1, other);
            render_scene_free(scene);
        }
        builder_release(&b);
    }
    assert_memory_equal(moving[1], standing, sizeof standing);
    assert_memory_equal(moving[2], standing, sizeof standing);
    assert_memory_not_equal(moving[1], other, sizeof other);
}

/* What is said to move but stands costs nothing: no steps, no time. */
static void test_standing_node(void **state)
{
    static const float path[6] = {1, 2, 3, 1, 2, 3};
    struct render_settings settings = open_shutter();
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, triangle_mesh(&b), 0, vec3_splat(1), vec3_splat(0))->node = 0;
    builder_node(&b, -1, 0);
    builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, path);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->instances[0].motion_steps, 0);
    assert_int_equal(scene->camera.shutter_open, 0);
    assert_int_equal(scene->effects & EFFECT_MOTION_BLUR ? 1 : 0, 0);
    assert_true(scene->instances[0].instance_positions[0] == 0);
    assert_true(scene->instances[0].instance_positions[2] == 3);
    render_scene_free(scene);
    builder_release(&b);
}

/* A camera on a node, and a lamp on another. */
static void test_camera_and_light(void **state)
{
    static const float path[6] = {0, 0, 9, 0, 3, 9}, lamp[6] = {0, 1, 0, 0, 5, 0};
    struct render_settings settings = open_shutter();
    struct render_scene *scene;
    struct scene_builder b;
    struct error err = {0};

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, triangle_mesh(&b), 0, vec3_splat(1), vec3_splat(0));
    builder_node(&b, -1, 0);
    builder_node(&b, -1, 0);
    builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, path);
    builder_channel(&b, 1, PATH_TRANSLATION, 2, no_yes, lamp);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    b.scene.cameras[0].node = 0;
    builder_light(&b, LIGHT_POINT)->node = 1;
    b.scene.lights[0].intensity[0] = 1;
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->instances[0].motion_steps, 0);
    assert_int_equal(scene->camera.motion_steps, 2);
    assert_true(scene->camera.to_world.m[1][3] == 0);
    assert_true(camera_to_world_at(&scene->camera, 0.5f).m[1][3] == 1.5f);
    assert_int_equal(scene->emitters.punctual[0]->motion.steps, 2);
    assert_true(scene->emitters.punctual[0]->pose.position.y == 1);
    assert_true(scene->emitters.punctual[0]->motion.at[1].position.y == 5);
    render_scene_free(scene);
    /* Half a frame a second: frame 1 is at half a second. */
    settings.fps = 2;
    settings.shutter = 0;
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 1, builder_source(&b), &err), STATUS_OK);
    assert_int_equal(scene->camera.motion_steps, 0);
    assert_true(scene->camera.to_world.m[1][3] == 1.5f);
    render_scene_free(scene);
    builder_release(&b);
}

/* A light alone calls for motion blur, and for rays with a time, if what it asks for moves: a point
 * light that only turns stands still, and so does one that is black or left out. */
static void test_light_alone(void **state)
{
    static const float path[6] = {0, 1, 0, 0, 5, 0};
    static const struct {
        int turns;
        enum scene_light_kind kind;
        float intensity;
        uint64_t without;
        int moves;
    } cases[] = {
        {0, LIGHT_POINT, 1, 0, 1},
        {0, LIGHT_DIRECTIONAL, 1, 0, 0},
        {0, LIGHT_POINT, 0, 0, 0},
        {0, LIGHT_POINT, 1, EFFECT_PUNCTUAL_LIGHT, 0},
        {0, LIGHT_POINT, 1, EFFECT_MOTION_BLUR, 0},
        {1, LIGHT_POINT, 1, 0, 0},
        {1, LIGHT_SPOT, 1, 0, 1},
        {1, LIGHT_DIRECTIONAL, 1, 0, 1},
        {1, LIGHT_GONIOMETRIC, 1, 0, 1},
    };

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        struct render_settings settings = open_shutter();
        struct effect_cause causes[EFFECT_COUNT];
        struct render_scene *scene;
        struct scene_builder b;
        struct scene_light *light;
        float turns[8];

        builder_init(&b);
        builder_lambert(&b, 0.5f);
        builder_place(&b, triangle_mesh(&b), 0, vec3_splat(1), vec3_splat(0));
        builder_node(&b, -1, 0);
        turn_y(0, turns);
        turn_y(1, turns + 4);
        if (cases[k].turns)
            builder_channel(&b, 0, PATH_ROTATION, 2, no_yes, turns);
        else
            builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, path);
        builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
        light = builder_light(&b, cases[k].kind);
        light->node = 0;
        light->name = "lamp";
        for (int c = 0; c < 3; c++)
            light->intensity[c] = cases[k].intensity;
        settings.without = cases[k].without;
        scene = builder_build(&b, &settings);
        assert_int_equal(scene->camera.shutter_open, cases[k].moves);
        assert_int_equal(scene->effects >> EFFECT_BIT_MOTION_BLUR & 1, cases[k].moves);
        if (scene->emitters.punctual_count)
            assert_int_equal(scene->emitters.punctual[0]->motion.steps > 0, cases[k].moves);
        render_scene_free(scene);
        if (cases[k].moves) {
            scene_effects(&b.scene, &settings, 0, causes);
            assert_string_equal(causes[EFFECT_BIT_MOTION_BLUR].kind, "light");
            assert_string_equal(causes[EFFECT_BIT_MOTION_BLUR].name, "lamp");
        }
        builder_release(&b);
    }
}

/* A thing that is scaled to nothing and back: no matrix of it can be inverted half way. It is
 * there at both ends and a point, that no ray meets, in the middle. */
static void test_vanishing(void **state)
{
    static const float times[3] = {0, 0.5f, 1}, scales[9] = {1, 1, 1, 0, 0, 0, 1, 1, 1};
    struct render_settings settings = open_shutter();
    struct render_scene *scene;
    struct scene_builder b;
    struct surface s;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, triangle_mesh(&b), 0, vec3_splat(1), vec3_splat(0))->node = 0;
    builder_node(&b, -1, 0);
    builder_channel(&b, 0, PATH_SCALE, 3, times, scales);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->instances[0].motion_steps, 3);
    assert_non_null(scene->instances[0].motion_positions);
    assert_true(shoot(scene, 0.1f, -0.9f, 0, &s));
    assert_true(s.ng.z == 1);
    assert_true(shoot(scene, 0.1f, -0.9f, 0.99f, &s));
    assert_false(shoot(scene, 0.1f, -0.9f, 0.3f, &s));
    assert_true(shoot(scene, 0.03f, -0.2f, 0.3f, &s));
    assert_false(shoot(scene, 0.03f, -0.2f, 0.5f, &s));
    hits_agree(scene, 1);
    render_scene_free(scene);
    builder_release(&b);
}

/* Out of memory at every place, with everything that moves. */
static void test_out_of_memory(void **state)
{
    static const float base[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0}, morph[9] = {0, 0, 1};
    static const uint32_t indices[3] = {0, 1, 2};
    static const float path[6] = {0, 0, 0, 3, -1, 2};
    struct render_settings settings = open_shutter();
    struct render_scene *scene = NULL;
    struct scene_builder b;
    struct error err = {0};
    long n = 0;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, triangle_mesh(&b), 0, vec3_splat(1), vec3_splat(0))->node = 0;
    builder_place(&b, builder_mesh_deforming_smooth(&b, base, base, 3, indices, 1, NULL, morph, morph, 1),
                  0, vec3_splat(1), vec3_splat(0))->node = 1;
    builder_node(&b, -1, 0);
    builder_node(&b, -1, 1);
    builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, path);
    builder_channel(&b, 1, PATH_WEIGHTS, 2, no_yes, no_yes);
    builder_camera(&b, vec3_make(0, 0, 9), vec3_splat(0), 1);
    for (;; n++) {
        status s;
        mem_fault_arm(n, 1);
        s = render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err);
        if (mem_fault_count() == 0) {
            mem_fault_arm(-1, 0);
            assert_int_equal(s, STATUS_OK);
            break;
        }
        mem_fault_arm(-1, 0);
        /* Where the question was only whether something moves, the answer "yes" is no failure. */
        if (s == STATUS_OK)
            render_scene_free(scene);
        else if (s != STATUS_ERR_NO_MEMORY)
            fail_msg("allocation %ld failed and the status is '%s'", n, status_text(s));
    }
    assert_true(n > 20);
    render_scene_free(scene);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_moving_triangle), cmocka_unit_test(test_turning),
        cmocka_unit_test(test_spinning),        cmocka_unit_test(test_morphing),
        cmocka_unit_test(test_skin),            cmocka_unit_test(test_normals),
        cmocka_unit_test(test_rigid_normals),
        cmocka_unit_test(test_closed_shutter),
        cmocka_unit_test(test_vanishing),       cmocka_unit_test(test_standing_node),
        cmocka_unit_test(test_camera_and_light), cmocka_unit_test(test_light_alone),
        cmocka_unit_test(test_out_of_memory),
    };
    render_keep_origin(1); /* rays and places here are in the scenes' own coordinates */
    return cmocka_run_group_tests_name("motion", tests, NULL, NULL);
}
