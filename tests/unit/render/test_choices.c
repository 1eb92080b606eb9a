/* Choices of algorithm that may change the picture: clamping, texture filter, Embree's build quality and
 * robust flag. What they do, and what they leave alone. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/light/light_table.h"
#include "worker/render/render_scene.h"

enum { SIDE = 16 };

static void render(struct scene_builder *b, const struct render_settings *settings, double *mean,
                   struct render_stats *stats)
{
    struct render_scene *scene = builder_build(b, settings);

    memset(stats, 0, sizeof *stats);
    builder_render(scene, settings, 0, mean, NULL, stats);
    render_scene_free(scene);
}

/* ---- clamping ------------------------------------------------------------------------------ */

/* A lamp fills the picture: every sample is its radiance (8, 4, 2). */
static void bright(struct scene_builder *b)
{
    struct scene_material *m;

    builder_init(b);
    m = builder_lambert(b, 0);
    m->emission[0] = 8;
    m->emission[1] = 4;
    m->emission[2] = 2;
    builder_place(b, builder_quad(b), 0, vec3_splat(10), vec3_splat(0));
    builder_camera(b, vec3_make(0, 2, 0), vec3_splat(0), 0.5f);
}

static void test_clamp(void **state)
{
    struct render_settings settings = builder_settings(SIDE, SIDE, 6);
    double mean[SIDE * SIDE * 3], kept_luminance = 0.212656 * 2 + 0.715158 + 0.072186 * 0.5;
    struct render_stats stats;
    struct scene_builder b;
    double samples = SIDE * SIDE * 6;

    (void)state;
    bright(&b);
    render(&b, &settings, mean, &stats);
    assert_true(fabs(mean[0] - 8) < 1e-6 && stats.work.clamped_samples == 0);
    assert_true(stats.work.clamped_luminance == 0 && stats.work.kept_luminance == 0);

    settings.clamp = 8; /* nothing is above it */
    render(&b, &settings, mean, &stats);
    assert_true(fabs(mean[0] - 8) < 1e-6 && stats.work.clamped_samples == 0);
    assert_true(stats.work.clamped_luminance == 0);
    assert_true(fabs(stats.work.kept_luminance / (4 * kept_luminance * samples) - 1) < 1e-6);

    settings.clamp = 2; /* a quarter, and the hue stays */
    render(&b, &settings, mean, &stats);
    for (int i = 0; i < SIDE * SIDE; i++)
        assert_true(fabs(mean[3 * i] - 2) < 1e-6 && fabs(mean[3 * i + 1] - 1) < 1e-6 &&
                    fabs(mean[3 * i + 2] - 0.5) < 1e-6);
    assert_int_equal(stats.work.clamped_samples, (uint64_t)samples);
    assert_true(fabs(stats.work.kept_luminance / (kept_luminance * samples) - 1) < 1e-6);
    assert_true(fabs(stats.work.clamped_luminance / (3 * kept_luminance * samples) - 1) < 1e-6);
    builder_release(&b);
}

/* What was removed is a function of the unit: two threads in any order report the same bits. */
static void test_clamp_is_deterministic(void **state)
{
    struct render_settings settings = builder_settings(SIDE, SIDE, 8);
    double mean[SIDE * SIDE * 3];
    struct render_stats one, two;
    struct scene_builder b;

    (void)state;
    builder_room(&b, NULL);
    settings.clamp = 0.7f;
    render(&b, &settings, mean, &one);
    render(&b, &settings, mean, &two);
    assert_true(one.work.clamped_samples > 0 && one.work.clamped_samples < one.work.samples);
    assert_memory_equal(&one, &two, sizeof one);
    builder_release(&b);
}

/* ---- textures ------------------------------------------------------------------------------ */

