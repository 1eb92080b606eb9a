/* Two ends of TLS in memory, and what many connections leave behind. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "protocol/tls.h"

static struct farm_key key;

static int set_up(void **state)
{
    (void)state;
    return farm_key_generate(&key, NULL) == STATUS_OK ? 0 : -1;
}

static void move(struct tls *from, struct tls *to)
{
    uint8_t bytes[4096];
    size_t size;

    while ((size = tls_output_take(from, bytes, sizeof bytes)) > 0)
        assert_int_equal(tls_feed(to, bytes, size, NULL), STATUS_OK);
}

static void shake(struct tls *client, struct tls *server)
{
    for (int i = 0; i < 4; i++) {
        assert_int_equal(tls_step(client, NULL), STATUS_OK);
        move(client, server);
        assert_int_equal(tls_step(server, NULL), STATUS_OK);
        move(server, client);
    }
    assert_int_equal(tls_state_of(client), TLS_OPEN);
    assert_int_equal(tls_state_of(server), TLS_OPEN);
}

/* What is shared between connections carries no key: two farms in one process stay apart. */
static void test_keys_stay_apart(void **state)
{
    struct farm_key other;
    struct tls *client, *server;
    struct error err = {0};

    (void)state;
    assert_int_equal(farm_key_generate(&other, NULL), STATUS_OK);
    for (int round = 0; round < 2; round++) {
        const struct farm_key *theirs = round ? &other : &key;
        assert_int_equal(tls_new_client(&client, theirs, FARM_ROLE_WORKER, NULL), STATUS_OK);
        assert_int_equal(tls_new_server(&server, theirs, NULL), STATUS_OK);
        shake(client, server);
        assert_int_equal(tls_role(server), FARM_ROLE_WORKER);
        tls_free(client);
        tls_free(server);
    }
    assert_int_equal(tls_new_client(&client, &other, FARM_ROLE_CLIENT, NULL), STATUS_OK);
    assert_int_equal(tls_new_server(&server, &key, NULL), STATUS_OK);
    assert_int_equal(tls_step(client, NULL), STATUS_OK);
    move(client, server);
    assert_int_equal(tls_step(server, &err), STATUS_ERR_REFUSED);
    assert_non_null(strstr(err.text, "not of this farm"));
    tls_free(client);
    tls_free(server);
}

static struct farm_key named(const char *text)
{
    struct farm_key out;
    struct key_identity id;

    assert_true(key_identity_parse(&id, text, strlen(text)));
    assert_int_equal(farm_key_derive_named(&key, &id, &out, NULL), STATUS_OK);
    return out;
}

/* The farm's key proves itself to every name, and a name's to the farm's alone: not to another name, not to an older or
 * newer key of the same name, and not to a role's key. */
static void test_names_are_proved(void **state)
{
    static const char *const texts[] = {"azulejo-2 submit 1 ana", "azulejo-2 submit 2 ana", "azulejo-2 admin 1 ana",
                                        "azulejo-2 submit 1 rui", "azulejo-1 client"};
    enum { COUNT = sizeof texts / sizeof *texts };
    struct tls *client, *server;
    char text[KEY_IDENTITY_SIZE];

    (void)state;
    for (int c = 0; c < COUNT; c++) {
        const struct farm_key theirs = named(texts[c]);
        for (int s = -1; s < COUNT; s++) {
            const struct farm_key mine = s < 0 ? key : named(texts[s]);
            struct error err = {0};
            assert_int_equal(tls_new_client(&client, &theirs, FARM_ROLE_CLIENT, NULL), STATUS_OK);
            assert_int_equal(tls_new_server(&server, &mine, NULL), STATUS_OK);
            if (s < 0 || s == c) {
                struct key_identity id;
                shake(client, server);
                id = tls_identity(server);
                assert_string_equal(key_identity_print(&id, text), texts[c]);
            } else {
                assert_int_equal(tls_step(client, NULL), STATUS_OK);
                move(client, server);
                assert_int_equal(tls_step(server, &err), STATUS_ERR_REFUSED);
                assert_int_equal(tls_role(server), FARM_ROLE_NONE);
                move(server, client);
                assert_int_equal(tls_step(client, &err), STATUS_ERR_REFUSED);
            }
            tls_free(client);
            tls_free(server);
        }
    }
}

static size_t resident_bytes(void)
{
    unsigned long total, resident = 0;
    FILE *source = fopen("/proc/self/statm", "r");

    assert_non_null(source);
    assert_int_equal(fscanf(source, "%lu %lu", &total, &resident), 2);
    fclose(source);
    return resident * (size_t)sysconf(_SC_PAGESIZE);
}

/* A worker that reconnects 10,000 times: what a first few hundred left is all that is left. */
static void test_reconnecting_leaves_nothing(void **state)
{
    enum { WARM_UP = 500, COUNT = 10000, GROWTH_MAX = 1 << 20 };
    size_t before = 0;

    (void)state;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    skip(); /* freed memory is kept there; leaks are found at the end */
#endif
    for (int i = 0; i < COUNT; i++) {
        struct tls *client, *server;
        if (i == WARM_UP)
            before = resident_bytes();
        assert_int_equal(tls_new_client(&client, &key, FARM_ROLE_WORKER, NULL), STATUS_OK);
        assert_int_equal(tls_new_server(&server, &key, NULL), STATUS_OK);
        assert_int_equal(tls_step(client, NULL), STATUS_OK);
        if (i % 20 == 0)
            shake(client, server);
        tls_free(client);
        tls_free(server);
    }
    assert_true(resident_bytes() < before + GROWTH_MAX);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_keys_stay_apart), cmocka_unit_test(test_names_are_proved),
        cmocka_unit_test(test_reconnecting_leaves_nothing),
    };
    return cmocka_run_group_tests_name("tls", tests, set_up, NULL);
}
