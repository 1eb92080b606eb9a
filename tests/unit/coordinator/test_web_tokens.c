/* Tokens of the page and its API: made, found, renewed, revoked, expired; cookies; wrong ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/clock.h"
#include "common/system/file.h"
#include "coordinator/page/tokens.h"
#include "web/base/callers.h"
#include "tests/support/scratch.h"
#include "tests/support/sim_farm.h"

enum { NOW = 1800000000, DAY = 86400 };

static struct store *store;
static struct web_tokens *tokens;
static struct {
    uint64_t token[8];
    int cookies[8];
    size_t count;
} ended;

static void note_end(void *user, uint64_t token, int cookies)
{
    assert_ptr_equal(user, &ended);
    assert_true(ended.count < 8);
    ended.token[ended.count] = token;
    ended.cookies[ended.count++] = cookies;
}

/* ---- as the page's program sees them ---------------------------------------------------------- */

static struct callers callers;
static struct {
    uint64_t token[8];
    int cookies[8];
    size_t count;
} gone;

static void note_gone(void *user, uint64_t token, int cookies)
{
    (void)user;
    if (gone.count < 8) {
        gone.token[gone.count] = token;
        gone.cookies[gone.count++] = cookies;
    }
}

static void take(void *user, Azulejo__Wire__PageTokens *message)
{
    struct error err = {0};

    (void)user;
    assert_int_equal(message->version, 7);
    assert_int_equal(callers_set(&callers, message, note_gone, NULL, &err), STATUS_OK);
}

static void tell(void)
{
    struct error err = {0};

    assert_int_equal(web_tokens_tell(tokens, 7, take, NULL, &err), STATUS_OK);
}

static int find(const char *text, int64_t now_s, struct web_caller *out)
{
    tell();
    return callers_find(&callers, text, now_s, out);
}

static int find_cookie(const char *cookie, int64_t now_s, struct web_caller *out)
{
    tell();
    return callers_find_cookie(&callers, cookie, now_s, out);
}

static void make_cookie(uint64_t token, int64_t now_s, char out[COOKIE_SIZE], int64_t *life_s)
{
    tell();
    callers_cookie(&callers, token, now_s, out, life_s);
}

static void open_all(void)
{
    struct error err = {0};

    store = sim_store(folder);
    assert_int_equal(web_tokens_open(&tokens, store, note_end, &ended, &err), STATUS_OK);
}

static void close_all(void)
{
    web_tokens_close(tokens);
    store_close(store);
    callers_release(&callers);
    memset(&gone, 0, sizeof gone);
}

static int set_up(void **state)
{
    memset(&ended, 0, sizeof ended);
    if (folder_set_up(state) != 0)
        return -1;
    open_all();
    return 0;
}

static int tear_down(void **state)
{
    close_all();
    return folder_tear_down(state);
}

/* Make a token; its number. */
static uint64_t make(enum web_role role, int64_t expires_at, char secret[TOKEN_TEXT_SIZE])
{
    struct token_row row = {.role = role, .name = "render node", .owner = "ana@ws3", .made_by = "rui@ws1",
                            .expires_at = expires_at};
    struct error err = {0};

    assert_int_equal(web_token_create(tokens, &row, NOW, secret, &err), STATUS_OK);
    store_settle(store);
    return row.number;
}

static void a_token_is_found_and_survives_a_restart(void **state)
{
    char secret[TOKEN_TEXT_SIZE], other[TOKEN_TEXT_SIZE];
    struct web_caller caller;
    uint64_t number = make(WEB_ROLE_SUBMIT, 0, secret), second = make(WEB_ROLE_VIEW, 0, other);

    (void)state;
    assert_int_equal(number, TOKEN_FIRST);
    assert_int_equal(second, TOKEN_FIRST + 1);
    assert_string_not_equal(secret, other);
    for (int times = 0; times < 2; times++) {
        assert_true(find(secret, NOW, &caller));
        assert_int_equal(caller.role, WEB_ROLE_SUBMIT);
        assert_int_equal(caller.token, number);
        assert_string_equal(caller.who, "ana@ws3");
        assert_false(caller.by_cookie);
        assert_true(find(other, NOW, &caller));
        assert_int_equal(caller.role, WEB_ROLE_VIEW);
        close_all();
        open_all();
    }
}

