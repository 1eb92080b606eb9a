/* Radiance against closed forms, by t-tests over independent frames.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons of this program;
 * seeds are fixed. Each comparison averages a picture per frame and tests the frames' mean. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"

enum { FRAMES = 24, COMPARISONS = 40 };

/* Mean over the picture's pixels and channels (or one pixel) of `frames` independent frames. */
static struct running_stats frame_means(struct scene_builder *b, const struct render_settings *settings)
{
    struct render_scene *scene = builder_build(b, settings);
    size_t n = (size_t)settings->width * settings->height * 3;
    double *mean = test_malloc(n * sizeof *mean);
    struct render_stats stats = {0};
    struct running_stats result = {0};

    for (uint32_t frame = 0; frame < FRAMES; frame++) {
        double sum = 0;
        builder_render(scene, settings, frame, mean, NULL, &stats);
        for (size_t i = 0; i < n; i++)
            sum += mean[i];
        running_stats_add(&result, sum / (double)n);
    }
    assert_int_equal(stats.work.dropped_samples, 0);
    test_free(mean);
    render_scene_free(scene);
    return result;
}

static void expect_mean(struct scene_builder *b, const struct render_settings *settings, double expected,
                        const char *what)
{
    struct running_stats s = frame_means(b, settings);
    double p = mean_test_p_value(&s, expected);

    /* Where nothing is random but the rounding of float, rounding is what is left. */
    if (fabs(s.mean - expected) <= 1e-5 * fabs(expected))
        return;
    if (p < sidak_alpha(0.01, COMPARISONS))
        fail_msg("%s: mean %.7g +- %.2g, expected %.7g (p = %.2g)", what, s.mean, running_stats_error(&s), expected, p);
}

static struct render_settings small(uint32_t spp) { return builder_settings(16, 16, spp); }

/* A white sphere in a constant environment cannot be seen, by any strategy. */
static void test_furnace_lambert(void **state)
{
    static const enum env_sampling modes[] = {ENV_SAMPLING_IMPORTANCE, ENV_SAMPLING_UNIFORM,
                                              ENV_SAMPLING_BSDF};
    static const float albedos[] = {1, 0.5f};

    (void)state;
    for (size_t m = 0; m < 3; m++)
        for (size_t a = 0; a < 2; a++) {
            struct scene_builder b;
            struct render_settings settings = small(16);
            settings.env_sampling = modes[m];
            settings.max_depth = 64;
            builder_init(&b);
            builder_lambert(&b, albedos[a]);
            builder_place(&b, builder_sphere(&b, 24, 0), 0, vec3_splat(1), vec3_splat(0));
            builder_environment_constant(&b, vec3_splat(1));
            /* The camera sees nothing but the sphere's middle. */
            builder_camera(&b, vec3_make(0, 0, 4), vec3_splat(0), 0.15f);
            expect_mean(&b, &settings, (double)albedos[a], env_sampling_name(modes[m]));
            builder_release(&b);
        }
}

/* The same inside a concave white room: every path is long, nothing may be lost. */
static void test_furnace_interreflection(void **state)
{
    struct scene_builder b;
    struct render_settings settings = small(32);
    struct scene_material *m;
    const double albedo = 0.7, emission = 0.5;

    (void)state;
    settings.max_depth = 200;
    builder_init(&b);
    m = builder_lambert(&b, (float)albedo);
    m->emission[0] = m->emission[1] = m->emission[2] = (float)emission;
    builder_place(&b, builder_sphere(&b, 16, 0), 0, vec3_splat(3), vec3_splat(0));
    builder_camera(&b, vec3_make(0.5f, 0.2f, 1), vec3_splat(0), 1);
    /* A closed cavity of uniform emission and albedo: L = Le / (1 - albedo). */
    expect_mean(&b, &settings, emission / (1 - albedo), "cavity");
    builder_release(&b);
}

/* Smooth glass in a furnace neither adds nor loses light. */
static void test_furnace_glass(void **state)
{
    struct scene_builder b;
    struct render_settings settings = small(32);
    struct scene_material *m;

    (void)state;
    settings.max_depth = 256;
    builder_init(&b);
    m = builder_lambert(&b, 1);
    m->specular = 1;
    m->transmission = 1;
    m->roughness = 0;
    m->refractive = 1;
    m->ior = 1.5f;
    builder_place(&b, builder_sphere(&b, 32, 1), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, 0, 4), vec3_splat(0), 0.3f);
    expect_mean(&b, &settings, 1, "smooth glass");
    builder_release(&b);
}

