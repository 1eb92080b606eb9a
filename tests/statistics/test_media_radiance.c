/* Media in whole pictures against closed forms and quadrature: Beer-Lambert, one scattering,
 * emission, fog, grids, and furnaces.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "common/scene/effects.h"
#include "tests/support/radiance.h"

enum { COMPARISONS = 160 };

static const float absorbing[3] = {0.1f, 0.5f, 1.5f}, scattering[3] = {0.9f, 0.3f, 2.0f};

static void set3(float out[3], const float in[3], float scale)
{
    for (int c = 0; c < 3; c++)
        out[c] = in[c] * scale;
}

static double henyey_greenstein(double g, double cosine)
{
    return (1 - g * g) / (4 * M_PI * pow(1 + g * g - 2 * g * cosine, 1.5));
}

static struct render_settings narrow(uint32_t spp, uint32_t depth)
{
    struct render_settings s = builder_settings(8, 8, spp);

    s.max_depth = depth;
    return s;
}

/* A boundary that is none around the builder's first medium. */
static uint32_t boundary(struct scene_builder *b)
{
    struct scene_material *m = builder_lambert(b, 0);

    m->kind = MATERIAL_INTERFACE;
    m->medium = 0;
    return builder_last_material(b);
}

/* How a density of 1 is passed to the renderer. */
enum form { HOMOGENEOUS, GRID, THIN_GRID, FORMS };

static void fill(struct scene_builder *b, struct scene_medium *m, enum form form)
{
    static const uint32_t size[3] = {3, 2, 4};
    float density[24];

    if (form == HOMOGENEOUS)
        return;
    for (int i = 0; i < 24; i++)
        density[i] = form == GRID ? 1 : 0.25f;
    builder_grid(b, m, density, size, vec3_make(-11, -1, -11), vec3_make(11, 1, 11));
    if (form == THIN_GRID)
        for (int c = 0; c < 3; c++) {
            m->absorption[c] *= 4;
            m->scattering[c] *= 4;
            m->emission[c] *= 4;
        }
}

/* A slab of the medium from y = -1 to 1, looked at from above along -y. */
static void slab_scene(struct scene_builder *b, const struct scene_medium *what, enum form form)
{
    struct scene_medium *m;
    const char *name;

    builder_init(b);
    m = builder_medium(b);
    name = m->name;
    *m = *what;
    m->name = name;
    fill(b, m, form);
    builder_place(b, builder_slab(b), boundary(b), vec3_make(10, 1, 10), vec3_splat(0));
    builder_camera(b, vec3_make(0.3f, 5, 0.1f), vec3_make(0.3f, 0, 0.1f), 0.002f);
}

static struct scene_medium medium_of(float absorb, float scatter, float g)
{
    struct scene_medium m;

    scene_medium_default(&m);
    set3(m.absorption, absorbing, absorb);
    set3(m.scattering, scattering, scatter);
    m.g = g;
    return m;
}

/* Absorption alone before a constant sky; and a slab that is half as dense below as above. */
static void test_beer_lambert(void **state)
{
    static const uint32_t size[3] = {1, 2, 1};
    static const float half[2] = {0.5f, 1};
    struct render_settings settings = narrow(16, 4);
    struct scene_medium m = medium_of(1, 0, 0);

    (void)state;
    for (enum form form = 0; form < FORMS; form++) {
        struct scene_builder b;
        double expected[3];
        for (int c = 0; c < 3; c++)
            expected[c] = 0.5 * exp(-2 * (double)absorbing[c]);
        slab_scene(&b, &m, form);
        builder_environment_constant(&b, vec3_splat(0.5f));
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "absorbing slab");
        settings.without = EFFECT_MEDIUM;
        radiance_expect(&b, &settings, COMPARISONS, 0.5, "without its medium");
        settings.without = 0;
        builder_release(&b);
    }
    {
        struct scene_builder b;
        double expected[3];
        for (int c = 0; c < 3; c++) /* mean density 3/4: linear between the cells' centres */
            expected[c] = exp(-1.5 * (double)absorbing[c]);
        slab_scene(&b, &m, HOMOGENEOUS);
        builder_grid(&b, &b.scene.media[0], half, size, vec3_make(-11, -1, -11), vec3_make(11, 1, 11));
        builder_environment_constant(&b, vec3_splat(1));
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "slab of two densities");
        builder_release(&b);
    }
}