/* One character more, less or changed; a hash; nothing. */
static void what_is_no_token_is_not_found(void **state)
{
    char secret[TOKEN_TEXT_SIZE], wrong[TOKEN_TEXT_SIZE + 1], hex[DIGEST_HEX_SIZE];
    struct web_caller caller;
    uint64_t number = make(WEB_ROLE_ADMIN, 0, secret);

    (void)state;
    for (size_t i = 0; i < strlen(secret); i++) {
        snprintf(wrong, sizeof wrong, "%s", secret);
        wrong[i] = wrong[i] == '0' ? '1' : '0';
        assert_false(find(wrong, NOW, &caller));
        assert_int_equal(caller.role, WEB_ROLE_NONE);
        wrong[i] = 0;
        assert_false(find(wrong, NOW, &caller));
    }
    snprintf(wrong, sizeof wrong, "%s0", secret);
    assert_false(find(wrong, NOW, &caller));
    digest_to_hex(&web_token_row(tokens, number)->hash, hex);
    snprintf(wrong, sizeof wrong, "azt_%s", hex); /* what a thief of the store would have */
    assert_false(find(wrong, NOW, &caller));
    assert_false(find_cookie(secret, NOW, &caller));
}

/* The store's bytes hold no token: only its hash. */
static void the_store_does_not_hold_the_token(void **state)
{
    char secret[TOKEN_TEXT_SIZE], path[128];
    struct buffer bytes = BUFFER_INIT;
    struct error err = {0};
    const struct token_row *row = web_token_row(tokens, make(WEB_ROLE_VIEW, 0, secret));

    (void)state;
    for (const char *const *name = (const char *const[]){"queue.sqlite", "queue.sqlite-wal", NULL}; *name; name++) {
        snprintf(path, sizeof path, "%s/%s", folder, *name);
        assert_int_equal(file_read(path, 16 << 20, &bytes, &err), STATUS_OK);
    }
    assert_null(memmem(bytes.data, bytes.size, secret, strlen(secret)));
    assert_null(memmem(bytes.data, bytes.size, secret + 4, strlen(secret) - 4));
    assert_non_null(memmem(bytes.data, bytes.size, &row->hash, sizeof row->hash)); /* we looked at the right bytes */
    buffer_release(&bytes);
}

static void a_revoked_token_ends_what_it_opened(void **state)
{
    char first[TOKEN_TEXT_SIZE], second[TOKEN_TEXT_SIZE];
    struct web_caller caller;
    struct error err = {0};
    uint64_t a = make(WEB_ROLE_VIEW, 0, first), b = make(WEB_ROLE_OPERATE, 0, second), c;

    (void)state;
    assert_int_equal(web_token_revoke(tokens, a, &err), STATUS_OK);
    assert_int_equal(ended.count, 1);
    assert_int_equal(ended.token[0], a);
    assert_false(ended.cookies[0]);
    for (int times = 0; times < 2; times++) {
        assert_false(find(first, NOW, &caller));
        assert_true(find(second, NOW, &caller));
        assert_int_equal(caller.token, b);
        close_all();
        open_all();
    }
    assert_int_equal(web_token_revoke(tokens, a, &err), STATUS_ERR_NOT_FOUND);
    c = make(WEB_ROLE_VIEW, 0, first);
    assert_true(c > b); /* numbers are not reused */
    assert_int_equal(web_token_revoke(tokens, TOKEN_OWN, &err), STATUS_ERR_REFUSED);
    assert_non_null(strstr(err.text, "token renew"));
    assert_true(find(web_tokens_own(tokens), NOW, &caller));
}

