/* Balls of white rough glass in a white furnace. Inside, light meets the surface again and again
 * before it leaves, so that the smallest loss of the interface compounds: a mean loss of 1 % reads
 * as 20 % for an index of 5.
 *
 * The light in a ball keeps its cosine from wall to wall, so its way is a Markov chain over cosines.
 * Its transitions are measured with the sampler's own weights, by a lattice (no depth cuts them), and
 * the chain is followed to its end. With --print it writes the table of docs/NUMERICS.md. */
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
#include "worker/render/bsdf/bsdf.h"

/* Cells of equal cos^2: light that is uniform over the hemisphere fills them evenly. */
enum { CELLS = 32, WALLS_MAX = 5000 };

/* Where one cell's light goes: on inside the ball, to each cell; or out of it. */
struct transition {
    double inside[CELLS], outside;
};

static double fraction(double x) { return x - floor(x); }

static float number(int i, double step) { return fminf((float)fraction(0.5 + i * step), 0x1.fffffep-1f); }

/* The steps are powers of the inverse of the root of x^5 = x + 1 (Roberts' lattice). */
static struct transition transition_of(int cell, int inside, double alpha, double ior, int samples)
{
    struct bsdf_params p = {.base_color = {1, 1, 1}, .alpha = (float)alpha, .ior = (float)ior,
                            .specular = 1, .specular_color = {1, 1, 1}, .transmission = 1,
                            .refractive = 1, .inside = inside};
    struct transition t = {{0}, 0};

    for (int i = 0; i < samples; i++) {
        double mu = sqrt((cell + fraction(0.5 + i * 0.8566748838545029)) / CELLS), power, square;
        struct vec3 wo = {(float)sqrt(1 - mu * mu), 0, (float)mu};
        struct bsdf_sample s;
        struct bsdf b;

        bsdf_init(&b, &p, wo);
        if (!bsdf_sample(&b, wo, number(i, 0.5385972572236101), number(i, 0.7338918566271260),
                         number(i, 0.6287067210378087), &s))
            continue;
        power = (double)(s.weight.y * s.eta_scale) / samples;
        square = (double)s.wi.z * (double)s.wi.z;
        if ((s.wi.z < 0) ^ inside)
            t.inside[(int)fmin(CELLS - 1, square * CELLS)] += power;
        else
            t.outside += power;
    }
    return t;
}

/* What leaves a ball on which light falls evenly from all sides. */
static double ball_reading(double alpha, double ior, int samples)
{
    static struct transition within[CELLS];
    double light[CELLS] = {0}, left = 0;

    for (int i = 0; i < CELLS; i++) {
        struct transition in = transition_of(i, 0, alpha, ior, samples);
        within[i] = transition_of(i, 1, alpha, ior, samples);
        left += in.outside / CELLS;
        for (int j = 0; j < CELLS; j++)
            light[j] += in.inside[j] / CELLS;
    }
    for (int wall = 0; wall < WALLS_MAX; wall++) {
        double next[CELLS] = {0};
        for (int i = 0; i < CELLS; i++) {
            left += light[i] * within[i].outside;
            for (int j = 0; j < CELLS; j++)
                next[j] += light[i] * within[i].inside[j];
        }
        memcpy(light, next, sizeof light);
    }
    return left;
}

/* With these points a cell the lattice is right to .004 up to 3, to .008 for 5: what errs by one wall compounds with the
 * index. */
static void white_balls_are_white(void **state)
{
    static const double ALPHAS[] = {0.1, 0.25, 0.36, 0.5, 0.81, 1};
    static const struct { double ior, least, most; int points; } BALLS[] = {
        {1.1, 0.997, 1.002, 10000}, {1.5, 0.995, 1.003, 10000}, {2.4, 0.992, 1.005, 10000}, {3, 0.99, 1.006, 20000},
        {5, 0.985, 1.01, 20000},
    };

    (void)state;
    for (size_t a = 0; a < sizeof ALPHAS / sizeof *ALPHAS; a++)
        for (size_t k = 0; k < sizeof BALLS / sizeof *BALLS; k++) {
            double got = ball_reading(ALPHAS[a], BALLS[k].ior, BALLS[k].points);
            if (!(got > BALLS[k].least && got < BALLS[k].most))
                fail_msg("alpha %g, ior %g: a white ball reads %.4f", ALPHAS[a], BALLS[k].ior, got);
        }
}

