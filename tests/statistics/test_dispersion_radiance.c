/* Dispersion in whole pictures: where a prism sends each wavelength, and that white stays white.
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
#include "worker/render/bsdf/dispersion.h"

enum { COMPARISONS = 40 };

#define INDEX 1.6f
#define ABBE 20.0 /* dispersion 1 */
#define WEDGE 0.5 /* radians between the faces */
#define FALL 5.0  /* metres from the far face to the lamp */

static struct scene_material *flint(struct scene_builder *b)
{
    struct scene_material *m = builder_lambert(b, 1);

    m->double_sided = 0;
    m->specular = m->transmission = 1;
    m->roughness = 0;
    m->refractive = 1;
    m->ior = INDEX;
    m->dispersion = (float)(20 / ABBE);
    return m;
}

/* Cauchy's formula with two terms, through the Fraunhofer lines d (587.56 nm), F (486.13 nm) and
 * C (656.27 nm): (n_d - 1) / (n_F - n_C) is the Abbe number. */
static double cauchy(double nm)
{
    const double d = 587.56, f = 486.13, c = 656.27, n = (double)INDEX;
    double slope = (n - 1) / ABBE / (1 / (f * f) - 1 / (c * c));

    return n + slope * (1 / (nm * nm) - 1 / (d * d));
}

/* Unpolarised Fresnel transmittance from inside, by the angles. */
static double leaves(double n, double angle)
{
    double out = asin(n * sin(angle)), s, p;

    s = (n * cos(angle) - cos(out)) / (n * cos(angle) + cos(out));
    p = (n * cos(out) - cos(angle)) / (n * cos(out) + cos(angle));
    return 1 - 0.5 * (s * s + p * p);
}

/* How far from straight below light of this index falls. */
static double landing(double n) { return FALL * tan(asin(n * sin(WEDGE)) - WEDGE); }

/* A wedge: light enters its upper face, y = 1, head on, and leaves the lower one through the
 * point (0, -1, 0) towards -x, to a lamp whose edge is at -edge. */
static void wedge_scene(struct scene_builder *b, double edge, int beyond)
{
    const float slope = (float)tan(WEDGE), w = 2;
    const float positions[24] = {-w, -1 - w * slope, -w, w, -1 + w * slope, -w, w, -1 + w * slope, w,
                                 -w, -1 - w * slope, w,  -w, 1, -w, w, 1, -w, w, 1, w, -w, 1, w};
    static const uint32_t indices[12] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6};
    struct scene_material *m;

    builder_init(b);
    flint(b);
    builder_place(b, builder_mesh(b, positions, NULL, 8, indices, 4, 0), 0, vec3_splat(1), vec3_splat(0));
    m = builder_lambert(b, 0);
    m->emission[0] = m->emission[1] = m->emission[2] = 1;
    /* two metres wide, on one side of the edge */
    builder_place(b, builder_quad(b), 1, vec3_splat(1),
                  vec3_make((float)(-edge + (beyond ? -1 : 1)), (float)(-1 - FALL), 0));
    builder_camera(b, vec3_make(0, 3, 0), vec3_splat(0), 1e-5f);
}

static void test_prism(void **state)
{
    /* The edge, as where light of this wavelength falls. */
    static const double edges[] = {587.56, 500, 620};
    const int steps = 200000;
    double enters = 0;

    (void)state;
    for (size_t k = 0; k < 3; k++) {
        double edge = landing(cauchy(edges[k])), sides[2][3] = {{0}};
        for (int i = 0; i < steps; i++) {
            struct vec3 rgb;
            double nm = (double)wavelength_sample((float)((i + 0.5) / steps), &rgb);
            double n = cauchy(nm), gets;
            double *side = sides[landing(n) > edge];
            enters = 1 - pow((n - 1) / (n + 1), 2);
            gets = enters * leaves(n, WEDGE) / steps;
            side[0] += (double)rgb.x * gets;
            side[1] += (double)rgb.y * gets;
            side[2] += (double)rgb.z * gets;
        }
        /* Blue is bent more than red. */
        assert_true(sides[1][2] > sides[1][0] && sides[0][0] > sides[0][2]);
        for (int beyond = 0; beyond < 2; beyond++) {
            struct render_settings settings = builder_settings(8, 8, 256);
            struct scene_builder b;
            settings.max_depth = 2;
            wedge_scene(&b, edge, beyond);
            radiance_expect_rgb(&b, &settings, COMPARISONS, sides[beyond],
                                beyond ? "bent more than the edge" : "bent less");
            builder_release(&b);
        }
    }
    {
        /* All of it goes where n_d says when there is no dispersion. */
        struct render_settings settings = builder_settings(8, 8, 16);
        double n = (double)INDEX, at = landing(n);
        struct scene_builder b;
        settings.max_depth = 2;
        settings.without = EFFECT_DISPERSION;
        wedge_scene(&b, at - 1e-3, 1);
        enters = 1 - pow((n - 1) / (n + 1), 2);
        radiance_expect(&b, &settings, COMPARISONS, enters * leaves(n, WEDGE), "bent by n_d, just beyond the edge");
        builder_release(&b);
        wedge_scene(&b, at + 1e-3, 1);
        radiance_expect(&b, &settings, COMPARISONS, 0, "bent by n_d, just short of it");
        builder_release(&b);
    }
}