static void a_token_expires_once(void **state)
{
    char secret[TOKEN_TEXT_SIZE];
    struct web_caller caller;
    uint64_t number = make(WEB_ROLE_VIEW, NOW + DAY, secret);
    struct token_row late = {.role = WEB_ROLE_VIEW, .name = "n", .owner = "o", .expires_at = NOW};
    struct error err = {0};

    (void)state;
    assert_true(find(secret, NOW + DAY - 1, &caller));
    web_tokens_tick(tokens, NOW + DAY - 1);
    assert_int_equal(ended.count, 0);
    assert_false(find(secret, NOW + DAY, &caller));
    web_tokens_tick(tokens, NOW + DAY);
    web_tokens_tick(tokens, NOW + DAY + 1);
    assert_int_equal(ended.count, 1);
    assert_int_equal(ended.token[0], number);
    web_tokens_tick(tokens, NOW); /* the clock was ahead: its real end comes later */
    web_tokens_tick(tokens, NOW + DAY);
    assert_int_equal(ended.count, 2);
    assert_int_equal(ended.token[1], number);
    assert_int_equal(web_token_renew(tokens, number, NOW + DAY, secret, &err), STATUS_ERR_REFUSED);
    assert_int_equal(web_token_create(tokens, &late, NOW, secret, &err), STATUS_ERR_INPUT);
}

static void the_coordinators_own_is_kept_and_renewed(void **state)
{
    char own[TOKEN_TEXT_SIZE], secret[TOKEN_TEXT_SIZE], cookie[COOKIE_SIZE], guest[TOKEN_TEXT_SIZE], path[128];
    struct web_caller caller;
    struct error err = {0};
    struct stat info;
    int64_t life_s;
    uint64_t number = make(WEB_ROLE_VIEW, 0, guest);

    (void)state;
    snprintf(own, sizeof own, "%s", web_tokens_own(tokens));
    snprintf(path, sizeof path, "%s/web.token", folder);
    assert_int_equal(stat(path, &info), 0);
    assert_int_equal(info.st_mode & 0777, 0600);
    close_all();
    open_all();
    assert_string_equal(web_tokens_own(tokens), own);
    assert_true(find(own, NOW, &caller));
    assert_int_equal(caller.role, WEB_ROLE_ADMIN);
    assert_int_equal(caller.token, TOKEN_OWN);
    assert_true(caller.who[0]);
    make_cookie(number, NOW, cookie, &life_s);
    assert_int_equal(token_text_make(secret, &err), STATUS_OK);
    assert_int_equal(web_token_own_write(tokens, secret, &err), STATUS_OK);
    assert_int_equal(ended.count, 0);
    assert_int_equal(web_token_own_renewed(tokens, secret, NOW, &err), STATUS_OK);
    assert_int_equal(ended.count, 1);
    assert_int_equal(ended.token[0], TOKEN_OWN);
    assert_true(ended.cookies[0]); /* it signs everybody out */
    assert_false(find_cookie(cookie, NOW, &caller));
    assert_true(find(guest, NOW, &caller));
    for (int times = 0; times < 2; times++) {
        assert_false(find(own, NOW, &caller));
        assert_true(find(secret, NOW, &caller));
        assert_string_equal(web_tokens_own(tokens), secret);
        close_all();
        open_all();
    }
    close_all();
    assert_int_equal(file_write_private(path, "a word\n", 7, &err), STATUS_OK);
    open_all(); /* a damaged one is made again */
    assert_false(find(secret, NOW, &caller));
    assert_true(find(web_tokens_own(tokens), NOW, &caller));
}