/* A slab of clear glass with an absorbing colour, looked at head on: Beer-Lambert with the
 * series of inner reflections in closed form. */
static void test_absorbing_slab(void **state)
{
    static const float positions[24] = {-9, -1, -9, 9, -1, -9, 9, -1, 9, -9, -1, 9,
                                        -9, 1,  -9, 9, 1,  -9, 9, 1,  9, -9, 1,  9};
    static const uint32_t indices[12] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6};
    struct scene_builder b;
    struct render_settings settings = small(64);
    struct scene_material *m;
    double r = pow((1.5 - 1) / (1.5 + 1), 2), t = pow(0.25, 2.0 / 4.0);
    double through = (1 - r) * (1 - r) * t / (1 - r * r * t * t);
    double back = r + (1 - r) * (1 - r) * r * t * t / (1 - r * r * t * t);

    (void)state;
    settings.max_depth = 100;
    builder_init(&b);
    m = builder_lambert(&b, 1);
    m->specular = 1;
    m->transmission = 1;
    m->roughness = 0;
    m->refractive = 1;
    m->ior = 1.5f;
    m->attenuation_distance = 4;
    m->attenuation_color[0] = m->attenuation_color[1] = m->attenuation_color[2] = 0.25f;
    builder_place(&b, builder_mesh(&b, positions, NULL, 8, indices, 4, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0.3f, 5, 0.1f), vec3_make(0.3f, 0, 0.1f), 0.002f);
    expect_mean(&b, &settings, through + back, "absorbing slab");
    builder_release(&b);
}

/* Form factor of a differential element to a parallel rectangle a x b with a corner straight
 * above it at distance c (Siegel and Howell, C-11 of Howell's catalogue). */
static double corner_form_factor(double a, double b, double c)
{
    double x = a / c, y = b / c;

    return (x / sqrt(1 + x * x) * atan(y / sqrt(1 + x * x)) + y / sqrt(1 + y * y) * atan(x / sqrt(1 + y * y))) /
           (2 * M_PI);
}

static void square_lamp(struct scene_builder *b, float height, float half, int double_sided)
{
    struct scene_material *m;
    uint32_t quad = builder_quad(b);

    builder_lambert(b, 0.6f);
    builder_place(b, quad, 0, vec3_make(50, 1, 50), vec3_splat(0));
    m = builder_lambert(b, 0);
    m->double_sided = double_sided;
    m->emission[0] = m->emission[1] = m->emission[2] = 10;
    /* Scale -1 in y turns the lamp's front downwards: a mirrored instance. */
    builder_place(b, quad, 1, vec3_make(half, -1, half), vec3_make(0, height, 0));
}

/* Irradiance of a Lambertian plane under a square lamp. */
static void test_square_lamp(void **state)
{
    (void)state;
    for (int variant = 0; variant < 2; variant++) {
        struct scene_builder b;
        struct render_settings settings = small(64);
        double expected = 0.6 * 10 * 4 * corner_form_factor(1.5, 1.5, 2);

        settings.max_depth = 1;
        builder_init(&b);
        square_lamp(&b, 2, 1.5f, variant);
        builder_camera(&b, vec3_make(0, 1.9f, 0.0f), vec3_splat(0), 0.004f);
        expect_mean(&b, &settings, expected, variant ? "two-sided lamp" : "lamp");
        builder_release(&b);
    }
}

