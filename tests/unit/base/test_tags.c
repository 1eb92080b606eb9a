/* Tags: words of workers and of jobs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/base/tags.h"

static void lists(void **state)
{
    static const struct { const char *text, *tags; } good[] = {
        {"gpu", "gpu"}, {"gpu,big", "big,gpu"}, {"a,b,a", "a,b"}, {"A-1_.x", "A-1_.x"},
        {"a,b,c,d,e,f,g,h", "a,b,c,d,e,f,g,h"},
        {"0123456789012345678901234567890", "0123456789012345678901234567890"},
    };
    static const char *const bad[] = {
        "", ",", "a,", ",a", "a,,b", "a b", "gp\xc3\xbc", "a;b", "a/b", "01234567890123456789012345678901",
        "a,b,c,d,e,f,g,h,i",
    };
    char tags[TAGS_TEXT_MAX + 1];
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        assert_int_equal(tags_parse(good[i].text, tags, &err), STATUS_OK);
        assert_string_equal(tags, good[i].tags);
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        err.text[0] = 0;
        assert_int_equal(tags_parse(bad[i], tags, &err), STATUS_ERR_USAGE);
        assert_true(err.text[0]);
    }
}

static void which_is_missing(void **state)
{
    char missing[TAG_MAX + 1];

    (void)state;
    assert_true(tags_have("", "", missing));
    assert_true(tags_have("big,gpu", "", missing));
    assert_true(tags_have("big,gpu", "gpu", missing));
    assert_true(tags_have("big,gpu,x", "big,x", missing));
    assert_false(tags_have("big,gpu", "big,gpus", missing));
    assert_string_equal(missing, "gpus");
    assert_false(tags_have("bigger", "big", missing));
    assert_false(tags_have("", "a,b", missing));
    assert_string_equal(missing, "a");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists),
        cmocka_unit_test(which_is_missing),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
