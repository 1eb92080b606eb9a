/* Volumes that touch: faces that floats cannot keep apart are one boundary, those farther apart
 * have air between them, and nowhere is light made.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>

#include "common/scene/effects.h"
#include "tests/support/layers.h"
#include "tests/support/radiance.h"
#include "tests/support/slabs.h"

enum { COMPARISONS = 200 };

/* The box from -1 to 1; inwards: as the wall of a cavity. */
static uint32_t box(struct scene_builder *b, int inwards)
{
    static const uint32_t outside[36] = {0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                                         2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
    float positions[24];
    uint32_t indices[36];

    for (int i = 0; i < 24; i++)
        positions[i] = (i / 3) >> (i % 3) & 1 ? 1 : -1;
    for (int i = 0; i < 36; i++)
        indices[i] = outside[inwards ? 35 - i : i];
    return builder_mesh(b, positions, NULL, 8, indices, 12, !inwards);
}

/* Slabs of these indices from 0 to 2 and from -2 to `top`, the lower one dyed. */
static void two_slabs(struct scene_builder *b, float upper, float lower, float top)
{
    uint32_t slab;

    builder_init(b);
    slabs_glass(b, upper, INFINITY);
    slabs_glass(b, lower, 2);
    slab = builder_slab(b);
    builder_place(b, slab, 0, vec3_make(9, 1, 9), vec3_make(0, 1, 0));
    builder_place(b, slab, 1, vec3_make(9, 0.5f * (top + 2), 9), vec3_make(0, 0.5f * (top - 2), 0));
    slabs_look_down(b, 5);
}

/* What two_slabs shows, with an air film between or without. */
static void two_layers(const struct scene_builder *b, double upper, double lower, int film, double out[3])
{
    for (int c = 0; c < 3; c++) {
        struct layers s = layers_interface(1, upper);
        if (film)
            s = layers_stacked(layers_stacked(s, layers_interface(upper, 1)), layers_interface(1, lower));
        else
            s = layers_stacked(s, layers_interface(upper, lower));
        s = layers_stacked(s, layers_absorber(layers_per_metre(&b->scene.materials[1], c), 2));
        out[c] = layers_seen(layers_stacked(s, layers_interface(lower, 1)));
    }
}

static void test_slabs(void **state)
{
    static const float indices[][2] = {{1.5f, 1.5f}, {1.5f, 2}, {2, 1.5f}};
    /* The faces at 0: one float apart is nothing; a ten-thousandth is an air film. */
    static const struct {
        float top;
        int film;
    } gaps[] = {{0, 0}, {-1e-30f, 0}, {1e-30f, 0}, {-1e-4f, 1}};

    (void)state;
    for (size_t i = 0; i < sizeof indices / sizeof *indices; i++)
        for (size_t k = 0; k < sizeof gaps / sizeof *gaps; k++) {
            struct render_settings settings = slabs_settings();
            struct scene_builder b;
            double expected[3];
            two_slabs(&b, indices[i][0], indices[i][1], gaps[k].top);
            two_layers(&b, (double)indices[i][0], (double)indices[i][1], gaps[k].film, expected);
            radiance_expect_rgb(&b, &settings, COMPARISONS, expected,
                                gaps[k].film ? "slabs with an air film" : "touching slabs");
            builder_release(&b);
        }
}

/* A block in two halves, and in its middle dyed glass of the same priority, which both halves surround: it stays the innermost. */
static void test_halves_around(void **state)
{
    for (int reversed = 0; reversed < 2; reversed++) {
        struct render_settings settings = slabs_settings();
        struct scene_builder b;
        double expected[3];
        uint32_t slab;
        builder_init(&b);
        slabs_glass(&b, 1.5f, INFINITY);
        slabs_glass(&b, 1.5f, 2);
        slab = builder_slab(&b);
        for (int half = 0; half < 2; half++)
            builder_place(&b, slab, 0, vec3_make(9, 1, 9), vec3_make(0, half == reversed ? 1 : -1, 0));
        builder_place(&b, slab, 1, vec3_make(9, 1, 9), vec3_splat(0));
        slabs_look_down(&b, 5);
        LAYERS_SEEN(expected, {&b.scene.materials[0], 1}, {&b.scene.materials[1], 2}, {&b.scene.materials[0], 1});
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "dyed glass in two halves");
        builder_release(&b);
    }
    (void)state;
}

