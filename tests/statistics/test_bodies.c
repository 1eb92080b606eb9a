/* Bodies of glass: one volume of several meshes, parts that overlap, cavities; and pbrt's rule, by
 * which every boundary counts as the file gives it.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "common/scene/effects.h"
#include "tests/support/layers.h"
#include "tests/support/radiance.h"
#include "tests/support/slabs.h"

enum { COMPARISONS = 60 };

/* One face of a slab at this height: its front is above (up) or below. */
static struct scene_instance *face(struct scene_builder *b, uint32_t quad, uint32_t material, float y, int up)
{
    return builder_place(b, quad, material, vec3_make(9, up ? 1 : -1, 9), vec3_make(0, y, 0));
}

/* A slab of one material from -2 to 2 in a mesh for each face, with one of another glass in it,
 * which makes the path count. */
static void test_two_meshes(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *outer, *inner;
    struct scene_builder b;
    double expected[3];
    uint32_t quad;

    (void)state;
    builder_init(&b);
    outer = slabs_glass(&b, 1.5f, 5);
    inner = slabs_glass(&b, 2, 1);
    quad = builder_quad(&b);
    face(&b, quad, 0, 2, 1);
    face(&b, quad, 0, -2, 0);
    face(&b, quad, 1, 0.5f, 1);
    face(&b, quad, 1, -0.5f, 0);
    slabs_look_down(&b, 5);
    LAYERS_SEEN(expected, {outer, 1.5}, {inner, 1}, {outer, 1.5});
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "a slab of two meshes");
    builder_release(&b);
}

/* A hollow slab: the walls of its cavity are another mesh, wound towards the air in it. */
static void test_hollow(void **state)
{
    static const float positions[24] = {-9, -1, -9, 9, -1, -9, 9, -1, 9, -9, -1, 9,
                                        -9, 1,  -9, 9, 1,  -9, 9, 1,  9, -9, 1,  9};
    static const uint32_t inwards[12] = {0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7};
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;
    double expected[3];

    (void)state;
    builder_init(&b);
    m = slabs_glass(&b, 1.5f, 2);
    builder_place(&b, builder_slab(&b), 0, vec3_make(9, 2, 9), vec3_splat(0));
    builder_place(&b, builder_mesh(&b, positions, NULL, 8, inwards, 4, 0), 0, vec3_splat(1), vec3_splat(0));
    slabs_look_down(&b, 5);
    LAYERS_SEEN(expected, {m, 1}, {NULL, 2}, {m, 1});
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "a hollow slab");
    builder_release(&b);
}

/* Parts of one body that overlap are their union, here from -1 to 2; with a third in the common
 * part, and one wound in reverse and mirrored, which comes to the same. */
static void test_union(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;
    double expected[3];
    uint32_t slab;

    (void)state;
    builder_init(&b);
    m = slabs_glass(&b, 1.5f, 2);
    slab = builder_slab(&b);
    builder_place(&b, slab, 0, vec3_make(9, 1, 9), vec3_splat(0));
    builder_place(&b, slab, 0, vec3_make(9, -1, 9), vec3_make(0, 1, 0));
    builder_place(&b, slab, 0, vec3_make(-9, 0.25f, 9), vec3_make(0, 0.5f, 0));
    slabs_look_down(&b, 5);
    LAYERS_SEEN(expected, {m, 3});
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "slabs that overlap");
    builder_release(&b);
}

/* The same material again within another one: glass, water in it, glass in the water. */
static void test_again_within(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *outer, *inner;
    struct scene_builder b;
    double expected[3];
    uint32_t slab;

    (void)state;
    builder_init(&b);
    outer = slabs_glass(&b, 1.5f, 5);
    inner = slabs_glass(&b, 1.33f, 1);
    slab = builder_slab(&b);
    builder_place(&b, slab, 0, vec3_make(9, 3, 9), vec3_splat(0));
    builder_place(&b, slab, 1, vec3_make(9, 2, 9), vec3_splat(0));
    builder_place(&b, slab, 0, vec3_make(9, 1, 9), vec3_splat(0));
    slabs_look_down(&b, 5);
    LAYERS_SEEN(expected, {outer, 1}, {inner, 1}, {outer, 2}, {inner, 1}, {outer, 1});
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "glass in water in glass");
    builder_release(&b);
}

