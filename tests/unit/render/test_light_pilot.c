/* The pilot of the guides: a room with a window, and rooms with lamps, are guided, and alike for any number of threads,
 * instruction set, part of the picture, seed and number of samples; a field is not, nor is a job that asks for the map, or
 * the tree of lights, alone. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/render_scene.h"

enum { WIDTH = 48, HEIGHT = 32, SPP = 8 };

static struct render_scene *build(struct scene_builder *b, const struct render_settings *settings)
{
    return builder_build(b, settings);
}

static const struct sky_guide *guide_of(const struct render_scene *scene) { return &scene->emitters.environment.guide; }

static void expect_same_lamps(const struct lamp_guide *g, const struct lamp_guide *h)
{
    assert_true(g->known_count > 20);
    assert_int_equal(g->known_count, h->known_count);
    assert_int_equal(g->at.count, h->at.count);
    assert_memory_equal(g->seen, h->seen, g->at.count * g->known_count * sizeof *g->seen);
    assert_memory_equal(g->at.boxes, h->at.boxes, g->at.count * sizeof *g->at.boxes);
}

static void expect_same(const struct render_scene *a, const struct render_scene *b)
{
    const struct sky_guide *g = guide_of(a), *h = guide_of(b);

    if (a->emitters.tree.node_count > 0) {
        assert_true(a->emitters.guide.at.count > 10);
        expect_same_lamps(&a->emitters.guide, &b->emitters.guide);
        return;
    }
    assert_true(g->at.count > 10);
    assert_int_equal(g->at.count, h->at.count);
    for (uint32_t i = 0; i < g->at.count; i++) {
        const struct distribution *c = &g->regions[i].cells, *d = &h->regions[i].cells;

        assert_memory_equal(c->column_start, d->column_start, (size_t)SKY_ROWS * (SKY_COLUMNS + 1) * sizeof *c->column_start);
        assert_memory_equal(c->row_start, d->row_start, (SKY_ROWS + 1) * sizeof *c->row_start);
        assert_memory_equal(&g->at.boxes[i], &h->at.boxes[i], sizeof g->at.boxes[i]);
        assert_true(g->regions[i].window_share == h->regions[i].window_share);
    }
}

static struct render_settings settings_of(void) { return builder_settings(WIDTH, HEIGHT, SPP); }

static void lit_room(struct scene_builder *b)
{
    builder_windowed_room(b);
    builder_environment_constant(b, vec3_make(5, 6, 8));
}

static void expect_alike(void (*make)(struct scene_builder *b))
{
    struct render_settings settings = settings_of(), other;
    struct render_scene *first, *second;
    struct scene_builder b;

    make(&b);
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

static void test_alike(void **state)
{
    (void)state;
    expect_alike(lit_room);
    expect_alike(builder_lamp_rooms);
}

/* A part of the picture has the whole's samples. */
static void expect_part(void (*make)(struct scene_builder *b))
{
    enum { PART = 16 };
    static double whole[WIDTH * HEIGHT * 3], part[PART * PART * 3];
    struct render_settings settings = settings_of(), cut = settings;
    struct render_stats stats = {0};
    struct render_scene *first, *second;
    struct scene_builder b;

    make(&b);
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

static void test_a_region(void **state)
{
    (void)state;
    expect_part(lit_room);
    expect_part(builder_lamp_rooms);
}

static int ascending(const void *a_, const void *b_)
{
    const double *a = a_, *b = b_;

    return (*a > *b) - (*a < *b);
}

/* It pays: the rooms' noise, by the two groups, in the mean and in the median channel. */
static void noise_of(struct scene_builder *b, const struct render_settings *settings, double *mean, double *median)
{
    static double picture[WIDTH * HEIGHT * 3], variance[WIDTH * HEIGHT * 3];
    struct render_stats stats = {0};
    struct render_scene *scene = build(b, settings);

    builder_render(scene, settings, 0, picture, variance, &stats);
    *mean = 0;
    for (int i = 0; i < WIDTH * HEIGHT * 3; i++)
        *mean += variance[i] / (WIDTH * HEIGHT * 3);
    qsort(variance, WIDTH * HEIGHT * 3, sizeof *variance, ascending);
    *median = variance[WIDTH * HEIGHT * 3 / 2];
    render_scene_free(scene);
}

static void test_less_noise(void **state)
{
    struct render_settings settings = settings_of(), other = settings;
    struct scene_builder b;
    double learned[2], alone[2];

    (void)state;
    lit_room(&b);
    other.env_sampling = ENV_SAMPLING_IMPORTANCE;
    noise_of(&b, &settings, &learned[0], &learned[1]);
    noise_of(&b, &other, &alone[0], &alone[1]);
    print_message("# variance by the map alone over that with the guide: %.2f\n", alone[0] / learned[0]);
    assert_true(alone[0] > 2 * learned[0]);
    builder_release(&b);

    builder_lamp_rooms(&b);
    settings.max_depth = other.max_depth = 1;
    other.light_choice = LIGHT_CHOICE_TREE;
    noise_of(&b, &settings, &learned[0], &learned[1]);
    noise_of(&b, &other, &alone[0], &alone[1]);
    print_message("# variance by the tree of lights alone over that with the guide: %.2f, median %.2f\n",
                  alone[0] / learned[0], alone[1] / learned[1]);
    assert_true(alone[1] > 1.7 * learned[1]);
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
        print_message("# regions behind curtain %d: %u\n", i, guide_of(scene)->at.count);
        assert_true(guide_of(scene)->at.count > 10);
        render_scene_free(scene);
        builder_release(&b);
    }
}

