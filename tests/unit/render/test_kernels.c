/* Every kernel variant that covers a scene gives the same bits as the general one. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/scene/kernel_sets.h"
#include "tests/support/scene_builder.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/path/kernel.h"
#include "worker/render/render_scene.h"

enum { SIZE = 24, FLOATS = 2 * 3 * 256 };

static void dress_mirror(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->metallic = 1;
    ball->roughness = 0;
}

static void dress_plastic(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->specular = 1;
    ball->roughness = 0.3f;
}

static void dress_conductor(struct scene_builder *b, struct scene_material *ball)
{
    static const float eta[3] = {0.2f, 0.9f, 1.1f}, k[3] = {3.9f, 2.4f, 2.2f};

    (void)b;
    ball->kind = MATERIAL_CONDUCTOR;
    ball->roughness = 0.4f;
    memcpy(ball->conductor_eta, eta, sizeof eta);
    memcpy(ball->conductor_k, k, sizeof k);
}

static void dress_glass(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->specular = 1;
    ball->transmission = 1;
    ball->refractive = 1;
    ball->roughness = 0;
    ball->attenuation_distance = 2;
    ball->attenuation_color[0] = 0.5f;
}

static void dress_frosted(struct scene_builder *b, struct scene_material *ball)
{
    dress_glass(b, ball);
    ball->roughness = 0.5f;
}

static void dress_coat(struct scene_builder *b, struct scene_material *ball)
{
    dress_plastic(b, ball);
    ball->clearcoat = 0.8f;
    ball->clearcoat_roughness = 0.1f;
}

static void dress_sheen(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->sheen_color[0] = 0.8f;
    ball->sheen_roughness = 0.4f;
}

static void dress_film(struct scene_builder *b, struct scene_material *ball)
{
    dress_plastic(b, ball);
    ball->iridescence = 1;
}

static void dress_leaf(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->diffuse_transmission = 0.5f;
    ball->diffuse_transmission_color[2] = 0.2f;
}

static void dress_prism(struct scene_builder *b, struct scene_material *ball)
{
    dress_glass(b, ball);
    ball->dispersion = 0.5f;
}

static void dress_mix(struct scene_builder *b, struct scene_material *ball)
{
    struct scene_material *mix;

    dress_mirror(b, ball);
    mix = builder_lambert(b, 1);
    mix->kind = MATERIAL_MIX;
    mix->mix_amount = 0.4f;
    mix->mix_material[0] = 0;
    mix->mix_material[1] = (uint32_t)(ball - b->scene.materials);
    b->scene.instances[2].material = builder_last_material(b);
}

static void dress_lens(struct scene_builder *b, struct scene_material *ball)
{
    dress_plastic(b, ball);
    b->scene.cameras[0].lens_radius = 0.1f;
    b->scene.cameras[0].focus_distance = 5;
}

static void dress_rough(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->diffuse_roughness = 0.7f;
}

static void dress_orthographic(struct scene_builder *b, struct scene_material *ball)
{
    dress_plastic(b, ball);
    b->scene.cameras[0].kind = CAMERA_ORTHOGRAPHIC;
    b->scene.cameras[0].ymag = b->scene.cameras[0].xmag = 2;
}

static void dress_alpha(struct scene_builder *b, struct scene_material *ball)
{
    (void)b;
    ball->alpha_mode = ALPHA_BLEND;
    ball->base_color[3] = 0.5f;
}

static void dress_culled(struct scene_builder *b, struct scene_material *ball)
{
    (void)ball;
    b->scene.materials[0].double_sided = 0;
}

/* A lamp without size, whose light the ball reflects and refracts. */
static void dress_lamp(struct scene_builder *b, struct scene_material *ball)
{
    struct scene_light *lamp = builder_light(b, LIGHT_POINT);

    dress_mirror(b, ball);
    lamp->position[1] = 3;
    lamp->intensity[0] = lamp->intensity[1] = 9;
}

static void dress_lit_glass(struct scene_builder *b, struct scene_material *ball)
{
    dress_lamp(b, ball);
    ball->metallic = 0;
    dress_glass(b, ball);
}

