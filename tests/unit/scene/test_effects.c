/* What a scene calls for: each effect appears when something reachable causes it, and not
 * otherwise. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "common/scene/effects_material.h"
#include "common/scene/scene_effects.h"
#include "common/scene/settings.h"
#include "tests/support/scene_sample.h"

/* One box, one material, one camera in front of it; no light. */
struct plain {
    struct scene scene;
    struct scene_mesh mesh[2];
    struct scene_material material;
    struct scene_instance instance[2];
    struct scene_light light;
    struct scene_camera camera[2];
};

static void plain_init(struct plain *p)
{
    memset(p, 0, sizeof *p);
    scene_init(&p->scene);
    p->mesh[0] = (struct scene_mesh){.name = "",
                                     .vertex_count = 24,
                                     .triangle_count = 12,
                                     .bounds_min = {-1, -1, -1},
                                     .bounds_max = {1, 1, 1},
                                     .closed = 1};
    p->mesh[1] = p->mesh[0];
    scene_material_default(&p->material);
    p->material.metallic = 0;
    scene_instance_default(&p->instance[0]);
    p->instance[1] = p->instance[0];
    scene_light_default(&p->light);
    scene_camera_default(&p->camera[0]);
    p->camera[0].yfov_rad = 1;
    p->camera[0].to_world.m[2][3] = 5;
    p->camera[1] = p->camera[0];
    p->camera[1].kind = CAMERA_ORTHOGRAPHIC;
    p->camera[1].xmag = p->camera[1].ymag = 1;
    p->scene.meshes = p->mesh;
    p->scene.mesh_count = 2;
    p->scene.materials = &p->material;
    p->scene.material_count = 1;
    p->scene.instances = p->instance;
    p->scene.instance_count = 1;
    p->scene.lights = &p->light;
    p->scene.light_count = 1;
    p->scene.cameras = p->camera;
    p->scene.camera_count = 2;
}

#define plain_set (EFFECT_DIFFUSE | EFFECT_GLOSSY)

static void assert_set(const struct plain *p, uint64_t wanted)
{
    /* What follows from the rest is test_consequences' business. */
    uint64_t got = scene_effects_default(&p->scene, 0) &
                   ~(EFFECT_MULTIPLE_SCATTERING | EFFECT_CAUSTICS | EFFECT_NESTED_DIELECTRIC);

    for (int i = 0; i < EFFECT_COUNT; i++)
        if ((got ^ wanted) >> i & 1)
            print_error("%s is %s\n", effect_name((enum effect_bit)i),
                        got >> i & 1 ? "there, but should not be" : "missing");
    assert_int_equal(got, wanted);
}

/* With these statements done to the plain scene, the set is exactly this. */
#define EXPECT(set, ...)       \
    do {                       \
        struct plain p;        \
        plain_init(&p);        \
        __VA_ARGS__;           \
        assert_set(&p, (set)); \
    } while (0)

static void test_lobes(void **state)
{
    (void)state;
    EXPECT(plain_set, (void)0);
    EXPECT(EFFECT_DIFFUSE, p.material.specular = 0);
    EXPECT(EFFECT_DIFFUSE | EFFECT_ROUGH_DIFFUSE, p.material.specular = 0; p.material.diffuse_roughness = 0.5f);
    EXPECT(EFFECT_GLOSSY, memset(p.material.base_color, 0, 3 * sizeof(float)); p.material.diffuse_roughness = 0.5f);
    EXPECT(EFFECT_GLOSSY, p.material.metallic = 1; p.material.diffuse_roughness = 0.5f);
    EXPECT(EFFECT_GLOSSY, p.material.metallic = 1);
    EXPECT(plain_set, p.material.metallic = 0.5f);
    EXPECT(EFFECT_MIRROR, p.material.metallic = 1; p.material.roughness = 0);
    EXPECT(EFFECT_DIFFUSE | EFFECT_MIRROR, p.material.roughness = 0.03f);
    EXPECT(EFFECT_GLOSSY, memset(p.material.base_color, 0, 3 * sizeof(float)));
    /* A texture lowers its factor: metal with a metallic texture may be partly none. */
    EXPECT(plain_set | EFFECT_MIRROR | EFFECT_TEXTURE, p.material.metallic = 1;
           p.material.metallic_roughness_texture.texture = 0);
    /* ... but a factor of 0 stays 0. */
    EXPECT(EFFECT_DIFFUSE | EFFECT_MIRROR, p.material.roughness = 0; p.material.metallic_roughness_texture.texture = 0);
}

