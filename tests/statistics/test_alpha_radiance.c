/* Surfaces that are there by a share: alpha, mixes, diffuse transmission, and what they do to
 * shadows.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "common/scene/effects.h"
#include "tests/support/radiance.h"

enum { COMPARISONS = 122 };

static struct render_settings narrow(uint32_t spp, uint32_t depth)
{
    struct render_settings s = builder_settings(8, 8, spp);

    s.max_depth = depth;
    return s;
}

static void splat(float out[3], float value) { out[0] = out[1] = out[2] = value; }

static void veil(struct scene_builder *b, float alpha, float albedo, float height)
{
    struct scene_material *m = builder_lambert(b, albedo);

    m->alpha_mode = ALPHA_BLEND;
    m->base_color[3] = alpha;
    builder_place(b, 0, builder_last_material(b), vec3_make(10, 1, 10), vec3_make(0, height, 0));
}

/* Veils before the sky: each lets 1 - alpha through and covers the rest with its own light. */
static void test_blend(void **state)
{
    static const float alphas[] = {0.5f, 0.125f};

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        struct render_settings settings = narrow(64, 1);
        struct scene_builder b;
        double a = (double)alphas[k];
        builder_init(&b);
        builder_quad(&b);
        veil(&b, alphas[k], 0, 0);
        builder_environment_constant(&b, vec3_splat(3));
        builder_camera(&b, vec3_make(0, 1, 0), vec3_splat(0), 0.002f);
        radiance_expect(&b, &settings, COMPARISONS, 3 * (1 - a), "black veil");
        splat(b.scene.materials[0].emission, 2);
        radiance_expect(&b, &settings, COMPARISONS, 3 * (1 - a) + 2 * a, "shining veil");
        veil(&b, alphas[k], 0, -1);
        radiance_expect(&b, &settings, COMPARISONS, 3 * (1 - a) * (1 - a) + 2 * a, "two veils");
        settings.without = EFFECT_ALPHA;
        radiance_expect(&b, &settings, COMPARISONS, 2, "solid veil");
        builder_release(&b);
    }
}

/* The shadow of a veil is as dark as it covers, from every kind of light. */
static void test_shadow(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        struct render_settings settings = narrow(64, 1);
        struct scene_builder b;
        struct scene_light *l;
        double lit = 0.8 / M_PI * 3;
        builder_init(&b);
        builder_lambert(&b, 0.8f);
        builder_place(&b, builder_quad(&b), 0, vec3_make(10, 1, 10), vec3_splat(0));
        veil(&b, 0.5f, 0, 2);
        if (kind < 2) {
            l = builder_light(&b, kind ? LIGHT_POINT : LIGHT_DIRECTIONAL);
            splat(l->intensity, 3);
            l->position[1] = 4;
            if (kind)
                lit /= 16;
        } else {
            /* Against the same lamp without the veil, rendered with many more samples. */
            struct scene_material *m = builder_lambert(&b, 0);
            splat(m->emission, 3);
            builder_place(&b, 0, 2, vec3_make(0.1f, 1, 0.1f), vec3_make(0, 3, 0));
            lit = -1;
        }
        builder_camera(&b, vec3_make(0.2f, 1, 0.1f), vec3_splat(0), 0.002f);
        if (lit < 0) {
            struct running_stats s[3];
            struct render_settings bare = settings;
            b.scene.materials[1].base_color[3] = 0;
            bare.spp *= 16;
            radiance_measure(&b, &bare, s);
            b.scene.materials[1].base_color[3] = 0.5f;
            lit = s[0].mean;
        }
        radiance_expect(&b, &settings, COMPARISONS, lit / 2, "half a shadow");
        builder_release(&b);
    }
}

/* The share of the hemisphere's cosine that a square lamp of half side `a` covers, seen from `d` metres
 * below its centre and parallel to it (Nusselt; the closed form of a rectangle at its corner, four times). */
static double square_above(double a, double d)
{
    double x = a / d, root = sqrt(1 + x * x);

    return 4 * (x / root * atan(x / root)) / M_PI;
}

/* A lamp that is there by a share gives that share of its light, by whichever strategy it is found: the
 * floor below finds it by light sampling and by its own directions. */
