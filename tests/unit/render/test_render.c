/* The renderer as a library: purity of render_tile, culling, instances, hostile blobs. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "common/base/memory.h"
#include "tests/support/scene_builder.h"

enum { SIDE = 40 };

/* A little of everything: mirror, glass, emissive, textured environment. */
static void busy_scene(struct scene_builder *b)
{
    static float map[8 * 4 * 3];
    struct scene_material *m;
    uint32_t sphere, quad;

    for (int i = 0; i < 8 * 4 * 3; i++)
        map[i] = 0.2f + 0.13f * (float)(i * 7 % 11);
    builder_init(b);
    quad = builder_quad(b);
    sphere = builder_sphere(b, 12, 1);
    builder_lambert(b, 0.7f);
    m = builder_lambert(b, 0.9f);
    m->metallic = 1;
    m->roughness = 0;
    m = builder_lambert(b, 1);
    m->transmission = 1;
    m->specular = 1;
    m->roughness = 0.3f;
    m->refractive = 1;
    m = builder_lambert(b, 0.2f);
    m->emission[0] = 5;
    m->emission[1] = 3;
    m->emission[2] = 1;
    builder_place(b, quad, 0, vec3_make(4, 1, 4), vec3_make(0, -1, 0));
    builder_place(b, sphere, 1, vec3_splat(0.8f), vec3_make(-1, 0, 0));
    builder_place(b, sphere, 2, vec3_splat(0.8f), vec3_make(1, 0, 0));
    builder_place(b, quad, 3, vec3_make(0.5f, -1, 0.5f), vec3_make(0, 3, 0));
    builder_environment_map(b, map, 8, 4);
    builder_camera(b, vec3_make(0, 1, 5), vec3_splat(0), 0.8f);
}

static void test_tiles_are_pure(void **state)
{
    struct render_settings settings = builder_settings(SIDE, SIDE, 12);
    float first[TILE_FLOATS_MAX], again[TILE_FLOATS_MAX];
    struct render_stats stats = {0};
    struct render_scene *one, *two;
    struct scene_builder b;
    uint32_t tiles = tile_count(SIDE, SIDE);

    (void)state;
    busy_scene(&b);
    one = builder_build(&b, &settings);
    two = builder_build(&b, &settings);
    /* Forwards in one scene, backwards in another: nothing may be carried along. */
    for (uint32_t t = 0; t < tiles; t++)
        for (uint32_t p = 0; p < pass_count(settings.spp, 0); p++) {
            uint32_t other = tiles - 1 - t;
            struct tail tail, same;
            size_t n = render_tile(one, 3, t, p % GROUPS, p, first, &tail, &stats);
            struct tile_rect r = tile_rect_of(SIDE, SIDE, t);
            assert_int_equal(n, (size_t)PIXEL_FLOATS * r.width * r.height);
            render_tile(two, 3, other, p % GROUPS, p, again, &same, &stats);
            n = render_tile(two, 3, t, p % GROUPS, p, again, &same, &stats);
            assert_memory_equal(first, again, n * sizeof *first);
            assert_int_equal(tail.count, same.count);
            assert_memory_equal(tail.entries, same.entries, tail.count * sizeof *tail.entries);
            assert_true(tail.count > 0 && tail_is_valid(&tail, r.width * r.height));
        }
    assert_int_equal(stats.work.dropped_samples, 0);
    assert_true(stats.work.rays > stats.work.samples);
    render_scene_free(one);
    render_scene_free(two);
    builder_release(&b);
}

/* A different frame, seed, group or pass gives different samples. */
static void test_inputs_matter(void **state)
{
    struct render_settings settings = builder_settings(SIDE, SIDE, 12);
    float base[TILE_FLOATS_MAX], other[TILE_FLOATS_MAX];
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct scene_builder b;
    size_t n;

    (void)state;
    busy_scene(&b);
    scene = builder_build(&b, &settings);
    n = render_tile(scene, 0, 4, 0, 1, base, NULL, &stats) * sizeof *base;
    render_tile(scene, 1, 4, 0, 1, other, NULL, &stats);
    assert_memory_not_equal(base, other, n);
    render_tile(scene, 0, 4, 0, 0, other, NULL, &stats);
    assert_memory_not_equal(base, other, n);
    render_tile(scene, 0, 4, 1, 1, other, NULL, &stats);
    assert_memory_not_equal(base, other, n);
    render_scene_free(scene);
    settings.seed = 1;
    scene = builder_build(&b, &settings);
    render_tile(scene, 0, 4, 0, 1, other, NULL, &stats);
    assert_memory_not_equal(base, other, n);
    render_scene_free(scene);
    builder_release(&b);
}