static void test_mirror_threshold(void **state)
{
    float below = nextafterf(EFFECT_MIRROR_ROUGHNESS, 0);

    (void)state;
    /* The renderer squares the roughness and compares with 1e-3: so must the macro. */
    assert_true(below * below < 1e-3f);
    assert_false(EFFECT_MIRROR_ROUGHNESS * EFFECT_MIRROR_ROUGHNESS < 1e-3f);
    EXPECT(EFFECT_DIFFUSE | EFFECT_MIRROR, p.material.roughness = below);
    EXPECT(plain_set, p.material.roughness = EFFECT_MIRROR_ROUGHNESS);
}

/* A texture of roughness makes a mirror somewhere, unless its least value is known to be rough. */
static void test_least_roughness(void **state)
{
    const uint64_t coated = plain_set | EFFECT_CLEARCOAT | EFFECT_TEXTURE;

    (void)state;
    EXPECT(plain_set | EFFECT_TEXTURE | EFFECT_MIRROR, p.material.metallic_roughness_texture.texture = 0);
    EXPECT(plain_set | EFFECT_TEXTURE, p.material.metallic_roughness_texture.texture = 0;
           p.material.least_roughness = 0.04f);
    EXPECT(plain_set | EFFECT_TEXTURE | EFFECT_MIRROR, p.material.metallic_roughness_texture.texture = 0;
           p.material.least_roughness = EFFECT_MIRROR_ROUGHNESS); /* filtering rounds */
    EXPECT(coated | EFFECT_MIRROR, p.material.clearcoat = 1; p.material.clearcoat_roughness = 0.5f;
           p.material.clearcoat_roughness_texture.texture = 0);
    EXPECT(coated, p.material.clearcoat = 1; p.material.clearcoat_roughness = 0.5f;
           p.material.clearcoat_roughness_texture.texture = 0; p.material.clearcoat_least_roughness = 0.04f);
}

static void test_transmission(void **state)
{
    /* What transmits has no closed, opaque surface: single-sided ones are culled. */
    const uint64_t thin = EFFECT_GLOSSY | EFFECT_THIN_TRANSMISSION | EFFECT_CULLING;
    const uint64_t glass = EFFECT_MIRROR | EFFECT_DIELECTRIC;

    (void)state;
    EXPECT(thin, p.material.transmission = 1);
    EXPECT(thin | EFFECT_DIFFUSE, p.material.transmission = 0.5f);
    EXPECT(thin | EFFECT_DIFFUSE | EFFECT_TEXTURE, p.material.transmission = 1;
           p.material.transmission_texture.texture = 0);
    EXPECT(EFFECT_GLOSSY, p.material.transmission = 1; p.material.metallic = 1);
    EXPECT(glass, p.material.transmission = 1; p.material.refractive = 1; p.material.roughness = 0);
    EXPECT(glass, p.material.transmission = 1; p.material.refractive = 1; p.material.roughness = 0;
           p.material.specular = 0);
    EXPECT(EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC, p.material.transmission = 1; p.material.refractive = 1);
    EXPECT(EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC | EFFECT_DIELECTRIC, p.material.transmission = 1;
           p.material.refractive = 1; p.material.ior = 1);
    /* Absorption needs a distance and a colour, and something that lets light in. */
    EXPECT(glass, p.material.transmission = 1; p.material.refractive = 1;
           p.material.roughness = 0; p.material.attenuation_distance = 1);
    EXPECT(glass, p.material.transmission = 1; p.material.refractive = 1;
           p.material.roughness = 0; p.material.attenuation_color[1] = 0.5f);
    EXPECT(glass | EFFECT_ABSORPTION, p.material.transmission = 1; p.material.refractive = 1;
           p.material.roughness = 0; p.material.attenuation_color[1] = 0.5f;
           p.material.attenuation_distance = 1);
    EXPECT(plain_set, p.material.refractive = 1; p.material.attenuation_color[1] = 0.5f;
           p.material.attenuation_distance = 1);
}

