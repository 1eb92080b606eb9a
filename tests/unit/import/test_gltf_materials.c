/* glTF: materials, textures, images and their extensions. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>

#include "common/math/elementary.h"
#include "tests/support/gltf_maker.h"

static void test_material(void **state)
{
    struct maker m = triangle_maker();
    const struct scene_material *a;
    struct import_result r;

    (void)state;
    maker_import(
        &m,
        ONE_NODE
        ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":1}]}],"
        "\"materials\":[{\"name\":\"not used\"},{\"name\":\"glass\",\"doubleSided\":true,"
        "\"alphaMode\":\"MASK\",\"alphaCutoff\":0.25,\"emissiveFactor\":[1,0.5,0],"
        "\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.1,0.2,0.3,0.4],\"metallicFactor\":0.5,"
        "\"roughnessFactor\":0.25},\"extensions\":{"
        "\"KHR_materials_emissive_strength\":{\"emissiveStrength\":8},"
        "\"KHR_materials_ior\":{\"ior\":1.33},"
        "\"KHR_materials_specular\":{\"specularFactor\":0.5,\"specularColorFactor\":[2,1,0.5]},"
        "\"KHR_materials_transmission\":{\"transmissionFactor\":0.75},"
        "\"KHR_materials_volume\":{\"thicknessFactor\":0.1,\"attenuationDistance\":2,"
        "\"attenuationColor\":[0.5,0.6,0.7]}}}]",
        &r);
    assert_int_equal(r.scene.material_count, 1); /* only what is used */
    a = &r.scene.materials[0];
    assert_string_equal(a->name, "glass");
    assert_true(a->double_sided && a->alpha_mode == ALPHA_MASK && a->alpha_cutoff == 0.25f);
    assert_floats(a->base_color, (const float[]){0.1f, 0.2f, 0.3f, 0.4f}, 4, 0);
    assert_true(a->metallic == 0.5f && a->roughness == 0.25f);
    assert_floats(a->emission, (const float[]){8, 4, 0}, 3, 0);
    assert_true(a->ior == 1.33f && a->specular == 0.5f && a->transmission == 0.75f);
    assert_floats(a->specular_color, (const float[]){2, 1, 0.5f}, 3, 0);
    assert_floats(a->attenuation_color, (const float[]){0.5f, 0.6f, 0.7f}, 3, 0);
    assert_true(a->refractive && a->attenuation_distance == 2);
    import_result_release(&r);
}

/* One material by its JSON. */
static void import_material(const char *json, struct import_result *r)
{
    struct buffer rest = BUFFER_INIT;
    struct maker m = triangle_maker();

    buffer_printf(&rest,
                  ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                           "\"material\":0}]}],\"materials\":[{%s}]",
                  json);
    maker_import(&m, buffer_text(&rest), r);
    buffer_release(&rest);
}

static void test_material_kinds(void **state)
{
    struct import_result r;

    (void)state;
    import_material("\"extensions\":{\"KHR_materials_unlit\":{}},\"emissiveFactor\":[1,1,1]", &r);
    assert_true(r.scene.materials[0].unlit);
    assert_false(r.scene.environment.present); /* it shines by itself */
    import_result_release(&r);
    import_material("\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":1},"
                    "\"KHR_materials_volume\":{\"attenuationDistance\":3}}",
                    &r);
    assert_false(r.scene.materials[0].refractive); /* thickness 0: a thin wall */
    import_result_release(&r);
    import_material("\"extensions\":{\"KHR_materials_ior\":{\"ior\":0}}", &r);
    assert_true(r.scene.materials[0].ior == 0);
    import_result_release(&r);
    import_material("\"pbrMetallicRoughness\":{\"roughnessFactor\":1.5},\"alphaMode\":\"BLEND\"",
                    &r);
    assert_true(r.scene.materials[0].roughness == 1);
    assert_int_equal(r.scene.materials[0].alpha_mode, ALPHA_BLEND);
    assert_warned(&r, "roughnessFactor is 1.5, taken as 1");
    import_result_release(&r);
    import_material("\"emissiveFactor\":[1,1,1],\"occlusionTexture\":{\"index\":99}", &r);
    assert_false(r.scene.environment.present); /* lights itself; occlusion is not looked at */
    import_result_release(&r);
}

static void test_material_warnings(void **state)
{
    static const char *const names[] = {"clearcoat", "sheen", "iridescence", "anisotropy",
                                        "dispersion", "diffuse_transmission"};

    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        struct import_result r;
        char json[128];
        snprintf(json, sizeof json,
                 "\"name\":\"paint\\u001b[31m\",\"extensions\":{\"KHR_materials_%s\":{}}",
                 names[i]);
        import_material(json, &r);
        assert_warned(&r, names[i]);
        assert_warned(&r, "paint?[31m"); /* nothing that a terminal would obey */
        assert_string_equal(r.scene.materials[0].name, "paint?[31m");
        import_result_release(&r);
    }
}

