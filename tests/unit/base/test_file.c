/* Whole files and folders: rights, what a failed read means, and nothing left behind. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "tests/support/scratch.h"

static unsigned mode_of(const char *name)
{
    struct stat info;

    assert_int_equal(stat(path_of(name), &info), 0);
    return info.st_mode & 0777;
}

static void rights_are_as_asked_for(void **state)
{
    struct error err = {0};
    mode_t mask = umask(022);

    (void)state;
    assert_int_equal(file_make_folder(path_of("a/b"), &err), STATUS_OK);
    assert_int_equal(file_make_private_folder(path_of("a/c/d"), &err), STATUS_OK);
    assert_int_equal(file_make_private_folder(path_of("a/b"), &err), STATUS_OK); /* left as it is */
    assert_int_equal(file_make_scratch_folder(path_of("a/d/e"), &err), STATUS_OK);
    assert_int_equal(mode_of("a/b"), 0755);
    assert_int_equal(mode_of("a/c"), 0700);
    assert_int_equal(mode_of("a/c/d"), 0700);
    assert_int_equal(mode_of("a/d/e"), 0700);
    assert_int_equal(file_write_atomic(path_of("a/open"), "x", 1, &err), STATUS_OK);
    assert_int_equal(file_write_private(path_of("a/closed"), "x", 1, &err), STATUS_OK);
    assert_int_equal(mode_of("a/open"), 0644);
    assert_int_equal(mode_of("a/closed"), 0600);
    assert_int_equal(file_make_folder(path_of("a/open/below"), &err), STATUS_ERR_IO);
    assert_non_null(strstr(err.text, "Not a directory"));
    umask(mask);
}

/* A missing file is one thing, a machine that cannot read is another. */
static void failed_reads_are_told_apart(void **state)
{
    struct buffer out = BUFFER_INIT;
    struct error err = {0};
    struct rlimit old, none;

    (void)state;
    assert_int_equal(file_make_folder(path_of("kept/1"), &err), STATUS_OK);
    assert_int_equal(file_write_atomic(path_of("kept/1/file"), "x", 1, &err), STATUS_OK);
    assert_int_equal(file_read(path_of("kept/1/no"), 9, &out, &err), STATUS_ERR_INPUT);
    assert_int_equal(file_read(path_of("kept/1"), 9, &out, &err), STATUS_ERR_INPUT);
    assert_int_equal(file_read_kept(path_of("kept/1/no"), 9, &out, &err), STATUS_ERR_NOT_FOUND);
    assert_int_equal(file_read_kept(path_of("kept/2/no"), 9, &out, &err), STATUS_ERR_NOT_FOUND);
    assert_int_equal(file_read_kept(path_of("gone/2/no"), 9, &out, &err), STATUS_ERR_IO);
    assert_int_equal(file_read_kept(path_of("kept/1"), 9, &out, &err), STATUS_ERR_IO);
    assert_int_equal(file_read_kept(path_of("kept/1/file"), 0, &out, &err), STATUS_ERR_LIMIT);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &old), 0);
    none = old;
    none.rlim_cur = 0;
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    assert_int_equal(file_read(path_of("kept/1/file"), 9, &out, &err), STATUS_ERR_IO);
    assert_int_equal(file_write_private(path_of("kept/1/other"), "x", 1, &err), STATUS_ERR_IO);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &old), 0);
    assert_false(file_exists(path_of("kept/1/other")));
    assert_int_equal(file_read_kept(path_of("kept/1/file"), 9, &out, &err), STATUS_OK);
    assert_string_equal(buffer_text(&out), "x");
    buffer_release(&out);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(rights_are_as_asked_for, folder_set_up, folder_tear_down),
        cmocka_unit_test_setup_teardown(failed_reads_are_told_apart, folder_set_up, folder_tear_down),
    };
    return cmocka_run_group_tests_name("file", tests, NULL, NULL);
}