static void test_textures(void **state)
{
    const uint64_t textured = plain_set | EFFECT_TEXTURE;

    (void)state;
    EXPECT(textured, p.material.base_color_texture.texture = 0);
    EXPECT(EFFECT_GLOSSY, p.material.base_color_texture.texture = 0;
           memset(p.material.base_color, 0, 3 * sizeof(float)));
    EXPECT(textured, p.material.specular_texture.texture = 0);
    EXPECT(EFFECT_DIFFUSE, p.material.specular_texture.texture = 0; p.material.specular = 0);
    EXPECT(textured, p.material.specular_color_texture.texture = 0);
    EXPECT(plain_set, p.material.diffuse_roughness_texture.texture = 0);
    EXPECT(textured | EFFECT_ROUGH_DIFFUSE, p.material.diffuse_roughness_texture.texture = 0;
           p.material.diffuse_roughness = 0.5f);
    EXPECT(plain_set | EFFECT_ROUGH_DIFFUSE, p.material.diffuse_roughness_texture.texture = 0;
           p.material.diffuse_roughness = 0.5f; scene_material_reduce(&p.material, EFFECT_TEXTURE));
    EXPECT(plain_set, p.material.transmission_texture.texture = 0);
    EXPECT(plain_set, p.material.emission_texture.texture = 0);
    EXPECT(textured | EFFECT_EMISSIVE_MESH, p.material.emission_texture.texture = 0; p.material.emission[2] = 1);
    EXPECT(plain_set, p.material.normal_texture.texture = 0);
    EXPECT(plain_set, p.material.normal_texture.texture = 0; p.mesh[0].arrays = MESH_TANGENTS;
           p.material.normal_scale = 0);
    EXPECT(textured | EFFECT_NORMAL_MAP, p.material.normal_texture.texture = 0; p.mesh[0].arrays = MESH_TANGENTS);
    EXPECT(plain_set | EFFECT_VERTEX_COLOR, p.mesh[0].arrays = MESH_COLORS);
}

static void test_alpha(void **state)
{
    const uint32_t seen_through = plain_set | EFFECT_ALPHA | EFFECT_CULLING;

    (void)state;
    EXPECT(plain_set, p.material.base_color[3] = 0.5f);
    EXPECT(plain_set, p.material.alpha_mode = ALPHA_BLEND);
    EXPECT(seen_through, p.material.alpha_mode = ALPHA_BLEND; p.material.base_color[3] = 0.5f);
    EXPECT(seen_through & ~EFFECT_CULLING, p.material.alpha_mode = ALPHA_BLEND; p.material.base_color[3] = 0.5f;
           p.material.double_sided = 1);
    EXPECT(seen_through | EFFECT_TEXTURE, p.material.alpha_mode = ALPHA_BLEND;
           p.material.base_color_texture.texture = 0);
    EXPECT(seen_through | EFFECT_VERTEX_COLOR, p.material.alpha_mode = ALPHA_BLEND; p.mesh[0].arrays = MESH_COLORS);
    EXPECT(plain_set, p.material.alpha_mode = ALPHA_MASK);
    EXPECT(plain_set | EFFECT_TEXTURE, p.material.alpha_mode = ALPHA_MASK; p.material.alpha_cutoff = 0;
           p.material.base_color_texture.texture = 0);
    EXPECT(seen_through | EFFECT_TEXTURE, p.material.alpha_mode = ALPHA_MASK;
           p.material.base_color_texture.texture = 0);
    /* What is nowhere visible calls for nothing else. */
    EXPECT(EFFECT_ALPHA, p.material.alpha_mode = ALPHA_BLEND; p.material.base_color[3] = 0; p.material.emission[0] = 9);
    EXPECT(EFFECT_ALPHA, p.material.alpha_mode = ALPHA_MASK; p.material.base_color[3] = 0.25f);
}