static void test_texture_transform(void **state)
{
    static const float uv[6] = {0, 0, 1, 0, 0, 1};
    struct maker m = triangle_maker();
    const struct scene_texture_slot *slot;
    struct import_result r;
    float s, c;

    (void)state;
    put_floats(&m, "VEC2", uv, 6, 3);
    put_floats(&m, "VEC2", uv, 6, 3);
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                          "\"TEXCOORD_0\":1,\"TEXCOORD_1\":2},\"material\":0}]}],\"materials\":[{"
                          "\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0,"
                          "\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0.5,0.25],"
                          "\"scale\":[2,3],"
                          "\"rotation\":0.5,\"texCoord\":1}}}}}],"
                          "\"samplers\":[{\"wrapS\":33071,\"wrapT\":33648,\"magFilter\":9728}],"
                          "\"textures\":[{\"source\":0,\"sampler\":0}],"
                          "\"images\":[{\"name\":\"dot\",\"mimeType\":\"image/png\","
                          "\"uri\":\"data:,%89PNG%0D%0A%1A%0Ax\"}]",
                 &r);
    det_sincos(0.5f, &s, &c);
    slot = &r.scene.materials[0].base_color_texture;
    assert_int_equal(slot->uv_set, 1);
    assert_floats(&slot->uv_transform[0][0],
                  (const float[]){2 * c, 3 * s, 0.5f, -2 * s, 3 * c, 0.25f}, 6, 1e-6f);
    assert_int_equal(r.scene.textures[0].wrap_u, WRAP_CLAMP);
    assert_int_equal(r.scene.textures[0].wrap_v, WRAP_MIRROR);
    assert_int_equal(r.scene.textures[0].nearest, 1);
    assert_string_equal(r.scene.images[0].name, "dot");
    assert_int_equal(r.scene.images[0].blob.size_bytes, 9); /* percent-decoded */
    assert_int_equal(r.scene.meshes[0].arrays, MESH_UV1);
    import_result_release(&r);
}

static void test_texture_faults(void **state)
{
    static const struct {
        const char *tables, *words;
    } cases[] = {
        {"\"textures\":[{\"source\":5}],\"images\":[]", "textures[0]|source is 5"},
        {"\"textures\":[{\"source\":0}],\"images\":[{}]", "images[0]|neither"},
        {"\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"wood.png\"}]",
         "images[0]|names another file"},
        {"\"textures\":[{\"source\":0}],\"images\":[{\"name\":\"w\",\"uri\":"
         "\"data:;base64,UklGRgAAAABXRUJQ\"}]",
         "images[0]|w is a WebP file|PNG and JPEG"},
        {"\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:;base64,@@\"}]",
         "images[0]|base64"},
        {"\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:nothing\"}]",
         "images[0]|comma"},
        {"\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:;base64,AAAAA\"}]",
         "images[0]|cut short"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = triangle_maker();
        char rest[1024];
        snprintf(rest, sizeof rest,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                          "\"material\":0}]}],\"materials\":[{\"pbrMetallicRoughness\":{"
                          "\"baseColorTexture\":{\"index\":0}}}],%s",
                 cases[i].tables);
        maker_refuse(&m, rest, cases[i].words);
    }
}

static void test_texture_warnings(void **state)
{
    static const struct {
        const char *material, *textures, *words;
    } cases[] = {
        {"\"baseColorTexture\":{\"index\":0,\"texCoord\":2}", "{\"source\":0}",
         "coordinate set 2"},
        {"\"baseColorTexture\":{\"index\":0}",
         "{\"extensions\":{\"KHR_texture_basisu\":{\"source\":0}}}", "left out"},
        {"\"baseColorTexture\":{\"index\":0}",
         "{\"extensions\":{\"EXT_texture_webp\":{\"source\":0}}}", "WebP"},
        {"\"baseColorTexture\":{\"index\":0}", "{}", "has no image"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct maker m = triangle_maker();
        struct import_result r;
        char rest[1024];
        snprintf(rest, sizeof rest,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                          "\"material\":0}]}],\"materials\":[{\"pbrMetallicRoughness\":{%s}}],"
                          "\"textures\":[%s],\"images\":[{\"uri\":\"absent.png\"}]",
                 cases[i].material, cases[i].textures);
        maker_import(&m, rest, &r);
        assert_warned(&r, cases[i].words);
        assert_int_equal(r.scene.materials[0].base_color_texture.texture, -1);
        import_result_release(&r);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_material),
        cmocka_unit_test(test_material_kinds),
        cmocka_unit_test(test_material_warnings),
        cmocka_unit_test(test_texture_transform),
        cmocka_unit_test(test_texture_faults),
        cmocka_unit_test(test_texture_warnings),
    };

    return cmocka_run_group_tests_name("glTF materials", tests, NULL, NULL);
}
