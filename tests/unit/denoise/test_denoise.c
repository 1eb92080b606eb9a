/* Denoising: less noise where the truth is known, the same bits for any number of threads, and what cannot be denoised. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/base/memory.h"
#include "common/denoise/denoise.h"
#include "common/denoise/wide.h"
#include "common/image/color.h"
#include "tests/support/denoise_toys.h"

static status srgb_codes(void *user, const float *rgb, uint32_t width, uint32_t height, float *codes, struct error *err)
{
    (void)user;
    (void)err;
    for (size_t i = 0; i < (size_t)width * height * 3; i++)
        codes[i] = 255 * srgb_encode(rgb[i]);
    return STATUS_OK;
}

static const struct accuracy_transform srgb = {.apply = srgb_codes, .user = NULL};

static void run(const struct denoise_input *input, enum denoise_method method, unsigned threads,
                struct denoise_result *result)
{
    const struct denoise_options options = {.method = method, .threads = threads, .transform = &srgb};
    struct error err = {0};

    if (denoise(input, &options, result, &err) != STATUS_OK)
        fail_msg("%s", err.text);
}

static float *mean_of(const struct denoise_input *input)
{
    const size_t values = (size_t)input->width * input->height * 3;
    float *mean = mem_alloc_array(values, sizeof *mean);

    assert_non_null(mean);
    for (size_t i = 0; i < values; i++)
        mean[i] = (input->groups[0][i] + input->groups[1][i]) / 2;
    return mean;
}

static void noise_falls(void **state)
{
    (void)state;
    for (int features = 0; features < 2; features++)
        for (int method = DENOISE_FAST; method <= DENOISE_FULL; method++) {
            struct toy toy;
            struct toy_groups groups;
            struct denoise_result result;
            float *raw;

            toy_make(&toy, 96, 96, features);
            toy_sample(&groups, &toy, TOY_EXPONENTIAL, 16, 1);
            raw = mean_of(&groups.input);
            run(&groups.input, method, 1, &result);
            if (!(toy_error(&toy, result.image) < toy_error(&toy, raw) / 4))
                fail_msg("features %d, method %d: %g of %g", features, method, toy_error(&toy, result.image),
                         toy_error(&toy, raw));
            mem_free(raw);
            denoise_result_release(&result);
            toy_groups_release(&groups);
            toy_release(&toy);
        }
}

/* Where the picture is almost clean, nothing gets worse. */
static void a_clean_picture_stays_as_good(void **state)
{
    (void)state;
    for (uint32_t samples = 256; samples <= 2048; samples *= 8)
        for (int features = 0; features < 2; features++) {
            struct toy toy;
            struct toy_groups groups;
            struct denoise_result result;
            float *raw;

            toy_make(&toy, 96, 96, features);
            toy_sample(&groups, &toy, TOY_SPIKY_HUNDREDTH, samples, 7);
            raw = mean_of(&groups.input);
            run(&groups.input, DENOISE_FULL, 1, &result);
            if (!(toy_error(&toy, result.image) < toy_error(&toy, raw)))
                fail_msg("features %d, %u samples: %g of %g", features, samples, toy_error(&toy, result.image),
                         toy_error(&toy, raw));
            mem_free(raw);
            denoise_result_release(&result);
            toy_groups_release(&groups);
            toy_release(&toy);
        }
}

enum { SIDE = 64 };

static float noise_at(uint32_t x, uint32_t y, uint32_t g, uint32_t c)
{
    uint32_t h = x * 73856093u ^ y * 19349663u ^ (g * 83492791u + c * 2654435761u);

    h = (h ^ (h >> 16)) * 0x45d9f3bu;
    h = (h ^ (h >> 16)) * 0x45d9f3bu;
    return (float)(h >> 8) / 8388608.0f - 1;
}