static void test_culling(void **state)
{
    (void)state;
    EXPECT(plain_set | EFFECT_CULLING, p.mesh[0].closed = 0);
    EXPECT(plain_set, p.mesh[0].closed = 0; p.material.double_sided = 1);
    /* From inside a closed mesh its back faces are seen. */
    EXPECT(plain_set | EFFECT_CULLING, p.camera[0].to_world.m[2][3] = 0.5f);
    EXPECT(plain_set, p.camera[0].to_world.m[2][3] = 0.5f; p.instance[0].to_world.m[1][3] = 9);
    /* An orthographic camera's rays start on a plane without known borders. */
    EXPECT(plain_set | EFFECT_CULLING | EFFECT_ORTHOGRAPHIC, p.camera[0] = p.camera[1]);
    /* A refracting volume has two sides by definition. */
    EXPECT(EFFECT_GLOSSY | EFFECT_ROUGH_DIELECTRIC, p.mesh[0].closed = 0; p.material.transmission = 1;
           p.material.refractive = 1);
}

static void test_light(void **state)
{
    (void)state;
    EXPECT(plain_set | EFFECT_PUNCTUAL_LIGHT, p.light.intensity[1] = 1);
    EXPECT(plain_set | EFFECT_EMISSIVE_MESH, p.material.emission[0] = 1);
    EXPECT(plain_set | EFFECT_ENVIRONMENT, p.scene.environment.present = 1);
    EXPECT(plain_set, p.scene.environment.present = p.scene.environment.constant = 1;
           memset(p.scene.environment.radiance, 0, sizeof p.scene.environment.radiance));
    EXPECT(plain_set | EFFECT_ENVIRONMENT, p.scene.environment.present = p.scene.environment.constant = 1;
           p.scene.environment.radiance[0] = 1);
    EXPECT(EFFECT_UNLIT, p.material.unlit = 1; p.material.emission[0] = 1; p.material.transmission = 1);
    EXPECT(EFFECT_UNLIT | EFFECT_TEXTURE, p.material.unlit = 1; p.material.base_color_texture.texture = 0);
}

static void test_reachable(void **state)
{
    (void)state;
    /* A material that no instance uses does not count. */
    EXPECT(0, p.scene.instance_count = 0; p.material.emission[0] = 1);
    EXPECT(plain_set | EFFECT_INSTANCING, p.scene.instance_count = 2);
    EXPECT(plain_set, p.scene.instance_count = 2; p.instance[1].mesh = 1);
    EXPECT(plain_set | EFFECT_INSTANCING, p.scene.instance_count = 2; p.scene.mesh_count = 1);
    /* The next instance may have the same material on another mesh, or another on the same. */
    EXPECT(plain_set | EFFECT_VERTEX_COLOR, p.scene.instance_count = 2; p.instance[1].mesh = 1;
           p.mesh[1].arrays = MESH_COLORS);
    {
        struct scene_material two[2];
        struct plain p;
        plain_init(&p);
        two[0] = two[1] = p.material;
        two[1].metallic = 1;
        two[1].roughness = 0;
        p.scene.materials = two;
        p.scene.material_count = p.scene.instance_count = 2;
        p.instance[1].material = 1;
        assert_set(&p, plain_set | EFFECT_MIRROR | EFFECT_INSTANCING);
    }
    {
        struct plain p;
        plain_init(&p);
        assert_int_equal(scene_effects_default(&p.scene, 1) & ~EFFECT_MULTIPLE_SCATTERING,
                         plain_set | EFFECT_ORTHOGRAPHIC | EFFECT_CULLING);
    }
}

