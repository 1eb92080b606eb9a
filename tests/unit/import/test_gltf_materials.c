/* glTF: materials, textures, images and their extensions. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>

#include "common/image/image.h"
#include "common/math/elementary.h"
#include "tests/support/gltf_maker.h"

static void test_material(void **state)
{
    struct maker m = triangle_maker();
    const struct scene_material *a;
    struct import_result r;

    (void)state;
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":1}]}],"
                          "\"materials\":[{\"name\":\"not used\"},{\"name\":\"glass\",\"doubleSided\":true,"
                          "\"alphaMode\":\"MASK\",\"alphaCutoff\":0.5,\"emissiveFactor\":[1,0.5,0],"
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
    assert_true(a->double_sided && a->alpha_mode == ALPHA_MASK && a->alpha_cutoff == 0.5f);
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
    import_material("\"pbrMetallicRoughness\":{\"roughnessFactor\":1.5,\"baseColorFactor\":"
                    "[1,1,1,0.5]},\"alphaMode\":\"BLEND\"",
                    &r);
    assert_true(r.scene.materials[0].roughness == 1);
    assert_int_equal(r.scene.materials[0].alpha_mode, ALPHA_BLEND);
    assert_warned(&r, "roughnessFactor is 1.5, taken as 1");
    import_result_release(&r);
    import_material("\"emissiveFactor\":[1,1,1],\"occlusionTexture\":{\"index\":99}", &r);
    assert_false(r.scene.environment.present); /* lights itself; occlusion is not looked at */
    import_result_release(&r);
}

/* A text that a terminal would obey never reaches one. */
static void test_material_warnings(void **state)
{
    struct import_result r;

    (void)state;
    import_material("\"name\":\"paint\\u001b[31m\",\"extensions\":{\"KHR_materials_subsurface\":{}}", &r);
    assert_warned(&r, "subsurface");
    assert_warned(&r, "paint?[31m");
    assert_string_equal(r.scene.materials[0].name, "paint?[31m");
    import_result_release(&r);
}

/* A material by its JSON on a mesh with two sets of texture coordinates; texture 0 is there. */
static void import_textured(const char *json, struct import_result *r)
{
    static const float uv[6] = {0, 0, 1, 0, 0, 1};
    struct buffer rest = BUFFER_INIT;
    struct maker m = triangle_maker();

    put_floats(&m, "VEC2", uv, 6, 3);
    put_floats(&m, "VEC2", uv, 6, 3);
    buffer_printf(&rest,
                  ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,"
                           "\"TEXCOORD_0\":1,\"TEXCOORD_1\":2},\"material\":0}]}]," PNG_IMAGE ",\"materials\":[{%s}]",
                  json);
    maker_import(&m, buffer_text(&rest), r);
    buffer_release(&rest);
}

#define TEXTURE(name, set) "\"" name "\":{\"index\":0,\"texCoord\":" #set "}"

