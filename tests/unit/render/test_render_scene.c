/* What render_scene_new loads, leaves out and refuses. */
#include <math.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/render_scene.h"

enum { FLOATS = 2 * 16 * 16 * 3 };

/* A floor, a ball and a lamp's worth of everything; texture 0 on the floor. */
static void build_room(struct scene_builder *b)
{
    static const float checks[12] = {0.9f, 0.1f, 0.1f, 0.1f, 0.9f, 0.1f,
                                     0.1f, 0.1f, 0.9f, 0.9f, 0.9f, 0.9f};

    builder_init(b);
    builder_lambert(b, 1)->base_color_texture.texture = (int32_t)builder_texture(b, checks, 2, 2);
    builder_lambert(b, 0.5f);
    builder_place(b, builder_quad(b), 0, vec3_splat(4), vec3_splat(0));
    builder_place(b, builder_sphere(b, 8, 1), 1, vec3_splat(1), vec3_make(0, 1, 0));
    builder_environment_constant(b, vec3_splat(0.3f));
    builder_camera(b, vec3_make(0, 3, 8), vec3_make(0, 0.5f, 0), 0.6f);
}

static void picture(struct scene_builder *b, uint64_t without, float out[FLOATS])
{
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_stats stats = {0};
    struct render_scene *scene;

    settings.without = without;
    scene = builder_build(b, &settings);
    render_tile(scene, 0, 0, 0, 0, out, NULL, &stats);
    render_scene_free(scene);
}

/* Images that nothing reads are not decoded, whatever is in them: of a material that no instance
 * has, of a factor that is 0, of an unlit material's gloss, of lights that are black or that
 * have no use for one. */
static void test_unused_images(void **state)
{
    static const float white[3] = {1, 1, 1};
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_scene_info info;
    struct render_scene *scene;
    struct scene_material *m;
    struct scene_builder b;
    struct error err = {0};
    size_t one_image;

    (void)state;
    build_room(&b);
    scene = builder_build(&b, &settings);
    render_scene_info(scene, &info);
    one_image = info.texture_bytes;
    assert_true(one_image > 0);
    assert_non_null(scene->images[0]);
    render_scene_free(scene);

    builder_texture(&b, white, 1, 1);
    memset(b.blobs[b.blob_count - 1].data, 'x', b.blobs[b.blob_count - 1].size_bytes); /* garbage */
    m = builder_lambert(&b, 1);                                                        /* nobody's */
    m->base_color_texture.texture = 1;
    m = &b.scene.materials[1];
    m->emission_texture.texture = m->transmission_texture.texture = 1; /* factors of 0 */
    m->clearcoat_texture.texture = m->sheen_color_texture.texture = 1;
    m->diffuse_transmission_color_texture.texture = m->iridescence_texture.texture = 1;
    builder_light(&b, LIGHT_POINT)->image = 1; /* a point light has no image */
    b.scene.lights[0].intensity[0] = 1;
    scene = builder_build(&b, &settings);
    render_scene_info(scene, &info);
    assert_int_equal(info.texture_bytes, one_image);
    assert_null(scene->images[1]);
    assert_null(scene->materials[1].emission.image);
    render_scene_free(scene);

    m->sheen_color[1] = 0.5f; /* now it is used */
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err), STATUS_ERR_INPUT);
    settings.without = EFFECT_SHEEN;
    scene = builder_build(&b, &settings);
    assert_null(scene->materials[1].sheen_color.image);
    assert_true(scene->materials[1].m.sheen_color[1] == 0);
    render_scene_free(scene);
    settings.without = EFFECT_TEXTURE;
    scene = builder_build(&b, &settings);
    assert_null(scene->images[0]);
    render_scene_free(scene);
    builder_release(&b);
}

/* What a mix is made of counts as used, whether an instance has it or not. */
static void test_mix_parts(void **state)
{
    static const float grey[3] = {0.5f, 0.5f, 0.5f};
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_scene *scene;
    struct scene_material *m;
    struct scene_builder b;

    (void)state;
    build_room(&b);
    builder_lambert(&b, 1)->base_color_texture.texture = (int32_t)builder_texture(&b, grey, 1, 1);
    b.scene.materials[1].double_sided = b.scene.materials[2].double_sided = 0;
    m = builder_lambert(&b, 1);
    m->kind = MATERIAL_MIX;
    m->mix_material[0] = 1;
    m->mix_material[1] = 2;
    m->mix_amount = 0.5f;
    b.scene.instances[1].material = 3;
    scene = builder_build(&b, &settings);
    assert_non_null(scene->images[1]);
    assert_true(scene->materials[3].flags & MATERIAL_CULLED);
    render_scene_free(scene);
    b.scene.materials[2].double_sided = 1;
    b.scene.materials[2].diffuse_transmission = 0.5f;
    scene = builder_build(&b, &settings);
    assert_int_equal(scene->materials[3].flags & MATERIAL_CULLED, 0);
    assert_true(scene->materials[3].flags & MATERIAL_TWO_WAY);
    render_scene_free(scene);
    builder_release(&b);
}

