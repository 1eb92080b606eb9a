/* Who is charged: scopes, the lobe that scatters, the kind of light that is chosen. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/charge.h"
#include "worker/render/light/emitters.h"
#include "worker/render/world.h"

static int nested(int leave_early)
{
    CHARGE_SCOPE(CLEARCOAT);
    {
        CHARGE_SCOPE(TEXTURE);
        if (leave_early)
            return charge_get();
    }
    return charge_get();
}

static void test_scopes(void **state)
{
    (void)state;
    charge_set(CHARGE_NOBODY);
    assert_int_equal(nested(1), CHARGE_OF(TEXTURE));
    assert_int_equal(charge_get(), CHARGE_NOBODY);
    CHARGE(DIFFUSE);
    assert_int_equal(nested(0), CHARGE_OF(CLEARCOAT));
    assert_int_equal(charge_get(), CHARGE_OF(DIFFUSE));
    for (int i = 0; i < 3; i++) {
        CHARGE_SCOPE_OF(i == 1 ? CHARGE_OF(FOG) : CHARGE_OF(MEDIUM));
        assert_int_equal(charge_get(), i == 1 ? CHARGE_OF(FOG) : CHARGE_OF(MEDIUM));
        if (i == 0)
            continue;
        if (i == 1)
            break;
    }
    assert_int_equal(charge_get(), CHARGE_OF(DIFFUSE));
    charge_set(CHARGE_NOBODY);
}

/* Whoever is charged for preparing, and for each of the lobes by which it may scatter. */
static void assert_charged(const char *what, const struct bsdf_params *params, uint8_t prepares,
                           uint64_t lobes)
{
    const struct vec3 wo = {0.6f, 0, 0.8f};
    struct bsdf_sample sample;
    uint64_t met = 0;
    struct bsdf b;
    float pdf;

    CHARGE(FOG); /* whoever sent the ray */
    bsdf_init(&b, params, wo);
    if (charge_get() != prepares)
        fail_msg("%s: preparing is charged to %u, not to %u", what, charge_get(), prepares);
    CHARGE(FOG);
    bsdf_eval_pdf(&b, wo, (struct vec3){0.48f, 0.36f, 0.8f}, &pdf);
    bsdf_eval_pdf(&b, wo, (struct vec3){0.48f, 0.36f, -0.8f}, &pdf);
    assert_int_equal(charge_get(), CHARGE_OF(FOG)); /* as it was */
    for (int i = 0; i < 64; i++) {
        charge_set(prepares);
        if (bsdf_sample(&b, wo, ((float)i + 0.5f) / 64, 0.37f, 0.61f, &sample))
            met |= (uint64_t)1 << (charge_get() - 1);
    }
    if (met != lobes)
        fail_msg("%s: %llx are charged for scattering, not %llx", what, (unsigned long long)met,
                 (unsigned long long)lobes);
}

static struct bsdf_params grey(void)
{
    return (struct bsdf_params){.base_color = {0.5f, 0.5f, 0.5f}, .alpha = 0.3f, .ior = 1.5f,
                                .specular_color = {1, 1, 1}};
}

static void test_scattering(void **state)
{
    struct bsdf_params p = grey();

    (void)state;
    assert_charged("lambert", &p, CHARGE_OF(DIFFUSE), EFFECT_DIFFUSE);
    p.diffuse_roughness = 1;
    assert_charged("rough", &p, CHARGE_OF(DIFFUSE), EFFECT_DIFFUSE);
    p.diffuse_roughness = 0;
    p.base_color = (struct vec3){0, 0, 0};
    assert_charged("black", &p, CHARGE_OF(FOG), 0);
    p = grey();
    p.specular = 1;
    assert_charged("plastic", &p, CHARGE_OF(GLOSSY), EFFECT_GLOSSY | EFFECT_DIFFUSE);
    p.alpha = 0;
    assert_charged("polished", &p, CHARGE_OF(MIRROR), EFFECT_MIRROR | EFFECT_DIFFUSE);
    p.metallic = 1;
    assert_charged("mirror", &p, CHARGE_OF(MIRROR), EFFECT_MIRROR);
    p.alpha = 0.3f;
    assert_charged("metal", &p, CHARGE_OF(GLOSSY), EFFECT_GLOSSY | EFFECT_MULTIPLE_SCATTERING);
    p.single_scattering = 1;
    assert_charged("simple metal", &p, CHARGE_OF(GLOSSY), EFFECT_GLOSSY);
    p = grey();
    p.transmission = p.specular = 1;
    assert_charged("thin", &p, CHARGE_OF(THIN_TRANSMISSION),
                   EFFECT_THIN_TRANSMISSION | EFFECT_GLOSSY | EFFECT_MULTIPLE_SCATTERING);
    p.refractive = 1;
    p.single_scattering = 1;
    assert_charged("frosted", &p, CHARGE_OF(ROUGH_DIELECTRIC), EFFECT_ROUGH_DIELECTRIC);
    p.alpha = 0;
    assert_charged("glass", &p, CHARGE_OF(DIELECTRIC), EFFECT_DIELECTRIC);
}