static void test_extensions(void **state)
{
    const struct scene_material *m;
    struct import_result r;

    (void)state;
    import_textured(
        "\"pbrMetallicRoughness\":{\"metallicFactor\":0},\"extensions\":{"
        "\"KHR_materials_clearcoat\":{\"clearcoatFactor\":0.5,\"clearcoatRoughnessFactor\":0.25,"
        "\"clearcoatNormalTexture\":{\"index\":0,\"scale\":0.125,\"texCoord\":1}," TEXTURE(
            "clearcoatTexture", 1) "," TEXTURE("clearcoatRoughnessTexture", 0) "},"
        "\"KHR_materials_sheen\":{\"sheenColorFactor\":[0.1,0.2,0.3],\"sheenRoughnessFactor\":0.4,"
        TEXTURE("sheenColorTexture", 1) "," TEXTURE("sheenRoughnessTexture", 1) "},"
        "\"KHR_materials_iridescence\":{\"iridescenceFactor\":0.6,\"iridescenceIor\":1.7,"
        "\"iridescenceThicknessMinimum\":500,\"iridescenceThicknessMaximum\":300,"
        TEXTURE("iridescenceTexture", 1) "," TEXTURE("iridescenceThicknessTexture", 0) "},"
        "\"KHR_materials_anisotropy\":{\"anisotropyStrength\":0.7,\"anisotropyRotation\":-1.5,"
        TEXTURE("anisotropyTexture", 1) "},"
        "\"KHR_materials_dispersion\":{\"dispersion\":0.8},"
        "\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionFactor\":0.9,"
        "\"diffuseTransmissionColorFactor\":[0.4,0.5,0.6]," TEXTURE(
            "diffuseTransmissionTexture", 1) "," TEXTURE("diffuseTransmissionColorTexture", 0) "},"
        "\"KHR_materials_diffuse_roughness\":{\"diffuseRoughnessFactor\":0.3,"
        TEXTURE("diffuseRoughnessTexture", 1) "}}",
        &r);
    m = &r.scene.materials[0];
    assert_true(m->clearcoat == 0.5f && m->clearcoat_roughness == 0.25f && m->clearcoat_normal_scale == 0.125f &&
                m->clearcoat_ior == 1.5f);
    assert_true(m->clearcoat_texture.texture == 0 && m->clearcoat_texture.uv_set == 1);
    assert_true(m->clearcoat_roughness_texture.texture == 0 && m->clearcoat_roughness_texture.uv_set == 0);
    assert_true(m->clearcoat_normal_texture.texture == 0 && m->clearcoat_normal_texture.uv_set == 1);
    assert_floats(m->sheen_color, (const float[]){0.1f, 0.2f, 0.3f}, 3, 0);
    assert_true(m->sheen_roughness == 0.4f && m->sheen_color_texture.uv_set == 1 &&
                m->sheen_roughness_texture.uv_set == 1);
    assert_true(m->iridescence == 0.6f && m->iridescence_ior == 1.7f);
    assert_true(m->iridescence_thickness_min_nm == 500 && m->iridescence_thickness_max_nm == 300);
    assert_true(m->iridescence_texture.uv_set == 1 && m->iridescence_thickness_texture.texture == 0);
    assert_true(m->anisotropy == 0.7f && m->anisotropy_rotation_rad == -1.5f && m->anisotropy_texture.uv_set == 1);
    assert_true(m->dispersion == 0.8f);
    assert_true(m->diffuse_transmission == 0.9f && m->diffuse_transmission_texture.uv_set == 1);
    assert_floats(m->diffuse_transmission_color, (const float[]){0.4f, 0.5f, 0.6f}, 3, 0);
    assert_true(m->diffuse_transmission_color_texture.texture == 0);
    assert_true(m->diffuse_roughness == 0.3f && m->diffuse_roughness_texture.uv_set == 1);
    /* The coat's normal map and the anisotropy need tangents. */
    assert_int_equal(r.scene.meshes[0].arrays, MESH_TANGENTS | MESH_UV0 | MESH_UV1);
    import_result_release(&r);
}

/* Each extension's defaults, and that its absence is the same as a factor of 0, whose textures
 * are not even looked at. */
static void test_extensions_off(void **state)
{
    static const char *const off[] = {
        "\"KHR_materials_clearcoat\":{\"clearcoatTexture\":{\"index\":7}}",
        "\"KHR_materials_sheen\":{\"sheenColorTexture\":{\"index\":7}}",
        "\"KHR_materials_iridescence\":{\"iridescenceTexture\":{\"index\":7}}",
        "\"KHR_materials_anisotropy\":{\"anisotropyTexture\":{\"index\":7}}",
        "\"KHR_materials_dispersion\":{}",
        "\"KHR_materials_diffuse_transmission\":{\"diffuseTransmissionTexture\":{\"index\":7}}",
        "\"KHR_materials_diffuse_roughness\":{\"diffuseRoughnessTexture\":{\"index\":7}}",
        "\"KHR_materials_transmission\":{\"transmissionTexture\":{\"index\":7}}",
        "\"KHR_materials_specular\":{}",
        "\"KHR_materials_ior\":{}",
        "\"KHR_materials_volume\":{}",
    };
    struct import_result plain;

    (void)state;
    import_material("", &plain);
    for (size_t i = 0; i < sizeof off / sizeof *off; i++) {
        struct import_result r;
        char json[256];
        snprintf(json, sizeof json, "\"extensions\":{%s}", off[i]);
        import_material(json, &r);
        assert_true(digest_equal(&r.scene_digest, &plain.scene_digest));
        assert_int_equal(r.scene.meshes[0].arrays, 0);
        import_result_release(&r);
    }
    import_result_release(&plain);
    import_material("\"extensions\":{\"KHR_materials_iridescence\":{\"iridescenceFactor\":1},"
                    "\"KHR_materials_anisotropy\":{\"anisotropyStrength\":2}}",
                    &plain);
    assert_true(plain.scene.materials[0].iridescence_ior == 1.3f &&
                plain.scene.materials[0].iridescence_thickness_min_nm == 100 &&
                plain.scene.materials[0].iridescence_thickness_max_nm == 400);
    assert_true(plain.scene.materials[0].anisotropy == 1);
    assert_warned(&plain, "anisotropyStrength is 2, taken as 1");
    assert_warned(&plain, "anisotropy but no texture coordinates");
    import_result_release(&plain);
}