/* A lamp of no size inside a dispersive body with a rough face, seen through that face from the side:
 * only light sampling finds it, and how much the face refracts towards the camera depends on the index. What
 * is seen is the mean, over the wavelengths with their colours, of what a body without dispersion shows that
 * has each wavelength's index. */
static void rough_scene(struct scene_builder *b, double index)
{
    struct scene_material *m;
    struct scene_light *lamp;

    builder_init(b);
    m = flint(b);
    m->roughness = 0.3f;
    if (index > 0) {
        m->ior = (float)index;
        m->dispersion = 0;
    } else {
        m->dispersion = 3; /* Abbe number 6.7: indices 1.55 to 1.79 */
    }
    builder_place(b, builder_quad(b), 0, vec3_make(10, 1, 10), vec3_splat(0));
    lamp = builder_light(b, LIGHT_POINT);
    lamp->position[0] = -0.35;
    lamp->position[1] = -1;
    lamp->intensity[0] = lamp->intensity[1] = lamp->intensity[2] = 1;
    builder_camera(b, vec3_make(1.2f, 1, 0), vec3_splat(0), 1e-4f);
}

static void test_rough_face(void **state)
{
    enum { STEPS = 400 };
    struct render_settings settings = builder_settings(8, 8, 256);
    struct scene_builder b;
    double expected[3] = {0}, plain = 0;

    (void)state;
    settings.max_depth = 1;
    for (int i = 0; i < STEPS; i++) {
        struct render_settings one = builder_settings(1, 1, 512);
        struct render_scene *scene;
        struct render_stats stats = {0};
        struct vec3 rgb;
        float nm = wavelength_sample((float)((i + 0.5) / STEPS), &rgb);
        double mean[3];

        one.max_depth = 1;
        rough_scene(&b, (double)dispersion_ior(INDEX, 3, nm));
        scene = builder_build(&b, &one);
        builder_render(scene, &one, 0, mean, NULL, &stats);
        render_scene_free(scene);
        builder_release(&b);
        expected[0] += (double)rgb.x * mean[0] / STEPS;
        expected[1] += (double)rgb.y * mean[1] / STEPS;
        expected[2] += (double)rgb.z * mean[2] / STEPS;
        plain += mean[0] / STEPS;
    }
    /* Without the wavelengths' colours it would be grey. */
    assert_true(fabs(expected[0] / plain - 1) > 0.05 && fabs(expected[2] / plain - 1) > 0.05);
    rough_scene(&b, 0);
    radiance_expect_rgb(&b, &settings, COMPARISONS, expected, "lamp behind a rough face");
    builder_release(&b);
}

/* A dispersive ball in a white furnace cannot be seen. */
static void test_furnace(void **state)
{
    struct render_settings settings = builder_settings(8, 8, 256);
    struct scene_builder b;

    (void)state;
    settings.max_depth = 256;
    builder_init(&b);
    flint(&b)->dispersion = 5;
    builder_place(&b, builder_sphere(&b, 32, 1), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, 0, 4), vec3_splat(0), 0.3f);
    radiance_expect(&b, &settings, COMPARISONS, 1, "dispersive ball");
    builder_release(&b);
}

/* Half of the time a black card hides a dispersive slab in a white furnace: the other half shows all
 * wavelengths, so that grey is seen. */
static void test_shutter(void **state)
{
    static const float times[2] = {0, 1}, path[6] = {-20, 2, 0, 0, 2, 0};
    struct render_settings settings = builder_settings(8, 8, 256);
    struct scene_builder b;

    (void)state;
    settings.max_depth = 64;
    settings.fps = settings.shutter = 1;
    builder_init(&b);
    flint(&b)->dispersion = 5;
    builder_place(&b, builder_slab(&b), 0, vec3_make(50, 1, 50), vec3_splat(0));
    builder_lambert(&b, 0);
    builder_place(&b, builder_quad(&b), 1, vec3_make(10, 1, 10), vec3_splat(0))->node = (int32_t)builder_node(&b, -1, 0);
    b.scene.nodes[0].scale[0] = b.scene.nodes[0].scale[2] = 10;
    builder_channel(&b, 0, PATH_TRANSLATION, 2, times, path);
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, 4, 0), vec3_splat(0), 1e-4f);
    radiance_expect(&b, &settings, COMPARISONS, 0.5, "slab hidden half of the time");
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_prism),
        cmocka_unit_test(test_rough_face),
        cmocka_unit_test(test_furnace),
        cmocka_unit_test(test_shutter),
    };
    return cmocka_run_group_tests_name("dispersion radiance", tests, NULL, NULL);
}