/* The same inside smooth glass: Fresnel's factors and the series of inner reflections. */
static void test_glass_filled(void **state)
{
    struct render_settings settings = narrow(64, 100);
    struct scene_medium m = medium_of(0.5f, 0, 0);
    double r = pow((1.5 - 1) / (1.5 + 1), 2), expected[3];
    struct scene_material *glass;
    struct scene_builder b;

    (void)state;
    for (int c = 0; c < 3; c++) {
        double t = exp(-2 * 0.5 * (double)absorbing[c]);
        expected[c] = r + (1 - r) * (1 - r) * t * (1 + r * t) / (1 - r * r * t * t);
    }
    slab_scene(&b, &m, HOMOGENEOUS);
    glass = &b.scene.materials[0];
    glass->kind = MATERIAL_SURFACE;
    glass->base_color[0] = glass->base_color[1] = glass->base_color[2] = 1;
    glass->specular = glass->transmission = 1;
    glass->roughness = 0;
    glass->refractive = 1;
    glass->double_sided = 0;
    glass->ior = 1.5f;
    builder_environment_constant(&b, vec3_splat(1));
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "glass filled with a dye");
    builder_release(&b);
}

/* Light that scattered once in the slab, from a distant light above or below it. */
static void test_single_scattering(void **state)
{
    static const double cosines[] = {0.8, -0.6};
    const double g = 0.4, sun = 3;

    (void)state;
    for (size_t k = 0; k < 2; k++)
        for (enum form form = 0; form < FORMS; form++) {
            struct render_settings settings = narrow(64, 1);
            struct scene_medium m = medium_of(0.3f, 0.5f, (float)g);
            double mu = cosines[k], expected[3];
            struct scene_builder b;
            struct scene_light *l;
            for (int c = 0; c < 3; c++) {
                double s = 0.5 * (double)scattering[c], t = s + 0.3 * (double)absorbing[c];
                /* The light flies along (x, -mu, 0), the eye's path along -y. */
                double phase = henyey_greenstein(g, -mu);
                double q = t * (1 + 1 / mu);
                double integral = mu > 0 ? (1 - exp(-2 * q)) / q
                                         : exp(2 * t / mu) * (1 - exp(-2 * t * (1 + 1 / mu))) / (t * (1 + 1 / mu));
                expected[c] = sun * s * phase * integral;
            }
            slab_scene(&b, &m, form);
            l = builder_light(&b, LIGHT_DIRECTIONAL);
            l->direction[0] = (float)sqrt(1 - mu * mu);
            l->direction[1] = (float)-mu;
            l->intensity[0] = l->intensity[1] = l->intensity[2] = (float)sun;
            radiance_expect_rgb(&b, &settings, COMPARISONS, expected, mu > 0 ? "lit from above" : "lit from below");
            builder_release(&b);
        }
}

/* A medium that glows: what it sends out is what it does not absorb again. */
static void test_emission(void **state)
{
    (void)state;
    for (enum form form = 0; form < FORMS; form++) {
        struct render_settings settings = narrow(64, 4);
        struct scene_medium m = medium_of(1, 0, 0);
        struct scene_builder b;
        double expected[3];
        for (int c = 0; c < 3; c++) {
            double a = (double)absorbing[c];
            m.emission[c] = 0.7f;
            expected[c] = (double)0.7f / a * (1 - exp(-2 * a));
        }
        slab_scene(&b, &m, form);
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "glowing slab");
        settings.without = EFFECT_MEDIUM_EMISSION;
        radiance_expect(&b, &settings, COMPARISONS, 0, "without its glow");
        builder_release(&b);
    }
}

