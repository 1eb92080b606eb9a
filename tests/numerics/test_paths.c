/* Hard cases of paths: densities and throughputs near the ends of floats, in small pictures against
 * closed forms. Seeds are fixed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/figure.h"
#include "tests/support/slabs.h"
#include "tests/support/statistics.h"
#include "worker/render/base/sampler.h"

enum { SIZE = 8, PIXELS = SIZE * SIZE };

struct picture {
    double mean, largest, deviation /* of pixels from 1, root mean square */;
    struct render_stats stats;
};

static struct picture render(struct scene_builder *b, uint32_t spp, uint32_t depth)
{
    struct render_settings settings = builder_settings(SIZE, SIZE, spp);
    double rgb[PIXELS * 3];
    struct picture out = {0};
    struct render_scene *scene;

    settings.max_depth = depth;
    scene = builder_build(b, &settings);
    builder_render(scene, &settings, 0, rgb, NULL, &out.stats);
    for (int i = 0; i < PIXELS; i++) {
        double green = rgb[3 * i + 1];
        out.mean += green / PIXELS;
        out.largest = fmax(out.largest, green);
        out.deviation += (green - 1) * (green - 1) / PIXELS;
    }
    out.deviation = sqrt(out.deviation);
    render_scene_free(scene);
    builder_release(b);
    return out;
}

/* A square lamp of 4e-20 square metres, 2 m over a matt floor: light sampling finds it with a density
 * of 1e20 per steradian, whose square is no float. */
static void tiny_lamps_give_their_light(void **state)
{
    const double edge = 2e-10, radiance = 1e20;
    struct scene_builder b;
    struct scene_material *m;
    struct picture p;

    (void)state;
    builder_init(&b);
    builder_lambert(&b, 0.5f);
    builder_place(&b, builder_quad(&b), 0, vec3_make(10, 1, 10), vec3_splat(0));
    m = builder_lambert(&b, 0);
    m->double_sided = 0;
    m->emission[0] = m->emission[1] = m->emission[2] = (float)radiance;
    builder_place(&b, builder_quad(&b), 1, vec3_make(1e-10f, -1, 1e-10f), vec3_make(0, 2, 0));
    builder_camera(&b, vec3_make(1, 3, 0), vec3_splat(0), 0.0005f);
    p = render(&b, 64, 1);
    figure_within("floor below a lamp of 4e-20 m2, over its closed form",
                  p.mean / (0.5 / M_PI * radiance * edge * edge / 4), 0.9999, 1.0001, "closed form, tolerance 1e-4");
    figure_within("samples of it that are dropped", (double)p.stats.work.dropped_samples, 0, 0, "exact");
}

/* Three reflections by metal of colour .1, seen at 45 degrees; the sky is as bright as they are dark. */
static void dark_mirrors_have_no_bright_pixels(void **state)
{
    const double once = 0.1 + 0.9 * pow(1 - M_SQRT1_2, 5);
    struct scene_builder b;
    struct scene_material *m;
    struct picture p;
    uint32_t quad;

    (void)state;
    builder_init(&b);
    m = builder_lambert(&b, 0.1f);
    m->metallic = 1;
    m->roughness = 0;
    quad = builder_quad(&b);
    builder_place(&b, quad, 0, vec3_make(3.5f, 1, 4), vec3_make(2.5f, 0, 0));
    builder_place(&b, quad, 0, vec3_make(3.5f, -1, 4), vec3_make(2.5f, 2, 0));
    builder_camera(&b, vec3_make(0, 1, 0), vec3_make(1, 0, 0), 0.01f);
    builder_environment_constant(&b, vec3_splat((float)pow(once, -3)));
    p = render(&b, 64, 8);
    figure_within("brightest pixel of a sky of mean 1 in three dark mirrors", p.largest, 0.5, 3,
                  "bound 3: 64 samples, none above 20");
}