/* The same lamp grazing a wall beside it, against quadrature over the lamp. */
static void test_grazing_lamp(void **state)
{
    struct scene_builder b;
    struct render_settings settings = small(64);
    struct scene_instance *wall;
    const int steps = 500;
    double sum = 0;

    (void)state;
    for (int i = 0; i < steps; i++)
        for (int j = 0; j < steps; j++) {
            double x = 0.5 * (2 * (i + 0.5) / steps - 1) + 2, y = 0.1, z = 0.5 * (2 * (j + 0.5) / steps - 1);
            double r2 = x * x + y * y + z * z;
            sum += x * y / (r2 * r2) / steps / steps;
        }
    settings.max_depth = 1;
    builder_init(&b);
    square_lamp(&b, 2, 0.5f, 0);
    wall = builder_place(&b, 0, 0, vec3_splat(1), vec3_splat(0));
    wall->to_world = (struct transform_d){{{0, 1, 0, -2}, {3, 0, 0, 0}, {0, 0, 3, 0}}};
    builder_camera(&b, vec3_make(0, 1.9f, 0), vec3_make(-2, 1.9f, 0), 0.004f);
    expect_mean(&b, &settings, 0.6 / M_PI * 10 * sum, "grazing lamp");
    builder_release(&b);
}

/* The lamp seen from behind is dark unless it is double-sided (then culling shows nothing). */
static void test_lamp_back_is_dark(void **state)
{
    struct scene_builder b;
    struct render_settings settings = small(8);

    (void)state;
    settings.max_depth = 1;
    builder_init(&b);
    square_lamp(&b, 2, 1.5f, 0);
    b.scene.instances[1].to_world.m[1][1] = 1; /* shines upwards now */
    builder_camera(&b, vec3_make(0, 1.9f, 0), vec3_splat(0), 0.004f);
    expect_mean(&b, &settings, 0, "lamp turned away");
    builder_release(&b);
}

static void lit_plane(struct scene_builder *b)
{
    builder_init(b);
    builder_lambert(b, 0.8f);
    builder_place(b, builder_quad(b), 0, vec3_make(50, 1, 50), vec3_splat(0));
    builder_camera(b, vec3_make(0, 3, 0), vec3_splat(0), 0.002f);
}

static void test_punctual_lights(void **state)
{
    struct render_settings settings = small(4);
    struct scene_builder b;
    struct scene_light *l;

    (void)state;
    settings.max_depth = 1;

    lit_plane(&b);
    l = builder_light(&b, LIGHT_POINT);
    l->position[1] = 2;
    l->position[0] = 1.5f;
    l->intensity[0] = l->intensity[1] = l->intensity[2] = 7;
    /* distance 2.5, cosine 0.8 */
    expect_mean(&b, &settings, 0.8 / M_PI * 7 * 0.8 / 6.25, "point light");
    l->range = 5;
    expect_mean(&b, &settings, 0.8 / M_PI * 7 * 0.8 / 6.25 * (1 - 0.0625), "point light with range");
    builder_release(&b);

    lit_plane(&b);
    l = builder_light(&b, LIGHT_DIRECTIONAL);
    l->direction[0] = 0.6f;
    l->direction[1] = -0.8f;
    l->intensity[0] = l->intensity[1] = l->intensity[2] = 3;
    expect_mean(&b, &settings, 0.8 / M_PI * 3 * 0.8, "directional light");
    builder_release(&b);

    lit_plane(&b);
    l = builder_light(&b, LIGHT_SPOT);
    l->position[1] = 2;
    l->intensity[0] = l->intensity[1] = l->intensity[2] = 5;
    l->inner_cone_rad = 0.2f;
    l->outer_cone_rad = 0.6f;
    expect_mean(&b, &settings, 0.8 / M_PI * 5 / 4, "spot light, inside the inner cone");
    l->direction[0] = sinf(0.4f);
    l->direction[1] = -cosf(0.4f);
    {
        double f = (cos(0.4) - cos(0.6)) / (cos(0.2) - cos(0.6));
        expect_mean(&b, &settings, 0.8 / M_PI * 5 / 4 * f * f, "spot light, in the penumbra");
    }
    builder_release(&b);
}

/* Two lights at once: the odds of choosing cancel. */
static void test_light_mixture(void **state)
{
    struct render_settings settings = small(64);
    struct scene_builder b;
    struct scene_light *l;
    double lamp = 0.6 * 10 * 4 * corner_form_factor(1.5, 1.5, 2);

    (void)state;
    settings.max_depth = 1;
    builder_init(&b);
    square_lamp(&b, 2, 1.5f, 1);
    l = builder_light(&b, LIGHT_POINT);
    l->position[1] = 1;
    l->intensity[0] = l->intensity[1] = l->intensity[2] = 4;
    builder_environment_constant(&b, vec3_splat(0.5f));
    builder_camera(&b, vec3_make(0, 0.9f, 0), vec3_splat(0), 0.004f);
    /* The environment reaches the plane past the lamp: 1 - F of the hemisphere. */
    expect_mean(&b, &settings, lamp + 0.6 / M_PI * 4 + 0.6 * 0.5 * (1 - 4 * corner_form_factor(1.5, 1.5, 2)),
                "lamp, point light and environment");
    builder_release(&b);
}