/* Far beyond the table: darker, but light never grows. */
static void no_ball_gains_light(void **state)
{
    static const double ALPHAS[] = {0.03, 0.07, 0.1, 0.3, 1}, IORS[] = {9.8, 12, 20, 100};

    (void)state;
    for (int i = 0; i < 20; i++) {
        double got = ball_reading(ALPHAS[i % 5], IORS[i / 5], 5000);
        if (!(got < 1.03)) /* the lattice's error at 9.8 */
            fail_msg("alpha %g, ior %g: a white ball reads %.4f", ALPHAS[i % 5], IORS[i / 5], got);
    }
}

/* The same as a picture of a ball of triangles, with depth to spare. */
static void a_rendered_ball_is_white(void **state)
{
    struct render_settings settings = builder_settings(16, 16, 64);
    enum { FRAMES = 24 };

    (void)state;
    settings.max_depth = SETTINGS_DEPTH_MAX;
    for (int k = 0; k < 2; k++) {
        struct running_stats frames = {0};
        struct render_stats stats = {0};
        struct render_scene *scene;
        struct scene_builder b;
        struct scene_material *m;
        double mean[16 * 16 * 3];
        builder_init(&b);
        m = builder_lambert(&b, 1);
        m->specular = m->transmission = m->roughness = 1;
        m->refractive = 1;
        m->ior = k ? 2.4f : 1.5f;
        builder_place(&b, builder_sphere(&b, 32, 0), 0, vec3_splat(1), vec3_splat(0));
        builder_environment_constant(&b, vec3_splat(1));
        builder_camera(&b, vec3_make(0, 0, 4), vec3_splat(0), 0.35f);
        scene = builder_build(&b, &settings);
        for (uint32_t frame = 0; frame < FRAMES; frame++) {
            double sum = 0;
            builder_render(scene, &settings, frame, mean, NULL, &stats);
            for (int i = 0; i < 16 * 16 * 3; i++)
                sum += mean[i] / (16 * 16 * 3);
            running_stats_add(&frames, sum);
        }
        /* A hundredth for what the interface loses, and the noise. */
        if (fabs(frames.mean - 1) > 0.01 + 3 * running_stats_error(&frames) || running_stats_error(&frames) > 0.01)
            fail_msg("ior %g: %.4f +- %.4f", k ? 2.4 : 1.5, frames.mean, running_stats_error(&frames));
        render_scene_free(scene);
        builder_release(&b);
    }
}

static void print_table(void)
{
    static const double ALPHAS[] = {0.1, 0.25, 0.36, 0.5, 0.81, 1};
    static const double IORS[] = {1.1, 1.5, 2, 2.4, 3, 4, 5, 7, 9.8};

    printf("ior   ");
    for (int a = 0; a < 6; a++)
        printf(" %6.2f", ALPHAS[a]);
    for (int k = 0; k < 9; k++) {
        printf("\n%5.2f ", IORS[k]);
        for (int a = 0; a < 6; a++)
            printf(" %6.3f", ball_reading(ALPHAS[a], IORS[k], 100000));
        fflush(stdout);
    }
    printf("\n");
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_balls_are_white),
        cmocka_unit_test(no_ball_gains_light),
        cmocka_unit_test(a_rendered_ball_is_white),
    };

    if (argc > 1 && strcmp(argv[1], "--print") == 0) {
        print_table();
        return 0;
    }
    return cmocka_run_group_tests_name("glass_ball", tests, NULL, NULL);
}
