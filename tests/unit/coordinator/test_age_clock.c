/* When ages count, and when the clock may be wrong. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/system/clock.h"
#include "coordinator/steering/age_clock.h"

enum { HOUR = 3600, DAY = 86400 };
#define NOON (20000ll * DAY)

static uint64_t boot_ns;
static int64_t wall_s;

static struct age_clock begun(void)
{
    struct age_clock clock;

    boot_ns = 5000 * NS_PER_SECOND;
    wall_s = NOON;
    age_clock_begin(&clock, HOUR, wall_s, boot_ns);
    return clock;
}

/* So many seconds pass, by which the wall clock goes wrong by so many. */
static int64_t pass(struct age_clock *clock, int64_t seconds, int64_t wrong_s)
{
    boot_ns += (uint64_t)seconds * NS_PER_SECOND;
    wall_s += seconds + wrong_s;
    return age_clock_look(clock, wall_s, boot_ns);
}

static void an_even_clock_is_believed_after_a_wait(void **state)
{
    struct age_clock clock = begun();

    (void)state;
    assert_int_equal(age_clock_judge(&clock, NOON, 0), AGES_WAIT);
    assert_int_equal(age_clock_judge(&clock, NOON, 1), AGES_COUNT);
    assert_int_equal(pass(&clock, HOUR - 1, 0), 0);
    assert_int_equal(age_clock_judge(&clock, NOON, 0), AGES_WAIT);
    assert_int_equal(age_clock_left_ns(&clock), NS_PER_SECOND);
    assert_int_equal(pass(&clock, 1, 0), 0);
    assert_int_equal(age_clock_judge(&clock, NOON, 0), AGES_COUNT);
    /* Corrected in small steps, and a machine that was suspended. */
    for (int i = 0; i < 100; i++)
        assert_int_equal(pass(&clock, 1, i % 2 ? 50 : -60), 0);
    assert_int_equal(pass(&clock, 30 * DAY, 0), 0);
    assert_int_equal(age_clock_judge(&clock, NOON, 0), AGES_COUNT);
}

static void a_jump_begins_the_wait_again(void **state)
{
    char text[AGE_CLOCK_TEXT_MAX + 1];

    (void)state;
    for (int ahead = 0; ahead < 2; ahead++) {
        struct age_clock clock = begun();
        int64_t jump_s = ahead ? 60 * DAY : -61;
        pass(&clock, DAY, 0);
        assert_int_equal(pass(&clock, 1, jump_s), jump_s);
        assert_int_equal(age_clock_judge(&clock, NOON, 0), AGES_JUMPED);
        assert_int_equal(age_clock_judge(&clock, NOON, 1), AGES_JUMPED);
        age_clock_text(text, &clock, AGES_JUMPED, 0);
        assert_non_null(strstr(text, ahead ? "ahead by 60 days" : "back by 61 s"));
        assert_int_equal(pass(&clock, HOUR, 0), 0);
        assert_int_equal(age_clock_judge(&clock, NOON, 0), AGES_COUNT);
    }
}

static void a_second_makes_no_day(void **state)
{
    struct age_clock clock = begun();
    char text[AGE_CLOCK_TEXT_MAX + 1];

    (void)state;
    pass(&clock, 1, 1 - 60 * DAY);
    age_clock_text(text, &clock, AGES_JUMPED, 0);
    assert_non_null(strstr(text, "back by 60 days"));
}

static void nothing_counts_before_what_has_happened(void **state)
{
    struct age_clock clock = begun();
    char text[AGE_CLOCK_TEXT_MAX + 1];

    (void)state;
    pass(&clock, HOUR, 0);
    assert_int_equal(age_clock_judge(&clock, wall_s + AGE_CLOCK_JUMP_S, 1), AGES_COUNT);
    assert_int_equal(age_clock_judge(&clock, wall_s + AGE_CLOCK_JUMP_S + 1, 1), AGES_BEFORE);
    age_clock_text(text, &clock, AGES_BEFORE, wall_s + 2 * DAY);
    assert_string_equal(text, "the clock says 2024-10-04 01:00 UTC, but the store knows of 2024-10-06 01:00 UTC: "
                              "nothing is removed by age before the clock is set right");
    age_clock_text(text, &clock, AGES_COUNT, 0);
    assert_string_equal(text, "");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_even_clock_is_believed_after_a_wait),
        cmocka_unit_test(a_jump_begins_the_wait_again),
        cmocka_unit_test(a_second_makes_no_day),
        cmocka_unit_test(nothing_counts_before_what_has_happened),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