static void a_renewed_token_keeps_all_but_its_secret(void **state)
{
    char old[TOKEN_TEXT_SIZE], new[TOKEN_TEXT_SIZE], cookie[COOKIE_SIZE];
    struct web_caller caller;
    struct error err = {0};
    int64_t life_s;
    uint64_t number = make(WEB_ROLE_OPERATE, 0, old);

    (void)state;
    make_cookie(number, NOW, cookie, &life_s);
    assert_int_equal(web_token_renew(tokens, number, NOW + 5, new, &err), STATUS_OK);
    assert_int_equal(ended.token[0], number);
    assert_false(ended.cookies[0]);
    for (int times = 0; times < 2; times++) {
        assert_false(find(old, NOW, &caller));
        assert_false(find_cookie(cookie, NOW, &caller));
        assert_true(find(new, NOW, &caller));
        assert_int_equal(caller.token, number);
        assert_int_equal(caller.role, WEB_ROLE_OPERATE);
        assert_string_equal(web_token_row(tokens, number)->name, "render node");
        close_all();
        open_all();
    }
    assert_int_equal(web_token_renew(tokens, 99, NOW, new, &err), STATUS_ERR_NOT_FOUND);
}

/* A cookie is good for its token, as long as that and for its own time; not one byte of it may differ. */
static void a_cookie_is_as_good_as_its_token_for_its_time(void **state)
{
    char secret[TOKEN_TEXT_SIZE], cookie[COOKIE_SIZE], wrong[COOKIE_SIZE + 8];
    struct web_caller caller;
    struct error err = {0};
    int64_t life_s, short_s;
    uint64_t number = make(WEB_ROLE_OPERATE, 0, secret), soon = make(WEB_ROLE_VIEW, NOW + 60, wrong);

    (void)state;
    make_cookie(number, NOW, cookie, &life_s);
    assert_int_equal(life_s, COOKIE_LIFE_S);
    assert_null(strstr(cookie, secret + 4));
    close_all();
    open_all(); /* it survives a restart */
    assert_true(find_cookie(cookie, NOW + life_s - 1, &caller));
    assert_int_equal(caller.role, WEB_ROLE_OPERATE);
    assert_int_equal(caller.token, number);
    assert_true(caller.by_cookie);
    assert_false(find_cookie(cookie, NOW + life_s, &caller));
    assert_false(find(cookie, NOW, &caller));
    for (size_t i = 0; i < strlen(cookie); i++) {
        snprintf(wrong, sizeof wrong, "%s", cookie);
        wrong[i] = wrong[i] == '1' ? '2' : '1';
        assert_false(find_cookie(wrong, NOW, &caller));
        assert_int_equal(caller.role, WEB_ROLE_NONE);
        wrong[i] = 0;
        assert_false(find_cookie(wrong, NOW, &caller));
    }
    snprintf(wrong, sizeof wrong, "0%s", cookie); /* the same number, written otherwise */
    assert_false(find_cookie(wrong, NOW, &caller));
    make_cookie(soon, NOW, wrong, &short_s);
    assert_int_equal(short_s, 60);
    assert_int_equal(web_token_revoke(tokens, number, &err), STATUS_OK);
    assert_false(find_cookie(cookie, NOW, &caller));
    make_cookie(number, NOW, wrong, &life_s);
    assert_string_equal(wrong, "");
}

/* It is found, and the coordinator is told. */
static void use(const char *text, int64_t now_s, struct web_caller *out)
{
    assert_true(find(text, now_s, out));
    if (callers_must_tell(&callers, out->token, now_s))
        web_tokens_used(tokens, out->token, now_s);
    assert_false(callers_must_tell(&callers, out->token, now_s));
}

/* The use is stored now and then, not with each request. */
static void the_last_use_is_stored_coarsely(void **state)
{
    char secret[TOKEN_TEXT_SIZE];
    struct web_caller caller;
    struct error err = {0};
    const struct token_row *used;
    uint64_t number = make(WEB_ROLE_VIEW, 0, secret);

    (void)state;
    assert_null(web_tokens_next_used(tokens));
    use(secret, NOW, &caller);
    used = web_tokens_next_used(tokens);
    assert_non_null(used);
    assert_int_equal(used->number, number);
    assert_int_equal(used->used_at, NOW);
    assert_int_equal(store_token_used(store, used->number, used->used_at, &err), STATUS_OK);
    use(secret, NOW + TOKEN_USED_S - 1, &caller);
    assert_null(web_tokens_next_used(tokens));
    close_all();
    open_all();
    assert_int_equal(web_token_row(tokens, number)->used_at, NOW);
    use(secret, NOW + TOKEN_USED_S, &caller);
    assert_int_equal(web_tokens_next_used(tokens)->used_at, NOW + TOKEN_USED_S);
    use(web_tokens_own(tokens), NOW, &caller);
    assert_null(web_tokens_next_used(tokens)); /* it has no row */
}