/* What scatters and does not absorb cannot be seen in a constant sky. */
static void test_furnace(void **state)
{
    static const float gs[] = {0, 0.7f};

    (void)state;
    for (int k = 0; k < 4; k++) {
        struct render_settings settings = builder_settings(4, 4, 128);
        struct scene_medium *m;
        struct scene_builder b;
        settings.max_depth = 512;
        builder_init(&b);
        m = builder_medium(&b);
        set3(m->scattering, scattering, 1);
        m->g = gs[k & 1];
        if (k & 2) {
            static const uint32_t size[3] = {2, 2, 2};
            static const float cells[8] = {0.2f, 1, 2, 0, 0.5f, 1.5f, 0.1f, 1};
            builder_grid(&b, m, cells, size, vec3_splat(-1), vec3_splat(1));
        }
        builder_place(&b, builder_sphere(&b, 16, 0), boundary(&b), vec3_splat(1), vec3_splat(0));
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_make(0, 0, 4), vec3_splat(0), 0.3f);
        radiance_expect(&b, &settings, COMPARISONS, 1, k & 2 ? "white smoke" : "white mist");
        builder_release(&b);
    }
}

static void foggy(struct scene_builder *b, const struct scene_medium *what)
{
    struct scene_medium *m = builder_medium(b);
    const char *name = m->name;

    *m = *what;
    m->name = name;
    b->scene.fog = 0;
}

/* A lamp that fills the view, seen through fog: what is neither absorbed nor scattered. */
static void test_fog_transmittance(void **state)
{
    static const float distances[] = {0.5f, 3};

    (void)state;
    for (size_t k = 0; k < 2; k++) {
        struct render_settings settings = narrow(64, 0);
        struct scene_medium m = medium_of(0.5f, 0.3f, 0.2f);
        struct scene_material *lamp;
        struct scene_builder b;
        double expected[3];
        for (int c = 0; c < 3; c++)
            expected[c] = 2 * exp(-(double)distances[k] * (0.5 * (double)absorbing[c] + 0.3 * (double)scattering[c]));
        builder_init(&b);
        foggy(&b, &m);
        lamp = builder_lambert(&b, 0);
        lamp->emission[0] = lamp->emission[1] = lamp->emission[2] = 2;
        builder_place(&b, builder_quad(&b), 0, vec3_splat(5), vec3_splat(0));
        builder_camera(&b, vec3_make(0, distances[k], 0), vec3_splat(0), 0.002f);
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "lamp in fog");
        settings.without = EFFECT_FOG;
        radiance_expect(&b, &settings, COMPARISONS, 2, "lamp without fog");
        builder_release(&b);
    }
}

/* A face that is nothing else than where fog begins, whichever side is said to be its outside: without fog there is none behind it. */
static void test_fog_behind_a_face(void **state)
{
    (void)state;
    for (int k = 0; k < 4; k++) {
        const int flipped = k & 1;
        struct render_settings settings = narrow(64, 0);
        struct scene_medium m = medium_of(0.5f, 0, 0);
        struct scene_material *lamp, *face;
        struct scene_builder b;
        double expected[3];

        for (int c = 0; c < 3; c++)
            expected[c] = 2 * exp(-3 * 0.5 * (double)absorbing[c]);
        builder_init(&b);
        foggy(&b, &m);
        b.scene.volume_rule = k & 2 ? VOLUMES_BOUNDARIES : VOLUMES_NESTED;
        lamp = builder_lambert(&b, 0);
        lamp->emission[0] = lamp->emission[1] = lamp->emission[2] = 2;
        builder_place(&b, builder_quad(&b), 0, vec3_splat(5), vec3_splat(0));
        face = builder_lambert(&b, 0);
        face->kind = MATERIAL_INTERFACE;
        face->medium = face->medium_outside = b.scene.fog;
        builder_place(&b, builder_quad(&b), 1, vec3_make(5, flipped ? -1 : 1, 5), vec3_make(0, 2, 0));
        builder_camera(&b, vec3_make(0, 3, 0), vec3_splat(0), 0.002f);
        radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "lamp behind a face in fog");
        settings.without = EFFECT_FOG;
        radiance_expect(&b, &settings, COMPARISONS, 2, "lamp behind a face without fog");
        builder_release(&b);
    }
}

/* Airlight: what a point light beside the line of sight throws into it, by quadrature, up to a
 * black wall. */
