/* When a worker may take work: its hours, the use of its machine, a signal. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "common/system/clock.h"
#include "worker/duty.h"

static void hours_are_parsed(void **state)
{
    static const char *const bad[] = {"", "20", "20-08", "20:00", "20:00-", "20:0-08:00", "24:01-08:00", "08:60-09:00",
                                      "08:00-08:00", "00:00-00:00", "20:00-08:00,", "20:00-08:00 ", "a:00-08:00",
                                      "020:00-08:00", "-1:00-08:00", "20:00--8:00",
                                      "1:00-1:01,2:00-2:01,3:00-3:01,4:00-4:01,5:00-5:01,6:00-6:01,7:00-7:01,"
                                      "8:00-8:01,9:00-9:01"};
    struct hours h;
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(hours_parse(&h, bad[i], &err), STATUS_ERR_USAGE);
    assert_int_equal(hours_parse(&h, "20:00-08:00", &err), STATUS_OK);
    assert_true(hours_include(&h, 20 * 60));
    assert_true(hours_include(&h, 0));
    assert_true(hours_include(&h, 8 * 60 - 1));
    assert_false(hours_include(&h, 8 * 60));
    assert_false(hours_include(&h, 20 * 60 - 1));
    assert_int_equal(hours_parse(&h, "12:00-13:00,20:30-24:00", &err), STATUS_OK);
    assert_true(hours_include(&h, 12 * 60) && hours_include(&h, 23 * 60 + 59));
    assert_false(hours_include(&h, 0) || hours_include(&h, 13 * 60));
    assert_int_equal(hours_next(&h, 13 * 60), 20 * 60 + 30);
    assert_int_equal(hours_next(&h, 0), 12 * 60);
    assert_int_equal(hours_parse(&h, "0:00-24:00", &err), STATUS_OK);
    assert_true(hours_include(&h, 0) && hours_include(&h, 12 * 60) && hours_include(&h, 23 * 60 + 59));
    assert_int_equal(hours_parse(&h, "24:00-1:00", &err), STATUS_OK);
    assert_true(hours_include(&h, 0));
    assert_false(hours_include(&h, 60) || hours_include(&h, 23 * 60 + 59));
    h.count = 0;
    assert_true(hours_include(&h, 77)); /* none were given */
}

static enum duty_state at(const struct duty *duty, int minute, double seconds, char reason[DUTY_REASON_SIZE])
{
    return duty_state(duty, minute, (uint64_t)(seconds * 1e9), reason);
}

static void look(struct duty *duty, double other_cpus, double input_idle_s, double seconds)
{
    struct usage usage = {.processors = 4, .other_cpus = other_cpus, .input_idle_s = input_idle_s};

    duty_look(duty, &usage, (uint64_t)(seconds * 1e9));
}

static void others_use_its_machine(void **state)
{
    const struct duty_options options = {.when_idle = 1, .idle_load = 0.25, .idle_for_s = 60};
    char reason[DUTY_REASON_SIZE];
    struct duty duty;

    (void)state;
    duty_init(&duty, &options, 1000 * NS_PER_SECOND);
    assert_int_equal(at(&duty, 0, 1001, reason), DUTY_IN_USE); /* it waits for idleness */
    assert_non_null(strstr(reason, "idle for 1 s of 60"));
    look(&duty, 0.5, -1, 1005);
    assert_int_equal(at(&duty, 0, 1059, reason), DUTY_IN_USE);
    assert_int_equal(at(&duty, 0, 1060, reason), DUTY_WORKS);
    assert_string_equal(reason, "");
    look(&duty, 1.0, -1, 1065); /* not above a quarter of four processors */
    assert_int_equal(at(&duty, 0, 1065, reason), DUTY_WORKS);
    look(&duty, 1.1, -1, 1070);
    assert_int_equal(at(&duty, 0, 1070, reason), DUTY_IN_USE);
    assert_non_null(strstr(reason, "1.1 of 4 processors"));
    look(&duty, 0, -1, 1075);
    assert_int_equal(at(&duty, 0, 1129, reason), DUTY_IN_USE);
    assert_int_equal(at(&duty, 0, 1131, reason), DUTY_WORKS);
    /* Somebody typed three seconds ago; then no more. */
    look(&duty, 0, 3, 1200);
    assert_int_equal(at(&duty, 0, 1200, reason), DUTY_IN_USE);
    assert_non_null(strstr(reason, "terminal 3 s ago"));
    look(&duty, 0, 58, 1255);
    assert_int_equal(at(&duty, 0, 1256, reason), DUTY_IN_USE);
    look(&duty, 0, 61, 1258);
    assert_int_equal(at(&duty, 0, 1258, reason), DUTY_WORKS);
    duty.options.idle_for_s = 0;
    look(&duty, 4, 0, 1259);
    assert_int_equal(at(&duty, 0, 1259, reason), DUTY_IN_USE);
    look(&duty, 0, 0, 1259);
    assert_int_equal(at(&duty, 0, 1259, reason), DUTY_WORKS);
    look(&duty, -1, -1, 1260); /* nothing is known */
    assert_int_equal(at(&duty, 0, 1260, reason), DUTY_WORKS);
}

static void reasons_have_an_order(void **state)
{
    struct duty_options options = {.when_idle = 1, .idle_load = 0.25, .idle_for_s = 60};
    char reason[DUTY_REASON_SIZE];
    struct error err = {0};
    struct duty duty;

    (void)state;
    assert_int_equal(hours_parse(&options.hours, "20:00-08:00", &err), STATUS_OK);
    duty_init(&duty, &options, 0);
    duty.by_signal = 1;
    assert_int_equal(at(&duty, 12 * 60, 1, reason), DUTY_SIGNAL);
    duty.by_signal = 0;
    assert_int_equal(at(&duty, 12 * 60, 1, reason), DUTY_HOURS);
    assert_non_null(strstr(reason, "until 20:00"));
    assert_int_equal(at(&duty, 21 * 60, 1, reason), DUTY_IN_USE);
    assert_int_equal(at(&duty, 21 * 60, 100, reason), DUTY_WORKS);
}

static void the_machine_is_measured(void **state)
{
    struct usage usage;

    (void)state;
    assert_int_equal(usage_busy_ns("cpu  100 20 3 9999 50 4 5 60 7 8\ncpu0 ...", 100), 1320000000ull);
    assert_int_equal(usage_busy_ns("cpu  100 20", 100), 0);
    assert_int_equal(usage_busy_ns("", 100), 0);
    assert_int_equal(usage_busy_ns("cpu  1 1 1 1 1 1 1", 0), 0);
    if (!usage_init(&usage))
        skip(); /* no /proc/stat here */
    assert_true(usage.other_cpus < 0 && usage.cpus == 0);
    usage_look(&usage);
    assert_true(usage.other_cpus >= 0 && usage.processors >= 1);
    assert_true(usage.memory_bytes > 0 && usage.machine_memory_bytes > usage.memory_bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hours_are_parsed),
        cmocka_unit_test(others_use_its_machine),
        cmocka_unit_test(reasons_have_an_order),
        cmocka_unit_test(the_machine_is_measured),
    };
    return cmocka_run_group_tests_name("duty", tests, NULL, NULL);
}
