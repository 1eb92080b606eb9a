/* Sheets of sweeps: their little language, where everything stands, and how tiles are reduced. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/views/sweep.h"
#include "client/terminal/text_draw.h"

static void sweep_of(struct sweep *s, const char *text)
{
    struct error err = {0};

    assert_int_equal(sweep_parse(s, text, 0, &err), STATUS_OK);
}

static void words(void **state)
{
    static const char *const bad[] = {"", "contrast", "=1", "contrast=", "contrast=1,",
                                      "contrast=,1", "contrast=1,,2"};
    struct sweep s;
    struct error err = {0};

    (void)state;
    sweep_of(&s, "contrast=0.4,0.8,1.6");
    assert_string_equal(s.name, "contrast");
    assert_int_equal(s.count, 3);
    assert_string_equal(s.values[1], "0.8");
    assert_string_equal(sweep_label(&s, 1), "contrast=0.8");
    sweep_release(&s);
    sweep_of(&s, "operator=gamma,linear");
    assert_string_equal(sweep_label(&s, 0), "gamma");
    sweep_release(&s);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(sweep_parse(&s, bad[i], 0, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "--sweep"));
        sweep_release(&s);
    }
}

/* "a=0,0,0,..." */
static void sweep_of_count(struct sweep *s, size_t count, status expected)
{
    char text[4 + 2 * (SWEEP_VALUES_MAX + 1)] = "a=";
    struct error err = {0};

    for (size_t i = 0; i < count; i++)
        strcat(text, i ? ",0" : "0");
    assert_int_equal(sweep_parse(s, text, 0, &err), expected);
}

static void as_many_as_allowed(void **state)
{
    struct sweep s;

    (void)state;
    sweep_of_count(&s, SWEEP_VALUES_MAX, STATUS_OK);
    assert_int_equal(s.count, SWEEP_VALUES_MAX);
    sweep_release(&s);
    sweep_of_count(&s, SWEEP_VALUES_MAX + 1, STATUS_ERR_USAGE);
    sweep_release(&s);
}

static void all_operators(void **state)
{
    size_t count, free_of_files = 0;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);
    struct sweep s;
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < count; i++)
        free_of_files += !operators[i]->file_required;
    sweep_of(&s, "operator=all");
    assert_int_equal(s.count, free_of_files);
    for (size_t i = 0; i < s.count; i++)
        assert_non_null(tonemap_find(s.values[i]));
    sweep_release(&s);
    assert_int_equal(sweep_parse(&s, "operator=all", 1, &err), STATUS_OK);
    assert_int_equal(s.count, count);
    sweep_release(&s);
    sweep_of(&s, "key=all"); /* a word like any other */
    assert_int_equal(s.count, 1);
    sweep_release(&s);
}

/* Every tile is on the sheet and touches no other, and labels fit into their cells. */
static void check_sheet(const struct sheet *s)
{
    uint32_t x, y, u, v;

    assert_int_equal(s->columns * s->rows >= s->tiles, 1);
    assert_int_equal(s->columns * (s->rows - 1) < s->tiles, 1);
    for (uint32_t i = 0; i < s->tiles; i++) {
        sheet_tile_at(s, i, &x, &y);
        assert_true(x >= s->left && x + s->tile_width + s->margin <= s->width);
        assert_true(y >= s->top && y + s->tile_height + s->margin <= s->height);
        for (uint32_t k = 0; k < i; k++) {
            sheet_tile_at(s, k, &u, &v);
            assert_true(x >= u + s->tile_width || u >= x + s->tile_width || y >= v + s->tile_height ||
                        v >= y + s->tile_height);
        }
    }
    for (size_t i = 0; i < s->sweeps[0].count; i++)
        assert_true(text_draw_width(sweep_label(&s->sweeps[0], i), s->scale) <= s->cell_width);
}

static void rows_and_grids(void **state)
{
    static const uint32_t sizes[][2] = {{1920, 1080}, {1024, 512}, {300, 900}, {1, 1}, {1, 4000},
                                        {4000, 1}};
    struct sweep s;
    struct sheet sheet;

    (void)state;
    for (size_t k = 0; k < sizeof sizes / sizeof sizes[0]; k++) {
        for (size_t count = 1; count <= SWEEP_VALUES_MAX; count++) {
            sweep_of_count(&s, count, STATUS_OK);
            sheet_plan(&sheet, &s, 1, sizes[k][0], sizes[k][1], 480, "a picture");
            check_sheet(&sheet);
            if (count <= 4)
                assert_int_equal(sheet.rows, 1);
            assert_int_equal(sheet.tile_width, sizes[k][0] < 480 ? sizes[k][0] : 480);
            sweep_release(&s);
        }
    }
    /* Nine pictures of 16:9 make three lines of three. */
    sweep_of_count(&s, 9, STATUS_OK);
    sheet_plan(&sheet, &s, 1, 1920, 1080, 480, "a picture");
    assert_int_equal(sheet.columns, 3);
    assert_int_equal(sheet.tile_height, 270);
    sweep_release(&s);
}