static void textured(struct scene_builder *b)
{
    enum { N = 64 };
    static float rgb[N * N * 3];
    struct scene_material *m;

    for (int i = 0; i < N * N * 3; i++)
        rgb[i] = (float)(i % 5);
    builder_init(b);
    m = builder_lambert(b, 1);
    m->unlit = 1;
    m->base_color_texture.texture = (int32_t)builder_texture(b, rgb, N, N);
    builder_place(b, builder_quad(b), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(b, vec3_make(0, 2, 0), vec3_splat(0), 0.5f);
}

/* Without the cone no pyramid is made. What the filters see: statistics/test_texture_filter. */
static void test_texture_filter_saves_memory(void **state)
{
    size_t bytes[TEXTURE_FILTER_COUNT];

    (void)state;
    for (int f = 0; f < TEXTURE_FILTER_COUNT; f++) {
        struct render_settings settings = builder_settings(SIDE, SIDE, 1);
        struct render_scene_info info;
        struct render_scene *scene;
        struct scene_builder b;

        textured(&b);
        settings.texture_filter = (enum texture_filter)f;
        scene = builder_build(&b, &settings);
        render_scene_info(scene, &info);
        bytes[f] = info.texture_bytes;
        render_scene_free(scene);
        builder_release(&b);
    }
    assert_true(bytes[TEXTURE_FILTER_BILINEAR] < bytes[TEXTURE_FILTER_CONE] * 4 / 5);
    assert_int_equal(bytes[TEXTURE_FILTER_NEAREST], bytes[TEXTURE_FILTER_BILINEAR]);
}

/* ---- Embree -------------------------------------------------------------------------------- */

static void many_balls(struct scene_builder *b)
{
    struct scene_material *glass;
    uint32_t ball;

    builder_room(b, NULL);
    glass = builder_lambert(b, 1);
    glass->specular = glass->transmission = 1;
    glass->roughness = 0;
    glass->refractive = 1;
    ball = builder_sphere(b, 24, 0);
    for (int i = 0; i < 6; i++)
        builder_place(b, ball, builder_last_material(b), vec3_splat(0.5f),
                      vec3_make((float)i - 2.5f, 0.4f * (float)(i % 3), 1.5f));
}

/* Other trees, the same hits: what is met near a ray's ends is decided in double, so pictures agree but
 * for exact ties. */
static void test_bvh_quality(void **state)
{
    double mean[BVH_QUALITY_COUNT][SIDE * SIDE * 3];
    uint64_t bytes[BVH_QUALITY_COUNT];

    (void)state;
    for (int q = 0; q < BVH_QUALITY_COUNT; q++) {
        struct render_settings settings = builder_settings(SIDE, SIDE, 16);
        struct render_stats stats = {0};
        struct render_scene_info info;
        struct render_scene *scene;
        struct scene_builder b;

        many_balls(&b);
        settings.bvh_quality = (enum bvh_quality)q;
        settings.not_robust = 1;
        scene = builder_build(&b, &settings);
        render_scene_info(scene, &info);
        bytes[q] = info.bvh_bytes;
        builder_render(scene, &settings, 0, mean[q], NULL, &stats);
        render_scene_free(scene);
        builder_release(&b);
    }
    print_message("# bytes: medium %llu, low %llu, high %llu\n", (unsigned long long)bytes[0],
                  (unsigned long long)bytes[1], (unsigned long long)bytes[2]);
    assert_true(bytes[BVH_QUALITY_LOW] != bytes[BVH_QUALITY_MEDIUM]);
    assert_true(bytes[BVH_QUALITY_HIGH] != bytes[BVH_QUALITY_MEDIUM]);
    for (int q = 1; q < BVH_QUALITY_COUNT; q++)
        for (int i = 0; i < SIDE * SIDE * 3; i++)
            assert_true(fabs(mean[q][i] - mean[0][i]) < 1e-6 * (1 + fabs(mean[0][i])));
}

/* Rays from the middle of a closed ball, straight at its vertices and edges. */
static uint64_t escapes(int not_robust)
{
    struct render_settings settings = builder_settings(1, 1, 1);
    struct render_scene *scene;
    struct test_random random = {3};
    struct scene_builder b;
    const struct render_mesh *mesh;
    uint64_t out = 0;

    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_sphere(&b, 40, 0), 0, vec3_splat(1), vec3_make(3, 7, 11));
    builder_camera(&b, vec3_make(3, 7, 11), vec3_make(3, 7, 12), 1);
    settings.not_robust = not_robust;
    scene = builder_build(&b, &settings);
    mesh = &scene->meshes[0];
    for (uint32_t i = 0; i < 200000; i++) {
        const uint32_t *vertex = triangle_vertices(mesh, i % mesh->triangle_count);
        const float *p = mesh->positions + 3 * (size_t)vertex[0];
        const float *q = mesh->positions + 3 * (size_t)vertex[1];
        struct ray ray = {.origin = {3, 7, 11}, .t_max = INFINITY};
        float along = test_random_float(&random);
        struct hit hit;

        ray.direction = vec3_normalize(vec3_lerp(vec3_make(p[0], p[1], p[2]), vec3_make(q[0], q[1], q[2]), along));
        out += !accel_intersect(scene->accel, &ray, NULL, &hit);
    }
    render_scene_free(scene);
    builder_release(&b);
    return out;
}

