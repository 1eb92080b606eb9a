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
#include "tests/support/scratch_folder.h"

#define ZEROS "0000000000000000000000000000000000000000000000000000000000000000"

static char folder[SCRATCH_PATH];
static char path[sizeof folder + 16];

static int make_folder(void **state)
{
    (void)state;
    scratch_folder(folder);
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
        assert_int_equal(read.id.role, r);
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
        "62e8406d20f299c2d4b2ea679d08ee487adf02a021af4719f110624ccb04d832",
        "1dc2639f376e5609361e29416844c5aad5b27b7b1e0d1df4dc17c0669bec56d9"};
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

/* Names. HKDF-SHA256 with salt "azulejo-key-2" and info "role ROLE GENERATION NAME" of 32 zero bytes, by Python. */
static void test_named_derivation_is_fixed(void **state)
{
    static const struct {
        const char *role, *name;
        uint32_t generation;
        const char *secret;
    } expected[] = {
        {"worker", "node-1", 1, "b57be19a78ad6a79f714c8c2030c1952c351ee66e39a1e52efd31eea5277957d"},
        {"submit", "ana@ws3", 1, "a797877a25a8513dbce13b375e65cdf94d5f6b45ef86528015392004f7babd77"},
        {"submit", "ana@ws3", 2, "350c24e8f4cfd6841b0b2b9fd0abb972103d16d819616b157cb16a312ab96e38"},
        {"admin", "root", 1000000, "1a7590928a140f6a022c35f58a99bbb83b0f7448b4ba1b816e6d09fbc6681c2c"},
    };
    struct farm_key farm = {.is_farm = 1};

    (void)state;
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        struct key_identity id = {.generation = expected[i].generation};
        struct farm_key key, read;
        struct digest secret;
        struct buffer text = BUFFER_INIT;
        char hex[DIGEST_HEX_SIZE];
        assert_true(key_identity_set_role(&id, expected[i].role));
        snprintf(id.name, sizeof id.name, "%s", expected[i].name);
        assert_int_equal(farm_key_derive_named(&farm, &id, &key, NULL), STATUS_OK);
        memcpy(secret.bytes, key.secret, sizeof key.secret);
        digest_to_hex(&secret, hex);
        assert_string_equal(hex, expected[i].secret);
        farm_key_print(&key, &text);
        assert_int_equal(load_text(&read, text.data, text.size, NULL), STATUS_OK);
        assert_true(!read.is_farm && key_identity_equal(&read.id, &id));
        assert_memory_equal(read.secret, key.secret, FARM_KEY_BYTES);
        buffer_release(&text);
    }
}

/* No two of them are the same key, and each opens itself alone. */
static void test_named_keys_differ(void **state)
{
    static const char *const texts[] = {"azulejo-1 worker", "azulejo-1 client", "azulejo-2 worker 1 ana", "azulejo-2 worker 2 ana",
                                        "azulejo-2 worker 11 ana", "azulejo-2 worker 1 1ana", "azulejo-2 submit 1 ana",
                                        "azulejo-2 admin 1 ana", "azulejo-2 submit 1 anb"};
    enum { COUNT = sizeof texts / sizeof *texts };
    struct farm_key farm, keys[COUNT];
    uint8_t secret[FARM_KEY_BYTES];

    (void)state;
    assert_int_equal(farm_key_generate(&farm, NULL), STATUS_OK);
    for (size_t i = 0; i < COUNT; i++) {
        struct key_identity id;
        assert_true(key_identity_parse(&id, texts[i], strlen(texts[i])));
        assert_int_equal(farm_key_derive_named(&farm, &id, &keys[i], NULL), STATUS_OK);
        for (size_t k = 0; k < i; k++) {
            assert_memory_not_equal(keys[i].secret, keys[k].secret, FARM_KEY_BYTES);
            assert_int_equal(farm_key_secret(&keys[i], &keys[k].id, secret, NULL), STATUS_ERR_REFUSED);
            assert_int_equal(farm_key_secret(&keys[k], &keys[i].id, secret, NULL), STATUS_ERR_REFUSED);
        }
    }
}