/* The same where floats have a spacing: faces that overlap by 4 of them, 4 apart, and 12. */
static void test_spacing(void **state)
{
    (void)state;
    for (int ulps = -4; ulps <= 12; ulps += 8) {
        struct render_settings settings = slabs_settings();
        int film = ulps == 12;
        struct scene_builder b;
        double expected[3];
        uint32_t quad;
        float lower = 3;
        builder_init(&b);
        slabs_glass(&b, 1.5f, INFINITY);
        slabs_glass(&b, 2, 2);
        for (int i = 0; i < abs(ulps); i++)
            lower = nextafterf(lower, ulps < 0 ? INFINITY : -INFINITY);
        quad = builder_quad(&b);
        builder_place(&b, quad, 0, vec3_make(9, 1, 9), vec3_make(0, 4, 0));
        builder_place(&b, quad, 0, vec3_make(9, -1, 9), vec3_make(0, 3, 0));
        builder_place(&b, quad, 1, vec3_make(9, 1, 9), vec3_make(0, lower, 0));
        builder_place(&b, quad, 1, vec3_make(9, -1, 9), vec3_make(0, 1, 0));
        slabs_look_down(&b, 5);
        two_layers(&b, 1.5, 2, film, expected);
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected,
                            film ? "twelve floats apart" : "four floats apart or over");
        builder_release(&b);
    }
}

/* Whatever the gap or the overlap, light is neither made nor lost: two blocks in a furnace, seen
 * at a slant. */
static void test_furnace(void **state)
{
    (void)state;
    for (int i = -10; i <= 10; i += 4) {
        struct render_settings settings = builder_settings(8, 8, 64);
        struct scene_builder b;
        float top = 0.7f;
        uint32_t block;
        settings.max_depth = 1000;
        builder_init(&b);
        slabs_glass(&b, 1.5f, INFINITY);
        slabs_glass(&b, 1.33f, INFINITY);
        block = box(&b, 0);
        for (int k = 0; k < abs(i); k++)
            top = nextafterf(top, i > 0 ? INFINITY : -INFINITY);
        builder_place(&b, block, 0, vec3_splat(1), vec3_make(0, 1.7f, 0));
        builder_place(&b, block, 1, vec3_make(1, 0.5f * (top + 1), 1), vec3_make(0, 0.5f * (top - 1), 0));
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_make(2, 3, 4), vec3_make(0, 0.7f, 0), 0.5f);
        radiance_expect(&b, &settings, COMPARISONS, 1, "two blocks, almost touching");
        builder_release(&b);
    }
}

/* Water that fills a hollow cube of glass exactly, by the same corners. */
static void test_filled(void **state)
{
    (void)state;
    for (int dyed = 0; dyed < 2; dyed++) {
        struct render_settings settings = slabs_settings();
        struct scene_material *water;
        struct scene_builder b;
        double expected[3] = {1, 1, 1};
        uint32_t full;
        builder_init(&b);
        slabs_glass(&b, 1.5f, INFINITY);
        water = slabs_glass(&b, 1.33f, dyed ? 3 : INFINITY);
        full = box(&b, 0);
        builder_place(&b, full, 0, vec3_splat(2), vec3_splat(0));
        builder_place(&b, box(&b, 1), 0, vec3_splat(1), vec3_splat(0));
        builder_place(&b, full, 1, vec3_splat(1), vec3_splat(0));
        if (dyed) {
            double n = (double)1.33f;
            slabs_look_down(&b, 5);
            for (int c = 0; c < 3; c++) {
                struct layers s = layers_stacked(layers_interface(1, 1.5), layers_interface(1.5, n));
                s = layers_stacked(s, layers_absorber(layers_per_metre(water, c), 2));
                s = layers_stacked(s, layers_interface(n, 1.5));
                expected[c] = layers_seen(layers_stacked(s, layers_interface(1.5, 1)));
            }
        } else {
            settings.max_depth = 1000;
            builder_environment_constant(&b, vec3_splat(1));
            builder_camera(&b, vec3_make(3, 4, 5), vec3_splat(0), 0.5f);
        }
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "water that fills its glass");
        builder_release(&b);
    }
}

