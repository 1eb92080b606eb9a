/* What goes first, and what never goes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "coordinator/steering/retention.h"

enum { DAY = 86400, NOW = 1000 * DAY, MIB = 1 << 20 };

/* Job `number` of anna, which ended so many days ago, with 10 MiB of films and 2 MiB of pictures. */
static struct retention_job ended(uint64_t number, int days)
{
    return (struct retention_job){.job = number,
                                  .owner = "anna@studio",
                                  .ended = 1,
                                  .ended_at = NOW - (int64_t)days * DAY,
                                  .films = 10 * MIB,
                                  .pictures = 2 * MIB};
}

static struct retention_job active(uint64_t number)
{
    return (struct retention_job){.job = number, .owner = "anna@studio", .films = 10 * MIB, .pictures = 2 * MIB};
}

static struct retention_plan make(const struct retention_policy *policy, const struct retention_job *jobs, size_t count,
                                  uint64_t used, uint64_t limit)
{
    struct retention_plan plan = {0};
    struct error err = {0};

    assert_int_equal(retention_make(&plan, policy, jobs, count, used, limit, NOW, &err), STATUS_OK);
    return plan;
}

/* The plan as text: "3f 1j", films of job 3 and then job 1. */
static void expect_plan(struct retention_plan plan, const char *expected)
{
    char text[256] = "";

    for (size_t i = 0; i < plan.count; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "%s%llu%c", i ? " " : "",
                 (unsigned long long)plan.steps[i].job, plan.steps[i].whole ? 'j' : 'f');
    assert_string_equal(text, expected);
    retention_plan_release(&plan);
}

static void without_a_policy_nothing_goes(void **state)
{
    const struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    const struct retention_job jobs[] = {ended(1, 900), ended(2, 1), active(3)};

    (void)state;
    expect_plan(make(&policy, jobs, 3, 36 * MIB, 0), "");
}

static void jobs_go_by_age_and_state(void **state)
{
    struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    struct retention_job jobs[] = {ended(1, 31), ended(2, 30), ended(3, 29), ended(4, 8),
                                   ended(5, 6),  active(6),    ended(7, 99)};
    struct retention_plan plan;

    (void)state;
    jobs[3].failed = jobs[4].failed = 1;
    jobs[6].busy = 1;
    policy.keep_s = 30 * DAY;
    plan = make(&policy, jobs, 7, 0, 0);
    assert_int_equal(plan.in_use, 1);
    expect_plan(plan, "1j 2j");
    policy.keep_failed_s = 7 * DAY;
    expect_plan(make(&policy, jobs, 7, 0, 0), "1j 2j 4j");
    policy.keep_s = -1;
    expect_plan(make(&policy, jobs, 7, 0, 0), "4j");
    policy.keep_failed_s = -1;
    policy.keep_s = 0;
    expect_plan(make(&policy, jobs, 7, 0, 0), "1j 2j 3j 4j 5j");
}

static void the_reason_is_told(void **state)
{
    struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    struct retention_job jobs[] = {ended(1, 31), ended(2, 8), ended(3, 1)};
    char text[RETENTION_TEXT_MAX + 1];
    struct retention_plan plan;

    (void)state;
    jobs[1].failed = 1;
    policy.keep_s = 30 * DAY;
    policy.keep_failed_s = 7 * DAY;
    plan = make(&policy, jobs, 3, 1000 * MIB, 970 * MIB);
    assert_int_equal(plan.count, 3);
    retention_text(text, &plan, &plan.steps[0], &policy);
    assert_string_equal(text, "it ended 31 days ago (--keep 30d)");
    retention_text(text, &plan, &plan.steps[1], &policy);
    assert_string_equal(text, "it ended 8 days ago (--keep-failed 7d)");
    retention_text(text, &plan, &plan.steps[2], &policy);
    assert_string_equal(text, "the store takes 1000.0 MiB, and 970.0 MiB are allowed (--store-limit)");
    retention_plan_release(&plan);
}