/* Irradiance from a map with one bright patch of known solid angle, by every strategy. */
static void test_environment_patch(void **state)
{
    enum { W = 32, H = 16 };
    static float map[H * W * 3];
    double expected = 0;
    const int steps = 400;

    (void)state;
    for (int x = 8; x < 14; x++)
        for (int y = 1; y < 5; y++)
            map[(y * W + x) * 3] = map[(y * W + x) * 3 + 1] = map[(y * W + x) * 3 + 2] = 20;
    /* Quadrature of the bilinear map times cosine over the upper hemisphere. */
    for (int i = 0; i < steps; i++)
        for (int j = 0; j < 2 * steps; j++) {
            double v = (i + 0.5) / steps / 2, u = (j + 0.5) / (2 * steps);
            double fx = u * W - 0.5, fy = v * H - 0.5, theta = v * M_PI;
            int x0 = (int)floor(fx), y0 = (int)floor(fy);
            double ax = fx - x0, ay = fy - y0, sum = 0;
            for (int dy = 0; dy < 2; dy++)
                for (int dx = 0; dx < 2; dx++) {
                    int x = (x0 + dx + W) % W, y = y0 + dy;
                    if (y < 0) {
                        y = 0;
                        x = (x + W / 2) % W;
                    }
                    sum += (double)map[(y * W + x) * 3] * (dx ? ax : 1 - ax) * (dy ? ay : 1 - ay);
                }
            expected += sum * cos(theta) * sin(theta) * (M_PI / 2 / steps) * (M_PI / steps);
        }
    for (int mode = 0; mode < ENV_SAMPLING_COUNT; mode++) {
        struct render_settings settings = small(mode == ENV_SAMPLING_IMPORTANCE ? 64 : 256);
        struct scene_builder b;

        settings.max_depth = 1;
        settings.env_sampling = (enum env_sampling)mode;
        settings.env_strength = 0.5f;
        settings.env_rotate_deg = 33; /* about +Y: the plane's irradiance does not change */
        lit_plane(&b);
        builder_environment_map(&b, map, W, H);
        expect_mean(&b, &settings, 0.8 / M_PI * expected * 0.5, env_sampling_name((enum env_sampling)mode));
        builder_release(&b);
    }
}

/* Coverage by alpha is met by camera, light and bounced rays alike. */
static void test_alpha_blend(void **state)
{
    struct render_settings settings = small(64);
    struct scene_builder b;
    struct scene_material *m;

    (void)state;
    settings.max_depth = 4;
    lit_plane(&b);
    m = builder_lambert(&b, 0);
    m->alpha_mode = ALPHA_BLEND;
    m->base_color[3] = 0.25f;
    /* A black veil of coverage 0.25 between the plane and the sky, under the camera's ray. */
    builder_place(&b, 0, 1, vec3_make(100, 1, 100), vec3_make(0, 0.5f, 0));
    builder_environment_constant(&b, vec3_splat(1));
    /* 0.75 on the way in and 0.75 for the light; the veil's horizon is far outside. */
    expect_mean(&b, &settings, 0.75 * 0.8 * 0.75, "veil");
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_furnace_lambert),     cmocka_unit_test(test_furnace_interreflection),
        cmocka_unit_test(test_furnace_glass),       cmocka_unit_test(test_absorbing_slab),
        cmocka_unit_test(test_square_lamp),         cmocka_unit_test(test_grazing_lamp),
        cmocka_unit_test(test_lamp_back_is_dark),
        cmocka_unit_test(test_punctual_lights),     cmocka_unit_test(test_light_mixture),
        cmocka_unit_test(test_environment_patch),   cmocka_unit_test(test_alpha_blend),
    };
    return cmocka_run_group_tests_name("radiance", tests, NULL, NULL);
}