static const struct {
    const char *name, *kernel;
    void (*dress)(struct scene_builder *b, struct scene_material *ball);
} rooms[] = {
    {"lambert", "matte", NULL},
    {"culled", "matte", dress_culled},
    {"rough diffuse", "opaque", dress_rough},
    {"mirror", "opaque", dress_mirror},
    {"plastic", "opaque", dress_plastic},
    {"conductor", "opaque", dress_conductor},
    {"orthographic", "opaque", dress_orthographic},
    {"alpha", "opaque", dress_alpha},
    {"glass", "glass", dress_glass},
    {"mirror under a lamp", "opaque", dress_lamp},
    {"glass under a lamp", "glass", dress_lit_glass},
    {"frosted", "glass", dress_frosted},
    {"coat", "layered", dress_coat},
    {"sheen", "layered", dress_sheen},
    {"film", "layered", dress_film},
    {"leaf", "layered", dress_leaf},
    {"prism", "general", dress_prism},
    {"mix", "general", dress_mix},
    {"lens", "general", dress_lens},
};

static void test_same_bits(void **state)
{
    static float expected[FLOATS], got[FLOATS];

    (void)state;
    for (size_t i = 0; i < sizeof rooms / sizeof *rooms; i++) {
        struct render_settings settings = builder_settings(SIZE, SIZE, 16);
        struct render_scene *scene;
        struct scene_builder b;
        int compared = 0;

        builder_room(&b, rooms[i].dress);
        scene = builder_build(&b, &settings);
        if (strcmp(render_kernel_variant(scene), rooms[i].kernel) != 0)
            fail_msg("%s is rendered by kernel %s, not by %s", rooms[i].name, render_kernel_variant(scene),
                     rooms[i].kernel);
        for (uint32_t tile = 0; tile < tile_count(SIZE, SIZE); tile++) {
            struct render_stats stats = {0};
            struct tail tail, other;
            size_t count = tile_render(scene, 3, tile, 1, 1, expected, &tail, &stats);
            uint64_t rays = stats.work.rays;
            for (size_t k = 0; kernel_at(k); k++) {
                const struct kernel *kernel = kernel_at(k);
                if (scene->effects & ~kernel->effects)
                    continue;
                memset(got, 0x5a, sizeof got);
                memset(&stats, 0, sizeof stats);
                assert_int_equal(kernel->tile_render(scene, 3, tile, 1, 1, got, &other, &stats), count);
                if (memcmp(got, expected, count * sizeof *got) != 0 || stats.work.rays != rays ||
                    tail.count != other.count ||
                    memcmp(tail.entries, other.entries, tail.count * sizeof *tail.entries) != 0)
                    fail_msg("%s: kernel %s differs from the general one in tile %u", rooms[i].name, kernel->name,
                             tile);
                compared++;
            }
        }
        assert_true(compared >= (int)tile_count(SIZE, SIZE));
        render_scene_free(scene);
        builder_release(&b);
    }
}

/* The comparison can fail: another scene's bits differ. */
static void test_comparison_bites(void **state)
{
    static float one[FLOATS], two[FLOATS];
    struct render_settings settings = builder_settings(SIZE, SIZE, 16);
    struct render_stats stats = {0};
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    builder_room(&b, dress_coat);
    scene = builder_build(&b, &settings);
    tile_render(scene, 0, 0, 0, 0, one, NULL, &stats);
    /* A kernel that cannot do clearcoats leaves the coat out. */
    kernel_at(1)->tile_render(scene, 0, 0, 0, 0, two, NULL, &stats);
    tile_render(scene, 0, 2, 0, 0, one, NULL, &stats);
    kernel_at(1)->tile_render(scene, 0, 2, 0, 0, two, NULL, &stats);
    assert_memory_not_equal(one, two, sizeof one);
    render_scene_free(scene);
    builder_release(&b);
}

/* The smallest kernel is compiled without lobes: nothing that a surface of its scenes has needs more
 * than Lambert's. */
static void test_matte_has_no_lobes(void **state)
{
#define CALLED(name, condition) | EFFECT_##name
    const uint64_t lobes = EFFECT_MIRROR BSDF_CALL_MAP(CALLED);
#undef CALLED

    (void)state;
    assert_int_equal(KERNEL_SET_MATTE & lobes, 0);
}

static void test_order(void **state)
{
    (void)state;
    for (size_t k = 0; kernel_at(k); k++)
        assert_true(kernel_for(kernel_at(k)->effects) == kernel_at(k)); /* none before it would do */
    assert_true(kernel_for(0) == kernel_at(0));
    assert_string_equal(kernel_for(EFFECTS_ALL)->name, "general");
    render_force_general(1);
    assert_string_equal(kernel_for(0)->name, "general");
    render_force_general(0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_bits),
        cmocka_unit_test(test_comparison_bites),
        cmocka_unit_test(test_matte_has_no_lobes),
        cmocka_unit_test(test_order),
    };

    return cmocka_run_group_tests_name("kernels", tests, NULL, NULL);
}
