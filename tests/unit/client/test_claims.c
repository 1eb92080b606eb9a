/* Which base name a job's files get in a folder that holds other files. */
#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "client/follow/claims.h"
#include "common/system/file.h"
#include "tests/support/scratch.h"

static void touch(const char *name)
{
    char path[PATH_MAX];

    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(file_write_atomic(path, "", 0, NULL), STATUS_OK);
}

static Azulejo__Wire__JobInfo job_of(uint64_t number, const char *name, int64_t submitted)
{
    Azulejo__Wire__JobInfo job = AZULEJO__WIRE__JOB_INFO__INIT;

    job.job = number;
    job.name = (char *)name;
    job.submitted_at = submitted;
    return job;
}

/* Take a name and put a file there, as fetch does. */
static void expect_base(uint64_t number, const char *name, int64_t submitted, int force, const char *base)
{
    const Azulejo__Wire__JobInfo job = job_of(number, name, submitted);
    struct claim claim = {0};
    char file[300];

    assert_int_equal(claim_take(&claim, folder, &job, force, NULL), STATUS_OK);
    assert_string_equal(buffer_text(&claim.base), base);
    assert_true(claim.locked); /* until the file is there */
    snprintf(file, sizeof file, "%s.png", base);
    touch(file);
    claim_release(&claim);
    assert_false(claim.locked);
}

static void test_jobs_of_one_name(void **state)
{
    (void)state;
    expect_base(1, "a", 100, 0, "a");
    expect_base(2, "a", 200, 0, "a-job2");
    expect_base(1, "a", 100, 0, "a"); /* again: the same */
    expect_base(2, "a", 200, 0, "a-job2");
    expect_base(2, "a", 777, 0, "a-job2-2"); /* another farm's job 2 */
    expect_base(3, "a", 300, 1, "a");
    expect_base(1, "a", 100, 0, "a-job1"); /* its name was taken by force */
    expect_base(3, "a", 300, 0, "a");
    expect_base(4, "a b", 400, 0, "a b"); /* a space is part of the name */
    expect_base(5, "a b", 500, 0, "a b-job5");
    expect_base(4, "a b", 400, 0, "a b");
}

static void test_files_of_unknown_origin(void **state)
{
    char path[PATH_MAX];

    (void)state;
    touch("b-0001.exr");
    touch("c.txt");
    touch("dd.png");
    touch("e.effects.json");
    expect_base(1, "b", 100, 0, "b-job1");
    expect_base(2, "c", 100, 0, "c");
    expect_base(3, "d", 100, 0, "d");
    expect_base(4, "e", 100, 0, "e-job4");
    expect_base(1, "b", 100, 0, "b-job1");
    /* A claim whose files are gone hinders nobody, but its job keeps it. */
    snprintf(path, sizeof path, "%s/c.png", folder);
    assert_int_equal(unlink(path), 0);
    expect_base(2, "c", 100, 0, "c");
    assert_int_equal(unlink(path), 0);
    expect_base(9, "c", 100, 0, "c");
    /* Without the list of claims nothing is known of any file. */
    snprintf(path, sizeof path, "%s/" CLAIMS_FILE, folder);
    assert_int_equal(unlink(path), 0);
    expect_base(3, "d", 100, 0, "d-job3");
}

static void test_names(void **state)
{
    static char longest[256], cut[256];
    static const struct { const char *name, *plain; } cases[] = {
        {"shot", "shot"}, {"../../etc/x", "_.._etc_x"}, {"...", "job-7"}, {"", "job-7"},
        {"a\nb?c", "a_b_c"}, {".hidden", "hidden"}, {longest, cut},
    };

    (void)state;
    memset(longest, 0, sizeof longest);
    for (int i = 0; i < 127; i++)
        memcpy(longest + 1 + 2 * i, "\xc3\xa9", 2); /* 255 bytes, cut within a character */
    longest[0] = 'x';
    memcpy(cut, longest, sizeof cut);
    cut[CLAIM_NAME_BYTES_MAX - 1] = 0;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const Azulejo__Wire__JobInfo job = job_of(7, cases[i].name, 100);
        struct buffer name = BUFFER_INIT;

        claim_plain_name(&job, &name);
        assert_string_equal(buffer_text(&name), cases[i].plain);
        buffer_release(&name);
    }
    expect_base(UINT64_MAX, longest, 100, 0, cut);
}

/* What is in the list is only looked at. */
static void test_damaged_list(void **state)
{
    static const char text[] = "\n\n 1 2\n7 100 - a\n7 100  \n1 100 - a\nx\0y\n3 100 - b";
    char path[PATH_MAX];

    (void)state;
    snprintf(path, sizeof path, "%s/" CLAIMS_FILE, folder);
    assert_int_equal(file_write_atomic(path, text, sizeof text - 1, NULL), STATUS_OK);
    touch("a.png");
    expect_base(1, "a", 100, 0, "a");
    expect_base(7, "a", 100, 0, "a-job7");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_jobs_of_one_name, folder_set_up, folder_tear_down),
        cmocka_unit_test_setup_teardown(test_files_of_unknown_origin, folder_set_up, folder_tear_down),
        cmocka_unit_test_setup_teardown(test_names, folder_set_up, folder_tear_down),
        cmocka_unit_test_setup_teardown(test_damaged_list, folder_set_up, folder_tear_down),
    };

    return cmocka_run_group_tests_name("client/claims", tests, NULL, NULL);
}
