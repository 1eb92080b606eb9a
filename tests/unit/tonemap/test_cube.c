/* The `lut` operator: .cube files, good and bad, and what lies between their entries. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/image/color.h"
#include "common/tonemap/tonemap.h"

static struct tonemap_settings lut_settings(const char *input, const char *output)
{
    struct tonemap_settings s;

    assert_int_equal(tonemap_settings_init(&s, "lut", NULL), STATUS_OK);
    assert_int_equal(tonemap_settings_set_text(&s, "input", input, NULL), STATUS_OK);
    assert_int_equal(tonemap_settings_set_text(&s, "result", output, NULL), STATUS_OK);
    s.has_file = 1;
    snprintf(s.file_name, sizeof s.file_name, "look.cube");
    return s;
}

static void develop(const struct tonemap_settings *s, const char *cube, const float in[3], float out[3])
{
    struct tonemap_context context = {
        .threads = 1, .file_data = (const uint8_t *)cube, .file_size = strlen(cube)};
    struct image picture, developed;
    struct error err = {0};

    assert_int_equal(image_init(&picture, 1, 1, 3, &err), STATUS_OK);
    memcpy(picture.pixels, in, 3 * sizeof(float));
    if (tonemap_apply(&developed, &picture, s, &context, &err) != STATUS_OK)
        fail_msg("%s", err.text);
    memcpy(out, developed.pixels, 3 * sizeof(float));
    image_release(&picture);
    image_release(&developed);
}

static void expect(const struct tonemap_settings *s, const char *cube, float r, float g, float b, float out_r,
                   float out_g, float out_b)
{
    const float in[3] = {r, g, b};
    float out[3];

    develop(s, cube, in, out);
    if (!(fabsf(out[0] - out_r) < 2e-6f && fabsf(out[1] - out_g) < 2e-6f && fabsf(out[2] - out_b) < 2e-6f))
        fail_msg("(%g, %g, %g) became (%g, %g, %g), not (%g, %g, %g)", (double)r, (double)g, (double)b, (double)out[0],
                 (double)out[1], (double)out[2], (double)out_r, (double)out_g, (double)out_b);
}

static const char identity[] = "TITLE \"nothing\"\n# a comment\n\nLUT_3D_SIZE 2\n"
                               "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n1 0 1\n0 1 1\n1 1 1\n";

static void test_one_dimension(void **state)
{
    struct tonemap_settings s = lut_settings("linear", "display");
    const char *squares = "LUT_1D_SIZE 3\r\n0 1 0\r\n0.25 0.75 0.5\r\n1 0 1";

    (void)state;
    expect(&s, squares, 0.0f, 0.5f, 0.25f, 0.0f, 0.75f, 0.25f);
    expect(&s, squares, 0.75f, 0.25f, 1.0f, 0.625f, 0.875f, 1.0f);
    expect(&s, squares, 9.0f, 9.0f, 9.0f, 1.0f, 0.0f, 1.0f);
    expect(&s, "DOMAIN_MAX 4 8 2\nDOMAIN_MIN 0 0 1\nLUT_1D_SIZE 2\n0 0 0\n1 1 1\n", 1.0f, 1.0f, 1.0f, 0.25f, 0.125f,
           0.0f);
    expect(&s, "LUT_1D_INPUT_RANGE -1 3\nLUT_1D_SIZE 2\n0 0 0\n1 1 1\n", 1.0f, 2.0f, 0.0f, 0.5f, 0.75f, 0.25f);
}

/* Red runs fastest, and every corner comes out as it stands. */
static void test_cube_order(void **state)
{
    struct tonemap_settings s = lut_settings("linear", "display");
    const char *cube = "LUT_3D_SIZE 2\n0 0 .1\n.1 0 0\n.2 0 0\n.3 0 0\n.4 0 0\n.5 0 0\n.6 0 0\n.7 0 0\n";

    (void)state;
    expect(&s, cube, 0, 0, 0, 0.0f, 0, 0.1f);
    expect(&s, cube, 1, 0, 0, 0.1f, 0, 0);
    expect(&s, cube, 0, 1, 0, 0.2f, 0, 0);
    expect(&s, cube, 0, 0, 1, 0.4f, 0, 0);
    expect(&s, cube, 1, 1, 1, 0.7f, 0, 0);
}

/* A cube of one corner: within a tetrahedron the value is linear, so that corner 111's weight is the
 * smallest of the three coordinates (trilinear interpolation would give the product). */