/* The camera is in the water, right beside the glass around it. */
static void test_camera_inside(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 64);
    struct scene_builder b;
    uint32_t full;

    (void)state;
    settings.max_depth = 1000;
    builder_init(&b);
    slabs_glass(&b, 1.5f, INFINITY);
    slabs_glass(&b, 1.33f, INFINITY);
    full = box(&b, 0);
    builder_place(&b, full, 0, vec3_splat(2), vec3_splat(0));
    builder_place(&b, box(&b, 1), 0, vec3_splat(1), vec3_splat(0));
    builder_place(&b, full, 1, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0.1f, 0.2f, 0.3f), vec3_make(3, 4, 5), 0.5f);
    /* Radiance in water is n^2 times that of the air around. */
    radiance_expect(&b, &settings, COMPARISONS, (double)(1.33f * 1.33f), "a camera in the water");
    builder_release(&b);
}

/* Two blocks of one material are one: no boundary, also where only parts of the faces touch. */
static void test_one_material(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;
    double expected[3];
    uint32_t full;

    (void)state;
    builder_init(&b);
    m = slabs_glass(&b, 1.5f, 3);
    full = box(&b, 0);
    builder_place(&b, full, 0, vec3_splat(1), vec3_make(0, 1, 0));
    builder_place(&b, full, 0, vec3_make(3, 1, 2), vec3_make(0.5f, -1, 0.25f));
    slabs_look_down(&b, 5);
    for (int c = 0; c < 3; c++) {
        struct layers s = layers_stacked(layers_interface(1, 1.5), layers_absorber(layers_per_metre(m, c), 4));
        expected[c] = layers_seen(layers_stacked(s, layers_interface(1.5, 1)));
    }
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "two blocks of one material");
    builder_release(&b);
}

/* A block stands on a black table, without air in between: nothing comes through. And on one that
 * shines within the glass. */
static void test_on_table(void **state)
{
    (void)state;
    for (int lamp = 0; lamp < 2; lamp++) {
        struct render_settings settings = slabs_settings();
        struct scene_material *table;
        struct layers face = layers_interface(1, 1.5);
        struct scene_builder b;
        builder_init(&b);
        slabs_glass(&b, 1.5f, INFINITY);
        table = builder_lambert(&b, 0);
        table->emission[0] = table->emission[1] = table->emission[2] = (float)lamp;
        builder_place(&b, builder_quad(&b), 1, vec3_make(20, 1, 20), vec3_make(0, -1, 0));
        builder_place(&b, box(&b, 0), 0, vec3_splat(1), vec3_splat(0));
        slabs_look_down(&b, 5);
        radiance_expect(&b, &settings, COMPARISONS, face.r_above + lamp * face.t / (1.5 * 1.5), "glass on a table");
        builder_release(&b);
    }
}

/* A medium's box stands on a lamp. */
static void test_medium_on_lamp(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;

    (void)state;
    builder_init(&b);
    builder_medium(&b)->absorption[0] = 0.5f;
    m = builder_lambert(&b, 0);
    m->kind = MATERIAL_INTERFACE;
    m->medium = 0;
    m = builder_lambert(&b, 0);
    m->emission[0] = 1;
    builder_place(&b, builder_quad(&b), 1, vec3_make(20, 1, 20), vec3_make(0, -1, 0));
    builder_place(&b, box(&b, 0), 0, vec3_splat(1), vec3_splat(0));
    slabs_camera(&b, 5);
    radiance_expect_rgb(&b, &settings, COMPARISONS, (double[3]){exp(-1), 0, 0}, "a medium on a lamp");
    builder_release(&b);
}

