/* Numbers, durations and foreign text as they are printed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "client/follow/figures_view.h"
#include "client/terminal/format.h"
#include "client/terminal/table.h"

static void counts(void **state)
{
    static const struct { double value; const char *text; } cases[] = {
        {0, "0"}, {7, "7"}, {1.5, "1.50"}, {999, "999"}, {999.6, "1.00 k"}, {1000, "1.00 k"},
        {4214, "4.21 k"}, {99960, "100 k"}, {999499, "999 k"}, {999500, "1.00 M"}, {1.07e6, "1.07 M"},
        {9.31e10, "93.1 G"}, {1e18, "1.00 E"}, {1e21, "1000 E"}, {NAN, "?"}, {INFINITY, "?"},
    };
    char out[FORMAT_SIZE];

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_string_equal(format_count(out, cases[i].value), cases[i].text);
}

static void byte_sizes(void **state)
{
    char out[FORMAT_SIZE];

    (void)state;
    assert_string_equal(bytes_text(out, 0), "0 B");
    assert_string_equal(bytes_text(out, 1023), "1023 B");
    assert_string_equal(bytes_text(out, 1024), "1.0 KiB");
    assert_string_equal(bytes_text(out, 1536 * 1024), "1.5 MiB");
    assert_string_equal(bytes_text(out, UINT64_MAX), "16.0 EiB");
}

static void durations(void **state)
{
    static const struct { double seconds; const char *text; } cases[] = {
        {0, "0.0 s"}, {0.44, "0.4 s"}, {9.94, "9.9 s"}, {9.96, "10 s"}, {59.4, "59 s"},
        {59.6, "1:00"}, {187, "3:07"}, {3599.6, "1:00:00"}, {3753, "1:02:33"}, {172799, "47:59:59"},
        {172800, "2 d 00 h"}, {356400, "4 d 03 h"}, {-1, "?"}, {NAN, "?"}, {INFINITY, "?"}, {1e300, "?"},
    };
    char out[FORMAT_SIZE];

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_string_equal(format_duration(out, cases[i].seconds), cases[i].text);
}

static void display_errors(void **state)
{
    char out[FORMAT_SIZE];

    (void)state;
    assert_string_equal(figures_display_text(out, 0.134), "0.13/255");
    assert_string_equal(figures_display_text(out, 3.14), "3.1/255");
    assert_string_equal(figures_display_text(out, 2), "2/255");
    assert_string_equal(figures_display_text(out, 41.4), "41/255");
    assert_string_equal(figures_display_text(out, 0), "0/255");
    assert_string_equal(figures_display_text(out, NAN), "?");
    assert_string_equal(figures_display_text(out, -1), "?");
    assert_string_equal(figures_time_text(out, 4.25), "4.2 s");
    assert_string_equal(figures_time_text(out, 98), "98 s");
    assert_string_equal(figures_time_text(out, 540), "9 min");
    assert_string_equal(figures_time_text(out, 9000), "2.5 h");
    assert_string_equal(figures_time_text(out, 3 * 86400), "3.0 d");
    assert_string_equal(figures_time_text(out, INFINITY), "?");
}

static void columns_are_characters(void **state)
{
    (void)state;
    assert_int_equal(text_columns(""), 0);
    assert_int_equal(text_columns("abc"), 3);
    assert_int_equal(text_columns("\xc3\xa9\xe2\x99\xbb"), 2); /* two letters of UTF-8 */
}

/* What comes over a wire cannot write escape sequences to somebody's terminal. */
static void cells_are_printable(void **state)
{
    static const char *const titles[] = {"A", ">B"};
    struct table t;

    (void)state;
    table_init(&t, titles, 2);
    table_add(&t, "%s", "a\x1b[31mb\n\x7f\xc2\x9bz \xc3\xa9");
    table_add(&t, "%d", 7);
    assert_int_equal(t.cell_count, 2);
    assert_string_equal(t.cells[0], "a?[31mb???z \xc3\xa9");
    assert_string_equal(t.cells[1], "7");
    table_release(&t);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(counts), cmocka_unit_test(byte_sizes),   cmocka_unit_test(durations),
        cmocka_unit_test(display_errors), cmocka_unit_test(columns_are_characters),
        cmocka_unit_test(cells_are_printable),
    };

    return cmocka_run_group_tests_name("client/format", tests, NULL, NULL);
}