static unsigned flags_of(void (*edit)(struct scene_material *m))
{
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_scene *scene;
    struct scene_builder b;
    unsigned flags;

    build_room(&b);
    b.scene.materials[1].double_sided = 0;
    edit(&b.scene.materials[1]);
    scene = builder_build(&b, &settings);
    flags = scene->materials[1].flags;
    render_scene_free(scene);
    builder_release(&b);
    return flags;
}

static void plain(struct scene_material *m) { (void)m; }
static void coated(struct scene_material *m) { m->clearcoat = 1; }
static void brushed(struct scene_material *m) { m->anisotropy = 0.5f; }
static void leaf(struct scene_material *m) { m->diffuse_transmission = 0.5f; }
static void pane(struct scene_material *m) { m->transmission = 1; }
static void glass(struct scene_material *m) { m->transmission = 1; m->refractive = 1; }
static void gilded(struct scene_material *m) { glass(m); m->metallic = 1; }
static void interface(struct scene_material *m) { m->kind = MATERIAL_INTERFACE; }
static void shining(struct scene_material *m) { m->emission[1] = 1; }
static void shining_unlit(struct scene_material *m) { m->emission[1] = 1; m->unlit = 1; }
static void conductor(struct scene_material *m)
{
    m->kind = MATERIAL_CONDUCTOR;
    m->conductor_eta[0] = m->conductor_eta[1] = m->conductor_eta[2] = 1;
}

static void test_flags(void **state)
{
    static const struct {
        void (*edit)(struct scene_material *m);
        unsigned flags;
    } rows[] = {
        {plain, MATERIAL_CULLED},
        {coated, MATERIAL_CULLED | MATERIAL_LAYERED},
        {brushed, MATERIAL_CULLED | MATERIAL_LAYERED | MATERIAL_NEEDS_FRAME},
        {leaf, MATERIAL_CULLED | MATERIAL_LAYERED | MATERIAL_TWO_WAY},
        {pane, MATERIAL_CULLED | MATERIAL_TWO_WAY},
        {glass, MATERIAL_BOUNDS | MATERIAL_TWO_WAY | MATERIAL_ENCLOSES},
        {gilded, MATERIAL_CULLED},
        {interface, MATERIAL_BOUNDS | MATERIAL_TWO_WAY | MATERIAL_ENCLOSES},
        {shining, MATERIAL_CULLED | MATERIAL_EMISSIVE},
        {shining_unlit, MATERIAL_CULLED},
        {conductor, MATERIAL_CULLED | MATERIAL_LAYERED},
    };

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        unsigned got = flags_of(rows[i].edit);
        if (got != rows[i].flags)
            fail_msg("row %zu: flags %u instead of %u", i, got, rows[i].flags);
    }
}

/* What a job does without is as if the scene did not have it, bit by bit. */
static void test_without(void **state)
{
    static float with[FLOATS], without[FLOATS], never[FLOATS];
    struct scene_builder b;

    (void)state;
    build_room(&b);
    b.scene.materials[1].emission[0] = 2;
    picture(&b, 0, with);
    picture(&b, EFFECT_EMISSIVE_MESH, without);
    b.scene.materials[1].emission[0] = 0;
    picture(&b, 0, never);
    assert_memory_equal(without, never, sizeof never);
    assert_memory_not_equal(with, never, sizeof never);

    builder_light(&b, LIGHT_POINT)->intensity[1] = 20;
    b.scene.lights[0].position[1] = 4;
    picture(&b, 0, with);
    picture(&b, EFFECT_PUNCTUAL_LIGHT, without);
    assert_memory_equal(without, never, sizeof never);
    assert_memory_not_equal(with, never, sizeof never);
    b.scene.light_count = 0;

    picture(&b, EFFECT_TEXTURE, without);
    b.scene.materials[0].base_color_texture.texture = -1;
    picture(&b, 0, never);
    assert_memory_equal(without, never, sizeof never);

    picture(&b, EFFECT_ENVIRONMENT, without);
    b.scene.environment.present = 0;
    picture(&b, 0, never);
    assert_memory_equal(without, never, sizeof never);
    builder_release(&b);
}

/* A scene that is too large is refused before it is built, with numbers. */
static void test_memory_limit(void **state)
{
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_scene *scene = NULL;
    struct scene_builder b;
    struct error err = {0};

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_sphere(&b, 200, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(0, 0, 8), vec3_splat(0), 0.6f);
    render_memory_limit(1 << 20);
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err), STATUS_ERR_NO_MEMORY);
    assert_null(scene);
    assert_non_null(strstr(err.text, "the scene needs about 0.0"));
    assert_non_null(strstr(err.text, "this worker has 0.000977 GiB"));
    render_memory_limit(1 << 28);
    scene = builder_build(&b, &settings);
    render_scene_free(scene);
    render_memory_limit(0); /* what the machine has */
    scene = builder_build(&b, &settings);
    render_scene_free(scene);
    builder_release(&b);
}