static void test_airlight(void **state)
{
    const double g = 0.3, away = 4, beside = 1.5, along = 1.7, power = 5;
    const int steps = 200000;
    struct render_settings settings = narrow(256, 1);
    struct scene_medium m = medium_of(0.2f, 0.15f, (float)g);
    struct scene_builder b;
    struct scene_light *l;
    double expected[3] = {0, 0, 0};

    (void)state;
    for (int c = 0; c < 3; c++) {
        double s = 0.15 * (double)scattering[c], t = s + 0.2 * (double)absorbing[c];
        for (int i = 0; i < steps; i++) {
            double x = (i + 0.5) * away / steps, r = hypot(beside, along - x);
            /* the light flies from (along, beside) to (x, 0), the eye's path along +x */
            double cosine = (along - x) / r;
            expected[c] += s * power * henyey_greenstein(g, cosine) * exp(-t * (x + r)) / (r * r) * away / steps;
        }
    }
    builder_init(&b);
    foggy(&b, &m);
    builder_lambert(&b, 0);
    builder_place(&b, builder_quad(&b), 0, vec3_splat(9), vec3_splat(0));
    builder_camera(&b, vec3_make(0, (float)away, 0), vec3_splat(0), 0.0005f);
    l = builder_light(&b, LIGHT_POINT);
    l->position[0] = (float)beside;
    l->position[1] = (float)(away - along);
    l->intensity[0] = l->intensity[1] = l->intensity[2] = (float)power;
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "airlight");
    builder_release(&b);
}

/* Chandrasekhar's H(1) for isotropic scattering, from 1 / H(m) = sqrt(1 - albedo) + albedo / 2 *
 * integral over n of n H(n) / (m + n) ("Radiative Transfer", chapter 5), by iteration. */
static double chandrasekhar_h1(double albedo)
{
    enum { NODES = 2000, ROUNDS = 60 };
    static double h[NODES];
    double h1 = 1;

    for (int i = 0; i < NODES; i++)
        h[i] = 1;
    for (int round = 0; round < ROUNDS; round++) {
        double next[NODES];
        for (int i = 0; i <= NODES; i++) {
            double m = i < NODES ? (i + 0.5) / NODES : 1, sum = 0;
            for (int k = 0; k < NODES; k++) {
                double n = (k + 0.5) / NODES;
                sum += n * h[k] / (m + n);
            }
            sum = 1 / (sqrt(1 - albedo) + 0.5 * albedo * sum / NODES);
            if (i < NODES)
                next[i] = sum;
            else
                h1 = sum;
        }
        for (int i = 0; i < NODES; i++)
            h[i] = next[i];
    }
    return h1;
}

/* A medium so dense that free paths are shorter than the distance between floats, under a white
 * sky: 1 - H(1) sqrt(1 - albedo) comes back along the normal, however dense it is. */
static void test_dense(void **state)
{
    static const float depths[] = {1e4f, 1e6f, 1e7f, 1e8f, 1e9f};
    const double albedo = 0.75, expected = 1 - chandrasekhar_h1(albedo) * sqrt(1 - albedo);
    struct render_settings settings = narrow(64, 256);

    (void)state;
    for (size_t k = 0; k < sizeof depths / sizeof *depths; k++) {
        struct scene_medium m;
        struct scene_builder b;
        char what[64];

        scene_medium_default(&m);
        for (int c = 0; c < 3; c++) {
            m.scattering[c] = (float)albedo * depths[k];
            m.absorption[c] = (float)(1 - albedo) * depths[k];
        }
        slab_scene(&b, &m, HOMOGENEOUS);
        builder_environment_constant(&b, vec3_splat(1));
        snprintf(what, sizeof what, "optical radius %g", (double)depths[k]);
        radiance_expect(&b, &settings, COMPARISONS, expected, what);
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_beer_lambert),      cmocka_unit_test(test_glass_filled),
        cmocka_unit_test(test_single_scattering), cmocka_unit_test(test_emission),
        cmocka_unit_test(test_furnace),           cmocka_unit_test(test_fog_transmittance),
        cmocka_unit_test(test_fog_behind_a_face), cmocka_unit_test(test_airlight),          cmocka_unit_test(test_dense),
    };
    return cmocka_run_group_tests_name("media radiance", tests, NULL, NULL);
}