static void test_tetrahedra(void **state)
{
    struct tonemap_settings s = lut_settings("linear", "display");
    const char *white = "LUT_3D_SIZE 2\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n1 1 1\n";
    const char *red = "LUT_3D_SIZE 2\n0 0 0\n1 1 1\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n";

    (void)state;
    for (int r = 0; r <= 4; r++)
        for (int g = 0; g <= 4; g++)
            for (int b = 0; b <= 4; b++) {
                float x = (float)r / 4, y = (float)g / 4, z = (float)b / 4;
                float least = fminf(x, fminf(y, z)), lead = fmaxf(x - fmaxf(y, z), 0.0f);

                expect(&s, white, x, y, z, least, least, least);
                expect(&s, red, x, y, z, lead, lead, lead);
                expect(&s, identity, x, y, z, x, y, z);
            }
}

/* A larger cube of a linear map reproduces it everywhere. */
static void test_large_cube(void **state)
{
    enum { SIDE = 17 };
    struct tonemap_settings s = lut_settings("linear", "display");
    char *cube = malloc((size_t)SIDE * SIDE * SIDE * 64 + 100);
    size_t length;

    (void)state;
    assert_non_null(cube);
    length = (size_t)sprintf(cube, "LUT_3D_SIZE %d\nLUT_3D_INPUT_RANGE 0 2\n", SIDE);
    for (int b = 0; b < SIDE; b++)
        for (int g = 0; g < SIDE; g++)
            for (int r = 0; r < SIDE; r++)
                length += (size_t)sprintf(cube + length, "%.9f %.9f %.9f\n", (0.5 * r + 0.3 * g) / (SIDE - 1),
                                          (0.9 * b + 0.1) / (SIDE - 1), 1.0 - 0.9 * g / (SIDE - 1));
    for (float r = 0.0f; r < 2.0f; r += 0.17f)
        for (float g = 0.0f; g < 2.0f; g += 0.31f)
            expect(&s, cube, r, g, 0.77f, 0.25f * r + 0.15f * g, 0.9f * 0.385f + 0.1f / 16, 1.0f - 0.45f * g);
    free(cube);
}

/* A shaper of its own range before the cube. */
static void test_line_before_cube(void **state)
{
    struct tonemap_settings s = lut_settings("linear", "display");
    char cube[400];

    (void)state;
    snprintf(cube, sizeof cube, "LUT_1D_SIZE 3\nLUT_1D_INPUT_RANGE 0 4\nLUT_3D_SIZE 2\n"
             "LUT_3D_INPUT_RANGE 0 10\n0 0 0\n8 8 8\n10 10 10\n%s", strstr(identity, "0 0 0\n"));
    expect(&s, cube, 1.0f, 2.0f, 3.0f, 0.4f, 0.8f, 0.9f);
    expect(&s, cube, 0.0f, 4.0f, 400.0f, 0.0f, 1.0f, 1.0f);
}

static void test_inputs_and_outputs(void **state)
{
    struct tonemap_settings s = lut_settings("srgb", "display");
    struct error err = {0};

    (void)state;
    expect(&s, identity, 0.18f, 0.5f, 3.0f, srgb_encode(0.18f), srgb_encode(0.5f), 1.0f);
    s = lut_settings("linear", "linear");
    expect(&s, identity, 0.18f, 0.5f, 3.0f, srgb_encode(0.18f), srgb_encode(0.5f), 1.0f);
    s = lut_settings("log2", "display"); /* -10 .. 6.5 stops around 0.18 */
    expect(&s, identity, 0.18f, 0.36f, 0.09f, 10 / 16.5f, 11 / 16.5f, 9 / 16.5f);
    expect(&s, identity, 0.18f / 4096, 0.18f * 64, 1e20f, 0.0f, 16 / 16.5f, 1.0f);
    assert_int_equal(tonemap_settings_set(&s, "log2-min", -8.0, &err), STATUS_OK);
    assert_int_equal(tonemap_settings_set(&s, "log2-max", 8.0, &err), STATUS_OK);
    for (double stops = -7.9; stops < 8.0; stops += 0.13) {
        float light = (float)(0.18 * pow(2.0, stops)), code = (float)((stops + 8.0) / 16.0);
        expect(&s, identity, light, light, light, code, code, code);
    }
}

/* ---- files that are refused ------------------------------------------------------------------ */

static void refuse_bytes(const void *data, size_t size, const char *where, const char *why)
{
    struct error err = {0};
    void *file;

    assert_int_equal(tonemap_find("lut")->file_load(&file, data, size, "bad.cube", &err), STATUS_ERR_INPUT);
    assert_null(file);
    if (!strstr(err.text, "bad.cube") || !strstr(err.text, where) || !strstr(err.text, why))
        fail_msg("\"%s\" does not speak of \"%s\" and \"%s\"", err.text, where, why);
}

static void refuse(const char *text, const char *where, const char *why)
{
    refuse_bytes(text, strlen(text), where, why);
}

