/* Lights with images, cones that fall off smoothly, and light that comes by way of a mirror.
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

enum { COMPARISONS = 150 };

static struct render_settings narrow(uint32_t spp, uint32_t depth)
{
    struct render_settings s = builder_settings(8, 8, spp);

    s.max_depth = depth;
    return s;
}

/* A light 2 m above a plane of albedo 0.8, looked at at (x, 0, 0). */
static struct scene_light *lit_plane(struct scene_builder *b, enum scene_light_kind kind, float x)
{
    struct scene_light *l;

    builder_init(b);
    builder_lambert(b, 0.8f);
    builder_place(b, builder_quad(b), 0, vec3_make(10, 1, 10), vec3_splat(0));
    builder_camera(b, vec3_make(x, 3, 0), vec3_make(x, 0, 0), 0.0005f);
    l = builder_light(b, kind);
    l->position[1] = 2;
    l->intensity[0] = 4;
    l->intensity[1] = 5;
    l->intensity[2] = 6;
    /* looks along -Z: turned down, the image's up is -Z of the world */
    l->to_world = (struct transform_d){{{1, 0, 0, 0}, {0, 0, 1, 2}, {0, -1, 0, 0}}};
    return l;
}

static void point_light(const struct scene_light *l, double x, double scale, double out[3])
{
    double r2 = 4 + x * x;

    for (int c = 0; c < 3; c++)
        out[c] = scale * 0.8 / M_PI * (double)l->intensity[c] * 2 / (r2 * sqrt(r2));
}

/* A goniometric light of a constant image, and of none, is a point light; so is a projector
 * inside its frustum, and dark outside. */
static void test_constant_images(void **state)
{
    static const float xs[] = {0, 0.8f, 1.7f};
    static float gray[2 * 2 * 3];

    (void)state;
    for (int i = 0; i < 12; i++)
        gray[i] = 0.5f;
    for (size_t k = 0; k < 3; k++)
        for (int kind = 0; kind < 4; kind++) {
            struct render_settings settings = narrow(4, 1);
            struct scene_builder b;
            struct scene_light *l = lit_plane(&b, kind < 2 ? LIGHT_GONIOMETRIC : LIGHT_PROJECTION, xs[k]);
            double expected[3], scale = kind & 1 ? 0.5 : 1;
            if (kind & 1)
                l->image = (int32_t)b.scene.textures[builder_texture(&b, gray, 2, 2)].image;
            l->projection_yfov_rad = (float)(M_PI / 4);
            l->projection_aspect = 1.5f;
            /* the slide's half width at 2 m: 2 tan(22.5 degrees) 1.5 */
            if (kind >= 2 && (double)xs[k] > 2 * tan(M_PI / 8) * 1.5)
                scale = 0;
            point_light(l, (double)xs[k], scale, expected);
            radiance_expect_rgb(&b, &settings, COMPARISONS, expected, kind < 2 ? "goniometric light" : "projector");
            settings.without = EFFECT_LIGHT_IMAGE;
            point_light(l, (double)xs[k], scale > 0, expected);
            radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "without its image");
            builder_release(&b);
        }
}

/* Which way round: a slide whose left half is dark, and a lat-long image that is lit on one side. */
static void test_sides(void **state)
{
    enum { W = 32, H = 16 };
    static float slide[H * W * 3], globe[H * W * 3];

    (void)state;
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int c = 0; c < 3; c++) {
                slide[(y * W + x) * 3 + c] = x < W / 2 ? 0.25f : 1;
                /* u = 1/2 is +X of the light */
                globe[(y * W + x) * 3 + c] = x >= W / 4 && x < 3 * W / 4 ? 1 : 0.25f;
            }
    for (int kind = 0; kind < 2; kind++)
        for (int side = -1; side <= 1; side += 2) {
            struct render_settings settings = narrow(4, 1);
            float x = 0.7f * (float)side;
            struct scene_builder b;
            struct scene_light *l = lit_plane(&b, kind ? LIGHT_PROJECTION : LIGHT_GONIOMETRIC, x);
            double expected[3];
            l->image = (int32_t)b.scene.textures[builder_texture(&b, kind ? slide : globe, W, H)].image;
            l->projection_yfov_rad = 1;
            l->projection_aspect = 1;
            point_light(l, (double)x, side > 0 ? 1 : 0.25, expected);
            radiance_expect_rgb(&b, &settings, COMPARISONS, expected,
                                kind ? "slide of two halves" : "globe of two halves");
            builder_release(&b);
        }
}

