/* The sRGB curve against the standard's formula in libm's double, and colour spaces. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "common/image/color.h"
#include "common/math/elementary.h"

static double reference_encode(double v) { return v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055; }

static double reference_decode(double v) { return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4); }

static void test_against_formula(void **state)
{
    float before = -1.0f;

    (void)state;
    for (int i = 0; i <= 100000; i++) {
        float v = (float)i / 100000.0f;

        assert_true(fabs((double)srgb_encode(v) - reference_encode((double)v)) < 2e-7);
        assert_true(fabs((double)srgb_decode(v) - reference_decode((double)v)) < 2e-7);
        assert_true(srgb_encode(v) >= before); /* monotone, across the joint too */
        before = srgb_encode(v);
    }
}

/* The quick row against the curve, and over every float of its power part without a step back. */
static void test_row(void **state)
{
    enum { CHUNK = 1 << 16 };
    static float row[CHUNK];
    float before = 0.0f, ends[] = {-1.0f, 0.0f, 1.0f, 7.0f, NAN, -INFINITY, INFINITY, 1e-45f};
    uint32_t first = float_bits(0.0031f), last = float_bits(1.0f);

    (void)state;
    for (uint32_t bits = first; bits <= last; bits += CHUNK) {
        for (uint32_t i = 0; i < CHUNK; i++)
            row[i] = float_from_bits(bits + i);
        srgb_encode_row(row, CHUNK);
        for (uint32_t i = 0; i < CHUNK; i++) {
            assert_true(row[i] >= before);
            before = row[i];
        }
        for (uint32_t i = 0; i < CHUNK; i += 997)
            assert_true(fabsf(row[i] - srgb_encode(float_from_bits(bits + i))) < 1e-7f);
    }
    assert_true(before == 1.0f);
    memcpy(row, ends, sizeof ends);
    srgb_encode_row(row, sizeof ends / sizeof *ends);
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++)
        assert_true(row[i] == srgb_encode(ends[i]));
}

/* A row is encoded four values at a time; its rest, too, and NaN is black. */
static void test_row_lengths(void **state)
{
    float whole[12], row[12];

    (void)state;
    for (int i = 0; i < 12; i++)
        whole[i] = i == 5 ? NAN : (float)i * 0.11f - 0.01f;
    for (size_t count = 0; count <= 12; count++) {
        memcpy(row, whole, sizeof row);
        srgb_encode_row(row, count);
        for (size_t i = 0; i < 12; i++) {
            float alone = whole[i];
            srgb_encode_row(&alone, 1);
            assert_true(i < count ? row[i] == alone && fabsf(alone - srgb_encode(whole[i])) < 1e-7f
                                  : memcmp(&row[i], &whole[i], sizeof row[i]) == 0);
        }
    }
}

static void test_ends_and_nonsense(void **state)
{
    (void)state;
    assert_true(srgb_encode(0.0f) == 0.0f && srgb_decode(0.0f) == 0.0f);
    assert_true(srgb_encode(1.0f) == 1.0f && srgb_decode(1.0f) == 1.0f);
    assert_true(srgb_encode(-3.0f) == 0.0f && srgb_decode(-INFINITY) == 0.0f);
    assert_true(srgb_encode(7.0f) == 1.0f && srgb_decode(INFINITY) == 1.0f);
    assert_true(srgb_encode(NAN) == 0.0f && srgb_decode(NAN) == 0.0f);
}

/* Every 8-bit code survives decoding and encoding. */
static void test_table(void **state)
{
    const float *table = srgb_decode_table();

    (void)state;
    assert_ptr_equal(table, srgb_decode_table());
    for (int i = 0; i < 256; i++) {
        assert_true(table[i] == srgb_decode((float)i / 255.0f));
        assert_int_equal((int)(srgb_encode(table[i]) * 255.0f + 0.5f), i);
    }
}

static void test_color_spaces(void **state)
{
    /* ACES AP0, white near D60: its neutral must stay neutral after adaptation. */
    static const struct color_primaries ap0 = {
        {0.7347, 0.2653}, {0.0, 1.0}, {0.0001, -0.077}, {0.32168, 0.33767}};
    static const struct color_primaries nonsense = {
        {0.3, 0.3}, {0.3, 0.3}, {0.3, 0.3}, {0.3, 0.3}};
    double m[3][3];

    (void)state;
    assert_true(color_to_rec709(&color_rec709, m));
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            assert_true(fabs(m[i][j] - (i == j)) < 1e-12);
    assert_true(color_to_rec709(&ap0, m));
    for (int i = 0; i < 3; i++)
        assert_true(fabs(m[i][0] + m[i][1] + m[i][2] - 1) < 1e-9);
    assert_true(fabs(m[0][0] - 2.5216) < 2e-3); /* AP0 to Rec. 709, Bradford */
    assert_true(color_to_rec709(&color_xyz, m));
    assert_true(fabs(m[0][0] - 3.2406) < 2e-3 && fabs(m[2][1] + 0.2040) < 2e-3);
    assert_false(color_to_rec709(&nonsense, m));
    assert_true(color_primaries_equal(&color_rec709, &color_rec709));
    assert_false(color_primaries_equal(&color_rec709, &ap0));
}

static void test_matrix_inverse(void **state)
{
    const double m[3][3] = {{2, -1, 0.5}, {0.25, 3, 1}, {-4, 0.125, 7}};
    const double flat[3][3] = {{1, 2, 3}, {2, 4, 6}, {1, 1, 1}};
    double inverse[3][3];

    (void)state;
    assert_true(color_matrix_invert(m, inverse));
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0;
            for (int k = 0; k < 3; k++)
                sum += m[i][k] * inverse[k][j];
            assert_true(fabs(sum - (i == j)) < 1e-12);
        }
    assert_false(color_matrix_invert(flat, inverse));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_against_formula), cmocka_unit_test(test_row),
        cmocka_unit_test(test_row_lengths),
        cmocka_unit_test(test_ends_and_nonsense), cmocka_unit_test(test_table),
        cmocka_unit_test(test_color_spaces), cmocka_unit_test(test_matrix_inverse),
    };
    return cmocka_run_group_tests_name("color", tests, NULL, NULL);
}