static void test_bad_files(void **state)
{
    char line[1400] = "# ";

    (void)state;
    refuse("", "holds no table", "");
    refuse("TITLE \"x\"\n", "holds no table", "");
    refuse("0 0 0\n1 1 1\n", "line 1", "LUT_1D_SIZE");
    refuse("LUT_1D_SIZE 2\n0 0 0\n", "too short", "");
    refuse("LUT_1D_SIZE 2\n0 0 0\n# and no more\n", "after 1 of 2", "");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 1 1\n2 2 2\n", "line 4", "more than the 2");
    refuse("LUT_1D_SIZE 2\n0.0 0 0\n1 1\n", "line 3", "3 numbers");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 1 1 1\n", "line 3", "more");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 nan 1\n", "line 3", "\"nan\"");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 inf 1\n", "line 3", "\"inf\"");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 1e999 1\n", "line 3", "inf");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 0x1p1 1\n", "line 3", "0x1p1");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 1..5 1\n", "line 3", "1..5");
    refuse("LUT_1D_SIZE 2\n0 0 0\n1 2000000 1\n", "line 3", "scale");
    refuse("LUT_1D_SIZE 1\n0 0 0\n", "line 1", "from 2 to 65536");
    refuse("LUT_1D_SIZE 65537\n", "line 1", "65536");
    refuse("LUT_1D_SIZE 2.5\n", "line 1", "whole");
    refuse("LUT_1D_SIZE -2\n", "line 1", "from 2");
    refuse("LUT_1D_SIZE\n", "line 1", "1 numbers");
    refuse("LUT_3D_SIZE 257\n", "line 1", "256");
    refuse("LUT_3D_SIZE 256\n0 0 0\n", "16777216", "too short");
    refuse("LUT_3D_SIZE 2\nLUT_3D_SIZE 2\n", "line 2", "twice");
    refuse("TITLE \"a\"\nTITLE \"b\"\n", "line 2", "twice");
    refuse("DOMAIN_MIN 0 0 0\nDOMAIN_MIN 0 0 0\n", "line 2", "twice");
    refuse("LUT_1D_INPUT_RANGE 0 1\nLUT_1D_INPUT_RANGE 0 1\n", "line 2", "twice");
    refuse("LUT_1D_SIZE 2\nDOMAIN_MIN 0 0 2\n0 0 0\n1 1 1\n", "domain", "larger");
    refuse("LUT_1D_SIZE 2\nLUT_1D_INPUT_RANGE 1 1\n0 0 0\n1 1 1\n", "domain", "larger");
    refuse("LUT_1D_SIZE 2\nLUT_1D_INPUT_RANGE 0 2\nDOMAIN_MAX 1 1 1\n0 0 0\n1 1 1\n", "one of", "");
    refuse("LUT_1D_SIZE 2\nLUT_3D_SIZE 2\nDOMAIN_MAX 1 1 1\n0 0 0\n1 1 1\n", "two tables", "");
    refuse("LUT_1D_SIZE 2\n0 0 0\nTITLE \"late\"\n1 1 1\n", "line 3", "above");
    refuse("LUT_2D_SIZE 2\n", "line 1", "LUT_2D_SIZE");
    refuse("LUT_IN_VIDEO_RANGE\n", "line 1", "full range");
    refuse("<xml>\n", "line 1", "<xml>");
    refuse("\"\n", "line 1", "");
    memset(line + 2, 'x', 1100);
    refuse(line, "line 1", "too long");
    refuse_bytes("LUT_1D_SIZE 2\n0 \0 0\n", 21, "line 2", "zero byte");
}

static void test_bad_log_range(void **state)
{
    struct tonemap_settings s = lut_settings("log2", "display");
    struct tonemap_context context = {
        .file_data = (const uint8_t *)identity, .file_size = sizeof identity - 1};
    struct image picture, out;
    struct error err = {0};

    (void)state;
    assert_int_equal(image_init(&picture, 1, 1, 3, &err), STATUS_OK);
    assert_int_equal(tonemap_settings_set(&s, "log2-min", 7.0, &err), STATUS_OK);
    assert_int_equal(tonemap_apply(&out, &picture, &s, &context, &err), STATUS_ERR_INPUT);
    assert_non_null(strstr(err.text, "log2-max"));
    assert_null(out.pixels);
    image_release(&picture);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_dimension),
        cmocka_unit_test(test_cube_order),
        cmocka_unit_test(test_tetrahedra),
        cmocka_unit_test(test_large_cube),
        cmocka_unit_test(test_line_before_cube),
        cmocka_unit_test(test_inputs_and_outputs),
        cmocka_unit_test(test_bad_files),
        cmocka_unit_test(test_bad_log_range),
    };
    return cmocka_run_group_tests_name("cube", tests, NULL, NULL);
}