/* The colour at the middle of the picture. */
static double centre_counted(struct scene_builder *b, uint32_t spp, uint32_t max_depth, struct unit_work *work)
{
    struct render_settings settings = builder_settings(1, 1, spp);
    struct render_stats stats = {0};
    struct render_scene *scene;
    double mean[3];

    settings.max_depth = max_depth;
    settings.no_roulette = 1;
    scene = builder_build(b, &settings);
    builder_render(scene, &settings, 0, mean, NULL, &stats);
    render_scene_free(scene);
    *work = stats.work;
    return mean[1];
}

static double centre(struct scene_builder *b, uint32_t spp)
{
    struct unit_work unused;

    return centre_counted(b, spp, SETTINGS_DEPTH_DEFAULT, &unused);
}

static void facing_quad(struct scene_builder *b, float flip)
{
    builder_init(b);
    builder_lambert(b, 0)->double_sided = 0;
    b->scene.materials[0].unlit = 1;
    b->scene.materials[0].base_color[1] = 0.25f;
    builder_place(b, builder_quad(b), 0, vec3_make(1, flip, 1), vec3_splat(0));
    builder_environment_constant(b, vec3_splat(1));
}

/* Rays of the camera and of paths that met nothing; the rays towards lights, which meet nothing where they should, are
 * not among them. */
static void test_escapes_are_counted(void **state)
{
    struct scene_builder b;
    struct unit_work work;

    (void)state;
    facing_quad(&b, 1);
    builder_camera(&b, vec3_make(0, 3, 0), vec3_make(0, 6, 0), 0.01f);
    centre_counted(&b, 8, 3, &work);
    assert_int_equal(work.rays, 8);
    assert_int_equal(work.escaped_rays, 8);
    builder_release(&b);
    facing_quad(&b, 1);
    builder_camera(&b, vec3_make(0.1f, 3, 0), vec3_make(0.1f, 0, 0), 0.01f);
    centre_counted(&b, 8, 3, &work);
    assert_int_equal(work.escaped_rays, 0); /* unlit: the path ends there */
    b.scene.materials[0].unlit = 0;
    centre_counted(&b, 8, 3, &work);
    assert_true(work.rays > 2 * 8); /* besides the camera's and the path's those towards the sky above */
    assert_int_equal(work.escaped_rays, 8);
    centre_counted(&b, 8, 0, &work);
    assert_int_equal(work.escaped_rays, 0);
    builder_release(&b);
}

static void test_culling(void **state)
{
    struct scene_builder b;

    (void)state;
    /* Front from above, nothing from below; a mirrored instance is the other way about
     * in the world but keeps its object-space front. */
    for (int flip = 0; flip < 2; flip++)
        for (int below = 0; below < 2; below++) {
            double expected;
            facing_quad(&b, flip ? -1 : 1);
            builder_camera(&b, vec3_make(0.1f, below ? -3 : 3, 0), vec3_make(0.1f, 0, 0), 0.01f);
            expected = below == flip ? 0.25 : 1;
            if (fabs(centre(&b, 4) - expected) > 1e-6)
                fail_msg("flip %d below %d: %g instead of %g", flip, below, centre(&b, 4), expected);
            b.scene.materials[0].double_sided = 1;
            assert_true(fabs(centre(&b, 4) - 0.25) < 1e-6);
            builder_release(&b);
        }
}

/* Inside a closed single-sided box one sees out, because its back faces are not there. */
static void test_closed_mesh_from_inside(void **state)
{
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0)->double_sided = 0;
    b.scene.materials[0].unlit = 1;
    builder_place(&b, builder_sphere(&b, 8, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_splat(0), vec3_make(0, 0, -1), 0.05f);
    assert_true(fabs(centre(&b, 4) - 1) < 1e-6);
    b.scene.cameras[0].to_world.m[2][3] = 5;
    assert_true(fabs(centre(&b, 4)) < 1e-6);
    builder_release(&b);
}

/* A coarse closed sphere of black triangles seen from inside leaks no ray. */
static void test_watertight(void **state)
{
    struct render_settings settings = builder_settings(64, 64, 64);
    static double mean[64 * 64 * 3];

    (void)state;
    for (int place = 0; place < 3; place++) {
        struct render_stats stats = {0};
        struct render_scene *scene;
        struct scene_builder b;
        struct vec3 at = vec3_splat(place == 1 ? 777.7f : 0);

        builder_init(&b);
        builder_lambert(&b, 0);
        builder_place(&b, builder_sphere(&b, 16, 0), 0, vec3_splat(place == 2 ? 1e-3f : 3.3f), at);
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_add(at, vec3_splat(1e-4f)), vec3_add(at, vec3_make(1, 0.3f, 0)), 2.5f);
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, mean, NULL, &stats);
        for (size_t i = 0; i < 64 * 64 * 3; i++)
            assert_true(mean[i] == 0);
        assert_int_equal(stats.work.escaped_rays, 0);
        render_scene_free(scene);
        builder_release(&b);
    }
}