/* ---- thin walls --------------------------------------------------------------------------- */

/* A sheet without thickness, of this colour and roughness. */
static struct scene_material *thin_wall(struct scene_builder *b, float color, float roughness)
{
    struct scene_material *m = builder_lambert(b, color);

    m->specular = m->transmission = 1;
    m->roughness = roughness;
    m->ior = 1.5f;
    return m;
}

static struct layers layers_thin_wall(double color)
{
    struct layers s = layers_interface(1, 1.5);

    s.t *= color;
    return s;
}

/* A thin wall lies on the outer side of a volume's face, whatever side it is seen from: on a slab
 * of glass, and on one that lies in another, which makes the path count. */
static void test_thin_wall(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        int from_below = i & 1, counted = i >> 1;
        struct render_settings settings = slabs_settings();
        struct layers wall = layers_thin_wall(0.5);
        struct scene_builder b;
        double expected[3];
        uint32_t slab;
        builder_init(&b);
        slabs_glass(&b, 2, 3);
        thin_wall(&b, 0.5f, 0);
        slab = builder_slab(&b);
        builder_place(&b, slab, 0, vec3_make(9, 1, 9), vec3_splat(0));
        builder_place(&b, builder_quad(&b), 1, vec3_make(9, 1, 9), vec3_make(0, 1, 0));
        if (counted) {
            slabs_glass(&b, 1.5f, INFINITY)->priority = -1;
            builder_place(&b, slab, 2, vec3_make(9, 0.5f, 9), vec3_make(0, 0.25f, 0));
        }
        builder_environment_constant(&b, vec3_splat(1));
        if (from_below)
            builder_camera(&b, vec3_make(0.3f, -5, 0.1f), vec3_make(0.3f, 9, 0.1f), 0.002f);
        else
            slabs_camera(&b, 5);
        for (int c = 0; c < 3; c++) {
            struct layers face = layers_interface(1, 2);
            struct layers middle = layers_absorber(layers_per_metre(&b.scene.materials[0], c), 2);
            struct layers s = from_below ? face : layers_stacked(wall, face);
            s = layers_stacked(layers_stacked(s, middle), face);
            expected[c] = layers_seen(from_below ? layers_stacked(s, wall) : s);
        }
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected,
                            from_below ? "a thin wall behind a slab" : "a thin wall on a slab");
        builder_release(&b);
    }
}

/* On a medium's boundary it is crossed with it: all that is dimmed is behind it. */
static void test_thin_wall_on_medium(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;
    struct layers wall = layers_thin_wall(0.5);

    (void)state;
    builder_init(&b);
    builder_medium(&b)->absorption[0] = 0.5f;
    m = builder_lambert(&b, 0);
    m->kind = MATERIAL_INTERFACE;
    m->medium = 0;
    thin_wall(&b, 0.5f, 0);
    m = builder_lambert(&b, 0);
    m->emission[0] = 1;
    builder_place(&b, builder_quad(&b), 1, vec3_splat(1), vec3_make(0, 1, 0));
    builder_place(&b, builder_quad(&b), 2, vec3_make(20, 1, 20), vec3_make(0, -4, 0));
    builder_place(&b, box(&b, 0), 0, vec3_splat(1), vec3_splat(0));
    slabs_camera(&b, 5);
    radiance_expect_rgb(&b, &settings, COMPARISONS, (double[3]){exp(-1) * wall.t, 0, 0}, "a thin wall on a medium");
    builder_release(&b);
}