/* Light that changes evenly with the normal or with the place: a fitted model follows where means flatten. */
static void slopes_stay(void **state)
{
    static float groups[2][SIDE * SIDE * 3], normal[SIDE * SIDE * 3], albedo[SIDE * SIDE * 3], truth[SIDE * SIDE * 3];
    const struct denoise_input input = {
        .width = SIDE, .height = SIDE, .groups = {groups[0], groups[1]}, .albedo = {albedo, albedo}, .normal = {normal, normal}};
    struct denoise_result result;
    double squares = 0, noise = 0;

    (void)state;
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            const float u = (float)(x % 16 - 8) / 9, v = (float)(y % 16 - 8) / 9; /* balls */
            const float up = 1 - (u * u + v * v) / 2;
            for (int c = 0; c < 3; c++) {
                const int i = (y * SIDE + x) * 3 + c;
                normal[i] = c == 0 ? u * up : c == 1 ? v * up : sqrtf(1 - (u * u + v * v) * up * up);
                albedo[i] = 0.5f;
            }
            for (int i = (y * SIDE + x) * 3, c = 0; c < 3; c++) {
                truth[i + c] = 0.3f + 0.25f * normal[i];
                for (int g = 0; g < 2; g++)
                    groups[g][i + c] = truth[i + c] + 0.1f * noise_at((uint32_t)x, (uint32_t)y, (uint32_t)g, (uint32_t)c);
            }
        }
    run(&input, DENOISE_FULL, 1, &result);
    for (int i = 0; i < SIDE * SIDE * 3; i++) {
        const float off = result.image[i] - truth[i], raw = (groups[0][i] + groups[1][i]) / 2 - truth[i];
        squares += (double)(off * off);
        noise += (double)(raw * raw);
    }
    if (!(squares < noise / 12))
        fail_msg("%g of %g", squares, noise);
    denoise_result_release(&result);
}

static void threads_change_no_bit(void **state)
{
    static const unsigned threads[] = {3, 7};
    struct toy toy;
    struct toy_groups groups;
    struct denoise_result one, other;

    (void)state;
    toy_make(&toy, 213, 150, 1);
    toy_sample(&groups, &toy, TOY_SPIKY_TENTH, 16, 3);
    for (int method = DENOISE_FAST; method <= DENOISE_FULL; method++) {
        run(&groups.input, method, 1, &one);
        for (size_t i = 0; i < sizeof threads / sizeof *threads; i++) {
            run(&groups.input, method, threads[i], &other);
            assert_memory_equal(one.image, other.image, (size_t)toy.width * toy.height * 3 * sizeof(float));
            assert_memory_equal(&one.figures, &other.figures, sizeof one.figures);
            assert_memory_equal(&one.counts, &other.counts, sizeof one.counts);
            denoise_result_release(&other);
        }
        denoise_result_release(&one);
    }
    toy_groups_release(&groups);
    toy_release(&toy);
}

static void the_instruction_set_changes_no_bit(void **state)
{
    struct toy toy;
    struct toy_groups groups;
    struct denoise_result wide, plain;

    (void)state;
    toy_make(&toy, 150, 90, 1);
    toy_sample(&groups, &toy, TOY_SPIKY_TENTH, 16, 4);
    for (int method = DENOISE_FAST; method <= DENOISE_FULL; method++) {
        run(&groups.input, method, 1, &wide);
        wide_allowed = 0;
        run(&groups.input, method, 1, &plain);
        wide_allowed = 1;
        assert_memory_equal(wide.image, plain.image, (size_t)toy.width * toy.height * 3 * sizeof(float));
        assert_memory_equal(&wide.figures, &plain.figures, sizeof wide.figures);
        denoise_result_release(&wide);
        denoise_result_release(&plain);
    }
    toy_groups_release(&groups);
    toy_release(&toy);
}

