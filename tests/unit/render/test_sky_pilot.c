/* The pilot of the environment's guide: a room with a window is guided, and alike for any number of threads, instruction
 * set, part of the picture, seed and number of samples; a field is not, nor is a job that asks for the map alone. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/render_scene.h"

enum { WIDTH = 48, HEIGHT = 32, SPP = 8 };

static struct render_scene *build(struct scene_builder *b, const struct render_settings *settings)
{
    return builder_build(b, settings);
}

static const struct sky_guide *guide_of(const struct render_scene *scene) { return &scene->emitters.environment.guide; }

static void expect_same(const struct render_scene *a, const struct render_scene *b)
{
    const struct sky_guide *g = guide_of(a), *h = guide_of(b);

    assert_true(g->region_count > 10);
    assert_int_equal(g->region_count, h->region_count);
    for (uint32_t i = 0; i < g->region_count; i++) {
        const struct distribution *c = &g->regions[i].cells, *d = &h->regions[i].cells;

        assert_memory_equal(c->column_start, d->column_start, (size_t)SKY_ROWS * (SKY_COLUMNS + 1) * sizeof *c->column_start);
        assert_memory_equal(c->row_start, d->row_start, (SKY_ROWS + 1) * sizeof *c->row_start);
        assert_memory_equal(g->regions[i].low, h->regions[i].low, sizeof g->regions[i].low);
        assert_true(g->regions[i].window_share == h->regions[i].window_share);
    }
}

static struct render_settings settings_of(void) { return builder_settings(WIDTH, HEIGHT, SPP); }

static void lit_room(struct scene_builder *b)
{
    builder_windowed_room(b);
    builder_environment_constant(b, vec3_make(5, 6, 8));
}

static void test_alike(void **state)
{
    struct render_settings settings = settings_of(), other;
    struct render_scene *first, *second;
    struct scene_builder b;

    (void)state;
    lit_room(&b);
    first = build(&b, &settings);
    render_build_threads(5);
    second = build(&b, &settings);
    render_build_threads(1);
    expect_same(first, second);
    render_scene_free(second);

    other = settings;
    other.seed = 99;
    other.spp = 512;
    other.max_depth = 30; /* deeper than the pilot goes, both */
    second = build(&b, &other);
    expect_same(first, second);
    render_scene_free(second);

    for (int isa = 0; isa < ISA_COUNT; isa++) {
        if (!(isa_supported_mask() >> isa & 1))
            continue;
        other = settings;
        other.isa = (enum isa)isa;
        second = build(&b, &other);
        expect_same(first, second);
        render_scene_free(second);
    }
    render_scene_free(first);
    builder_release(&b);
}

/* A part of the picture has the whole's samples. */
static void test_a_region(void **state)
{
    enum { PART = 16 };
    static double whole[WIDTH * HEIGHT * 3], part[PART * PART * 3];
    struct render_settings settings = settings_of(), cut = settings;
    struct render_stats stats = {0};
    struct render_scene *first, *second;
    struct scene_builder b;

    (void)state;
    lit_room(&b);
    cut.whole_width = WIDTH;
    cut.whole_height = HEIGHT;
    cut.width = cut.height = PART;
    cut.region_x = PART;
    cut.region_y = PART;
    first = build(&b, &settings);
    second = build(&b, &cut);
    expect_same(first, second);
    builder_render(first, &settings, 0, whole, NULL, &stats);
    builder_render(second, &cut, 0, part, NULL, &stats);
    for (int y = 0; y < PART; y++)
        assert_memory_equal(&part[3 * PART * y], &whole[3 * (WIDTH * (PART + y) + PART)], 3 * PART * sizeof *part);
    render_scene_free(first);
    render_scene_free(second);
    builder_release(&b);
}

/* It pays: the room's noise, by the two groups. */
static double noise_of(struct scene_builder *b, const struct render_settings *settings)
{
    static double mean[WIDTH * HEIGHT * 3], variance[WIDTH * HEIGHT * 3];
    struct render_stats stats = {0};
    struct render_scene *scene = build(b, settings);
    double sum = 0;

    builder_render(scene, settings, 0, mean, variance, &stats);
    for (int i = 0; i < WIDTH * HEIGHT * 3; i++)
        sum += variance[i];
    render_scene_free(scene);
    return sum;
}

static void test_less_noise(void **state)
{
    struct render_settings settings = settings_of(), by_map = settings;
    struct scene_builder b;
    double learned, map;

    (void)state;
    lit_room(&b);
    by_map.env_sampling = ENV_SAMPLING_IMPORTANCE;
    learned = noise_of(&b, &settings);
    map = noise_of(&b, &by_map);
    print_message("# variance by the map alone over that with the guide: %.2f\n", map / learned);
    assert_true(map > 2 * learned);
    builder_release(&b);
}

/* A sheet before the window that lets some rays pass, at random: each of the pilot's rays must draw for itself, or all are
 * blocked by it, or none. */
static void test_curtain(void **state)
{
    const float corners[9] = {-2.1f, -9, -9, -2.1f, -9, 9, -2.1f, 9, 0};
    const uint32_t triangle[3] = {0, 1, 2};
    struct render_settings settings = settings_of();

    (void)state;
    for (int i = 0; i < 4; i++) { /* each place has numbers of its own */
        struct render_scene *scene;
        struct scene_material *m;
        struct scene_builder b;

        lit_room(&b);
        m = builder_lambert(&b, 0);
        m->alpha_mode = ALPHA_BLEND;
        m->base_color[3] = 0.8f;
        builder_place(&b, builder_mesh(&b, corners, NULL, 3, triangle, 1, 0), builder_last_material(&b), vec3_splat(1),
                      vec3_make(-0.1f * (float)i, 0, 0));
        scene = build(&b, &settings);
        print_message("# regions behind curtain %d: %u\n", i, guide_of(scene)->region_count);
        assert_true(guide_of(scene)->region_count > 10);
        render_scene_free(scene);
        builder_release(&b);
    }
}

static void expect_none(struct scene_builder *b, const struct render_settings *settings)
{
    struct render_scene *scene = build(b, settings);

    assert_int_equal(guide_of(scene)->region_count, 0);
    render_scene_free(scene);
}

static void test_only_where_it_helps(void **state)
{
    struct render_settings settings = settings_of();
    struct scene_builder b;

    (void)state;
    builder_room(&b, NULL); /* a ball in a field, under a lamp */
    expect_none(&b, &settings);
    builder_release(&b);
    lit_room(&b);
    for (int how = 0; how < ENV_SAMPLING_COUNT; how++) {
        settings.env_sampling = (enum env_sampling)how;
        if (how != ENV_SAMPLING_LEARNED)
            expect_none(&b, &settings);
    }
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_alike),
        cmocka_unit_test(test_a_region),
        cmocka_unit_test(test_less_noise),
        cmocka_unit_test(test_curtain),
        cmocka_unit_test(test_only_where_it_helps),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