static void test_lamp(void **state)
{
    static const struct {
        enum scene_alpha_mode mode;
        float alpha;
        double share;
    } lamps[] = {{ALPHA_BLEND, 1, 1},        {ALPHA_BLEND, 0.5f, 0.5}, {ALPHA_BLEND, 0.125f, 0.125},
                 {ALPHA_MASK, 0.6f, 1}, {ALPHA_MASK, 0.4f, 0}};
    const double covered = square_above(0.5, 1);

    (void)state;
    for (size_t k = 0; k < sizeof lamps / sizeof *lamps; k++) {
        struct render_settings settings = narrow(64, 1);
        struct scene_material *m;
        struct scene_builder b;

        builder_init(&b);
        builder_lambert(&b, 0.8f);
        builder_place(&b, builder_quad(&b), 0, vec3_make(10, 1, 10), vec3_splat(0));
        veil(&b, lamps[k].alpha, 0, 1);
        m = &b.scene.materials[1];
        m->alpha_mode = lamps[k].mode;
        m->alpha_cutoff = 0.5f;
        splat(m->emission, 3);
        b.scene.instances[1].to_world.m[0][0] = b.scene.instances[1].to_world.m[2][2] = 0.5;
        builder_camera(&b, vec3_make(4, 2, 0), vec3_splat(0), 0.0005f);
        radiance_expect(&b, &settings, COMPARISONS, 0.8 * 3 * covered * lamps[k].share,
                        "lamp that is there by a share");
        builder_release(&b);
    }
}

/* A mix of two Lambert surfaces under a constant sky: the mean of their albedos by its share;
 * and a mix of that mix. */
static void test_mix(void **state)
{
    struct render_settings settings = narrow(256, 1);
    struct scene_material *m;
    struct scene_builder b;
    struct scene_instance *i;
    double first;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.8f);
    builder_lambert(&b, 0.1f);
    m = builder_lambert(&b, 1);
    m->kind = MATERIAL_MIX;
    m->mix_material[0] = 0;
    m->mix_material[1] = 1;
    m->mix_amount = 0.3f;
    first = 0.7 * 0.8 + 0.3 * 0.1;
    i = builder_place(&b, builder_quad(&b), 2, vec3_make(10, 1, 10), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(2));
    builder_camera(&b, vec3_make(0, 1, 0), vec3_splat(0), 0.002f);
    radiance_expect(&b, &settings, COMPARISONS, 2 * first, "mix");
    m = builder_lambert(&b, 1);
    m->kind = MATERIAL_MIX;
    m->mix_material[0] = 2;
    m->mix_material[1] = 0;
    m->mix_amount = 0.25f;
    i->material = 3;
    radiance_expect(&b, &settings, COMPARISONS, 2 * (0.75 * first + 0.25 * 0.8), "mix of a mix");
    /* The amount is a texture's, times the factor. */
    {
        static const float half[3] = {0.5f, 0.25f, 0.75f}; /* red counts */
        struct scene_material *first_mix = &b.scene.materials[2];

        first_mix->mix_texture = (struct scene_texture_slot){.texture = (int32_t)builder_texture(&b, half, 1, 1),
                                                             .uv_transform = {{1, 0, 0}, {0, 1, 0}}};
        i->material = 2;
        radiance_expect(&b, &settings, COMPARISONS, 2 * (0.85 * 0.8 + 0.15 * 0.1), "mix by a texture");
        first_mix->mix_texture.texture = -1;
        i->material = 3;
    }
    /* One part shines: seen, and thrown on nothing else. */
    splat(b.scene.materials[1].emission, 4);
    radiance_expect(&b, &settings, COMPARISONS, 2 * (0.75 * first + 0.25 * 0.8) + 0.75 * 0.3 * 4, "mix with a lamp");
    builder_release(&b);
}