static void expect_none(struct scene_builder *b, const struct render_settings *settings)
{
    struct render_scene *scene = build(b, settings);

    assert_int_equal(guide_of(scene)->at.count, 0);
    assert_int_equal(scene->emitters.guide.at.count, 0);
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
    builder_lamp_rooms(&b);
    for (int how = 0; how < LIGHT_CHOICE_COUNT; how++) {
        settings.light_choice = (enum light_choice)how;
        if (how != LIGHT_CHOICE_LEARNED)
            expect_none(&b, &settings);
    }
    builder_release(&b);
}

/* Light that scattering meets by chance is weighed with the odds by which it is chosen there. */
static void test_chosen_as_met(void **state)
{
    enum { SIDE = 12, TRIES = 64 };
    struct render_settings settings = settings_of();
    struct test_random random = {3};
    uint32_t guided = 0, met = 0;
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    builder_lamp_rooms(&b);
    scene = build(&b, &settings);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const struct light_context context = {
            .p = vec3_make(-1.9f + 3.8f * (real)(i % SIDE) / SIDE, -1, -2.4f + 6 * (real)(i / SIDE) / SIDE), .n = {0, 1, 0}};

        guided += lamp_guide_seen(&scene->emitters.guide, &context) != NULL;
        for (int k = 0; k < TRIES; k++) {
            struct light_sample light;
            struct vec3 c[3];
            real area, pdf;

            if (!emitters_sample(scene, &context, test_random_float(&random), test_random_float(&random), &light) || !light.on_face)
                continue;
            triangle_of_instance(scene, &scene->instances[light.face.instance], light.face.triangle, 0, c);
            area = 0.5f * vec3_length(vec3_cross(vec3_sub(c[1], c[0]), vec3_sub(c[2], c[0])));
            pdf = emitters_face_pdf(scene, &context, (uint32_t)((const struct hit *)light.light - scene->emitters.faces),
                                    light.distance * light.distance, light.cosine, area);
            assert_true(real_abs(pdf - light.pdf) < 0.01f * light.pdf);
            met++;
        }
    }
    assert_true(guided > SIDE * SIDE / 4 && met > 1000);
    render_scene_free(scene);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_alike),
        cmocka_unit_test(test_a_region),
        cmocka_unit_test(test_less_noise),
        cmocka_unit_test(test_curtain),
        cmocka_unit_test(test_chosen_as_met),
        cmocka_unit_test(test_only_where_it_helps),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
