/* A new material field is two lines: a row of material_fields.h and one of scene.proto. This
 * program is compiled with a value and a texture more than the others have (MATERIAL_ROW_VALUE in
 * the Makefile), and finds that everything which treats all fields alike knows them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>

#include "common/base/buffer.h"
#include "common/scene/scene_effects.h"
#include "common/scene/material.h"
#include "common/scene/settings.h"
#include "common/scene/simplify/simplify.h"
#include "tests/support/scene_sample.h"
#include "worker/render/scene/render_material.h"

static void test_default(void **state)
{
    struct scene_material m;

    (void)state;
    scene_material_default(&m);
    assert_true(m.clearcoat_varnish == 0.25f);
    assert_int_equal(m.clearcoat_varnish_texture.texture, -1);
    assert_true(m.clearcoat_varnish_texture.uv_transform[1][1] == 1);
}

static void assert_refused(struct scene *scene, const char *words)
{
    struct error err = {0};

    assert_int_equal(scene_validate(scene, &err), STATUS_ERR_INPUT);
    if (!strstr(err.text, words))
        fail_msg("\"%s\" does not say \"%s\"", err.text, words);
}

static void test_range(void **state)
{
    struct scene scene;

    (void)state;
    scene_sample(&scene);
    scene.materials[1].clearcoat_varnish = 2.5f;
    assert_refused(&scene, "materials[1].clearcoat_varnish is 2.5: must be 0 to 2");
    scene.materials[1].clearcoat_varnish = 2;
    assert_int_equal(scene_validate(&scene, NULL), STATUS_OK);
    scene.materials[1].clearcoat_varnish_texture.texture = 2;
    assert_refused(&scene, "materials[1].clearcoat_varnish_texture is 2: there are 2");
    scene_release(&scene);
}

static void test_wire(void **state)
{
    struct buffer packed = BUFFER_INIT;
    struct scene scene, copy;
    struct error err = {0};

    (void)state;
    scene_sample(&scene);
    scene.materials[1].clearcoat_varnish = 0.5f;
    scene.materials[1].clearcoat_varnish_texture = scene.materials[0].mix_texture;
    assert_int_equal(scene_pack(&scene, &packed, &err), STATUS_OK);
    if (scene_unpack(&copy, packed.data, packed.size, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_true(copy.materials[1].clearcoat_varnish == 0.5f);
    assert_memory_equal(&copy.materials[1].clearcoat_varnish_texture, &scene.materials[0].mix_texture,
                        sizeof(struct scene_texture_slot));
    assert_true(copy.materials[2].clearcoat_varnish == 0.25f); /* without the group */
    buffer_release(&packed);
    scene_release(&scene);
    scene_release(&copy);
}

/* A coat with the texture, on a box with a camera before it. */
static void varnished_scene(struct scene *scene)
{
    scene_sample(scene);
    scene->instance_count = 1;
    scene->light_count = 0;
    scene->instances[0].body = scene->instances[0].node = -1;
    scene_material_default(&scene->materials[0]);
    scene->materials[0].clearcoat = 1;
    scene->materials[0].clearcoat_varnish_texture.texture = 1;
    scene->environment.constant = 1;
}

static uint64_t effects_of(const struct scene *scene, uint64_t without)
{
    struct render_settings settings;

    render_settings_default(&settings);
    settings.without = without;
    return scene_effects(scene, &settings, 0, NULL);
}

static void test_effects(void **state)
{
    struct scene scene;

    (void)state;
    varnished_scene(&scene);
    assert_true(effects_of(&scene, 0) & EFFECT_TEXTURE);
    assert_false(effects_of(&scene, EFFECT_CLEARCOAT) & EFFECT_TEXTURE);
    scene.materials[0].clearcoat_varnish = 0;
    assert_false(effects_of(&scene, 0) & EFFECT_TEXTURE);
    scene_release(&scene);
}

static status no_blob(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes,
                      struct error *err)
{
    (void)user, (void)digest, (void)data, (void)size_bytes;
    return error_set(err, STATUS_ERR_INPUT, "the image is asked for");
}

/* A texture that acts is looked at; one that does not act goes. */
static void test_simplified(void **state)
{
    struct scene_blob_reader reader = {no_blob, NULL};
    struct scene_simplify_report report;
    struct scene scene;
    struct error err = {0};

    (void)state;
    varnished_scene(&scene);
    assert_int_equal(scene_simplify(&scene, reader, &report, &err), STATUS_ERR_INPUT);
    assert_string_equal(err.text, "the image is asked for");
    scene_release(&scene);
    varnished_scene(&scene);
    scene.materials[0].clearcoat = 0;
    assert_int_equal(scene_simplify(&scene, reader, &report, &err), STATUS_OK);
    assert_int_equal(report.unseen, 1);
    assert_int_equal(scene.texture_count, 0);
    scene_release(&scene);
}

/* The renderer loads its image, and keeps it for the code that will read it. */
static void test_loaded(void **state)
{
    struct render_settings settings;
    struct render_used used;
    struct render_material ready;
    struct scene scene;
    struct error err = {0};

    (void)state;
    varnished_scene(&scene);
    render_settings_default(&settings);
    assert_int_equal(used_init(&used, &scene, &settings, &err), STATUS_OK);
    assert_true(used.images[scene.textures[1].image] & RENDER_IMAGE_USED);
    used_release(&used);
    settings.without = EFFECT_CLEARCOAT;
    assert_int_equal(used_init(&used, &scene, &settings, &err), STATUS_OK);
    assert_int_equal(used.images[scene.textures[1].image], 0);
    used_release(&used);
    assert_ptr_equal(&ready.clearcoat_varnish, &ready.slots[MATERIAL_TEXTURE_clearcoat_varnish]);
    scene_release(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_default),    cmocka_unit_test(test_range),
        cmocka_unit_test(test_wire),       cmocka_unit_test(test_effects),
        cmocka_unit_test(test_simplified), cmocka_unit_test(test_loaded),
    };

    return cmocka_run_group_tests_name("one more material field", tests, NULL, NULL);
}
