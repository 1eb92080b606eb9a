/* Documents as commands print them: valid, in order, with the shortest numbers. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "client/terminal/json.h"

static void expect_text(json_t *value, const char *text)
{
    struct buffer out = BUFFER_INIT;
    json_t *back;

    json_write(&out, value);
    assert_string_equal(buffer_text(&out), text);
    back = json_loads(buffer_text(&out), JSON_DECODE_ANY, NULL);
    assert_true(json_equal(back, value));
    json_decref(back);
    json_decref(value);
    buffer_release(&out);
}

static void test_documents(void **state)
{
    (void)state;
    expect_text(json_pack("{s:o, s:[i, b, n], s:{}, s:[]}", "z", json_number(0.1), "a", 1, 1, "e",
                          "f"),
                "{\n  \"z\": 0.1,\n  \"a\": [\n    1,\n    true,\n    null\n  ],\n  \"e\": {},\n"
                "  \"f\": []\n}");
    expect_text(json_pack("[{s:s}]", "a \"key\"", "x\n\xc3\xa9\\"),
                "[\n  {\n    \"a \\\"key\\\"\": \"x\\n\xc3\xa9\\\\\"\n  }\n]");
}

static void test_numbers(void **state)
{
    (void)state;
    expect_text(json_number_float(0.1f), "0.1");
    expect_text(json_number(1.1), "1.1");
    expect_text(json_number(3), "3.0");
    expect_text(json_integer(3), "3");
    expect_text(json_number(NAN), "null");
    expect_text(json_number_float(INFINITY), "null");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_documents),
        cmocka_unit_test(test_numbers),
    };

    return cmocka_run_group_tests_name("client/json", tests, NULL, NULL);
}