/* Every path through clear glass brings a white sky's 1: nothing is random but its way. */
static void clear_glass_has_no_noise(void **state)
{
    struct scene_builder b;
    struct picture p;

    (void)state;
    builder_init(&b);
    slabs_glass(&b, 2.4f, INFINITY);
    builder_place(&b, builder_sphere(&b, 12, 0), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, 0, 3), vec3_splat(0), 0.4f);
    p = render(&b, 64, 1000);
    figure_within("deviation of a clear glass ball's pixels from the white sky", p.deviation, 0, 0.005,
                  "closed form 0, bound .005");
}

/* Rough glass that hardly bends light samples directions, one in 5,000, in which floats find no
 * density: they end the path, and the sample keeps what it has. */
static void rough_glass_drops_no_sample(void **state)
{
    struct scene_builder b;
    struct picture p;

    (void)state;
    builder_init(&b);
    slabs_glass(&b, 1.0001002f, INFINITY)->roughness = 1;
    builder_place(&b, builder_sphere(&b, 12, 1), 0, vec3_splat(1), vec3_splat(0));
    builder_environment_constant(&b, vec3_splat(1));
    builder_camera(&b, vec3_make(0, 0, 3), vec3_splat(0), 0.7f);
    p = render(&b, 1024, 100);
    figure_within("samples of rough glass that are dropped, of 65,536", (double)p.stats.work.dropped_samples, 0, 0, "exact");
}

/* The mean of the product of two decisions' numbers is the product of their means, 1/4. */
static void decisions_of_a_path_are_independent(void **state)
{
    enum { PIXELS_WIDE = 64, SAMPLES = 16, PAIRS = 3 };
    static const uint32_t PAIR[PAIRS][2] = {
        {DIMENSION_VERTEX + VERTEX_BSDF, DIMENSION_VERTEX + VERTEX_LIGHT_POINT},
        {DIMENSION_VERTEX + VERTEX_BSDF, DIMENSION_VERTEX + DIMENSIONS_PER_VERTEX + VERTEX_BSDF},
        {DIMENSION_PIXEL, DIMENSION_LENS},
    };
    static const char *const WHAT[PAIRS] = {"direction and light", "directions of two vertices",
                                            "places on pixel and lens"};

    (void)state;
    for (int k = 0; k < PAIRS; k++) {
        struct running_stats s = {0};
        char what[96];
        for (uint32_t i = 0; i < PIXELS_WIDE * PIXELS_WIDE; i++) {
            double sum = 0;
            for (uint32_t n = 0; n < SAMPLES; n++) {
                struct sampler sampler;
                sampler_start(&sampler, 7, 0, i % PIXELS_WIDE, i / PIXELS_WIDE, 0, n);
                sum += (double)sampler_get(&sampler, PAIR[k][0]).u * (double)sampler_get(&sampler, PAIR[k][1]).u;
            }
            running_stats_add(&s, sum / SAMPLES);
        }
        snprintf(what, sizeof what, "mean product of the random numbers: %s", WHAT[k]);
        figure_z(what, s.mean, running_stats_error(&s), 0.25, 1e-4, PAIRS);
    }
}

/* Of each 1,024 points one lies in each interval of 1/1,024, and none at 1, which no table of
 * probabilities has. */
static void random_numbers_keep_their_intervals(void **state)
{
    enum { POINTS = 1024, SEQUENCES = 1024 };
    unsigned wrong = 0;

    (void)state;
    for (uint32_t k = 0; k < SEQUENCES; k++) {
        uint8_t found[POINTS + 1] = {0};
        for (uint32_t n = 0; n < POINTS; n++)
            found[(uint32_t)(sobol_owen_2d(n, hash_u64(k)).u * POINTS)]++;
        for (int i = 0; i <= POINTS; i++)
            wrong += found[i] != (i < POINTS);
    }
    figure_within("intervals of 1/1024 without one of 1,024 points, of 2^20", wrong, 0, 0, "exact");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tiny_lamps_give_their_light),
        cmocka_unit_test(dark_mirrors_have_no_bright_pixels),
        cmocka_unit_test(clear_glass_has_no_noise),
        cmocka_unit_test(rough_glass_drops_no_sample),
        cmocka_unit_test(decisions_of_a_path_are_independent),
        cmocka_unit_test(random_numbers_keep_their_intervals),
    };
    return cmocka_run_group_tests_name("hard cases of paths", tests, NULL, NULL);
}