static void films_go_before_pictures(void **state)
{
    const struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    struct retention_job jobs[] = {ended(9, 1), ended(2, 3), active(1), ended(3, 2)};
    const uint64_t used = 48 * MIB;

    (void)state;
    expect_plan(make(&policy, jobs, 4, used, used), "");
    expect_plan(make(&policy, jobs, 4, used, used - 1), "2f");
    expect_plan(make(&policy, jobs, 4, used, used - 10 * MIB), "2f");
    expect_plan(make(&policy, jobs, 4, used, used - 30 * MIB), "2f 3f 9f");
    expect_plan(make(&policy, jobs, 4, used, used - 31 * MIB), "2f 3f 9f 1f"); /* of its done frames */
    expect_plan(make(&policy, jobs, 4, used, used - 41 * MIB), "2f 3f 9f 1f 2j");
    expect_plan(make(&policy, jobs, 4, used, 1), "2f 3f 9f 1f 2j 3j 9j");
    jobs[1].busy = 1;
    jobs[0].films = 0;
    expect_plan(make(&policy, jobs, 4, used, 1), "3f 1f 3j 9j");
}

static void blobs_count_where_a_job_alone_has_them(void **state)
{
    const struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    struct retention_job jobs[] = {ended(1, 3), ended(2, 2), ended(3, 1)};

    (void)state;
    for (int i = 0; i < 3; i++)
        jobs[i].films = 0;
    expect_plan(make(&policy, jobs, 3, 100 * MIB, 50 * MIB), "1j 2j 3j");
    jobs[0].blobs = 48 * MIB;
    expect_plan(make(&policy, jobs, 3, 100 * MIB, 50 * MIB), "1j");
}

static void each_owner_has_a_limit(void **state)
{
    struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    struct retention_job jobs[] = {ended(1, 5), ended(2, 4), ended(3, 3), ended(4, 2), ended(5, 1)};

    (void)state;
    jobs[0].owner = jobs[3].owner = "bert@studio";
    policy.owner_limit = 30 * MIB; /* anna has 36, bert 24 */
    expect_plan(make(&policy, jobs, 5, 60 * MIB, 0), "2f");
    policy.owner_limit = 5 * MIB;
    expect_plan(make(&policy, jobs, 5, 60 * MIB, 0), "2f 3f 5f 2j 1f 4f");
    /* What the owners' limits free is not freed again. */
    policy.owner_limit = 30 * MIB;
    expect_plan(make(&policy, jobs, 5, 60 * MIB, 50 * MIB), "2f");
    expect_plan(make(&policy, jobs, 5, 60 * MIB, 49 * MIB), "2f 1f");
    /* By age first. */
    policy.keep_s = 4 * DAY;
    expect_plan(make(&policy, jobs, 5, 60 * MIB, 36 * MIB), "1j 2j");
}

static void store_limits(void **state)
{
    struct retention_policy policy = RETENTION_POLICY_DEFAULT;

    (void)state;
    assert_true(room_limit_bytes(&policy.store, 1000) == 0);
    policy.store.share = 0.8;
    assert_true(room_limit_bytes(&policy.store, 1000) == 800);
    policy.store.bytes = 900;
    assert_true(room_limit_bytes(&policy.store, 1000) == 800);
    policy.store.bytes = 700;
    assert_true(room_limit_bytes(&policy.store, 1000) == 700);
}

static void a_plan_needs_memory(void **state)
{
    struct retention_policy policy = RETENTION_POLICY_DEFAULT;
    const struct retention_job jobs[] = {ended(1, 3), ended(2, 2), ended(3, 1)};

    (void)state;
    policy.keep_s = 0;
    policy.owner_limit = 1;
    for (long fault = 0; fault < 4; fault++) {
        struct retention_plan plan = {0};
        struct error err = {0};
        status s;
        mem_fault_arm(fault, 1);
        s = retention_make(&plan, &policy, jobs, 3, 100 * MIB, 1, NOW, &err);
        mem_fault_arm(-1, 0);
        assert_true(s == STATUS_OK ? plan.count == 3 : s == STATUS_ERR_NO_MEMORY && plan.count == 0);
        retention_plan_release(&plan);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_a_policy_nothing_goes),
        cmocka_unit_test(jobs_go_by_age_and_state),
        cmocka_unit_test(the_reason_is_told),
        cmocka_unit_test(films_go_before_pictures),
        cmocka_unit_test(blobs_count_where_a_job_alone_has_them),
        cmocka_unit_test(each_owner_has_a_limit),
        cmocka_unit_test(store_limits),
        cmocka_unit_test(a_plan_needs_memory),
    };

    return cmocka_run_group_tests(tests, NULL, NULL);
}