static void matrices(void **state)
{
    struct sweep s[2];
    struct sheet sheet;
    uint32_t x, y, u, v;

    (void)state;
    sweep_of(&s[0], "contrast=0.4,0.8,1.6");
    sweep_of(&s[1], "saturation=0.5,1");
    sheet_plan(&sheet, s, 2, 640, 480, 320, "a picture");
    check_sheet(&sheet);
    assert_int_equal(sheet.columns, 3);
    assert_int_equal(sheet.rows, 2);
    /* Row labels have their room to the left of the tiles. */
    assert_true(sheet.left >= sheet.margin + text_draw_width("saturation=0.5", sheet.scale));
    sheet_tile_at(&sheet, 1, &x, &y);
    sheet_tile_at(&sheet, 1 + 3, &u, &v);
    assert_int_equal(x, u);
    assert_true(v >= y + sheet.tile_height);
    sweep_release(&s[0]);
    sweep_release(&s[1]);
}

static void titles_are_wrapped(void **state)
{
    static const char title[] = "picture.hdr  mantiuk08  contrast=1.6  saturation=0.5  "
                                "averyveryveryveryveryveryveryverylongwordwithoutanyblank";
    struct sweep s;
    struct sheet sheet;

    (void)state;
    sweep_of_count(&s, 1, STATUS_OK);
    for (uint32_t width = 8; width <= 480; width += 8) {
        size_t shown = 0, blanks = 0;

        sheet_plan(&sheet, &s, 1, width, 10, width, title);
        for (size_t i = 0; i < sheet.title_lines; i++) {
            assert_true(sheet.title_length[i] > 0);
            assert_true(sheet.title_length[i] == 1 ||
                        (uint32_t)(sheet.title_length[i] * TEXT_ADVANCE - 1) * sheet.scale + 2 * sheet.margin <=
                            sheet.width);
            shown += sheet.title_length[i];
            if (i)
                blanks += sheet.title_begin[i] - (sheet.title_begin[i - 1] + sheet.title_length[i - 1]);
        }
        if (sheet.title_lines < SWEEP_TITLE_LINES_MAX)
            assert_int_equal(shown + blanks, strlen(title));
    }
    sweep_release(&s);
}

static void reducing(void **state)
{
    float in[6 * 3], out[2 * 3], same[6 * 3];
    struct image a = {3, 2, 3, in}, b = {2, 1, 3, out}, c = {3, 2, 3, same};

    (void)state;
    for (int i = 0; i < 6 * 3; i++)
        in[i] = (float)(i / 3 % 3); /* 0, 1, 2 in every line */
    image_box_reduce(&b, &a);
    /* The left half is pixel 0 and half of pixel 1, the right one the other half and pixel 2. */
    assert_float_equal(out[0], 0.5 / 1.5, 1e-6);
    assert_float_equal(out[3], 2.5 / 1.5, 1e-6);
    image_box_reduce(&c, &a);
    assert_memory_equal(same, in, sizeof in);
}

static void writing(void **state)
{
    float pixels[20 * 30 * 3] = {0};
    struct image image = {30, 20, 3, pixels};
    size_t lit = 0;

    (void)state;
    assert_int_equal(text_draw_width("", 2), 0);
    assert_int_equal(text_draw_width("ab", 2), 22);
    text_draw(&image, 0, 0, 2, 0.5f, "-");
    for (size_t i = 0; i < 20 * 30; i++)
        lit += pixels[i * 3] == 0.5f && pixels[i * 3 + 2] == 0.5f;
    assert_int_equal(lit, 5 * 4); /* five pixels, each of 2 x 2 */
    /* Beyond the edge, and bytes that are not ASCII. */
    text_draw(&image, 25, 15, 3, 1, "W\xc3\xa9\x7f\n");
    text_draw(&image, 100, 100, 1, 1, "W");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(words),          cmocka_unit_test(as_many_as_allowed),
        cmocka_unit_test(all_operators),  cmocka_unit_test(rows_and_grids),
        cmocka_unit_test(matrices),       cmocka_unit_test(titles_are_wrapped),
        cmocka_unit_test(reducing),       cmocka_unit_test(writing),
    };
    return cmocka_run_group_tests_name("client/sweep", tests, NULL, NULL);
}
