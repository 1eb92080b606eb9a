/* Who is charged: scopes, the lobe that scatters, the kind of light that is chosen. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/light/emitters.h"
#include "worker/render/render_scene.h"

static int nested(int leave_early)
{
    PROFILE_EFFECT(CLEARCOAT);
    {
        PROFILE_EFFECT(TEXTURE);
        if (leave_early)
            return profile_account_now();
    }
    return profile_account_now();
}

static void test_scopes(void **state)
{
    (void)state;
    profile_account(PROFILE_NO_EFFECT);
    assert_int_equal(nested(1), PROFILE_ACCOUNT(TEXTURE));
    assert_int_equal(profile_account_now(), PROFILE_NO_EFFECT);
    profile_account(PROFILE_ACCOUNT(DIFFUSE));
    assert_int_equal(nested(0), PROFILE_ACCOUNT(CLEARCOAT));
    assert_int_equal(profile_account_now(), PROFILE_ACCOUNT(DIFFUSE));
    for (int i = 0; i < 3; i++) {
        PROFILE_EFFECT_ACCOUNT(i == 1 ? PROFILE_ACCOUNT(FOG) : PROFILE_ACCOUNT(MEDIUM));
        assert_int_equal(profile_account_now(), i == 1 ? PROFILE_ACCOUNT(FOG) : PROFILE_ACCOUNT(MEDIUM));
        if (i == 0)
            continue;
        if (i == 1)
            break;
    }
    assert_int_equal(profile_account_now(), PROFILE_ACCOUNT(DIFFUSE));
    profile_account(PROFILE_NO_EFFECT);
}

/* The account of a surface's base, and those of the lobes by which it may scatter. */
static void assert_charged(const char *what, const struct bsdf_params *params, uint8_t base, uint64_t lobes)
{
    const struct vec3 wo = {0.6f, 0, 0.8f};
    struct bsdf_sample sample;
    uint64_t met = 0;
    struct bsdf b;
    float pdf;

    bsdf_init(&b, params, wo);
    if (b.account != base)
        fail_msg("%s: its base is charged to %u, not to %u", what, b.account, base);
    profile_account(PROFILE_ACCOUNT(FOG));
    bsdf_eval_pdf(&b, wo, (struct vec3){0.48f, 0.36f, 0.8f}, &pdf);
    bsdf_eval_pdf(&b, wo, (struct vec3){0.48f, 0.36f, -0.8f}, &pdf);
    assert_int_equal(profile_account_now(), PROFILE_NO_EFFECT); /* the stage is scattering, its lobes are done */
    assert_int_equal(WATCHED_GET(profile_place.stage), STAGE_SCATTER + 1);
    for (int i = 0; i < 64; i++) {
        profile_account(PROFILE_ACCOUNT(FOG));
        if (bsdf_sample(&b, wo, ((float)i + 0.5f) / 64, 0.37f, 0.61f, &sample))
            met |= (uint64_t)1 << (profile_account_now() - 1);
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
    assert_charged("lambert", &p, PROFILE_ACCOUNT(DIFFUSE), EFFECT_DIFFUSE);
    p.diffuse_roughness = 1;
    assert_charged("rough", &p, PROFILE_ACCOUNT(DIFFUSE), EFFECT_DIFFUSE);
    p.diffuse_roughness = 0;
    p.base_color = (struct vec3){0, 0, 0};
    assert_charged("black", &p, PROFILE_NO_EFFECT, 0);
    p = grey();
    p.specular = 1;
    assert_charged("plastic", &p, PROFILE_ACCOUNT(GLOSSY), EFFECT_GLOSSY | EFFECT_DIFFUSE);
    p.alpha = 0;
    assert_charged("polished", &p, PROFILE_ACCOUNT(MIRROR), EFFECT_MIRROR | EFFECT_DIFFUSE);
    p.metallic = 1;
    assert_charged("mirror", &p, PROFILE_ACCOUNT(MIRROR), EFFECT_MIRROR);
    p.alpha = 0.3f;
    assert_charged("metal", &p, PROFILE_ACCOUNT(GLOSSY), EFFECT_GLOSSY | EFFECT_MULTIPLE_SCATTERING);
    p.single_scattering = 1;
    assert_charged("simple metal", &p, PROFILE_ACCOUNT(GLOSSY), EFFECT_GLOSSY);
    p = grey();
    p.transmission = p.specular = 1;
    assert_charged("thin", &p, PROFILE_ACCOUNT(THIN_TRANSMISSION),
                   EFFECT_THIN_TRANSMISSION | EFFECT_GLOSSY | EFFECT_MULTIPLE_SCATTERING);
    p.refractive = 1;
    p.single_scattering = 1;
    assert_charged("frosted", &p, PROFILE_ACCOUNT(ROUGH_DIELECTRIC), EFFECT_ROUGH_DIELECTRIC);
    p.alpha = 0;
    assert_charged("glass", &p, PROFILE_ACCOUNT(DIELECTRIC), EFFECT_DIELECTRIC);
}

static void test_layers(void **state)
{
    struct bsdf_params p = grey();

    (void)state;
    p.sheen_color = (struct vec3){0.5f, 0.5f, 0.5f};
    p.sheen_alpha = 0.3f;
    p.single_scattering = 1;
    assert_charged("cloth", &p, PROFILE_ACCOUNT(DIFFUSE), EFFECT_DIFFUSE | EFFECT_SHEEN);
    p = grey();
    p.clearcoat = 1;
    p.clearcoat_ior = 1.5f;
    p.clearcoat_normal = (struct vec3){0, 0, 1};
    p.single_scattering = 1;
    assert_charged("varnish", &p, PROFILE_ACCOUNT(DIFFUSE), EFFECT_DIFFUSE | EFFECT_CLEARCOAT);
    p = grey();
    p.diffuse_transmission = 0.5f;
    p.diffuse_transmission_color = (struct vec3){0.5f, 0.5f, 0.5f};
    p.single_scattering = 1;
    assert_charged("leaf", &p, PROFILE_ACCOUNT(DIFFUSE), EFFECT_DIFFUSE | EFFECT_DIFFUSE_TRANSMISSION);
    p = grey();
    p.conductor = 1;
    p.eta = (struct vec3){0.2f, 0.9f, 1.1f};
    p.k = (struct vec3){3.9f, 2.4f, 2.2f};
    p.single_scattering = 1;
    assert_charged("copper", &p, PROFILE_ACCOUNT(GLOSSY), EFFECT_GLOSSY);
}

/* The accounts to which samples of the scene's lights are charged, as a set of effects. */
static uint64_t charged_lights(struct scene_builder *b, const struct render_settings *settings)
{
    const struct light_context context = {.n = {0, 1, 0}};
    struct render_scene *scene = builder_build(b, settings);
    uint64_t met = 0;

    for (int i = 0; i < 256; i++) {
        struct light_sample light;
        uint8_t point = PROFILE_ACCOUNT(PUNCTUAL_LIGHT);

        profile_account(PROFILE_NO_EFFECT);
        if (!emitters_sample(scene, &context, ((float)i + 0.5f) / 256, ((float)(i * 37 % 256) + 0.5f) / 256, &light))
            continue;
        if (light.delta && light.direction.x < 0 && !(settings->without & EFFECT_LIGHT_IMAGE))
            point = PROFILE_ACCOUNT(LIGHT_IMAGE);
        assert_int_equal(profile_account_now(), light.delta                 ? point
                                                : light.distance < INFINITY ? PROFILE_ACCOUNT(EMISSIVE_MESH)
                                                                            : PROFILE_ACCOUNT(ENVIRONMENT));
        met |= (uint64_t)1 << (profile_account_now() - 1);
    }
    profile_account(PROFILE_NO_EFFECT);
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