static void test_robust(void **state)
{
    uint64_t robust = escapes(0), loose = escapes(1);

    (void)state;
    print_message("# of 200000 rays at edges %llu slip through, not robust %llu\n", (unsigned long long)robust,
                  (unsigned long long)loose);
    assert_true(robust < 10 && loose > 10 * robust + 100);
}

/* ---- the table of lights ------------------------------------------------------------------- */

static void test_light_table(void **state)
{
    enum { COUNT = 37, DRAWS = 400000 };
    struct test_random random = {11};
    struct error err = {0};
    struct light_table table;
    double weights[COUNT], hits[COUNT] = {0}, sum = 0, statistic = 0;
    int cells = 0;

    (void)state;
    for (int i = 0; i < COUNT; i++)
        weights[i] = i % 5 == 3 ? 0 : pow(10, 4 * test_random_double(&random));
    weights[20] = 1e-30;
    assert_int_equal(light_table_init(&table, weights, COUNT, &err), STATUS_OK);
    for (int k = 0; k < DRAWS; k++) {
        float u = test_random_float(&random), v = test_random_float(&random), odds;
        uint32_t light;

        assert_true(light_table_choose(&table, &u, &v, &light, &odds));
        assert_true(u >= 0 && u < 1 && v >= 0 && v < 1);
        assert_true(odds > 0 && odds == light_table_odds(&table, light));
        hits[light]++;
    }
    for (uint32_t i = 0; i < COUNT; i++) {
        double odds = (double)light_table_odds(&table, i), expected = odds * DRAWS;

        sum += odds;
        assert_true((odds > 0) == (weights[i] > 0));
        if (!(weights[i] > 0)) {
            assert_true(hits[i] == 0);
        } else if (expected > 10) {
            statistic += (hits[i] - expected) * (hits[i] - expected) / expected;
            cells++;
        }
    }
    assert_true(fabs(sum - 1) < 1e-5);
    assert_true(chi_square_p_value(statistic, cells - 1) > 0.001);
    light_table_release(&table);

    for (int i = 0; i < COUNT; i++)
        weights[i] = 1;
    assert_int_equal(light_table_init(&table, weights, COUNT, &err), STATUS_OK);
    for (uint32_t i = 0; i < COUNT; i++)
        assert_true(fabs((double)light_table_odds(&table, i) * COUNT - 1) < 1e-5);
    light_table_release(&table);

    memset(weights, 0, sizeof weights);
    assert_int_equal(light_table_init(&table, weights, COUNT, &err), STATUS_OK);
    assert_int_equal(table.count, 0);
    assert_true(light_table_odds(&table, 3) == 0);
    light_table_release(&table);
}

/* Two lamps of two triangles each, one three times as bright. */
static void test_light_choice(void **state)
{
    static const double expected[LIGHT_CHOICE_COUNT][4] = {
        [LIGHT_CHOICE_POWER] = {0.125, 0.125, 0.375, 0.375},
        [LIGHT_CHOICE_UNIFORM] = {0.25, 0.25, 0.25, 0.25},
    };

    (void)state;
    for (int choice = 0; choice < LIGHT_CHOICE_COUNT; choice++) {
        struct render_settings settings = builder_settings(4, 4, 1);
        struct render_scene *scene;
        struct scene_builder b;
        uint32_t quad;

        builder_init(&b);
        quad = builder_quad(&b);
        for (uint32_t i = 0; i < 2; i++) {
            builder_lambert(&b, 0)->emission[1] = i ? 3 : 1;
            builder_place(&b, quad, i, vec3_splat(1), vec3_make(0, (float)i, 0));
        }
        builder_camera(&b, vec3_make(0, 5, 0), vec3_splat(0), 1);
        settings.light_choice = (enum light_choice)choice;
        scene = builder_build(&b, &settings);
        assert_int_equal(scene->emitters.tree.node_count > 0, choice == LIGHT_CHOICE_TREE || choice == LIGHT_CHOICE_LEARNED);
        for (uint32_t i = 0; i < 4; i++)
            assert_true(fabs((double)light_table_odds(&scene->emitters.table, i) - expected[choice][i]) < 1e-6);
        render_scene_free(scene);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clamp),
        cmocka_unit_test(test_clamp_is_deterministic),
        cmocka_unit_test(test_texture_filter_saves_memory),
        cmocka_unit_test(test_bvh_quality),
        cmocka_unit_test(test_robust),
        cmocka_unit_test(test_light_table),
        cmocka_unit_test(test_light_choice),
    };

    render_keep_origin(1); /* rays and places here are in the scenes' own coordinates */
    return cmocka_run_group_tests_name("choices", tests, NULL, NULL);
}
