/* Key files and the keys of roles. */
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

#include "common/base/digest.h"
#include "protocol/key.h"

#define ZEROS "0000000000000000000000000000000000000000000000000000000000000000"

static char folder[] = "/tmp/azulejo-test-key-XXXXXX";
static char path[sizeof folder + 16];

static int make_folder(void **state)
{
    (void)state;
    if (!mkdtemp(folder))
        return -1;
    snprintf(path, sizeof path, "%s/key", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    unlink(path);
    return rmdir(folder);
}

static status load_text(struct farm_key *key, const void *text, size_t size, struct error *err)
{
    FILE *f = fopen(path, "wb");

    assert_non_null(f);
    assert_int_equal(fwrite(text, 1, size, f), size);
    assert_int_equal(fclose(f), 0);
    assert_int_equal(chmod(path, 0600), 0);
    return farm_key_load(key, path, err);
}

static void test_print_and_load(void **state)
{
    struct farm_key farm, roles[FARM_ROLE_COUNT], read;

    (void)state;
    assert_int_equal(farm_key_generate(&farm, NULL), STATUS_OK);
    roles[0] = farm;
    for (int r = FARM_ROLE_WORKER; r < FARM_ROLE_COUNT; r++)
        assert_int_equal(farm_key_derive(&farm, r, &roles[r], NULL), STATUS_OK);
    for (int r = 0; r < FARM_ROLE_COUNT; r++) {
        struct buffer text = BUFFER_INIT;
        struct error err = {0};
        farm_key_print(&roles[r], &text);
        assert_true(buffer_ok(&text));
        assert_int_equal(load_text(&read, text.data, text.size, &err), STATUS_OK);
        assert_int_equal(read.is_farm, r == 0);
        assert_int_equal(read.role, r);
        assert_memory_equal(read.secret, roles[r].secret, FARM_KEY_BYTES);
        buffer_release(&text);
    }
}

/* HKDF-SHA256 with salt "azulejo-key-1" and info "role NAME" of a master of 32 zero bytes,
 * computed with Python's hmac and hashlib. Other programs rely on these. */
static void test_derivation_is_fixed(void **state)
{
    static const char *const expected[FARM_ROLE_COUNT] = {NULL,
        "056c7088ff53b623fd9ac8674045a4c11210b0e3d5abae270ecc632c56b115cd",
        "3ef6518faf9a9a16c52d43813ac0d3c5ca4c3615a80b1466ca4de4fe938efbef",
        "62e8406d20f299c2d4b2ea679d08ee487adf02a021af4719f110624ccb04d832"};
    struct farm_key farm = {.is_farm = 1};

    (void)state;
    for (int r = FARM_ROLE_WORKER; r < FARM_ROLE_COUNT; r++) {
        struct digest secret;
        char hex[DIGEST_HEX_SIZE];
        assert_int_equal(farm_key_for_role(&farm, r, secret.bytes, NULL), STATUS_OK);
        digest_to_hex(&secret, hex);
        assert_string_equal(hex, expected[r]);
    }
}

static void test_a_role_opens_no_other(void **state)
{
    struct farm_key farm, worker, other;
    struct error err = {0};
    uint8_t a[FARM_KEY_BYTES], b[FARM_KEY_BYTES];
    const uint8_t zeros[FARM_KEY_BYTES] = {0};

    (void)state;
    assert_int_equal(farm_key_generate(&farm, NULL), STATUS_OK);
    assert_int_equal(farm_key_generate(&other, NULL), STATUS_OK);
    assert_memory_not_equal(farm.secret, other.secret, FARM_KEY_BYTES);
    assert_int_equal(farm_key_derive(&farm, FARM_ROLE_WORKER, &worker, NULL), STATUS_OK);
    assert_int_equal(farm_key_for_role(&farm, FARM_ROLE_WORKER, a, NULL), STATUS_OK);
    assert_int_equal(farm_key_for_role(&worker, FARM_ROLE_WORKER, b, NULL), STATUS_OK);
    assert_memory_equal(a, b, FARM_KEY_BYTES);
    assert_memory_not_equal(a, farm.secret, FARM_KEY_BYTES);
    assert_int_equal(farm_key_for_role(&worker, FARM_ROLE_ADMIN, b, &err), STATUS_ERR_REFUSED);
    assert_non_null(strstr(err.text, "worker key cannot act as admin"));
    assert_memory_equal(b, zeros, FARM_KEY_BYTES);
    assert_int_equal(farm_key_derive(&worker, FARM_ROLE_CLIENT, &other, NULL), STATUS_ERR_REFUSED);
    assert_int_equal(farm_key_for_role(&farm, FARM_ROLE_NONE, b, NULL), STATUS_ERR_INTERNAL);
    assert_int_equal(farm_key_for_role(&farm, FARM_ROLE_COUNT, b, NULL), STATUS_ERR_INTERNAL);
}

static void test_malformed_files(void **state)
{
    static const struct {
        const char *text, *words;
    } bad[] = {
        {"", "has no"},
        {"# only a comment\n\n", "has no"},
        {"azulejo-key-1 farm " ZEROS " x\n", "line 1"},
        {"azulejo-key-1 farm\n", "line 1"},
        {"azulejo-key-2 farm " ZEROS "\n", "line 1"},
        {"\n# x\nazulejo-key-1 boss " ZEROS "\n", "line 3: unknown role 'boss'"},
        {"azulejo-key-1 none " ZEROS "\n", "unknown role"},
        {"azulejo-key-1 farm 00\n", "64 hexadecimal"},
        {"azulejo-key-1 farm " ZEROS "0\n", "64 hexadecimal"},
        {"azulejo-key-1 farm g" ZEROS "\n", "64 hexadecimal"},
        {"azulejo-key-1 farm " ZEROS "\nazulejo-key-1 worker " ZEROS "\n", "line 2: a second key"},
        {"-----BEGIN PRIVATE KEY-----\n", "line 1"},
    };
    struct farm_key key;
    char large[FARM_KEY_FILE_MAX + 2];

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct error err = {0};
        assert_int_equal(load_text(&key, bad[i].text, strlen(bad[i].text), &err), STATUS_ERR_INPUT);
        assert_non_null(strstr(err.text, bad[i].words));
        assert_non_null(strstr(err.text, path));
        assert_null(strstr(err.text, ZEROS)); /* no secret in a message */
    }
    memset(large, '\n', sizeof large);
    assert_int_equal(load_text(&key, large, sizeof large, NULL), STATUS_ERR_INPUT);
    assert_int_equal(load_text(&key, "azulejo-key-1 farm \0 0", 22, NULL), STATUS_ERR_INPUT);
    assert_int_equal(farm_key_load(&key, folder, NULL), STATUS_ERR_INPUT);
    assert_int_equal(farm_key_load(&key, "/nonexistent/key", NULL), STATUS_ERR_INPUT);
}

static void test_accepted_forms(void **state)
{
    struct farm_key key;
    const char windows[] = "# made elsewhere\r\n  azulejo-key-1\tworker  " ZEROS "\r\n";
    const char bare[] = "azulejo-key-1 client " ZEROS;

    (void)state;
    assert_int_equal(load_text(&key, windows, sizeof windows - 1, NULL), STATUS_OK);
    assert_int_equal(key.role, FARM_ROLE_WORKER);
    assert_int_equal(load_text(&key, bare, sizeof bare - 1, NULL), STATUS_OK);
    assert_int_equal(key.role, FARM_ROLE_CLIENT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_print_and_load),        cmocka_unit_test(test_derivation_is_fixed),
        cmocka_unit_test(test_a_role_opens_no_other), cmocka_unit_test(test_malformed_files),
        cmocka_unit_test(test_accepted_forms),
    };
    return cmocka_run_group_tests_name("key", tests, make_folder, remove_folder);
}
