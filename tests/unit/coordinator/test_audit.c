/* The audit log's files: rotated, bounded, mended after a crash. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "coordinator/store/files/audit.h"
#include "tests/support/scratch_folder.h"

static const struct audit_actor person = {.who = "anna@ws3", .address = "10.0.0.7:512", .key = "client", .session = 4};

static char *path_of(const char *folder, const char *name)
{
    static char path[512];

    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

/* How many lines the file has, each an object; -1: it is not there. */
static long count_lines(const char *path, off_t *size)
{
    FILE *file = fopen(path, "r");
    char line[65536];
    long count = 0;
    struct stat what;

    if (!file)
        return -1;
    while (fgets(line, sizeof line, file)) {
        json_t *value = json_loads(line, 0, NULL);
        if (value)
            count++;
        json_decref(value);
    }
    fclose(file);
    assert_int_equal(stat(path, &what), 0);
    *size = what.st_size;
    return count;
}

static void files_are_rotated_and_bounded(void **state)
{
    char folder[SCRATCH_PATH], long_text[1000], details[AUDIT_DETAILS_MAX + 1], name[32];
    struct error err = {0}, why = {.code = STATUS_ERR_REFUSED};
    struct audit a;
    off_t size;
    long written = 0, kept = 0;

    (void)state;
    scratch_folder(folder);
    assert_int_equal(audit_init(&a, folder, &err), STATUS_OK);
    memset(long_text, 'x', sizeof long_text - 1);
    long_text[sizeof long_text - 1] = 0;
    memcpy(why.text, long_text, sizeof long_text);
    memset(details, ' ', AUDIT_DETAILS_MAX);
    memcpy(details, "{}", 2);
    details[AUDIT_DETAILS_MAX] = 0;
    for (; written < 7 * (AUDIT_FILE_BYTES / 5000); written++)
        audit_note(&a, &person, "pause", 7, details, &why);
    assert_int_equal(a.lost, 0);
    for (int i = 0; i <= AUDIT_OLD_FILES; i++) {
        long lines;
        snprintf(name, sizeof name, i ? "audit.log.%d" : "audit.log", i);
        lines = count_lines(path_of(folder, name), &size);
        assert_true(lines > 0 && size <= AUDIT_FILE_BYTES);
        kept += lines;
    }
    assert_true(kept < written);
    snprintf(name, sizeof name, "audit.log.%d", AUDIT_OLD_FILES + 1);
    assert_int_equal(count_lines(path_of(folder, name), &size), -1);
    audit_release(&a);
    file_remove_tree(folder);
}

static void a_line_that_was_cut_is_ended(void **state)
{
    char folder[SCRATCH_PATH];
    struct error err = {0};
    struct audit a;
    FILE *file;
    off_t size;

    (void)state;
    scratch_folder(folder);
    file = fopen(path_of(folder, "audit.log"), "w");
    fputs("{\"time\": \"2026-03-", file);
    fclose(file);
    assert_int_equal(audit_init(&a, folder, &err), STATUS_OK);
    audit_note(&a, &person, "pause", 7, NULL, NULL);
    audit_note(&a, &person, "resume", 7, "{\"long\": 1}", NULL);
    audit_release(&a);
    assert_int_equal(count_lines(path_of(folder, "audit.log"), &size), 2);
    file_remove_tree(folder);
}

static void what_is_too_long_is_left_out(void **state)
{
    char folder[SCRATCH_PATH], details[AUDIT_DETAILS_MAX + 2];
    struct audit_actor odd = {.key = "client"};
    struct error err = {0};
    struct audit a;
    off_t size;

    (void)state;
    scratch_folder(folder);
    memset(details, ' ', sizeof details - 1);
    memcpy(details, "{}", 2);
    details[sizeof details - 1] = 0;
    memset(odd.who, '\x01', sizeof odd.who - 1);
    assert_int_equal(audit_init(&a, folder, &err), STATUS_OK);
    audit_note(&a, &odd, "pause", 7, details, NULL);
    assert_int_equal(count_lines(path_of(folder, "audit.log"), &size), 1);
    assert_true(size < AUDIT_DETAILS_MAX);
    audit_release(&a);
    assert_int_equal(audit_init(&a, NULL, &err), STATUS_OK); /* of a store that will be removed */
    audit_note(&a, &person, "pause", 7, NULL, NULL);
    assert_true(a.lost == 0 && a.fd == -1);
    audit_release(&a);
    file_remove_tree(folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(files_are_rotated_and_bounded),
        cmocka_unit_test(a_line_that_was_cut_is_ended),
        cmocka_unit_test(what_is_too_long_is_left_out),
    };

    return cmocka_run_group_tests_name("audit", tests, NULL, NULL);
}