static void test_layers(void **state)
{
    (void)state;
    EXPECT(plain_set | EFFECT_CLEARCOAT | EFFECT_MIRROR, p.material.clearcoat = 1);
    EXPECT(plain_set | EFFECT_CLEARCOAT, p.material.clearcoat = 1; p.material.clearcoat_roughness = 0.5f);
    EXPECT(plain_set, p.material.clearcoat_roughness = 0.5f);
    EXPECT(plain_set | EFFECT_SHEEN, p.material.sheen_color[2] = 0.1f);
    EXPECT(plain_set | EFFECT_IRIDESCENCE, p.material.iridescence = 0.5f);
    EXPECT(plain_set, p.material.iridescence_texture.texture = 0);
    EXPECT(EFFECT_GLOSSY | EFFECT_ANISOTROPY, p.material.metallic = 1; p.material.roughness = 0.5f;
           p.material.anisotropy = 1);
    EXPECT(EFFECT_GLOSSY, p.material.metallic = 1; p.material.roughness = 1;
           p.material.anisotropy = 1); /* nothing to stretch */
    /* Nor does a texture of what is not called for count. */
    EXPECT(EFFECT_GLOSSY, p.material.metallic = 1; p.material.roughness = 1; p.material.anisotropy = 1;
           p.material.anisotropy_texture.texture = 0);
    EXPECT(plain_set, p.material.diffuse_transmission = 1;
           memset(p.material.diffuse_transmission_color, 0, 3 * sizeof(float));
           p.material.diffuse_transmission_texture.texture = 0);
    EXPECT(EFFECT_MIRROR | EFFECT_GLOSSY | EFFECT_ANISOTROPY, p.material.metallic = 1; p.material.roughness = 0;
           p.material.anisotropy = 0.5f); /* rough along one axis */
    EXPECT(plain_set | EFFECT_DIFFUSE_TRANSMISSION | EFFECT_CULLING, p.material.diffuse_transmission = 0.5f);
    EXPECT(EFFECT_CONDUCTOR | EFFECT_GLOSSY, p.material.kind = MATERIAL_CONDUCTOR);
    EXPECT(EFFECT_CONDUCTOR | EFFECT_MIRROR, p.material.kind = MATERIAL_CONDUCTOR; p.material.roughness = 0);
    EXPECT(EFFECT_MIRROR | EFFECT_DIELECTRIC | EFFECT_DISPERSION, p.material.transmission = 1;
           p.material.refractive = 1; p.material.roughness = 0; p.material.dispersion = 1);
    EXPECT(EFFECT_INTERFACE, p.material.kind = MATERIAL_INTERFACE);
}

static void test_lens(void **state)
{
    (void)state;
    EXPECT(plain_set | EFFECT_DEPTH_OF_FIELD, p.camera[0].lens_radius = 0.1f);
    EXPECT(plain_set | EFFECT_PANORAMA, p.camera[0].kind = CAMERA_PANORAMA; p.camera[0].lens_radius = 0.1f);
}

static void test_media(void **state)
{
    static struct scene_medium medium = {.name = "haze", .scattering = {1, 1, 1}};
    static struct scene_medium clear = {.name = "none"};

    (void)state;
    EXPECT(plain_set | EFFECT_FOG | EFFECT_MEDIUM, p.scene.media = &medium; p.scene.medium_count = 1; p.scene.fog = 0);
    EXPECT(plain_set, p.scene.media = &clear; p.scene.medium_count = 1; p.scene.fog = 0);
    /* A medium in what lets no light in is not there. */
    EXPECT(plain_set, p.scene.media = &medium; p.scene.medium_count = 1; p.material.medium = 0);
    EXPECT(EFFECT_INTERFACE | EFFECT_MEDIUM, p.scene.media = &medium; p.scene.medium_count = 1; p.material.medium = 0;
           p.material.kind = MATERIAL_INTERFACE);
}

static void test_consequences(void **state)
{
    struct effect_cause causes[EFFECT_COUNT];
    struct render_settings settings;
    struct plain p;
    uint64_t set;

    (void)state;
    plain_init(&p);
    assert_true(scene_effects_default(&p.scene, 0) & EFFECT_MULTIPLE_SCATTERING);
    p.material.roughness = 0;
    p.scene.environment.present = 1;
    p.material.name = "lacquer";
    render_settings_default(&settings);
    set = scene_effects(&p.scene, &settings, 0, causes);
    assert_false(set & EFFECT_MULTIPLE_SCATTERING);
    assert_true(set & EFFECT_CAUSTICS);
    assert_string_equal(causes[EFFECT_BIT_MIRROR].kind, "material");
    assert_string_equal(causes[EFFECT_BIT_MIRROR].name, "lacquer");
    assert_int_equal(causes[EFFECT_BIT_MIRROR].count, 1);
    assert_null(causes[EFFECT_BIT_SHEEN].kind);
    p.material.transmission = p.material.refractive = 1;
    /* Volumes are counted, unless each boundary is to be as it is. */
    assert_true(scene_effects_default(&p.scene, 0) & EFFECT_NESTED_DIELECTRIC);
    p.scene.volume_rule = VOLUMES_BOUNDARIES;
    assert_false(scene_effects_default(&p.scene, 0) & EFFECT_NESTED_DIELECTRIC);
}