/* pbrt's spot light: a smooth step of the cosine between its cones. */
static void test_smoothstep(void **state)
{
    static const double angles[] = {0.1, 0.3, 0.4, 0.55, 0.7};

    (void)state;
    for (size_t k = 0; k < 5; k++) {
        struct render_settings settings = narrow(4, 1);
        double x = 2 * tan(angles[k]), inner = 0.2, outer = 0.6, t, expected[3];
        struct scene_builder b;
        struct scene_light *l = lit_plane(&b, LIGHT_SPOT, (float)x);
        l->inner_cone_rad = (float)inner;
        l->outer_cone_rad = (float)outer;
        l->falloff = FALLOFF_SMOOTHSTEP;
        t = (cos(angles[k]) - cos(outer)) / (cos(inner) - cos(outer));
        t = t < 0 ? 0 : t > 1 ? 1 : t;
        point_light(l, x, t * t * (3 - 2 * t), expected);
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "smooth spot light");
        settings.without = EFFECT_PUNCTUAL_LIGHT;
        radiance_expect(&b, &settings, COMPARISONS, 0, "without the light");
        builder_release(&b);
    }
}

/* Light of a horizontal square lamp of half-width h at (0, 2, 0) that faces down, at a point of
 * the floor at x, by quadrature. */
static double lamp_irradiance(double h, double x)
{
    const int steps = 400;
    double sum = 0;

    for (int i = 0; i < steps; i++)
        for (int k = 0; k < steps; k++) {
            double dx = h * (2 * (i + 0.5) / steps - 1) - x, dz = h * (2 * (k + 0.5) / steps - 1);
            double r2 = dx * dx + dz * dz + 4;
            sum += 4 / (r2 * r2) * 4 * h * h / steps / steps;
        }
    return sum;
}

/* A lamp over a floor beside a mirror wall: the mirror adds a second lamp behind it. Without
 * caustics that, and nothing else, is missing; a mirror looked into shows the lamp all the same. */
static void test_caustics(void **state)
{
    const double lamp = 10, wall = 1.2, albedo = 0.6, h = 0.5;
    struct render_settings settings = narrow(256, 2);
    struct scene_instance *i;
    struct scene_material *m;
    struct scene_builder b;
    double direct = albedo / M_PI * lamp * lamp_irradiance(h, 0.2);
    double mirrored = albedo / M_PI * lamp * lamp_irradiance(h, 2 * wall - 0.2);
    uint32_t quad;

    (void)state;
    builder_init(&b);
    quad = builder_quad(&b);
    builder_lambert(&b, (float)albedo);
    builder_place(&b, quad, 0, vec3_make(3, 1, 3), vec3_splat(0));
    m = builder_lambert(&b, 0);
    m->double_sided = 0;
    for (int c = 0; c < 3; c++)
        m->emission[c] = (float)lamp;
    builder_place(&b, quad, 1, vec3_make((float)h, -1, (float)h), vec3_make(0, 2, 0));
    m = builder_lambert(&b, 1);
    m->metallic = 1;
    m->roughness = 0;
    i = builder_place(&b, quad, 2, vec3_splat(1), vec3_splat(0));
    i->to_world = (struct transform_d){{{0, -1, 0, (float)wall}, {3, 0, 0, 0}, {0, 0, 3, 0}}};
    builder_camera(&b, vec3_make(0.2f, 1.9f, 0), vec3_make(0.2f, 0, 0), 0.002f);
    radiance_expect(&b, &settings, COMPARISONS, direct + mirrored, "lamp and its mirror image");
    settings.without = EFFECT_CAUSTICS;
    radiance_expect(&b, &settings, COMPARISONS, direct, "without caustics");
    builder_camera(&b, vec3_make(0, 1, 0), vec3_make((float)wall, 1.5f, 0), 0.002f);
    settings.camera = 1;
    radiance_expect(&b, &settings, COMPARISONS, lamp, "a mirror shows the lamp");
    builder_release(&b);
}

