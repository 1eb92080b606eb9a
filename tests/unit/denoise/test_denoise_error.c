/* The error of denoised pictures: right where each group is filtered without knowledge of the other's pixel, and wrong
 * by far where it is not, so that a filter which peeps is noticed. Sums of six pictures with fixed seeds. Some
 * knowledge is left, since the noise is averaged over neighbours: hence the wide limits of what counts as right. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "common/denoise/block.h"
#include "common/denoise/denoise.h"
#include "common/denoise/mix.h"
#include "common/denoise/wide.h"
#include "common/image/color.h"
#include "tests/support/denoise_toys.h"

enum { SEEDS = 6, SIDE = 96 };

enum form { RIGHT, FITTED, KNOWS_PIXEL, FEATURES_OF_BOTH, CHOSEN_BY_OTHER, FORMS };

struct sums {
    double stated, real;
};

/* Noise of the features that goes with that of the colours, as under a lens. */
static void blur_features(const struct toy *toy, const struct toy_groups *groups, int g, float *albedo)
{
    for (size_t i = 0; i < (size_t)toy->width * toy->height * 3; i++) {
        const float noise = groups->groups[g][i] / (toy->truth[i] + 1e-3f);
        albedo[i] = toy->albedo[i] * (0.5f + 0.5f * noise);
    }
}

static void mix_features(struct block *b)
{
    for (int k = 0; k < BLOCK_FEATURES; k++)
        for (int p = 0; p < BLOCK_PIXELS; p++)
            b->feature[0][k][p] = b->feature[1][k][p] = (b->feature[0][k][p] + b->feature[1][k][p]) / 2;
}

static void add_block(const struct block *b, const struct toy *toy, const struct toy_groups *groups, enum form form,
                      struct sums *sums)
{
    for (uint32_t y = 0; y < b->height; y++)
        for (uint32_t x = 0; x < b->width; x++)
            for (int c = 0; c < 3; c++) {
                const size_t i = ((size_t)(b->y + y) * toy->width + b->x + x) * 3 + (size_t)c;
                const float raw[2] = {groups->groups[0][i], groups->groups[1][i]};
                float f[2];
                double off;
                for (int g = 0; g < 2; g++) {
                    f[g] = (form == FITTED ? b->fitted : b->result)[g][c][block_index(x, y)];
                    if (form == CHOSEN_BY_OTHER && fabsf(raw[g] - raw[!g]) < fabsf(f[g] - raw[!g]))
                        f[g] = raw[g];
                }
                off = ((double)f[0] + (double)f[1]) / 2 - (double)toy->truth[i];
                sums->real += off * off;
                sums->stated += (double)error_of(raw[0], raw[1], f[0], f[1]) / 4;
            }
}

static const struct {
    enum toy_noise noise;
    uint32_t samples;
} kinds[] = {{TOY_EXPONENTIAL, 16}, {TOY_EXPONENTIAL, 128}, {TOY_SPIKY_TENTH, 32}, {TOY_SPIKY_HUNDREDTH, 128}};
enum { KINDS = sizeof kinds / sizeof *kinds };

/* Stated by real, of each form without and with features: the forms share pictures, and filters where they can. */
static double ratios[KINDS][2][FORMS];

static void filter_block(struct block *b, const struct toy *toy, const struct toy_groups *groups, int features,
                         struct sums sums[FORMS])
{
    block_filter_fitted(b, 5);
    add_block(b, toy, groups, FITTED, &sums[FITTED]);
    block_filter_joint(b, 5, JOINT_COLOURS);
    add_block(b, toy, groups, RIGHT, &sums[RIGHT]);
    if (!features) {
        add_block(b, toy, groups, CHOSEN_BY_OTHER, &sums[CHOSEN_BY_OTHER]);
        block_filter_joint(b, 5, JOINT_KNOWING);
        add_block(b, toy, groups, KNOWS_PIXEL, &sums[KNOWS_PIXEL]);
        return;
    }
    mix_features(b);
    block_filter_joint(b, 5, JOINT_COLOURS);
    add_block(b, toy, groups, FEATURES_OF_BOTH, &sums[FEATURES_OF_BOTH]);
}

static void measure(int kind, int features)
{
    struct sums sums[FORMS] = {{0, 0}};
    struct block *b = mem_alloc(sizeof *b);
    float *albedo[2] = {mem_alloc(SIDE * SIDE * 3 * sizeof(float)), mem_alloc(SIDE * SIDE * 3 * sizeof(float))};
    struct toy toy;

    assert_true(b && albedo[0] && albedo[1]);
    toy_make(&toy, SIDE, SIDE, features);
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        struct toy_groups groups;
        toy_sample(&groups, &toy, kinds[kind].noise, kinds[kind].samples, seed);
        for (int g = 0; g < 2 && features; g++) {
            blur_features(&toy, &groups, g, albedo[g]);
            groups.input.albedo[g] = albedo[g];
        }
        for (uint32_t at = 0; at < 4; at++) {
            block_load(b, &groups.input, NULL, at % 2 * BLOCK_INNER, at / 2 * BLOCK_INNER);
            filter_block(b, &toy, &groups, features, sums);
        }
        toy_groups_release(&groups);
    }
    toy_release(&toy);
    mem_free(albedo[1]);
    mem_free(albedo[0]);
    mem_free(b);
    for (int form = 0; form < FORMS; form++)
        ratios[kind][features][form] = sums[form].stated / sums[form].real;
}

static int measure_all(void **state)
{
    (void)state;
    for (int k = 0; k < KINDS; k++)
        for (int features = 0; features < 2; features++)
            measure(k, features);
    return 0;
}

static void the_error_is_right(void **state)
{
    (void)state;
    for (enum form form = RIGHT; form <= FITTED; form++)
        for (int features = 0; features < 2; features++)
            for (int k = 0; k < KINDS; k++) {
                const double r = ratios[k][features][form];
                if (!(r > 0.7 && r < 1.3))
                    fail_msg("form %d, features %d, noise %d: %g of the error", form, features, k, r);
            }
}

static void a_filter_that_peeps_is_noticed(void **state)
{
    static const struct {
        enum form form;
        int features;
        double most[KINDS];
    } wrong[] = {
        {KNOWS_PIXEL, 0, {0.7, 0.9, 0.7, 0.7}},
        {FEATURES_OF_BOTH, 1, {0.74, 0.95, 0.7, 0.7}},
        {CHOSEN_BY_OTHER, 0, {0, 0, 0, 0}},
    };

    (void)state;
    for (size_t w = 0; w < sizeof wrong / sizeof *wrong; w++)
        for (int k = 0; k < KINDS; k++) {
            const double r = ratios[k][wrong[w].features][wrong[w].form];
            if (!(r < wrong[w].most[k]))
                fail_msg("form %d, noise %d: %g of the error", wrong[w].form, k, r);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_error_is_right),
        cmocka_unit_test(a_filter_that_peeps_is_noticed),
    };

    return cmocka_run_group_tests(tests, measure_all, NULL);
}