/* The estimate against what is then taken: never less, and not four times as much. */
static void test_memory_estimate(void **state)
{
    enum { SIDE = 512 };
    static float pixels[SIDE * SIDE * 3];
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_scene *scene = NULL;
    struct render_scene_info info;
    struct scene_builder b;
    struct error err = {0};
    uint64_t taken;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f)->base_color_texture.texture = (int32_t)builder_texture(&b, pixels, SIDE, SIDE);
    builder_place(&b, builder_sphere(&b, 200, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(0, 0, 8), vec3_splat(0), 0.6f);
    scene = builder_build(&b, &settings);
    render_scene_info(scene, &info);
    taken = info.mesh_bytes + info.texture_bytes + info.bvh_bytes;
    render_scene_free(scene);
    render_memory_limit(taken);
    assert_int_equal(render_scene_new(&scene, &b.scene, &settings, 0, builder_source(&b), &err), STATUS_ERR_NO_MEMORY);
    render_memory_limit(4 * taken);
    scene = builder_build(&b, &settings);
    render_scene_free(scene);
    render_memory_limit(0);
    builder_release(&b);
}

/* Scenes that live at the same time share what they decode; of another use it is decoded again. */
static void test_shared_images(void **state)
{
    struct render_settings settings = builder_settings(16, 16, 16);
    struct render_scene *one, *two, *three;
    struct scene_builder b;

    (void)state;
    build_room(&b);
    one = builder_build(&b, &settings);
    two = builder_build(&b, &settings);
    assert_true(one->images[0] == two->images[0]);
    b.scene.materials[0].roughness = 0.5f;
    b.scene.materials[0].metallic_roughness_texture.texture = 0; /* as data too */
    three = builder_build(&b, &settings);
    assert_true(three->images[0] != one->images[0]);
    render_scene_free(one);
    b.scene.materials[0].metallic_roughness_texture.texture = -1;
    one = builder_build(&b, &settings);
    assert_true(one->images[0] == two->images[0]);
    render_scene_free(one);
    render_scene_free(two);
    render_scene_free(three);
    builder_release(&b);
}

static void *build_often(void *user)
{
    struct render_settings settings = builder_settings(16, 16, 16);
    struct scene_builder *b = user;

    for (int i = 0; i < 20; i++) {
        struct render_stats stats = {0};
        float out[FLOATS];
        struct render_scene *scene = builder_build(b, &settings);
        render_tile(scene, 0, 0, 0, 0, out, NULL, &stats);
        render_scene_free(scene);
    }
    return NULL;
}

/* Threads that build and free the same scene do not get in one another's way (the sanitizers
 * would tell). */
static void test_shared_by_threads(void **state)
{
    enum { THREADS = 4 };
    pthread_t threads[THREADS];
    struct scene_builder b;

    (void)state;
    build_room(&b);
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, build_often, &b), 0);
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_join(threads[i], NULL), 0);
    builder_release(&b);
}

/* glTF's clearcoat: what is emitted below it is dimmed by its weight times Schlick's term. */
static void a_coat_dims_the_emission_below_it(void **state)
{
    static const uint32_t vertex[3] = {0, 1, 2};
    struct render_material material = {
        .m = {.emission = {1, 1, 1}, .clearcoat = 0.5f, .clearcoat_ior = 1.5f}};

    (void)state;
    for (float c = 0; c <= 1; c += 0.125f) {
        float f = 0.04f + 0.96f * powf(1 - c, 5);
        float scale = material_emitted(&material, NULL, vertex, 0.3f, 0.3f, c, 1).x;
        assert_true(fabsf(scale - (1 - 0.5f * f)) < 1e-6f);
    }
    /* In something denser only the ratio counts. */
    for (float c = 0; c <= 1; c += 0.125f) {
        float n = 1.5f / 1.33f, f = (n - 1) * (n - 1) / ((n + 1) * (n + 1));
        f += (bsdf_f90_of(f) - f) * powf(1 - c, 5);
        assert_true(fabsf(material_emitted(&material, NULL, vertex, 0.3f, 0.3f, c, 1.33f).x - (1 - 0.5f * f)) < 1e-6f);
    }
    material.m.clearcoat_ior = 1; /* reflects nothing, at no angle */
    assert_true(material_emitted(&material, NULL, vertex, 0.3f, 0.3f, 0, 1).x == 1);
    material.m.clearcoat_ior = 1.5f;
    material.m.clearcoat = 0;
    assert_true(material_emitted(&material, NULL, vertex, 0.3f, 0.3f, 0, 1).x == 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_coat_dims_the_emission_below_it),
        cmocka_unit_test(test_unused_images), cmocka_unit_test(test_mix_parts),
        cmocka_unit_test(test_flags),         cmocka_unit_test(test_without),
        cmocka_unit_test(test_memory_limit),  cmocka_unit_test(test_memory_estimate),
        cmocka_unit_test(test_shared_images), cmocka_unit_test(test_shared_by_threads),
    };
    return cmocka_run_group_tests_name("world", tests, NULL, NULL);
}