/* A floor under a sky and a point light: light sampling divides its samples between them, and the weight of what
 * the floor's own directions find of the sky must count the sky's share alone. The sky of a map is sampled by its
 * brightness, a constant one uniformly. */
static void test_sky_and_light(void **state)
{
    static float map[16 * 8 * 3];

    (void)state;
    for (int i = 0; i < 16 * 8 * 3; i++)
        map[i] = i / 48 < 2 ? 3 : 0.5f; /* brighter around the zenith */
    for (int kind = 0; kind < 3; kind++) {
        struct render_settings settings = narrow(64, 1);
        struct scene_builder b;
        struct scene_light *l = lit_plane(&b, LIGHT_POINT, 0.8f);
        double expected[3];

        if (kind < 2)
            builder_environment_constant(&b, vec3_splat(2));
        else
            builder_environment_map(&b, map, 16, 8);
        l = &b.scene.lights[0];
        if (kind == 1) /* hardly any light: nothing but the shares */
            l->intensity[0] = l->intensity[1] = l->intensity[2] = 1e-3f;
        point_light(l, 0.8, 1, expected);
        if (kind == 2) {
            /* Against the map without the light, where nothing else takes a share. */
            struct running_stats sky[3];
            struct render_settings bare = settings;

            bare.without = EFFECT_PUNCTUAL_LIGHT;
            bare.spp *= 16;
            radiance_measure(&b, &bare, sky);
            for (int c = 0; c < 3; c++)
                expected[c] += sky[c].mean;
        } else {
            for (int c = 0; c < 3; c++)
                expected[c] += 0.8 * 2;
        }
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "sky and a light");
        builder_release(&b);
    }
}

/* A coat over a lamp takes the share that it reflects (Schlick, index 1.5): 4 % head on, more from aside. */
static void test_coated_lamp(void **state)
{
    static const double angles[] = {0, 0.8, 1.2};

    (void)state;
    for (size_t k = 0; k < 6; k++) {
        struct render_settings settings = narrow(4, 1);
        double angle = angles[k % 3], coat = k < 3 ? 1 : 0.5, f = 0.04 + 0.96 * pow(1 - cos(angle), 5);
        struct scene_material *m;
        struct scene_builder b;

        builder_init(&b);
        m = builder_lambert(&b, 0);
        m->clearcoat = (float)coat;
        m->emission[0] = m->emission[1] = m->emission[2] = 3;
        builder_place(&b, builder_quad(&b), 0, vec3_make(10, 1, 10), vec3_splat(0));
        builder_camera(&b, vec3_make((float)(2 * sin(angle)), (float)(2 * cos(angle)), 0.01f), vec3_splat(0), 1e-5f);
        radiance_expect(&b, &settings, COMPARISONS, 3 * (1 - coat * f), "lamp under a coat");
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_constant_images), cmocka_unit_test(test_sides),
        cmocka_unit_test(test_smoothstep),      cmocka_unit_test(test_caustics),
        cmocka_unit_test(test_sky_and_light),   cmocka_unit_test(test_coated_lamp),
    };
    return cmocka_run_group_tests_name("light radiance", tests, NULL, NULL);
}