static void wrong_tokens_are_limited_by_address(void **state)
{
    const uint64_t begin = 77 * NS_PER_SECOND;
    char peer[64];

    (void)state;
    for (int i = 0; i < TOKEN_FAILURES_MAX; i++) {
        snprintf(peer, sizeof peer, "10.0.0.7:%d", 1000 + i);
        assert_true(callers_note_failure(&callers, peer, begin));
    }
    assert_false(callers_note_failure(&callers, "10.0.0.7:1", begin + 1));
    assert_true(callers_note_failure(&callers, "10.0.0.8:1", begin + 1));
    assert_true(callers_note_failure(&callers, "[::1]:1", begin + 1));
    assert_false(callers_note_failure(&callers, "10.0.0.7:1", begin + TOKEN_FAILURES_S * NS_PER_SECOND - 1));
    assert_true(callers_note_failure(&callers, "10.0.0.7:1", begin + TOKEN_FAILURES_S * NS_PER_SECOND));
    for (int i = 0; i < 4 * TOKEN_ADDRESSES_MAX; i++) { /* others do not grow the table, nor clear an active one */
        snprintf(peer, sizeof peer, "10.1.%d.%d:9", i / 256, i % 256);
        assert_true(callers_note_failure(&callers, peer, begin + 200 * NS_PER_SECOND + (uint64_t)i));
        (void)callers_note_failure(&callers, "10.0.0.9:1", begin + 200 * NS_PER_SECOND + (uint64_t)i);
    }
    assert_false(callers_note_failure(&callers, "10.0.0.9:1", begin + 201 * NS_PER_SECOND));
}

static void what_cannot_be_a_token_is_refused(void **state)
{
    static const struct token_row wrong[] = {
        {.role = WEB_ROLE_NONE, .name = "n", .owner = "o"},
        {.role = WEB_ROLES, .name = "n", .owner = "o"},
        {.role = WEB_ROLE_VIEW, .name = "", .owner = "o"},
        {.role = WEB_ROLE_VIEW, .name = "n", .owner = ""},
        {.role = WEB_ROLE_VIEW, .name = "n\n", .owner = "o"},
        {.role = WEB_ROLE_VIEW, .name = "n", .owner = "\x1b[31m"},
    };
    char secret[TOKEN_TEXT_SIZE];
    struct error err = {0};
    size_t count;

    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct token_row row = wrong[i];
        assert_int_equal(web_token_create(tokens, &row, NOW, secret, &err), STATUS_ERR_INPUT);
    }
    (void)web_tokens_rows(tokens, &count);
    assert_int_equal(count, 1);
}

#define TOKEN_TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TOKEN_TEST(a_token_is_found_and_survives_a_restart),
        TOKEN_TEST(what_is_no_token_is_not_found),
        TOKEN_TEST(the_store_does_not_hold_the_token),
        TOKEN_TEST(a_revoked_token_ends_what_it_opened),
        TOKEN_TEST(a_token_expires_once),
        TOKEN_TEST(the_coordinators_own_is_kept_and_renewed),
        TOKEN_TEST(a_renewed_token_keeps_all_but_its_secret),
        TOKEN_TEST(a_cookie_is_as_good_as_its_token_for_its_time),
        TOKEN_TEST(the_last_use_is_stored_coarsely),
        TOKEN_TEST(wrong_tokens_are_limited_by_address),
        TOKEN_TEST(what_cannot_be_a_token_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