/* A leaf: what it sends on comes from the light behind it, the rest from that before it. */
static void test_diffuse_transmission(void **state)
{
    const double share = 0.4, cosine = 0.8;
    static const double albedo[3] = {0.9, 0.5, 0.2}, through[3] = {0.3, 0.6, 0.9};

    (void)state;
    for (int side = 0; side < 3; side++) {
        struct render_settings settings = narrow(256, 1);
        struct scene_material *m;
        struct scene_builder b;
        double expected[3], reflects, passes;
        builder_init(&b);
        m = builder_lambert(&b, 1);
        m->diffuse_transmission = (float)share;
        for (int c = 0; c < 3; c++) {
            m->base_color[c] = (float)albedo[c];
            m->diffuse_transmission_color[c] = (float)through[c];
        }
        builder_place(&b, builder_quad(&b), 0, vec3_make(10, 1, 10), vec3_splat(0));
        builder_camera(&b, vec3_make(0, 1, 0), vec3_splat(0), 0.002f);
        if (side < 2) {
            struct scene_light *l = builder_light(&b, LIGHT_DIRECTIONAL);
            l->direction[0] = (float)sqrt(1 - cosine * cosine);
            l->direction[1] = (float)(side ? cosine : -cosine);
            splat(l->intensity, 2);
        } else {
            builder_environment_constant(&b, vec3_splat(1));
        }
        for (int c = 0; c < 3; c++) {
            reflects = (1 - share) * albedo[c];
            passes = share * through[c];
            expected[c] = side == 2 ? reflects + passes : (side ? passes : reflects) * 2 * cosine / M_PI;
        }
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected,
                            side == 0   ? "leaf lit from before"
                            : side == 1 ? "leaf lit from behind"
                                        : "leaf in a furnace");
        settings.without = EFFECT_DIFFUSE_TRANSMISSION;
        for (int c = 0; c < 3; c++)
            expected[c] = side == 2 ? albedo[c] : side ? 0 : albedo[c] * 2 * cosine / M_PI;
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "leaf that lets nothing through");
        builder_release(&b);
    }
}

/* Coverage between 0 and 1 by mask is all or nothing at the cutoff. */
static void test_mask(void **state)
{
    static const float alphas[] = {0.5f, 0.4999f};

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        struct render_settings settings = narrow(16, 1);
        struct scene_builder b;
        builder_init(&b);
        builder_quad(&b);
        veil(&b, alphas[k], 0, 0);
        b.scene.materials[0].alpha_mode = ALPHA_MASK;
        b.scene.materials[0].alpha_cutoff = 0.5f;
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_make(0, 1, 0), vec3_splat(0), 0.002f);
        radiance_expect(&b, &settings, COMPARISONS, k ? 1 : 0, "mask");
        builder_release(&b);
    }
}

/* A black square before a sky of 1, in the mode; alpha is the material's times its vertices'. */
static void test_alpha_of_vertices(void **state)
{
    static const float positions[12] = {-1, 0, -1, -1, 0, 1, 1, 0, 1, 1, 0, -1};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    static const struct {
        float material, vertices;
    } alphas[] = {{1, 0.25f}, {0.75f, 0.5f}, {0.5f, 1}, {1, 0.75f}};

    (void)state;
    for (size_t k = 0; k < 8; k++) {
        const float alpha = alphas[k / 2].material * alphas[k / 2].vertices;
        const int is_mask = k % 2 == 0;
        struct render_settings settings = narrow(is_mask ? 16 : 64, 1);
        struct scene_material *m;
        struct scene_builder b;
        float colors[16];

        for (int i = 0; i < 16; i++)
            colors[i] = i % 4 == 3 ? alphas[k / 2].vertices : 1;
        builder_init(&b);
        m = builder_lambert(&b, 0);
        m->base_color[3] = alphas[k / 2].material;
        m->alpha_mode = is_mask ? ALPHA_MASK : ALPHA_BLEND;
        m->alpha_cutoff = 0.5f;
        builder_place(&b, builder_mesh_mapped(&b, &(struct builder_mapped){.positions = positions, .colors = colors,
                                                                           .vertex_count = 4, .indices = indices, .triangle_count = 2}),
                      0, vec3_splat(1), vec3_splat(0));
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_make(0, 1, 0), vec3_splat(0), 0.002f);
        radiance_expect(&b, &settings, COMPARISONS, is_mask ? alpha < 0.5f : 1 - (double)alpha, "alpha of vertices");
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_blend), cmocka_unit_test(test_shadow),
        cmocka_unit_test(test_lamp),
        cmocka_unit_test(test_mix),   cmocka_unit_test(test_diffuse_transmission),
        cmocka_unit_test(test_mask),  cmocka_unit_test(test_alpha_of_vertices),
    };
    return cmocka_run_group_tests_name("alpha radiance", tests, NULL, NULL);
}
