/* A room with a window: light sampled through a portal gives the same picture as light sampled
 * by the map alone, with less variance; directions that miss every portal are found as well.
 * Family-wise level 0.01, Sidak. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/math/elementary.h"
#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"
#include "worker/render/render_scene.h"

enum { FRAMES = 60, WIDTH = 32, HEIGHT = 16, CASES = 3, TESTS = 2 * CASES };

static float map[WIDTH * HEIGHT * 3];

/* The cube -1..1 with a hole of 0.4 x 0.4 in the wall at x = 1, built of quads. */
static void room(struct scene_builder *b)
{
    static const float quads[9][4][3] = {
        {{-1, -1, -1}, {1, -1, -1}, {1, -1, 1}, {-1, -1, 1}},
        {{-1, 1, -1}, {1, 1, -1}, {1, 1, 1}, {-1, 1, 1}},
        {{-1, -1, -1}, {-1, 1, -1}, {-1, 1, 1}, {-1, -1, 1}},
        {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}},
        {{-1, -1, 1}, {1, -1, 1}, {1, 1, 1}, {-1, 1, 1}},
        {{1, -1, -1}, {1, 0, -1}, {1, 0, 1}, {1, -1, 1}},
        {{1, 0.4f, -1}, {1, 1, -1}, {1, 1, 1}, {1, 0.4f, 1}},
        {{1, 0, -1}, {1, 0.4f, -1}, {1, 0.4f, -0.2f}, {1, 0, -0.2f}},
        {{1, 0, 0.2f}, {1, 0.4f, 0.2f}, {1, 0.4f, 1}, {1, 0, 1}},
    };

    builder_init(b);
    builder_lambert(b, 0.7f);
    builder_place(b, builder_quads(b, quads, 9), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(b, vec3_make(-0.9f, 0.6f, 0.7f), vec3_make(0, -1, -0.3f), 1);
    builder_environment_map(b, map, WIDTH, HEIGHT);
}

static struct running_stats means(struct scene_builder *b, uint32_t spp, double *variance)
{
    struct render_settings settings = builder_settings(12, 12, spp);
    struct render_scene *scene;
    struct running_stats result = {0}, pixels[12 * 12] = {0};
    struct render_stats stats = {0};
    double mean[12 * 12 * 3];

    settings.max_depth = 1;
    settings.seed = 2;
    scene = builder_build(b, &settings);
    for (uint32_t frame = 0; frame < FRAMES; frame++) {
        double sum = 0;

        builder_render(scene, &settings, frame, mean, NULL, &stats);
        for (int i = 0; i < 12 * 12; i++) {
            running_stats_add(&pixels[i], mean[3 * i]);
            sum += mean[3 * i] / (12 * 12);
        }
        running_stats_add(&result, sum);
    }
    *variance = 0;
    for (int i = 0; i < 12 * 12; i++)
        *variance += running_stats_variance(&pixels[i]) / (12 * 12);
    assert_int_equal(stats.work.dropped_samples, 0);
    render_scene_free(scene);
    return result;
}

/* The window itself; one of two where the other is a blind one in the floor; only a blind one,
 * so that every lit direction misses the portal. */
static void test_window(void **state)
{
    static struct scene_portal window = {{1, 0, -0.2f}, {0, 0.4f, 0}, {0, 0, 0.4f}};
    static struct scene_portal both[2] = {{{1, 0, -0.2f}, {0, 0.4f, 0}, {0, 0, 0.4f}},
                                          {{-0.5f, -1, -0.5f}, {0.3f, 0, 0}, {0, 0, 0.3f}}};
    static const uint32_t counts[CASES] = {1, 2, 1};
    struct scene_portal *portals[CASES] = {&window, both, &both[1]};
    struct running_stats plain;
    struct scene_builder b;
    double plain_variance;

    (void)state;
    for (int i = 0; i < WIDTH * HEIGHT * 3; i++)
        map[i] = 0.5f + (float)(i / 3 % WIDTH % 5) * 0.3f;
    room(&b);
    plain = means(&b, 128, &plain_variance);
    for (int i = 0; i < CASES; i++) {
        struct running_stats aimed;
        double variance, error;

        b.scene.environment.portal_count = counts[i];
        b.scene.environment.portals = portals[i];
        aimed = means(&b, 128, &variance);
        error = hypot(running_stats_error(&plain), running_stats_error(&aimed));
        print_message("# case %d: %.5g and %.5g +- %.2g, variance over that without %.3g\n", i, plain.mean, aimed.mean,
                      error, variance / plain_variance);
        assert_true(fabs(plain.mean - aimed.mean) < error * normal_quantile(1 - sidak_alpha(0.01, TESTS) / 2));
        assert_true(i == 2 || variance < 0.3 * plain_variance);
    }
    b.scene.environment.portal_count = 0;
    b.scene.environment.portals = NULL;
    builder_release(&b);
}

/* What a sample claims is what is asked later, and a function of the direction integrates to the
 * same through overlapping portals as over the sphere. */
static void test_mixture_integrates(void **state)
{
    enum { DRAWS = 200000 };
    static struct scene_portal portals[3] = {
        {{-1, -1, 4}, {2, 0, 0}, {0, 3, 0}},
        {{0, 0, 4.5f}, {2, 0, 0.5f}, {0, 1, 0}}, /* partly behind the first */
        {{-6, -6, -6}, {0.1f, 0, 0}, {0, 0.2f, 0.1f}},
    };
    struct render_settings settings = builder_settings(4, 4, 1);
    struct render_scene *scene;
    struct scene_builder b;

    (void)state;
    for (int i = 0; i < WIDTH * HEIGHT * 3; i++)
        map[i] = 0.5f;
    room(&b);
    b.scene.environment.portal_count = 3;
    b.scene.environment.portals = portals;
    scene = builder_build(&b, &settings);
    for (int place = 0; place < CASES; place++) {
        static const struct light_context queries[CASES] = {
            {.p = {0, 0, 0}}, {.n = {0, 0, 1}}, {.p = {-3, 4, 1}, .n = {0.6f, 0, 0.8f}}};
        struct test_random random = {(uint64_t)place};
        struct running_stats stats = {0};

        for (int i = 0; i < DRAWS; i++) {
            struct light_sample light;
            double value = 0;

            if (emitters_sample(scene, &queries[place], test_random_float(&random), test_random_float(&random),
                                &light)) {
                float pdf;

                (void)emitters_environment(scene, &queries[place], light.direction, &pdf);
                assert_true(fabsf(pdf - light.pdf) <= 1e-4f * pdf);
                value = (1 + (double)light.direction.z + (double)light.direction.x * (double)light.direction.y) /
                        (double)light.pdf;
            }
            running_stats_add(&stats, value);
        }
        assert_true(mean_test_p_value(&stats, 4 * PI_D) > sidak_alpha(0.01, TESTS));
    }
    render_scene_free(scene);
    b.scene.environment.portal_count = 0;
    b.scene.environment.portals = NULL;
    builder_release(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_window),
        cmocka_unit_test(test_mixture_integrates),
    };

    return cmocka_run_group_tests_name("emitters_portals", tests, NULL, NULL);
}