/* Every caller counts once, however many instances it has, and the next ones are named too. */
static void test_causes(void **state)
{
    enum { MATERIALS = EFFECT_CAUSES_ALSO + 3 };
    static const char *const labels[MATERIALS] = {"a", "b", "c", "d", "e", "f", "g", "h", "i", "j"};
    struct effect_cause causes[EFFECT_COUNT];
    struct scene_material materials[MATERIALS];
    struct scene_instance instances[3 * MATERIALS];
    const struct effect_cause *glossy = &causes[EFFECT_BIT_GLOSSY];
    struct render_settings settings;
    struct plain p;

    (void)state;
    plain_init(&p);
    render_settings_default(&settings);
    for (uint32_t i = 0; i < MATERIALS; i++) {
        materials[i] = p.material;
        materials[i].name = labels[i];
    }
    for (uint32_t i = 0; i < 3 * MATERIALS; i++) {
        instances[i] = p.instance[0];
        instances[i].material = i % MATERIALS;
    }
    p.scene.materials = materials;
    p.scene.material_count = MATERIALS;
    p.scene.instances = instances;
    p.scene.instance_count = 3 * MATERIALS;
    scene_effects(&p.scene, &settings, 0, causes);
    assert_int_equal(glossy->count, MATERIALS);
    assert_string_equal(glossy->name, "a");
    for (uint32_t i = 0; i < EFFECT_CAUSES_ALSO; i++) {
        assert_string_equal(glossy->also[i].kind, "material");
        assert_string_equal(glossy->also[i].name, labels[i + 1]);
        assert_int_equal(glossy->also[i].index, i + 1);
    }
    assert_int_equal(causes[EFFECT_BIT_INSTANCING].count, 1); /* of one mesh */
    assert_null(causes[EFFECT_BIT_INSTANCING].also[0].kind);
}

/* What is switched off is not in the set, nor what hangs on it. */
static void test_without(void **state)
{
    struct render_settings settings;
    struct plain p;

    (void)state;
    plain_init(&p);
    p.material.clearcoat = 1;
    p.material.clearcoat_texture.texture = 0;
    p.material.emission[0] = 1;
    render_settings_default(&settings);
    assert_true(scene_effects(&p.scene, &settings, 0, NULL) & EFFECT_TEXTURE);
    settings.without = EFFECT_CLEARCOAT | EFFECT_EMISSIVE_MESH;
    assert_int_equal(scene_effects(&p.scene, &settings, 0, NULL), plain_set | EFFECT_MULTIPLE_SCATTERING);
    for (int i = 0; i < EFFECT_COUNT; i++) {
        settings.without = (uint64_t)1 << i & EFFECTS_SWITCHABLE;
        assert_false(scene_effects(&p.scene, &settings, 0, NULL) & settings.without);
    }
}

static void test_parse(void **state)
{
    (void)state;
    assert_int_equal(effect_parse("normal-map"), EFFECT_BIT_NORMAL_MAP);
    assert_int_equal(effect_parse("normal map"), EFFECT_BIT_NORMAL_MAP);
    assert_int_equal(effect_parse("normal"), -1);
    assert_int_equal(effect_parse("normal-maps"), -1);
    assert_int_equal(effect_parse(""), -1);
}

static void test_names(void **state)
{
    (void)state;
    for (int i = 0; i < EFFECT_COUNT; i++)
        for (int j = 0; j < i; j++)
            assert_string_not_equal(effect_name((enum effect_bit)i), effect_name((enum effect_bit)j));
    assert_string_equal(effect_name(EFFECT_COUNT), "unknown");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lobes),      cmocka_unit_test(test_mirror_threshold), cmocka_unit_test(test_least_roughness),
        cmocka_unit_test(test_transmission), cmocka_unit_test(test_textures),
        cmocka_unit_test(test_alpha),      cmocka_unit_test(test_culling),
        cmocka_unit_test(test_light),      cmocka_unit_test(test_reachable),
        cmocka_unit_test(test_layers),
        cmocka_unit_test(test_lens),
        cmocka_unit_test(test_media),
        cmocka_unit_test(test_consequences),
        cmocka_unit_test(test_causes),
        cmocka_unit_test(test_without),
        cmocka_unit_test(test_parse),
        cmocka_unit_test(test_names),
    };

    return cmocka_run_group_tests_name("effects", tests, NULL, NULL);
}