static void test_specular_glossiness(void **state)
{
    const struct scene_material *m;
    struct import_result r;
    struct image8 image;
    const struct import_blob *blob = NULL;
    struct error err;

    (void)state;
    import_textured("\"pbrMetallicRoughness\":{\"baseColorFactor\":[1,0,0,1]},\"extensions\":{"
                    "\"KHR_materials_pbrSpecularGlossiness\":{\"diffuseFactor\":[0.1,0.2,0.3,0.4],"
                    "\"specularFactor\":[0.04,0.5,1],\"glossinessFactor\":0.75," TEXTURE("diffuseTexture", 1) "}}",
                    &r);
    m = &r.scene.materials[0];
    assert_floats(m->base_color, (const float[]){0.1f, 0.2f, 0.3f, 0.4f}, 4, 0);
    assert_true(m->metallic == 0 && m->roughness == 0.25f && m->ior == 1.5f);
    /* F0 = 0.04 specular_color */
    assert_floats(m->specular_color, (const float[]){1, 12.5f, 25}, 3, 1e-5f);
    assert_true(m->base_color_texture.texture == 0 && m->base_color_texture.uv_set == 1);
    assert_warned(&r, "archived");
    import_result_release(&r);

    import_textured("\"extensions\":{\"KHR_materials_pbrSpecularGlossiness\":{"
                    "\"glossinessFactor\":0.5," TEXTURE("specularGlossinessTexture", 1) "}}",
                    &r);
    m = &r.scene.materials[0];
    assert_int_equal(m->specular_color_texture.texture, 0);
    assert_int_equal(m->metallic_roughness_texture.texture, 1);
    assert_int_equal(m->metallic_roughness_texture.uv_set, 1);
    assert_true(m->roughness == 1 && m->metallic == 0);
    for (size_t i = 0; i < r.blob_count; i++)
        if (digest_equal(&r.blobs[i].digest, &r.scene.images[r.scene.textures[1].image].blob.digest))
            blob = &r.blobs[i];
    assert_non_null(blob);
    assert_int_equal(image_decode_8(&image, blob->data, blob->size_bytes, "made", &err), STATUS_OK);
    /* 1 - 0.5 * alpha, of alphas 64/255 and 192/255 */
    assert_int_equal(image.width, 2);
    assert_int_equal(image.channels, 1);
    assert_int_equal(image.pixels[0], 223);
    assert_int_equal(image.pixels[1], 159);
    image8_release(&image);
    import_result_release(&r);
}

static void test_variants(void **state)
{
    static const char rest[] = ONE_NODE ",\"extensions\":{\"KHR_materials_variants\":{\"variants\":[{\"name\":\"red\"},"
                                        "{\"name\":\"blue\"},{\"name\":\"0\"}]}},"
                                        "\"extensionsRequired\":[\"KHR_materials_variants\"],"
                                        "\"materials\":[{\"name\":\"A\"},{\"name\":\"B\"},{\"name\":\"C\"}],"
                                        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"material\":0,"
                                        "\"extensions\":{\"KHR_materials_variants\":{\"mappings\":[{\"material\":1,"
                                        "\"variants\":[2]},{\"material\":2,\"variants\":[0]}]}}}]}]";
    static const struct {
        const char *wanted, *material;
        int taken;
    } cases[] = {{NULL, "A", -1}, {"red", "C", 0},  {"blue", "A", 1},
                 {"1", "A", 1},   {"2", "B", 2}, {"0", "B", 2 /* the name counts first */}};
    struct import_options options = IMPORT_OPTIONS_DEFAULT;
    struct maker m = triangle_maker();
    struct buffer file = BUFFER_INIT;
    struct import_result r;
    struct error err = {0};

    (void)state;
    maker_write(&m, rest, &file);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        options.variant = cases[i].wanted;
        import_ok_with(file.data, file.size, "a.gltf", &options, &r);
        assert_int_equal(r.scene.material_count, 1);
        assert_string_equal(r.scene.materials[0].name, cases[i].material);
        assert_int_equal(r.variant_count, 3);
        assert_string_equal(r.variants[1], "blue");
        assert_int_equal(r.variant_taken, cases[i].taken);
        import_result_release(&r);
    }
    for (const char *const *wanted = (const char *const[]){"green", "3", "", "1x", "-1", NULL}; *wanted; wanted++) {
        options.variant = *wanted;
        assert_int_equal(import_scene_memory(file.data, file.size, "a.gltf", NULL, &options, &r, &err),
                         STATUS_ERR_INPUT);
        assert_says(&err, "a.gltf: there is no material variant|has 3");
    }
    buffer_release(&file);
    maker_release(&m);
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
                          "\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0,\"texCoord\":0,"
                          "\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0.5,0.25],"
                          "\"scale\":[2,3],"
                          "\"rotation\":0.5,\"texCoord\":1}}}}}],"
                          "\"samplers\":[{\"wrapS\":33071,\"wrapT\":33648,\"magFilter\":9728}],"
                          "\"textures\":[{\"source\":0,\"sampler\":0}],"
                          "\"images\":[{\"name\":\"dot\",\"mimeType\":\"image/png\","
                          "\"uri\":\"data:image/png;base64," TWO_PIXELS "\"}]",
                 &r);
    det_sincos(0.5f, &s, &c);
    slot = &r.scene.materials[0].base_color_texture;
    assert_int_equal(slot->uv_set, 1);
    assert_floats(&slot->uv_transform[0][0], (const float[]){2 * c, 3 * s, 0.5f, -2 * s, 3 * c, 0.25f}, 6, 1e-6f);
    assert_int_equal(r.scene.textures[0].wrap_u, WRAP_CLAMP);
    assert_int_equal(r.scene.textures[0].wrap_v, WRAP_MIRROR);
    assert_int_equal(r.scene.textures[0].nearest, 1);
    assert_string_equal(r.scene.images[0].name, "dot");
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
        {"\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:;base64,@@\"}]", "images[0]|base64"},
        {"\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:nothing\"}]", "images[0]|comma"},
        {"\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:;base64,AAAAA\"}]", "images[0]|cut short"},
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