/* Two materials close one another: the lower face's belongs to the upper one's body, so what it
 * says of a volume does not count. Another glass in it makes the path count. */
static void test_two_materials(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;
    double expected[3];
    uint32_t quad;

    (void)state;
    builder_init(&b);
    m = slabs_glass(&b, 1.5f, 3);
    slabs_glass(&b, 2.5f, 0.1f);
    slabs_glass(&b, 1.5f, INFINITY);
    quad = builder_quad(&b);
    face(&b, quad, 0, 2, 1);
    face(&b, quad, 1, -2, 0)->body = 0;
    face(&b, quad, 2, 1, 1);
    face(&b, quad, 2, 0.5f, 0);
    slabs_look_down(&b, 5);
    LAYERS_SEEN(expected, {m, 3.5});
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "a body of two materials");
    builder_release(&b);
}

/* A ball in two halves under an even sky is as bright as the sky, whatever it is in. */
static void test_halves(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 32);
    const struct scene_mesh *ball;
    const uint32_t *indices;
    const float *positions;
    struct scene_mesh_layout layout;
    struct scene_builder b;
    uint32_t whole;

    (void)state;
    settings.max_depth = 512;
    builder_init(&b);
    slabs_glass(&b, 1.5f, INFINITY);
    slabs_glass(&b, 1.33f, INFINITY);
    whole = builder_sphere(&b, 16, 0);
    ball = &b.scene.meshes[whole];
    scene_mesh_layout(ball, &layout);
    positions = (const void *)(b.blobs[whole].data + layout.positions);
    indices = (const void *)(b.blobs[whole].data + layout.indices);
    for (uint32_t half = 0; half < 2; half++) {
        uint32_t count = ball->triangle_count / 2, first = half * 3 * count;
        uint32_t part = builder_mesh(&b, positions, NULL, ball->vertex_count, indices + first,
                                     half ? ball->triangle_count - count : count, 0);
        builder_place(&b, part, 0, vec3_splat(1), vec3_splat(0));
    }
    builder_place(&b, whole, 1, vec3_splat(0.5f), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, 0, 4), vec3_splat(0), 0.3f);
    radiance_expect(&b, &settings, COMPARISONS, 1, "a ball in two halves");
    builder_release(&b);
}

/* The camera is in two bodies of equal priority: the inner one is there. */
static void test_camera_inside(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *outer, *inner;
    struct scene_builder b;
    double expected[3];
    uint32_t slab;

    (void)state;
    builder_init(&b);
    outer = slabs_glass(&b, 1.5f, 4);
    inner = slabs_glass(&b, 1.5f, 1);
    slab = builder_slab(&b);
    builder_place(&b, slab, 0, vec3_make(9, 2, 9), vec3_splat(0));
    builder_place(&b, slab, 1, vec3_make(9, 1, 9), vec3_splat(0));
    slabs_look_down(&b, 0.5f);
    for (int c = 0; c < 3; c++) {
        struct layers face_down = layers_interface(1.5, 1);
        double half = exp(-layers_per_metre(outer, c) - 2 * layers_per_metre(inner, c) - layers_per_metre(outer, c));
        double down = exp(-1.5 * layers_per_metre(inner, c) - layers_per_metre(outer, c));
        expected[c] = 1.5 * 1.5 * down * face_down.t / (1 - face_down.r_above * half);
    }
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "camera in two bodies");
    builder_release(&b);
}

/* A lamp of radiance 1 below everything, and no sky: what comes up through the layers. */
static void light_from_below(struct scene_builder *b)
{
    struct scene_material *lamp = builder_lambert(b, 0);

    lamp->emission[0] = lamp->emission[1] = lamp->emission[2] = 1;
    builder_place(b, builder_quad(b), builder_last_material(b), vec3_splat(40), vec3_make(0, -8, 0));
    slabs_camera(b, 5);
}

/* What stands open counts as it is wound: of two sheets of water the upper one shows its back.
 * A body elsewhere, whose parts overlap, makes the path count. */
