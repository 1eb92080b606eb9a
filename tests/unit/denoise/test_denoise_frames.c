/* Denoising with the frames around: less noise where they show the same, no trace of them where they do not, the error as true as
 * without them, and the same bits for any threads and instruction set. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "common/denoise/denoise.h"
#include "common/denoise/mix.h"
#include "common/denoise/wide.h"
#include "tests/support/denoise_toys.h"

enum { SIDE = 96, AROUND = 2, SAMPLES = 16 };

/* A picture and those before and after it: each of a toy, of which `source` says where it shows what the picture shows. */
struct frames {
    struct toy_groups own, others[AROUND];
    const int32_t *source;
    uint32_t asked;
};

static status find(void *user, uint32_t k, struct denoise_other *out, struct error *err)
{
    struct frames *f = user;

    (void)err;
    assert_int_equal(k, f->asked++);
    *out = (struct denoise_other){&f->others[k].input, f->source};
    return STATUS_OK;
}

static void frames_make(struct frames *f, const struct toy *own, const struct toy *other, enum toy_noise noise, uint64_t seed)
{
    memset(f, 0, sizeof *f);
    toy_sample(&f->own, own, noise, SAMPLES, seed);
    for (uint32_t k = 0; k < AROUND; k++)
        toy_sample(&f->others[k], other, noise, SAMPLES, seed + 1000 * (k + 1));
}

static void frames_release(struct frames *f)
{
    for (uint32_t k = 0; k < AROUND; k++)
        toy_groups_release(&f->others[k]);
    toy_groups_release(&f->own);
}