/* A texture of one color is a color, and its file does not travel. */
static void test_constant_texture(void **state)
{
    struct maker m = triangle_maker();
    struct import_result r;

    (void)state;
    maker_import(&m,
                 ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                          "\"material\":0}]}],\"materials\":[{\"pbrMetallicRoughness\":{"
                          "\"baseColorFactor\":[0.5,0.25,1,1],\"baseColorTexture\":{\"index\":0}"
                          "}}],\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"data:image/"
                          "png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR42mP4"
                          "z8AAAAMBAQD3A0FDAAAAAElFTkSuQmCC\"}]",
                 &r);
    assert_int_equal(r.scene.materials[0].base_color_texture.texture, -1);
    assert_floats(r.scene.materials[0].base_color, (const float[]){0.5f, 0, 0}, 3, 0); /* red */
    assert_int_equal(r.scene.image_count, 0);
    assert_int_equal(r.blob_count, 1);
    assert_int_equal(r.simplified.folded, 1);
    import_result_release(&r);
}

/* The source in EXT_texture_webp counts, the one beside it is for those who cannot read WebP. */
static void test_webp(void **state)
{
    static const char webp[] = "UklGRj4AAABXRUJQVlA4TDEAAAAvDAACAM1UIKL/sYmI/gfIhCFOBUz/wn4yaZvUv+JdI5O2Sa/5V7zIbAB2AtAcQLkBAA==";
    struct maker m = triangle_maker();
    struct import_result r;
    char rest[1024];

    (void)state;
    snprintf(rest, sizeof rest,
             ONE_NODE ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},"
                      "\"material\":0}]}],\"materials\":[{\"pbrMetallicRoughness\":{"
                      "\"baseColorTexture\":{\"index\":0}}}],\"textures\":[{\"source\":0,"
                      "\"extensions\":{\"EXT_texture_webp\":{\"source\":1}}}],"
                      "\"extensionsRequired\":[\"EXT_texture_webp\"],"
                      "\"images\":[{\"uri\":\"absent.png\"},{\"name\":\"w\",\"uri\":"
                      "\"data:image/webp;base64,%s\"}]",
             webp);
    maker_import(&m, rest, &r);
    assert_int_equal(r.scene.image_count, 1);
    assert_string_equal(r.scene.images[0].name, "w");
    assert_int_equal(r.scene.materials[0].base_color_texture.texture, 0);
    import_result_release(&r);
}

static void test_texture_warnings(void **state)
{
    static const struct {
        const char *material, *textures, *words;
    } cases[] = {
        {"\"baseColorTexture\":{\"index\":0,\"texCoord\":2}", "{\"source\":0}", "coordinate set 2"},
        {"\"baseColorTexture\":{\"index\":0}", "{\"extensions\":{\"KHR_texture_basisu\":{\"source\":0}}}", "left out"},
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
        cmocka_unit_test(test_extensions),
        cmocka_unit_test(test_extensions_off),
        cmocka_unit_test(test_specular_glossiness),
        cmocka_unit_test(test_variants),
        cmocka_unit_test(test_texture_transform),
        cmocka_unit_test(test_texture_faults),
        cmocka_unit_test(test_texture_warnings),
        cmocka_unit_test(test_webp),
        cmocka_unit_test(test_constant_texture),
    };

    return cmocka_run_group_tests_name("glTF materials", tests, NULL, NULL);
}
