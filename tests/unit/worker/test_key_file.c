/* The worker's key file: what it takes at the start, and what it makes of a file that changes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "worker/key_file.h"
#include "tests/support/scratch_folder.h"

static char folder[SCRATCH_PATH];
static char path[sizeof folder + 16], fresh[sizeof folder + 16];

static int make_folder(void **state)
{
    (void)state;
    scratch_folder(folder);
    snprintf(path, sizeof path, "%s/key", folder);
    snprintf(fresh, sizeof fresh, "%s/new", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    unlink(path);
    return rmdir(folder);
}

static struct farm_key key_of(enum farm_role role, int seed)
{
    struct farm_key key = {.is_farm = role == FARM_ROLE_NONE, .id = key_identity_shared(role)};

    memset(key.secret, seed, sizeof key.secret);
    return key;
}

/* The new file is complete before it has the name. */
static void put(const char *text)
{
    FILE *f = fopen(fresh, "wb");

    assert_non_null(f);
    assert_true(fputs(text, f) >= 0);
    assert_int_equal(fclose(f), 0);
    assert_int_equal(chmod(fresh, 0600), 0);
    assert_int_equal(rename(fresh, path), 0);
}

static void put_key(enum farm_role role, int seed)
{
    struct farm_key key = key_of(role, seed);
    struct buffer text = BUFFER_INIT;

    farm_key_print(&key, &text);
    assert_true(buffer_ok(&text));
    put(buffer_text(&text));
    buffer_release(&text);
}

static void test_load(void **state)
{
    struct key_file file;
    struct error err = {0};

    (void)state;
    assert_int_not_equal(key_file_load(&file, path, &err), STATUS_OK);
    assert_non_null(strstr(err.text, path));
    put("azulejo-key-1 worker 12\n");
    assert_int_equal(key_file_load(&file, path, &err), STATUS_ERR_INPUT);
    put_key(FARM_ROLE_CLIENT, 1);
    assert_int_equal(key_file_load(&file, path, &err), STATUS_ERR_REFUSED);
    assert_non_null(strstr(err.text, path));
    put_key(FARM_ROLE_NONE, 1); /* the farm's own key can do everything */
    assert_int_equal(key_file_load(&file, path, &err), STATUS_OK);
    put_key(FARM_ROLE_WORKER, 1);
    assert_int_equal(key_file_load(&file, path, &err), STATUS_OK);
    assert_int_equal(file.key.secret[0], 1);
}

static void test_refresh(void **state)
{
    struct key_file file;

    (void)state;
    put_key(FARM_ROLE_WORKER, 1);
    assert_int_equal(key_file_load(&file, path, NULL), STATUS_OK);
    assert_int_equal(key_file_refresh(&file), 0);
    put_key(FARM_ROLE_WORKER, 2);
    assert_int_equal(key_file_refresh(&file), 1);
    assert_int_equal(file.key.secret[0], 2);
    assert_int_equal(key_file_refresh(&file), 0);
    put_key(FARM_ROLE_WORKER, 2); /* another file with the same key */
    assert_int_equal(key_file_refresh(&file), 0);
    put_key(FARM_ROLE_NONE, 2); /* the same bytes stand for another key */
    assert_int_equal(key_file_refresh(&file), 1);
}

/* What cannot be used changes nothing, and what can is taken afterwards. */
static void test_unusable(void **state)
{
    struct key_file file;

    (void)state;
    put_key(FARM_ROLE_WORKER, 1);
    assert_int_equal(key_file_load(&file, path, NULL), STATUS_OK);
    put_key(FARM_ROLE_CLIENT, 3);
    assert_int_equal(key_file_refresh(&file), 0);
    put("azulejo-key-1 wor");
    assert_int_equal(key_file_refresh(&file), 0);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(key_file_refresh(&file), 0);
    assert_int_equal(file.key.id.role, FARM_ROLE_WORKER);
    assert_int_equal(file.key.secret[0], 1);
    put_key(FARM_ROLE_WORKER, 4);
    assert_int_equal(key_file_refresh(&file), 1);
    assert_int_equal(file.key.secret[0], 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_load),
        cmocka_unit_test(test_refresh),
        cmocka_unit_test(test_unusable),
    };

    return cmocka_run_group_tests_name("key_file", tests, make_folder, remove_folder);
}