/* A block with a thin wall on its top, or between it and another, in a furnace, at a slant. */
static void test_thin_wall_furnace(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct render_settings settings = builder_settings(8, 8, 64);
        struct scene_builder b;
        uint32_t block;
        settings.max_depth = 1000;
        builder_init(&b);
        slabs_glass(&b, 1.5f, INFINITY);
        thin_wall(&b, 1, 0);
        block = box(&b, 0);
        builder_place(&b, block, 0, vec3_splat(1), vec3_splat(0));
        builder_place(&b, builder_quad(&b), 1, vec3_splat(1), vec3_make(0, i & 1 ? nextafterf(1, 2) : 1, 0));
        if (i >> 1) {
            slabs_glass(&b, 1.33f, INFINITY);
            builder_place(&b, block, 2, vec3_splat(1), vec3_make(0, 2, 0));
        }
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_make(2, 3, 4), vec3_make(0, 0.7f, 0), 0.5f);
        radiance_expect(&b, &settings, COMPARISONS, 1, "a thin wall on a block");
        builder_release(&b);
    }
}

static void rough_wall(struct scene_builder *b, float height)
{
    struct scene_material *lamp;

    builder_init(b);
    slabs_glass(b, 1.5f, 2)->roughness = 0.4f;
    thin_wall(b, 0.8f, 0.5f);
    lamp = builder_lambert(b, 0);
    lamp->emission[0] = lamp->emission[1] = lamp->emission[2] = 20;
    builder_place(b, box(b, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_place(b, builder_quad(b), 1, vec3_splat(1), vec3_make(0, height, 0));
    builder_place(b, builder_quad(b), 2, vec3_make(0.5f, -0.5f, 0.5f), vec3_make(0.5f, 4, 0));
    builder_environment_constant(b, vec3_make(0.2f, 0.4f, 0.1f));
    builder_camera(b, vec3_make(2, 3, 4), vec3_make(0, 1, 0), 0.2f);
}

/* Rough glass under a rough wall, lit by a lamp and a sky: as if the wall were a little higher. Differences of 0.9 % are
 * significant. */
static void test_rough_thin_wall(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 256);
    struct scene_builder lifted, touching;

    (void)state;
    settings.max_depth = 24;
    rough_wall(&lifted, 1.0001f);
    rough_wall(&touching, 1);
    radiance_expect_same(&lifted, &touching, &settings, COMPARISONS, "a rough wall on rough glass");
    builder_release(&lifted);
    builder_release(&touching);
}

#ifndef WITHOUT_RULE
/* pbrt's rule: of faces that coincide the indices are multiplied. */
static void test_boundaries(void **state)
{
    (void)state;
    for (int slant = 0; slant < 2; slant++) {
        struct render_settings settings = slabs_settings();
        struct scene_builder b;
        double expected[3];
        two_slabs(&b, 1.5f, 2, 0);
        b.scene.volume_rule = VOLUMES_BOUNDARIES;
        two_layers(&b, 1.5, 2, 0, expected);
        if (slant) {
            settings.max_depth = 1000;
            b.scene.materials[1].attenuation_distance = INFINITY;
            expected[0] = expected[1] = expected[2] = 1;
            b.scene.camera_count = 0;
            builder_camera(&b, vec3_make(2, 5, 1), vec3_splat(0), 0.2f);
        }
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "touching slabs, pbrt's rule");
        builder_release(&b);
    }
}
#endif

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_slabs),        cmocka_unit_test(test_spacing),
        cmocka_unit_test(test_halves_around),
        cmocka_unit_test(test_furnace),      cmocka_unit_test(test_filled),
        cmocka_unit_test(test_camera_inside), cmocka_unit_test(test_one_material),
        cmocka_unit_test(test_on_table),     cmocka_unit_test(test_medium_on_lamp),
        cmocka_unit_test(test_thin_wall),    cmocka_unit_test(test_thin_wall_on_medium),
        cmocka_unit_test(test_thin_wall_furnace), cmocka_unit_test(test_rough_thin_wall),
#ifndef WITHOUT_RULE
        cmocka_unit_test(test_boundaries),
#endif
    };
    return cmocka_run_group_tests_name("contact", tests, NULL, NULL);
}