static void run(struct frames *f, uint32_t count, enum denoise_method method, unsigned threads, struct denoise_result *result)
{
    const struct accuracy_evidence evidence = {.samples = SAMPLES};
    const struct denoise_options options = {.method = method, .threads = threads, .evidence = &evidence};
    struct denoise_input input = f->own.input;
    struct error err = {0};

    f->asked = 0;
    input.other_count = count;
    input.other = find;
    input.other_user = f;
    if (denoise(&input, &options, result, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    assert_int_equal(f->asked, count);
}

static double error_with(struct frames *f, const struct toy *toy, uint32_t count, enum denoise_method method)
{
    struct denoise_result result;
    double error;

    run(f, count, method, 1, &result);
    error = toy_error(toy, result.image);
    denoise_result_release(&result);
    return error;
}

/* Three pictures with the noise of 16 samples instead of one. */
static void noise_falls(void **state)
{
    (void)state;
    for (int features = 0; features < 2; features++)
        for (int method = DENOISE_FAST; method <= DENOISE_FULL; method++) {
            struct toy toy;
            struct frames f;
            double alone, with;

            toy_make(&toy, SIDE, SIDE, features);
            frames_make(&f, &toy, &toy, TOY_EXPONENTIAL, 1);
            alone = error_with(&f, &toy, 0, method);
            with = error_with(&f, &toy, AROUND, method);
            /* Where features alone choose, what they do not know is most of the error. */
            if (!(with < (features && method == DENOISE_FAST ? 0.95 : 0.6) * alone))
                fail_msg("features %d, method %d: %g instead of %g", features, method, with, alone);
            frames_release(&f);
            toy_release(&toy);
        }
}

/* An edge's pixel shows more of one surface or of the other, in its colour and in its albedo alike: here all pixels do. */
static void cover(struct toy_groups *groups, const struct toy *toy, uint32_t seed, float *albedo[2])
{
    for (uint32_t g = 0; g < 2; g++) {
        uint32_t h = seed * 2654435761u + g * 40503u + 1;
        for (size_t p = 0; p < (size_t)SIDE * SIDE; p++) {
            float share;
            h ^= h << 13;
            h ^= h >> 17;
            h ^= h << 5;
            share = 0.5f + (float)(h >> 8) * 0x1p-24f;
            for (size_t i = p * 3; i < p * 3 + 3; i++) {
                groups->groups[g][i] = toy->truth[i] * share; /* no other noise */
                albedo[g][i] = toy->albedo[i] * share;
            }
        }
        groups->input.albedo[g] = albedo[g];
    }
}

/* Such noise is averaged, too: light is, as it is seen, not light divided by albedo. */
static void edges_gain_as_surfaces(void **state)
{
    float *albedo[1 + AROUND][2];
    struct toy toy;
    struct frames f;
    double alone, with;

    (void)state;
    toy_make(&toy, SIDE, SIDE, 1);
    frames_make(&f, &toy, &toy, TOY_EXPONENTIAL, 7);
    for (uint32_t k = 0; k <= AROUND; k++) {
        for (int g = 0; g < 2; g++) {
            albedo[k][g] = mem_alloc_array((size_t)SIDE * SIDE * 3, sizeof(float));
            assert_non_null(albedo[k][g]);
        }
        cover(k ? &f.others[k - 1] : &f.own, &toy, k + 1, albedo[k]);
    }
    alone = error_with(&f, &toy, 0, DENOISE_FULL);
    with = error_with(&f, &toy, AROUND, DENOISE_FULL);
    if (!(with < 0.85 * alone))
        fail_msg("%g instead of %g", with, alone);
    for (uint32_t k = 0; k <= AROUND; k++)
        for (int g = 0; g < 2; g++)
            mem_free(albedo[k][g]);
    frames_release(&f);
    toy_release(&toy);
}

/* The same picture, further to the right by so many pixels, at the edge repeated. */
static void move(struct toy *out, const struct toy *toy, uint32_t by)
{
    float *const from[] = {toy->truth, toy->albedo, toy->normal};

    *out = (struct toy){.width = toy->width, .height = toy->height};
    for (int k = 0; k < 3; k++) {
        float *to = NULL;
        if (from[k]) {
            to = mem_alloc_array((size_t)toy->width * toy->height * 3, sizeof *to);
            assert_non_null(to);
        }
        for (size_t i = 0; to && i < (size_t)toy->width * toy->height * 3; i++) {
            const size_t x = i / 3 % toy->width, line = i / 3 / toy->width * toy->width;
            to[i] = from[k][(line + (x < by ? 0 : x - by)) * 3 + i % 3];
        }
        *(k == 0 ? &out->truth : k == 1 ? &out->albedo : &out->normal) = to;
    }
}

enum { MOVED = 11 };

static void sources(int32_t out[SIDE * SIDE])
{
    for (int32_t p = 0; p < SIDE * SIDE; p++)
        out[p] = p % SIDE + MOVED < SIDE ? p + MOVED : -1;
}

/* What moves across the screen is followed where its source is known; where it is not, it leaves nothing. */
static void what_moves_is_followed(void **state)
{
    static int32_t source[SIDE * SIDE];

    (void)state;
    sources(source);
    for (int features = 0; features < 2; features++) {
        struct toy toy, moved;
        struct frames f;
        double alone, lost, followed;

        toy_make(&toy, SIDE, SIDE, features);
        move(&moved, &toy, MOVED);
        frames_make(&f, &toy, &moved, TOY_EXPONENTIAL, 3);
        alone = error_with(&f, &toy, 0, DENOISE_FULL);
        lost = error_with(&f, &toy, AROUND, DENOISE_FULL);
        f.source = source;
        followed = error_with(&f, &toy, AROUND, DENOISE_FULL);
        if (!(followed < 0.7 * alone) || !(lost < 1.05 * alone))
            fail_msg("features %d: %g alone, %g followed, %g without a source", features, alone, followed, lost);
        frames_release(&f);
        toy_release(&moved);
        toy_release(&toy);
    }
}

/* A shadow that moved, seen by its light alone: fainter than the noise of a pixel, and never there in part. */
static void a_shadow_leaves_no_ghost(void **state)
{
    (void)state;
    for (int k = 1; k <= 4; k++) { /* from half as dark as the noise to twice as dark */
        const float dark = 1 - 0.125f * (float)k;
        struct toy toy, other;
        struct frames f;
        struct denoise_result alone, with;
        double ghost = 0, before = 0, count = 0;

        toy_make(&toy, SIDE, SIDE, 0);
        toy_make(&other, SIDE, SIDE, 0);
        for (size_t i = 0; i < (size_t)SIDE * SIDE * 3; i++) {
            const size_t x = i / 3 % SIDE, y = i / 3 / SIDE;
            toy.truth[i] = 0.5f;
            other.truth[i] = x >= 32 && x < 64 && y >= 32 && y < 64 ? 0.5f * dark : 0.5f;
        }
        frames_make(&f, &toy, &other, TOY_EXPONENTIAL, (uint64_t)k);
        run(&f, 0, DENOISE_FULL, 1, &alone);
        run(&f, AROUND, DENOISE_FULL, 1, &with);
        for (size_t i = 0; i < (size_t)SIDE * SIDE * 3; i++)
            if (i / 3 % SIDE >= 36 && i / 3 % SIDE < 60 && i / 3 / SIDE >= 36 && i / 3 / SIDE < 60) {
                before += (double)alone.image[i] - 0.5;
                ghost += (double)with.image[i] - 0.5;
                count++;
            }
        if (!(fabs(ghost - before) / count < 0.02 * 0.5))
            fail_msg("darker by %g: the picture by %g", (double)(1 - dark), (before - ghost) / count / 0.5);
        denoise_result_release(&with);
        denoise_result_release(&alone);
        frames_release(&f);
        toy_release(&other);
        toy_release(&toy);
    }
}

/* Squared errors of six pictures, in squares of their mean. */
struct errors {
    double stated, real;
};

static struct errors errors_with(uint32_t count, enum toy_noise noise, int features)
{
    struct errors sums = {0, 0};
    double mean = 0;
    struct toy toy;

    toy_make(&toy, SIDE, SIDE, features);
    for (size_t i = 0; i < (size_t)SIDE * SIDE * 3; i++)
        mean += (double)toy.truth[i] / (SIDE * SIDE * 3);
    for (uint64_t seed = 1; seed <= 6; seed++) {
        struct frames f;
        struct denoise_result result;

        frames_make(&f, &toy, &toy, noise, 10 * seed);
        run(&f, count, DENOISE_FULL, 1, &result);
        sums.stated += result.figures.rmse_percent * result.figures.rmse_percent * 1e-4;
        sums.real += toy_error(&toy, result.image) / (mean * mean);
        denoise_result_release(&result);
        frames_release(&f);
    }
    toy_release(&toy);
    return sums;
}

/* What is chosen by figures hides some of the error (test_denoise_error.c). Frames around hide no more of it. */
static void the_error_is_as_right_as_alone(void **state)
{
    static const enum toy_noise noises[] = {TOY_EXPONENTIAL, TOY_SPIKY_TENTH};

    (void)state;
    for (size_t n = 0; n < sizeof noises / sizeof *noises; n++)
        for (int features = 0; features < 2; features++) {
            const struct errors alone = errors_with(0, noises[n], features);
            const struct errors with = errors_with(AROUND, noises[n], features);
            if (!(with.real - with.stated < alone.real - alone.stated + 0.05 * alone.real) || !(with.stated < 1.3 * with.real))
                fail_msg("noise %zu, features %d: %g of %g stated alone, %g of %g with others", n, features, alone.stated, alone.real,
                         with.stated, with.real);
        }
}

static void nothing_changes_a_bit(void **state)
{
    static int32_t source[SIDE * SIDE];
    struct toy toy;
    struct frames f;
    struct denoise_result one, other;

    (void)state;
    sources(source);
    toy_make(&toy, SIDE, SIDE, 1);
    frames_make(&f, &toy, &toy, TOY_SPIKY_TENTH, 4);
    f.source = source;
    for (int method = DENOISE_FAST; method <= DENOISE_FULL; method++) {
        run(&f, AROUND, method, 1, &one);
        for (int way = 0; way < 2; way++) {
            wide_allowed = way == 0;
            run(&f, AROUND, method, way == 0 ? 3 : 1, &other);
            wide_allowed = 1;
            assert_memory_equal(one.image, other.image, (size_t)SIDE * SIDE * 3 * sizeof(float));
            assert_memory_equal(&one.counts, &other.counts, sizeof one.counts);
            denoise_result_release(&other);
        }
        denoise_result_release(&one);
    }
    frames_release(&f);
    toy_release(&toy);
}

/* Nothing is taken of a tile that lacks a group, and of a place that the other frame does not show. */
static void what_is_not_there_is_not_taken(void **state)
{
    static int32_t nowhere[SIDE * SIDE];
    static uint32_t samples[2 * SIDE / 16 * SIDE / 16];
    struct toy toy;
    struct frames f;
    struct denoise_result result[3];

    (void)state;
    toy_make(&toy, SIDE, SIDE, 1);
    frames_make(&f, &toy, &toy, TOY_EXPONENTIAL, 5);
    run(&f, AROUND, DENOISE_FULL, 1, &result[0]);
    for (uint32_t k = 0; k < AROUND; k++)
        f.others[k].input.samples = samples;
    run(&f, AROUND, DENOISE_FULL, 1, &result[1]);
    memset(nowhere, 0xff, sizeof nowhere);
    for (uint32_t k = 0; k < AROUND; k++)
        f.others[k].input.samples = NULL;
    f.source = nowhere;
    run(&f, AROUND, DENOISE_FULL, 1, &result[2]);
    assert_memory_equal(result[1].image, result[2].image, sizeof(float) * SIDE * SIDE * 3);
    assert_true(memcmp(result[0].image, result[1].image, sizeof(float) * SIDE * SIDE * 3) != 0);
    for (int i = 0; i < 3; i++)
        denoise_result_release(&result[i]);
    frames_release(&f);
    toy_release(&toy);
}

static void frames_of_another_size_are_refused(void **state)
{
    const struct denoise_options options = {.method = DENOISE_FULL};
    struct toy toy, small;
    struct frames f;
    struct denoise_input input;
    struct denoise_result result;
    struct error err = {0};

    (void)state;
    toy_make(&toy, SIDE, SIDE, 0);
    toy_make(&small, SIDE / 2, SIDE, 0);
    frames_make(&f, &toy, &small, TOY_EXPONENTIAL, 6);
    input = f.own.input;
    input.other_count = 1;
    input.other = find;
    input.other_user = &f;
    assert_int_equal(denoise(&input, &options, &result, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "size"));
    assert_null(result.image);
    frames_release(&f);
    toy_release(&small);
    toy_release(&toy);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(noise_falls),
        cmocka_unit_test(edges_gain_as_surfaces),
        cmocka_unit_test(what_moves_is_followed),
        cmocka_unit_test(a_shadow_leaves_no_ghost),
        cmocka_unit_test(the_error_is_as_right_as_alone),
        cmocka_unit_test(nothing_changes_a_bit),
        cmocka_unit_test(what_is_not_there_is_not_taken),
        cmocka_unit_test(frames_of_another_size_are_refused),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