static void test_open(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_builder b;
    uint32_t quad, slab;

    (void)state;
    builder_init(&b);
    slabs_glass(&b, 1.33f, INFINITY);
    slabs_glass(&b, 1.5f, INFINITY);
    quad = builder_quad(&b);
    slab = builder_slab(&b);
    face(&b, quad, 0, 0, 0);
    face(&b, quad, 0, -1, 1);
    builder_place(&b, slab, 1, vec3_splat(1), vec3_make(0, -30, 0));
    builder_place(&b, slab, 1, vec3_splat(1), vec3_make(0, -30.5f, 0));
    light_from_below(&b);
    radiance_expect(&b, &settings, COMPARISONS,
                    layers_stacked(layers_interface((double)1.33f, 1), layers_interface(1, (double)1.33f)).t,
                    "open sheets");
    builder_release(&b);
}

/* pbrt: ice in water, its index given relative to the water's; and a volume within another whose
 * faces all count, which priorities would hide. */
static void test_boundaries(void **state)
{
    (void)state;
    for (int below_one = 0; below_one < 2; below_one++) {
        struct render_settings settings = slabs_settings();
        double eta = below_one ? (double)0.763f : 1.5;
        struct scene_builder b;
        struct layers s;
        uint32_t slab;
        builder_init(&b);
        slabs_glass(&b, 1.33f, INFINITY)->priority = 1;
        slabs_glass(&b, (float)eta, INFINITY);
        b.scene.volume_rule = VOLUMES_BOUNDARIES;
        slab = builder_slab(&b);
        builder_place(&b, slab, 0, vec3_make(9, 2, 9), vec3_splat(0));
        builder_place(&b, slab, 1, vec3_make(9, 0.5f, 9), vec3_splat(0));
        light_from_below(&b);
        s = layers_stacked(layers_interface(1, (double)1.33f), layers_interface(1, eta));
        s = layers_stacked(s, layers_interface(eta, 1));
        s = layers_stacked(s, layers_interface((double)1.33f, 1));
        radiance_expect(&b, &settings, COMPARISONS, s.t, below_one ? "an index below 1" : "every boundary");
        builder_release(&b);
    }
}

/* pbrt: the medium before a surface is what its outside says, whatever the ray came from. */
static void test_media_by_boundary(void **state)
{
    struct render_settings settings = slabs_settings();
    struct scene_material *m;
    struct scene_builder b;
    uint32_t slab;

    (void)state;
    builder_init(&b);
    builder_medium(&b)->absorption[0] = 0.25f;
    builder_medium(&b)->absorption[1] = 0.5f;
    for (int i = 0; i < 2; i++) {
        m = builder_lambert(&b, 0);
        m->kind = MATERIAL_INTERFACE;
        m->medium = i;
        m->medium_outside = i ? 0 : -1;
    }
    b.scene.volume_rule = VOLUMES_BOUNDARIES;
    slab = builder_slab(&b);
    builder_place(&b, slab, 0, vec3_make(9, 2, 9), vec3_splat(0));
    builder_place(&b, slab, 1, vec3_make(9, 1, 9), vec3_splat(0));
    slabs_look_down(&b, 5);
    radiance_expect_rgb(&b, &settings, COMPARISONS, (double[3]){exp(-0.25 * 2), exp(-0.5 * 2), 1},
                        "media by boundaries");
    /* A pane of glass's index 1 into the inner one: the same, and a thin wall parts media too. */
    b.scene.materials[1].kind = MATERIAL_SURFACE;
    b.scene.materials[1].transmission = 1;
    b.scene.materials[1].ior = 1;
    b.scene.materials[1].roughness = 0;
    for (int i = 0; i < 3; i++)
        b.scene.materials[1].base_color[i] = 1;
    radiance_expect_rgb(&b, &settings, COMPARISONS, (double[3]){exp(-0.25 * 2), exp(-0.5 * 2), 1},
                        "media parted by a pane");
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_two_meshes),        cmocka_unit_test(test_hollow),
        cmocka_unit_test(test_union),             cmocka_unit_test(test_again_within),
        cmocka_unit_test(test_two_materials),     cmocka_unit_test(test_halves),
        cmocka_unit_test(test_camera_inside),     cmocka_unit_test(test_open),
        cmocka_unit_test(test_boundaries),        cmocka_unit_test(test_media_by_boundary),
    };
    return cmocka_run_group_tests_name("bodies", tests, NULL, NULL);
}