static void test_layers(void **state)
{
    struct bsdf_params p = grey();

    (void)state;
    p.sheen_color = (struct vec3){0.5f, 0.5f, 0.5f};
    p.sheen_alpha = 0.3f;
    p.single_scattering = 1;
    assert_charged("cloth", &p, CHARGE_OF(DIFFUSE), EFFECT_DIFFUSE | EFFECT_SHEEN);
    p = grey();
    p.clearcoat = 1;
    p.clearcoat_ior = 1.5f;
    p.clearcoat_normal = (struct vec3){0, 0, 1};
    p.single_scattering = 1;
    assert_charged("varnish", &p, CHARGE_OF(DIFFUSE), EFFECT_DIFFUSE | EFFECT_CLEARCOAT);
    p = grey();
    p.diffuse_transmission = 0.5f;
    p.diffuse_transmission_color = (struct vec3){0.5f, 0.5f, 0.5f};
    p.single_scattering = 1;
    assert_charged("leaf", &p, CHARGE_OF(DIFFUSE), EFFECT_DIFFUSE | EFFECT_DIFFUSE_TRANSMISSION);
    p = grey();
    p.conductor = 1;
    p.eta = (struct vec3){0.2f, 0.9f, 1.1f};
    p.k = (struct vec3){3.9f, 2.4f, 2.2f};
    p.single_scattering = 1;
    assert_charged("copper", &p, CHARGE_OF(GLOSSY), EFFECT_GLOSSY);
}

/* The accounts to which samples of the scene's lights are charged, as a set of effects. */
static uint64_t charged_lights(struct scene_builder *b, const struct render_settings *settings)
{
    const struct light_context context = {{0, 0, 0}, {0, 1, 0}, 0};
    struct render_scene *scene = builder_build(b, settings);
    uint64_t met = 0;

    for (int i = 0; i < 256; i++) {
        struct light_sample light;
        uint8_t point = CHARGE_OF(PUNCTUAL_LIGHT);

        charge_set(CHARGE_NOBODY);
        if (!emitters_sample(scene, &context, ((float)i + 0.5f) / 256,
                             ((float)(i * 37 % 256) + 0.5f) / 256, &light))
            continue;
        if (light.delta && light.direction.x < 0 && !(settings->without & EFFECT_LIGHT_IMAGE))
            point = CHARGE_OF(LIGHT_IMAGE);
        assert_int_equal(charge_get(), light.delta ? point
                                       : light.distance < INFINITY ? CHARGE_OF(EMISSIVE_MESH)
                                                                   : CHARGE_OF(ENVIRONMENT));
        met |= (uint64_t)1 << (charge_get() - 1);
    }
    charge_set(CHARGE_NOBODY);
    render_scene_free(scene);
    return met;
}

/* A floor under a lamp, a point, a point with an image on the left, and a sky: each light sample is
 * charged to its own kind. */
static void test_lights(void **state)
{
    const uint64_t plain = EFFECT_PUNCTUAL_LIGHT | EFFECT_EMISSIVE_MESH | EFFECT_ENVIRONMENT;
    static const float white[3] = {1, 1, 1};
    struct render_settings settings = builder_settings(8, 8, 4);
    struct scene_material *m;
    struct scene_builder b;
    uint32_t quad;

    (void)state;
    builder_init(&b);
    quad = builder_quad(&b);
    builder_lambert(&b, 0.6f);
    builder_place(&b, quad, builder_last_material(&b), vec3_splat(4), vec3_make(0, 0, 0));
    m = builder_lambert(&b, 0);
    m->emission[0] = m->emission[1] = m->emission[2] = 5;
    builder_place(&b, quad, builder_last_material(&b), vec3_make(1, -1, 1), vec3_make(1, 3, 0));
    for (int left = 0; left < 2; left++) {
        struct scene_light *light = builder_light(&b, left ? LIGHT_GONIOMETRIC : LIGHT_POINT);

        light->intensity[0] = light->intensity[1] = light->intensity[2] = 10;
        light->position[0] = -left;
        light->position[1] = 2;
        if (left)
            light->image = (int32_t)b.scene.textures[builder_texture(&b, white, 1, 1)].image;
    }
    builder_camera(&b, vec3_make(0, 1, 5), vec3_splat(0), 0.7f);
    builder_environment_constant(&b, vec3_make(0.2f, 0.3f, 0.4f));
    assert_int_equal(charged_lights(&b, &settings), plain | EFFECT_LIGHT_IMAGE);
    settings.without = EFFECT_LIGHT_IMAGE;
    assert_int_equal(charged_lights(&b, &settings), plain);
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scopes),
        cmocka_unit_test(test_scattering),
        cmocka_unit_test(test_layers),
        cmocka_unit_test(test_lights),
    };

    return cmocka_run_group_tests_name("charge", tests, NULL, NULL);
}