static void test_hostile_identities(void **state)
{
    static const char *const bad[] = {
        "", "azulejo", "azulejo-1", "azulejo-1 ", "azulejo-1 farm", "azulejo-1 none", "azulejo-1 submit", "azulejo-1 worker ",
        "azulejo-1  worker", "azulejo-1 worker 1 ana", "azulejo-2 worker", "azulejo-2 worker ana", "azulejo-2 client 1 ana",
        "azulejo-2 web 1 ana", "azulejo-2 none 1 ana", "azulejo-2 worker 0 ana", "azulejo-2 worker -1 ana", "azulejo-2 worker +1 ana",
        "azulejo-2 worker 01 ana", "azulejo-2 worker 1000001 ana", "azulejo-2 worker 4294967297 ana", "azulejo-2 worker 1 -ana",
        "azulejo-2 worker 1 an a", "azulejo-2 worker 1 ana ", "azulejo-2 worker 1 ana\n", "azulejo-2 worker 1  ana",
        "azulejo-2 worker 1 a/b", "azulejo-2 worker 1 \xc3\xa9", "azulejo-2 Worker 1 ana", "azulejo-3 worker 1 ana", "%s%s%n",
        "azulejo-2 worker 1 aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
    };
    const struct key_identity zero = {0};
    struct key_identity id;
    char text[KEY_IDENTITY_SIZE];

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_false(key_identity_parse(&id, bad[i], strlen(bad[i])));
        assert_memory_equal(&id, &zero, sizeof id);
    }
    assert_false(key_identity_parse(&id, "azulejo-1 worker\0", 17));
    assert_false(key_identity_parse(&id, "azulejo-2 view 1 ana\0bob", 24));
    memset(&id, 'x', sizeof id);
    assert_true(key_identity_parse(&id, "azulejo-2 operate 1000000 A.b_c-d@9", 35));
    assert_string_equal(key_identity_print(&id, text), "azulejo-2 operate 1000000 A.b_c-d@9");
    assert_int_equal(id.role, FARM_ROLE_CLIENT);
    assert_int_equal(id.may, WEB_ROLE_OPERATE);
    memset(id.name, 'x', KEY_NAME_MAX); /* the longest there is fits */
    assert_true(strlen(key_identity_print(&id, text)) < KEY_IDENTITY_SIZE - 1);
    assert_true(key_identity_parse(&id, text, strlen(text)));
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
        {"azulejo-key-2 submit 1 ana\n", "line 1"},
        {"azulejo-key-2 submit 1 ana " ZEROS " x\n", "line 1"},
        {"azulejo-key-2 submit 0 ana " ZEROS "\n", "a role, a generation and a name"},
        {"azulejo-key-2 client 1 ana " ZEROS "\n", "a role, a generation and a name"},
        {"azulejo-key-2 submit 1 a/b " ZEROS "\n", "a role, a generation and a name"},
        {"azulejo-key-2 submit 1 ana " ZEROS "0\n", "64 hexadecimal"},
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
    assert_int_equal(key.id.role, FARM_ROLE_WORKER);
    assert_int_equal(load_text(&key, bare, sizeof bare - 1, NULL), STATUS_OK);
    assert_int_equal(key.id.role, FARM_ROLE_CLIENT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_print_and_load),        cmocka_unit_test(test_derivation_is_fixed),
        cmocka_unit_test(test_named_derivation_is_fixed), cmocka_unit_test(test_named_keys_differ),
        cmocka_unit_test(test_hostile_identities), cmocka_unit_test(test_a_role_opens_no_other), cmocka_unit_test(test_malformed_files),
        cmocka_unit_test(test_accepted_forms),
    };
    return cmocka_run_group_tests_name("key", tests, make_folder, remove_folder);
}
