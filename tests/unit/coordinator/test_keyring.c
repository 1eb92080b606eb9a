/* Which keys of names are good: used, revoked, rotated, stored, read again, and with damaged rows. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <sqlite3.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/net/base/keyring.h"
#include "coordinator/store/store.h"
#include "tests/support/scratch.h"
#include "tests/support/sim_farm.h"

enum { NOW = 1800000000, DAY = 86400 };

static struct key_identity key_of(const char *role, const char *name, uint32_t generation)
{
    struct key_identity id = {.generation = generation};

    assert_true(key_identity_set_role(&id, role));
    snprintf(id.name, sizeof id.name, "%s", name);
    return id;
}

/* NULL: it is good. */
static void expect_key(const struct keyring *ring, const char *role, const char *name, uint32_t generation,
                       int64_t now_s, const char *words)
{
    const struct key_identity id = key_of(role, name, generation);
    struct error err = {0};

    assert_int_equal(keyring_check(ring, &id, now_s, &err), words ? STATUS_ERR_REFUSED : STATUS_OK);
    if (words)
        assert_non_null(strstr(err.text, words));
}

static void generations(void **state)
{
    struct keyring ring = {0};
    struct key_row row;

    (void)state;
    expect_key(&ring, "submit", "ana", 1, NOW, NULL);
    expect_key(&ring, "submit", "ana", 2, NOW, "not good yet");
    assert_int_equal(keyring_rotate(&ring, "ana", DAY, "root", NOW, &row, NULL), STATUS_OK);
    assert_true(row.oldest == 1 && row.generation == 2 && row.oldest_until == NOW + DAY && !row.revoked);
    for (int64_t at = NOW; at < NOW + DAY; at += DAY - 1) {
        expect_key(&ring, "submit", "ana", 1, at, NULL);
        expect_key(&ring, "worker", "ana", 2, at, NULL);
    }
    assert_false(keyring_ends(&ring, NOW, NOW + DAY - 1));
    assert_true(keyring_ends(&ring, NOW + DAY - 1, NOW + DAY));
    assert_false(keyring_ends(&ring, NOW + DAY, NOW + 2 * DAY));
    expect_key(&ring, "submit", "ana", 1, NOW + DAY, "was replaced");
    expect_key(&ring, "submit", "ana", 2, NOW + DAY, NULL);
    /* A second one leaves the newest two, at most. */
    assert_int_equal(keyring_rotate(&ring, "ana", DAY, "root", NOW, &row, NULL), STATUS_OK);
    expect_key(&ring, "submit", "ana", 1, NOW, "generation 3 is good now");
    expect_key(&ring, "submit", "ana", 2, NOW, NULL);
    expect_key(&ring, "submit", "ana", 3, NOW, NULL);
    /* Revoked, in the middle of it: every role, every generation that there was. */
    assert_int_equal(keyring_revoke(&ring, "ana", "root", NOW, &row, NULL), STATUS_OK);
    assert_true(row.revoked && row.generation == 4 && strcmp(row.changed_by, "root") == 0 && row.changed_at == NOW);
    for (uint32_t g = 1; g <= 3; g++)
        expect_key(&ring, g == 2 ? "worker" : "admin", "ana", g, NOW, "was revoked");
    expect_key(&ring, "submit", "ana", 4, NOW, NULL);
    expect_key(&ring, "submit", "rui", 1, NOW, NULL); /* another name's stay */
    /* A name of which no key was seen. */
    assert_int_equal(keyring_revoke(&ring, "bob", "root", NOW, &row, NULL), STATUS_OK);
    expect_key(&ring, "submit", "bob", 1, NOW, "was revoked");
    keyring_release(&ring);
}

static void uses_are_noted_seldom(void **state)
{
    struct keyring ring = {0};
    struct key_identity ana = key_of("submit", "ana", 1), works = key_of("worker", "ana", 1),
                        everybody = key_identity_shared(FARM_ROLE_CLIENT);
    const struct key_row *row = keyring_used(&ring, &ana, NOW);
    struct key_row changed;

    (void)state;
    assert_non_null(row);
    assert_int_equal(row->roles, 1u << WEB_ROLE_SUBMIT);
    assert_null(keyring_used(&ring, &ana, NOW + KEYRING_USED_S - 1));
    assert_non_null(keyring_used(&ring, &ana, NOW + KEYRING_USED_S));
    row = keyring_used(&ring, &works, NOW + KEYRING_USED_S + 1); /* in another role */
    assert_non_null(row);
    assert_int_equal(row->roles, 1u << WEB_ROLE_SUBMIT | 1u);
    assert_null(keyring_used(&ring, &everybody, NOW));
    assert_int_equal(ring.count, 1);
    assert_int_equal(keyring_revoke(&ring, "ana", "root", NOW, &changed, NULL), STATUS_OK);
    ana.generation = 2;
    row = keyring_used(&ring, &ana, NOW + KEYRING_USED_S + 2); /* the next key ends it at once */
    assert_true(row && !row->revoked && row->changes > changed.changes);
    keyring_release(&ring);
}