static void test_alpha_mask(void **state)
{
    struct scene_builder b;

    (void)state;
    facing_quad(&b, 1);
    builder_camera(&b, vec3_make(0.1f, 3, 0), vec3_make(0.1f, 0, 0), 0.01f);
    b.scene.materials[0].alpha_mode = ALPHA_MASK;
    b.scene.materials[0].alpha_cutoff = 0.5f;
    b.scene.materials[0].base_color[3] = 0.5f; /* equal passes the test */
    assert_true(fabs(centre(&b, 4) - 0.25) < 1e-6);
    b.scene.materials[0].base_color[3] = 0.49f;
    assert_true(fabs(centre(&b, 4) - 1) < 1e-6);
    b.scene.materials[0].alpha_mode = ALPHA_OPAQUE;
    assert_true(fabs(centre(&b, 4) - 0.25) < 1e-6);
    builder_release(&b);
}

/* One mesh shared by many instances looks the same as in the top BVH. */
static void test_instanced_equals_baked(void **state)
{
    struct render_settings settings = builder_settings(32, 32, 8);
    static double baked[32 * 32 * 3], shared[32 * 32 * 3];
    double worst = 0, sum = 0;

    (void)state;
    for (int copies = 1; copies <= 2; copies++) {
        struct render_stats stats = {0};
        struct render_scene *scene;
        struct scene_builder b;
        uint32_t sphere;

        builder_init(&b);
        builder_lambert(&b, 0.5f);
        sphere = builder_sphere(&b, 130, 0); /* 67 080 triangles: twice is too many to bake */
        for (int i = 0; i < copies; i++)
            builder_place(&b, sphere, 0, vec3_make(1, 1.5f, 0.7f), vec3_make(i * 100.0f, 0.2f, 0));
        builder_environment_constant(&b, vec3_make(1, 0.5f, 0.1f));
        builder_camera(&b, vec3_make(0, 0, 5), vec3_splat(0), 0.6f);
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, copies == 1 ? baked : shared, NULL, &stats);
        render_scene_free(scene);
        builder_release(&b);
    }
    for (size_t i = 0; i < 32 * 32 * 3; i++) {
        worst = fmax(worst, fabs(baked[i] - shared[i]));
        sum += baked[i] - shared[i];
    }
    /* A ray at an edge may fall to the neighbour; the picture stays the same. */
    assert_true(fabs(sum) / (32 * 32 * 3) < 1e-4);
    assert_true(worst < 0.2);
}

static void test_hostile_blobs(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 4);
    struct render_scene *scene = NULL;
    struct scene_builder b;
    struct error err = {0};
    uint32_t *indices;
    float *positions;

    (void)state;
    busy_scene(&b);
    indices = (uint32_t *)(void *)(b.blobs[0].data + 48);
    positions = (float *)(void *)b.blobs[0].data;
    indices[5] = 4;
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "vertex 4 of 4"));
    indices[5] = 3;
    positions[2] = NAN;
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err), STATUS_ERR_INPUT);
    positions[2] = -1;
    b.blobs[0].size_bytes--;
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err), STATUS_ERR_INPUT);
    b.blobs[0].size_bytes++;
    settings.camera = 1;
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err), STATUS_ERR_INPUT);
    assert_null(scene);
    builder_release(&b);
}

/* Every allocation fails once: an error each time, and no leak (the sanitizer tells). */
static void test_out_of_memory(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 4);
    struct render_scene *scene = NULL;
    struct scene_builder b;
    struct error err = {0};
    long n = 0;

    (void)state;
    busy_scene(&b);
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
        if (s != STATUS_ERR_NO_MEMORY)
            fail_msg("allocation %ld failed and the status is '%s'", n, status_text(s));
    }
    assert_true(n > 10);
    render_scene_free(scene);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tiles_are_pure),  cmocka_unit_test(test_inputs_matter),
        cmocka_unit_test(test_culling),         cmocka_unit_test(test_closed_mesh_from_inside),
        cmocka_unit_test(test_escapes_are_counted),
        cmocka_unit_test(test_watertight),      cmocka_unit_test(test_alpha_mask),
        cmocka_unit_test(test_instanced_equals_baked),
        cmocka_unit_test(test_hostile_blobs),   cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests_name("render", tests, NULL, NULL);
}