/* Thin things that both groups have met are no fireflies. */
static void stars_and_wires_stay(void **state)
{
    static float a[SIDE * SIDE * 3], b[SIDE * SIDE * 3], truth[SIDE * SIDE * 3];
    const struct denoise_input input = {.width = SIDE, .height = SIDE, .groups = {a, b}};

    (void)state;
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
            for (int c = 0; c < 3; c++) {
                const int i = (y * SIDE + x) * 3 + c;
                const float value = (x % 16 == 7 && y % 16 == 5 && y < 32) || (y > 40 && x == y - 20) ? 1 : 0;
                const float noise = ((x * 7 + y * 13) % 5 - 2) * 0.01f;
                truth[i] = value;
                a[i] = value * (1 + noise);
                b[i] = value * (1 - noise);
            }
    for (int method = DENOISE_FAST; method <= DENOISE_FULL; method++) {
        struct denoise_result result;
        run(&input, method, 1, &result);
        for (int i = 0; i < SIDE * SIDE * 3; i++)
            if (!(fabsf(result.image[i] - truth[i]) < 0.05f))
                fail_msg("method %d, pixel (%d, %d): %g instead of %g", method, i / 3 % SIDE, i / 3 / SIDE,
                         (double)result.image[i], (double)truth[i]);
        denoise_result_release(&result);
    }
}

static void what_is_not_finite_is_refused(void **state)
{
    float a[12] = {0}, b[12] = {0};
    struct denoise_input input = {.width = 2, .height = 2, .groups = {a, b}};
    const struct denoise_options options = {.method = DENOISE_FULL};
    struct denoise_result result;
    struct error err = {0};

    (void)state;
    a[3] = NAN;
    assert_int_equal(denoise(&input, &options, &result, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "(1, 0)"));
    assert_null(result.image);
    a[3] = 0;
    b[11] = INFINITY;
    assert_int_equal(denoise(&input, &options, &result, &err), STATUS_ERR_INPUT);
    input.width = 0;
    assert_int_equal(denoise(&input, &options, &result, &err), STATUS_ERR_INPUT);
}

static void a_pixel_alone_stays(void **state)
{
    const float a[3] = {1, 2, 3}, b[3] = {3, 2, 1};
    const struct denoise_input input = {.width = 1, .height = 1, .groups = {a, b}};
    struct denoise_result result;

    (void)state;
    run(&input, DENOISE_FULL, 0, &result);
    for (int c = 0; c < 3; c++)
        assert_true(result.image[c] == 2);
    denoise_result_release(&result);
}

static void tiles_that_lack_a_group_stay_raw(void **state)
{
    uint32_t samples[2 * 9];
    struct toy toy;
    struct toy_groups groups;
    struct denoise_result result;

    (void)state;
    toy_make(&toy, 48, 48, 1);
    toy_sample(&groups, &toy, TOY_EXPONENTIAL, 4, 5);
    for (int i = 0; i < 18; i++)
        samples[i] = i == 9 ? 0 : 4; /* the middle tile has group 0 alone */
    groups.input.samples = samples;
    run(&groups.input, DENOISE_FULL, 0, &result);
    assert_int_equal(result.figures.known, 0);
    assert_true(isnan(result.figures.display_error));
    assert_true(result.counts.raw >= 1);
    for (uint32_t y = 16; y < 32; y++)
        for (uint32_t i = 16 * 3; i < 32 * 3; i++)
            assert_true(result.image[y * 48 * 3 + i] == groups.groups[0][y * 48 * 3 + i]);
    denoise_result_release(&result);
    toy_groups_release(&groups);
    toy_release(&toy);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(noise_falls),
        cmocka_unit_test(a_clean_picture_stays_as_good),
        cmocka_unit_test(slopes_stay),
        cmocka_unit_test(threads_change_no_bit),
        cmocka_unit_test(the_instruction_set_changes_no_bit),
        cmocka_unit_test(stars_and_wires_stay),
        cmocka_unit_test(what_is_not_finite_is_refused),
        cmocka_unit_test(a_pixel_alone_stays),
        cmocka_unit_test(tiles_that_lack_a_group_stay_raw),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
