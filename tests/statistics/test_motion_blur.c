/* The picture of what moves: its light against closed forms. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <cmocka.h>

#include "tests/support/scene_builder.h"
#include "tests/support/statistics.h"

enum { SIZE = 16, REPEATS = 200, SPP = 16 };

static const float no_yes[2] = {0, 1};

/* Share of the shutter's time that a segment of width 5, which begins at -6 and moves by 4 to
 * the right, covers x. */
static double covered(double x)
{
    double enters = (x - (-6 + 5)) / 4, leaves = (x + 6) / 4;

    enters = fmin(fmax(enters, 0), 1);
    leaves = fmin(fmax(leaves, 0), 1);
    return leaves - enters;
}

/* The same through the pixel's filter, a Blackman-Harris window of 3 pixels of a metre each. */
static double filtered(double centre)
{
    enum { STEPS = 30000 };
    double sum = 0, weights = 0;

    for (int i = 0; i < STEPS; i++) {
        double share = (i + 0.5) / STEPS, turn = 2 * M_PI * share;
        double w = 0.35875 - 0.48829 * cos(turn) + 0.14128 * cos(2 * turn) - 0.01168 * cos(3 * turn);
        weights += w;
        sum += w * covered(centre + 3 * (share - 0.5));
    }
    return sum / weights;
}

/* A mesh of two triangles, 5 wide and 60 high, from x = -6 on, that can be told to bend: its
 * one morph target moves all by 4 to the right. */
static uint32_t board(struct scene_builder *b, int morphs)
{
    static const float positions[12] = {-6, -30, 0, -1, -30, 0, -1, 30, 0, -6, 30, 0};
    static const float moved[12] = {4, 0, 0, 4, 0, 0, 4, 0, 0, 4, 0, 0};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};

    if (morphs)
        return builder_mesh_deforming(b, positions, 4, indices, 2, NULL, moved, 1);
    return builder_mesh(b, positions, NULL, 4, indices, 2, 0);
}

enum mover { BY_NODE, BY_MORPH, BY_CAMERA, MOVERS };

/* A shining board that moves by 4 pixels while the shutter is open, or before which the camera
 * moves as much to the left: the mean of each column, and its standard error. */
static void profile(enum mover mover, double mean[SIZE], double error[SIZE])
{
    static const float right[6] = {0, 0, 0, 4, 0, 0}, left[6] = {0, 0, 5, -4, 0, 5};
    struct render_settings settings = builder_settings(SIZE, SIZE, SPP);
    double sum[SIZE] = {0}, square[SIZE] = {0};
    struct scene_builder b;

    settings.fps = 1;
    settings.shutter = 1;
    settings.max_depth = 0;
    builder_init(&b);
    builder_lambert(&b, 0)->unlit = 1;
    b.scene.materials[0].base_color[0] = b.scene.materials[0].base_color[1] = b.scene.materials[0].base_color[2] = 1;
    builder_place(&b, board(&b, mover == BY_MORPH), 0, vec3_splat(1), vec3_splat(0));
    builder_camera(&b, vec3_make(0, 0, 5), vec3_splat(0), 1);
    b.scene.cameras[0].kind = CAMERA_ORTHOGRAPHIC;
    b.scene.cameras[0].xmag = b.scene.cameras[0].ymag = SIZE / 2;
    builder_node(&b, -1, mover == BY_MORPH);
    if (mover == BY_MORPH)
        builder_channel(&b, 0, PATH_WEIGHTS, 2, no_yes, no_yes);
    else
        builder_channel(&b, 0, PATH_TRANSLATION, 2, no_yes, mover == BY_NODE ? right : left);
    if (mover == BY_CAMERA)
        b.scene.cameras[0].node = 0;
    else
        b.scene.instances[0].node = 0;
    for (uint64_t seed = 0; seed < REPEATS; seed++) {
        static double picture[SIZE * SIZE * 3];
        struct render_stats stats = {0};
        struct render_scene *scene;
        settings.seed = seed;
        scene = builder_build(&b, &settings);
        builder_render(scene, &settings, 0, picture, NULL, &stats);
        render_scene_free(scene);
        for (int x = 0; x < SIZE; x++) {
            double column = 0;
            for (int y = 0; y < SIZE; y++)
                column += picture[(y * SIZE + x) * 3] / SIZE;
            sum[x] += column;
            square[x] += column * column;
        }
    }
    builder_release(&b);
    for (int x = 0; x < SIZE; x++) {
        double variance = (square[x] - sum[x] * sum[x] / REPEATS) / (REPEATS - 1);
        mean[x] = sum[x] / REPEATS;
        error[x] = sqrt(fmax(variance, 0) / REPEATS);
    }
}

/* z-test of every column of every mover, family-wise level 0.01. 200 independent scrambles, each
 * the mean of 256 samples: normal enough. */
static void test_coverage(void **state)
{
    static const char *const names[MOVERS] = {"node", "morph target", "camera"};

    (void)state;
    for (int mover = 0; mover < MOVERS; mover++) {
        double mean[SIZE], error[SIZE];
        profile((enum mover)mover, mean, error);
        for (int x = 0; x < SIZE; x++) {
            double expected = filtered(x + 0.5 - SIZE / 2), difference = mean[x] - expected, p;
            if (error[x] == 0) { /* all or nothing */
                assert_true(fabs(difference) < 1e-6);
                continue;
            }
            p = erfc(fabs(difference) / error[x] / sqrt(2));
            if (p < sidak_alpha(0.01, MOVERS * SIZE))
                fail_msg("moved by its %s, column %d: %g instead of %g, p = %g", names[mover], x, mean[x], expected, p);
        }
        /* The profile is a ramp, not an edge: a closed shutter would fail the test. */
        assert_true(error[4] > 0 && mean[4] > 0.3 && mean[4] < 0.8);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_coverage),
    };
    return cmocka_run_group_tests_name("motion blur", tests, NULL, NULL);
}
