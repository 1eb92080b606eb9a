/* Hard cases of media, as pictures or counts: each notices the loss of one safeguard
 * (common/base/safeguard.h; docs/NUMERICS.md). Steps in dense media: statistics/test_dense_media.c.
 *
 * Family-wise significance 0.01, Sidak-corrected over all comparisons; seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/radiance.h"

enum { COMPARISONS = 9 };

static struct render_settings narrow(uint32_t spp)
{
    struct render_settings s = builder_settings(8, 8, spp);

    s.max_depth = 1;
    return s;
}

static void set3(float out[3], float value) { out[0] = out[1] = out[2] = value; }

/* A slab of the builder's first medium from y = -1 to 1, looked at along -y by parallel rays. */
static struct scene_medium *slab_scene(struct scene_builder *b)
{
    struct scene_material *wall;
    struct scene_medium *medium;
    struct scene_camera *camera;

    builder_init(b);
    medium = builder_medium(b);
    wall = builder_lambert(b, 0);
    wall->kind = MATERIAL_INTERFACE;
    wall->medium = 0;
    builder_place(b, builder_slab(b), 0, vec3_make(10, 1, 10), vec3_splat(0));
    builder_camera(b, vec3_make(0.3f, 5, 0.1f), vec3_make(0.3f, 0, 0.1f), 0.002f);
    camera = &b->scene.cameras[0];
    camera->kind = CAMERA_ORTHOGRAPHIC;
    camera->xmag = camera->ymag = 0.01f;
    return medium;
}

/* ---- homogeneous ------------------------------------------------------------------------------ */

/* One sheet only: behind it the medium has no end. It absorbs nothing but red. */
static void test_clear_channel(void **state)
{
    struct render_settings settings = narrow(4);
    struct scene_medium *medium;
    struct scene_builder b;

    (void)state;
    medium = slab_scene(&b);
    medium->absorption[0] = 1;
    b.scene.instances[0].mesh = builder_quad(&b);
    builder_environment_constant(&b, vec3_splat(1));
    radiance_figure(&b, &settings, COMPARISONS, 1, 1, "green through an endless medium that absorbs red");
    builder_release(&b);
}

static void test_thin_glow(void **state)
{
    struct render_settings settings = narrow(4);
    struct scene_medium *medium;
    struct scene_builder b;

    (void)state;
    medium = slab_scene(&b);
    set3(medium->absorption, 1e-9f);
    set3(medium->emission, 0.7f);
    radiance_figure(&b, &settings, COMPARISONS, 0, 1.4, "glow of 2 m with an absorption of 1e-9");
    builder_release(&b);
}

/* Light scattered once, straight ahead. */
static void test_forward_peak(void **state)
{
    const double g = (double)0.999f, density = 0.5, irradiance = 1e-5;
    struct render_settings settings = narrow(16);
    struct scene_medium *medium;
    struct scene_light *sun;
    struct scene_builder b;

    (void)state;
    medium = slab_scene(&b);
    set3(medium->scattering, (float)density);
    medium->g = (float)g;
    sun = builder_light(&b, LIGHT_DIRECTIONAL);
    sun->direction[1] = 1;
    sun->intensity[0] = (float)irradiance;
    radiance_figure(&b, &settings, COMPARISONS, 0,
                    irradiance * 2 * density * exp(-2 * density) * (1 + g) / (4 * M_PI * (1 - g) * (1 - g)),
                    "forward peak of a phase function of 0.999");
    builder_release(&b);
}

/* A ball is opaque at an optical radius of 1000; at 1e9 a free path is a hundredth of the spacing of
 * floats, and it must look the same. */
static void test_dense_ball(void **state)
{
    struct render_settings settings = narrow(32);
    struct running_stats seen[2][3];

    (void)state;
    settings.max_depth = 1024;
    for (int i = 0; i < 2; i++) {
        struct scene_builder b;
        struct scene_medium *medium = slab_scene(&b);
        float density = i ? 1e9f : 1e3f;

        set3(medium->scattering, 0.9f * density);
        set3(medium->absorption, 0.1f * density);
        b.scene.instances[0].mesh = builder_sphere(&b, 4, 0);
        b.scene.instances[0].to_world.m[0][0] = b.scene.instances[0].to_world.m[2][2] = 1;
        builder_environment_constant(&b, vec3_splat(1));
        radiance_measure(&b, &settings, seen[i]);
        builder_release(&b);
    }
    figure_z("radiance of an opaque ball of a medium, at an optical radius of 1e9", seen[1][0].mean,
             hypot(running_stats_error(&seen[0][0]), running_stats_error(&seen[1][0])), seen[0][0].mean,
             RADIANCE_SIGNIFICANCE, COMPARISONS);
}

/* ---- grids ------------------------------------------------------------------------------------ */

/* Sixteen cells along y; what the walls transmit of a white sky. */
static void grid_scene(struct scene_builder *b, const float density[16], float absorption)
{
    static const uint32_t size[3] = {1, 16, 1};
    struct scene_medium *medium = slab_scene(b);

    set3(medium->absorption, absorption);
    builder_grid(b, medium, density, size, vec3_make(-11, -1, -11), vec3_make(11, 1, 11));
    builder_environment_constant(b, vec3_splat(1));
}

/* The ninth cell begins the second block; interpolation spreads an eighth of it into the first. */
static void test_block_edge(void **state)
{
    static const float density[16] = {[8] = 8};
    struct render_settings settings = narrow(64);
    struct scene_builder b;

    (void)state;
    grid_scene(&b, density, 3);
    radiance_figure(&b, &settings, COMPARISONS, 0, exp(-3), "transmittance of one cell at a block's edge");
    builder_release(&b);
}

static void test_along_an_axis(void **state)
{
    struct render_settings settings = narrow(16);
    struct scene_builder b;
    float density[16];

    (void)state;
    for (int i = 0; i < 16; i++)
        density[i] = 1;
    grid_scene(&b, density, 0.5f);
    radiance_figure(&b, &settings, COMPARISONS, 0, exp(-1), "transmittance of a grid along an axis");
    builder_release(&b);
}

/* Cells that are no density count as 0: a ramp of half a cell remains on each side. */
static void test_bad_cells(void **state)
{
    static const float bad[3] = {NAN, -5, -INFINITY};
    struct render_settings settings = narrow(16);
    double expected = exp(-0.5 * 2 * 13 / 16);

    (void)state;
    for (int i = 0; i < 3; i++) {
        struct scene_builder b;
        float density[16];

        for (int k = 0; k < 16; k++)
            density[k] = k == 3 || k == 4 || k == 5 ? bad[i] : 1;
        grid_scene(&b, density, 0.5f);
        radiance_figure(&b, &settings, COMPARISONS, 0, expected, "transmittance of a grid with three bad cells");
        builder_release(&b);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clear_channel), cmocka_unit_test(test_thin_glow),
        cmocka_unit_test(test_forward_peak),  cmocka_unit_test(test_dense_ball),
        cmocka_unit_test(test_block_edge),    cmocka_unit_test(test_along_an_axis),
        cmocka_unit_test(test_bad_cells),
    };

    return cmocka_run_group_tests_name("hard media", tests, NULL, NULL);
}