static void shared_keys_can_be_off(void **state)
{
    struct keyring ring = {0};
    struct error err = {0};

    (void)state;
    for (int off = 0; off < 2; off++) {
        ring.no_shared = off;
        for (int r = FARM_ROLE_WORKER; r < FARM_ROLE_COUNT; r++) {
            const struct key_identity id = key_identity_shared((enum farm_role)r);
            int good = !off || r == FARM_ROLE_WEB; /* the page's program has no name */
            assert_int_equal(keyring_check(&ring, &id, NOW, &err), good ? STATUS_OK : STATUS_ERR_REFUSED);
        }
        expect_key(&ring, "worker", "node", 1, NOW, NULL);
    }
    assert_non_null(strstr(err.text, "azulejo key new"));
}

static void what_is_no_name_or_too_much(void **state)
{
    static const char *const bad[] = {"", "-x", "a b", "a\n", "a/b", "\xc3\xa9"};
    struct keyring ring = {0};
    struct key_row row;
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        assert_int_equal(keyring_revoke(&ring, bad[i], "root", NOW, &row, &err), STATUS_ERR_INPUT);
    assert_int_equal(keyring_rotate(&ring, "ana", KEYRING_KEEP_MAX_S + 1, "root", NOW, &row, &err), STATUS_ERR_INPUT);
    assert_int_equal(ring.count, 0);
    assert_int_equal(keyring_revoke(&ring, "ana", "root", NOW, &row, NULL), STATUS_OK);
    ring.rows[0].generation = KEY_GENERATION_MAX;
    assert_int_equal(keyring_revoke(&ring, "ana", "root", NOW, &row, &err), STATUS_ERR_LIMIT);
    assert_int_equal(ring.rows[0].generation, KEY_GENERATION_MAX);
    keyring_release(&ring);
}

static void edit(const char *sql)
{
    sqlite3 *db;

    assert_int_equal(sqlite3_open(path_of("queue.sqlite"), &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_close(db), SQLITE_OK);
}

/* The store has it after a restart; an older row does not replace a newer one; a damaged row lets nobody in. */
static void over_restarts(void **state)
{
    static const char *const damage[] = {"UPDATE keys SET oldest=1, generation=1", "UPDATE keys SET name='anb'",
                                         "DELETE FROM keys"};
    for (size_t i = 0; i < sizeof damage / sizeof *damage; i++) {
        struct store *store = sim_store(folder);
        struct keyring ring = {0}, again = {0}, hurt = {0};
        struct key_row older, newer;

        assert_int_equal(keyring_open(&ring, store, NULL), STATUS_OK);
        assert_int_equal(keyring_rotate(&ring, "ana", DAY, "root", NOW, &older, NULL), STATUS_OK);
        assert_int_equal(keyring_revoke(&ring, "ana", "root", NOW, &newer, NULL), STATUS_OK);
        assert_int_equal(store_key_put(store, &newer, NULL), STATUS_OK);
        assert_int_equal(store_key_put(store, &older, NULL), STATUS_OK); /* tasks may end in any order */
        store_close(store);
        store = sim_store(folder);
        assert_int_equal(keyring_open(&again, store, NULL), STATUS_OK);
        assert_int_equal(again.count, 1);
        assert_int_equal(again.damaged, 0);
        assert_true(again.rows[0].revoked && again.rows[0].generation == 3 && again.rows[0].oldest == 3);
        expect_key(&again, "submit", "ana", 1, NOW, "was revoked");
        store_close(store);
        edit(damage[i]);
        store = sim_store(folder);
        assert_int_equal(keyring_open(&hurt, store, NULL), STATUS_OK);
        assert_true(hurt.damaged > 0);
        expect_key(&hurt, "submit", "ana", 1, NOW, "--repair");
        expect_key(&hurt, "submit", "anb", 1, NOW, "--repair");
        store_close(store);
        keyring_release(&ring);
        keyring_release(&again);
        keyring_release(&hurt);
        assert_int_equal(folder_tear_down(state), 0);
        assert_int_equal(folder_set_up(state), 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(generations), cmocka_unit_test(uses_are_noted_seldom),
                                       cmocka_unit_test(shared_keys_can_be_off), cmocka_unit_test(what_is_no_name_or_too_much),
                                       cmocka_unit_test_setup_teardown(over_restarts, folder_set_up, folder_tear_down)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
