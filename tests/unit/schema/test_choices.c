/* Every number of a choice has one word that leads back to it, and options offer the same words. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "common/scene/effects.h"
#include "common/scene/settings.h"
#include "common/schema/choices.h"

static void test_words_lead_back(void **state)
{
    (void)state;
    for (unsigned choice = 0; choice < CHOICE_COUNT; choice++) {
        const char *word;
        unsigned count = 0;
        for (; (word = choice_word(choice, count)) != NULL; count++)
            assert_int_equal(choice_find(choice, word), count); /* so no word stands twice */
        assert_true(count > 1);
        assert_null(choice_word(choice, UINT64_MAX));
        assert_int_equal(choice_find(choice, ""), -1);
        assert_int_equal(choice_find(choice, "sobol-"), -1);
    }
}

/* "a|b" has the words of the choice, each once. */
static void expect_options(const char *words, enum choice_name choice)
{
    unsigned count = 0;

    while (*words) {
        char word[32] = "";
        size_t length = strcspn(words, "|");
        assert_true(length < sizeof word);
        memcpy(word, words, length);
        assert_true(choice_find(choice, word) >= 0);
        words += length + (words[length] == '|');
        count++;
    }
    assert_null(choice_word(choice, count));
    assert_non_null(choice_word(choice, count - 1));
}

static void test_options(void **state)
{
    (void)state;
    assert_string_equal(CHOICE_WORDS(BVH_QUALITIES), "low|medium|high");
#define OPTIONS(PREFIX, type, noun, ROWS) expect_options(CHOICE_WORDS(ROWS), CHOICE_##PREFIX);
    CHOICES(OPTIONS)
#undef OPTIONS
}

static void test_names(void **state)
{
    (void)state;
    assert_int_equal(bvh_quality_parse("medium"), BVH_QUALITY_MEDIUM);
    assert_string_equal(sampler_name(SAMPLER_INDEPENDENT), "independent");
    assert_string_equal(sampler_name(SAMPLER_COUNT), "unknown");
    assert_int_equal(choice_find(CHOICE_EFFECT, "normal-map"), EFFECT_BIT_NORMAL_MAP);
    assert_int_equal(choice_find(CHOICE_EFFECT, "normal map"), EFFECT_BIT_NORMAL_MAP);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_words_lead_back),
        cmocka_unit_test(test_options),
        cmocka_unit_test(test_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
