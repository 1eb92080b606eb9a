/* Logs as JSON: each line is one object, whatever the text holds. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/system/log.h"

/* What one line of the log is for that text; the caller frees it. */
static char *line_of(const char *text)
{
    int ends[2], kept = dup(STDERR_FILENO);
    char *line = calloc(1, 1 << 16);
    ssize_t got;

    assert_int_equal(pipe(ends), 0);
    dup2(ends[1], STDERR_FILENO);
    log_warn("%s", text);
    dup2(kept, STDERR_FILENO);
    close(kept);
    close(ends[1]);
    got = read(ends[0], line, (1 << 16) - 1);
    close(ends[0]);
    assert_true(got > 1 && line[got - 1] == '\n' && strlen(line) == (size_t)got);
    return line;
}

/* The text, read back from JSON. */
static void expect_text(const char *text, const char *expected)
{
    char *line = line_of(text);
    json_t *value = json_loads(line, 0, NULL);

    assert_non_null(value);
    assert_null(strchr(line, '\n')[1] ? line : NULL);
    assert_int_equal(json_object_size(value), 5);
    assert_string_equal(json_string_value(json_object_get(value, "level")), "warn");
    assert_string_equal(json_string_value(json_object_get(value, "program")), "tester");
    assert_int_equal(json_integer_value(json_object_get(value, "pid")), getpid());
    assert_int_equal(strlen(json_string_value(json_object_get(value, "time"))), strlen("2026-03-01T12:00:00.000Z"));
    assert_string_equal(json_string_value(json_object_get(value, "text")), expected);
    json_decref(value);
    free(line);
}

static void every_text_is_one_object(void **state)
{
    char many[4000], *line;
    json_t *value;

    (void)state;
    expect_text("", "");
    expect_text("job 3 \"walk\", C:\\x", "job 3 \"walk\", C:\\x");
    expect_text("two\nlines\ttab\x01\x7f", "two\nlines\ttab\x01\x7f");
    expect_text("\xc3\xa4 \xe2\x9c\x93 \xf0\x9f\x98\x80", "\xc3\xa4 \xe2\x9c\x93 \xf0\x9f\x98\x80");
    expect_text("\xff \xc3", "\xef\xbf\xbd \xef\xbf\xbd");
    expect_text("\xc0\x80 \xed\xa0\x80 \xf4\x90\x80\x80",
                "\xef\xbf\xbd\xef\xbf\xbd \xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd \xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd");
    for (int c = 1; c < 4; c++) { /* the worst that can be escaped, and a character that is cut */
        memset(many, "\x01\xff\xc3"[c - 1], sizeof many - 1);
        many[sizeof many - 1] = 0;
        line = line_of(many);
        value = json_loads(line, 0, NULL);
        assert_non_null(value);
        json_decref(value);
        free(line);
    }
}

static void the_form_is_chosen(void **state)
{
    struct error err = {0};
    char *line;

    (void)state;
    setenv("AZULEJO_LOG_FORMAT", "json", 1);
    assert_int_equal(log_set_format("text", &err), STATUS_OK);
    assert_false(log_is_json());
    line = line_of("plain \"text\"");
    assert_non_null(strstr(line, "Z warn tester: plain \"text\"\n"));
    free(line);
    setenv("AZULEJO_LOG_FORMAT", "xml", 1);
    assert_int_equal(log_set_format(NULL, &err), STATUS_ERR_USAGE);
    assert_non_null(strstr(err.text, "AZULEJO_LOG_FORMAT: 'xml'"));
    setenv("AZULEJO_LOG_FORMAT", "", 1);
    assert_int_equal(log_set_format(NULL, &err), STATUS_OK);
    assert_false(log_is_json());
    setenv("AZULEJO_LOG_FORMAT", "json", 1);
    assert_int_equal(log_set_format(NULL, &err), STATUS_OK);
    assert_true(log_is_json());
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_form_is_chosen),
        cmocka_unit_test(every_text_is_one_object),
    };

    log_setup("tester", LOG_LEVEL_WARN);
    return cmocka_run_group_tests_name("log", tests, NULL, NULL);
}
