/* Which requests are answered, by their headers: the table of what may come from a browser and from a program. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "web/http/guard.h"

static struct guard guard_of(const char *host, const char *name, int is_tls)
{
    struct guard guard;

    assert_int_equal(guard_init(&guard, host, name, 7421, is_tls, NULL), STATUS_OK);
    return guard;
}

static unsigned check_host(const struct guard *guard, const char *host)
{
    struct error why;

    return guard_check(guard, &(struct guard_headers_of){.host = host}, &why);
}

static void test_loopback_hosts(void **state)
{
    static const char *const ours[] = {"127.0.0.1:7421", "localhost:7421", "LOCALHOST:7421", "[::1]:7421"};
    static const char *const foreign[] = {
        "evil.example", "evil.example:7421", "127.0.0.1", "127.0.0.1:7420", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:07421x",
        "localhost.evil.example:7421", "localhost:7421.evil.example", "127.0.0.1:7421, evil.example", "[::1]", "[::1]7421",
        "::1:7421", "[::2]:7421", "192.168.0.1:7421", "", " localhost:7421", "localhost :7421", "localhost:+7421",
        "localhost:73 ", "localhost:72957", "a@localhost:7421", "[::1%eth0]:7421", "localhost.:7421"};
    struct guard guard = guard_of("127.0.0.1", NULL, 0);
    char longest[300];

    (void)state;
    for (size_t i = 0; i < sizeof ours / sizeof *ours; i++)
        assert_int_equal(check_host(&guard, ours[i]), 0);
    for (size_t i = 0; i < sizeof foreign / sizeof *foreign; i++)
        if (check_host(&guard, foreign[i]) != 421)
            fail_msg("'%s' was taken", foreign[i]);
    assert_int_equal(check_host(&guard, NULL), 421);
    memset(longest, 'a', sizeof longest);
    longest[sizeof longest - 1] = 0;
    assert_int_equal(check_host(&guard, longest), 421);
}

static void test_other_hosts(void **state)
{
    struct guard named = guard_of("10.0.0.5", "Render.Example", 1), any = guard_of("0.0.0.0", NULL, 1),
                 six = guard_of("fe80::7", NULL, 1), none;

    (void)state;
    assert_int_equal(check_host(&named, "10.0.0.5:7421"), 0);
    assert_int_equal(check_host(&named, "render.example:7421"), 0);
    assert_int_equal(check_host(&named, "localhost:7421"), 421);
    assert_int_equal(check_host(&named, "10.0.0.6:7421"), 421);
    /* Nobody can make a browser believe that an address is a name of his. */
    assert_int_equal(check_host(&any, "10.1.2.3:7421"), 0);
    assert_int_equal(check_host(&any, "[fe80::1]:7421"), 0);
    assert_int_equal(check_host(&any, "localhost:7421"), 0);
    assert_int_equal(check_host(&any, "[fe80::1]:7422"), 421);
    assert_int_equal(check_host(&any, "10.1.2.3.example:7421"), 421);
    assert_int_equal(check_host(&any, "evil.example:7421"), 421);
    assert_int_equal(check_host(&six, "[fe80::7]:7421"), 0);
    assert_int_equal(check_host(&six, "fe80::7:7421"), 421);
    assert_int_equal(guard_init(&none, "127.0.0.1", "https://x", 1, 0, NULL), STATUS_ERR_USAGE);
    assert_int_equal(guard_init(&none, "127.0.0.1", "x:7421", 1, 0, NULL), STATUS_ERR_USAGE);
    assert_int_equal(guard_init(&none, "127.0.0.1", "", 1, 0, NULL), STATUS_ERR_USAGE);
    assert_string_equal(guard_public_name(&named, "10.0.0.5", "Render.Example"), "Render.Example");
    assert_string_equal(guard_public_name(&six, "fe80::7", NULL), "fe80::7");
}

static void test_default_ports(void **state)
{
    struct guard plain, secure;

    (void)state;
    assert_int_equal(guard_init(&plain, "127.0.0.1", NULL, 80, 0, NULL), STATUS_OK);
    assert_int_equal(guard_init(&secure, "127.0.0.1", NULL, 443, 1, NULL), STATUS_OK);
    assert_int_equal(check_host(&plain, "localhost"), 0);
    assert_int_equal(check_host(&plain, "localhost:80"), 0);
    assert_int_equal(check_host(&plain, "localhost:443"), 421);
    assert_int_equal(check_host(&secure, "localhost"), 0);
}

static void test_loopback(void **state)
{
    (void)state;
    assert_true(guard_is_loopback("127.0.0.1") && guard_is_loopback("127.8.9.1"));
    assert_true(guard_is_loopback("::1") && guard_is_loopback("LocalHost"));
    assert_false(guard_is_loopback("") || guard_is_loopback("0.0.0.0") || guard_is_loopback("::"));
    assert_false(guard_is_loopback("127.evil.example") || guard_is_loopback("localhost.evil.example"));
}

/* Each row: what a request says, and the answer. */
static void test_origins(void **state)
{
    static const struct {
        const char *origin, *site, *mode;
        int changes, is_socket, by_cookie;
        unsigned answer;
    } rows[] = {
        {NULL, NULL, NULL, 0, 0, 0, 0},                               /* a program reads */
        {NULL, NULL, NULL, 1, 0, 0, 0},                               /* a program writes, with its token */
        {"http://localhost:7421", "same-origin", "cors", 1, 0, 1, 0}, /* our page writes */
        {"http://localhost:7421", "same-origin", "websocket", 0, 1, 1, 0},
        {NULL, "same-origin", "cors", 0, 0, 1, 0},    /* our page reads */
        {NULL, "none", "navigate", 0, 0, 1, 0},       /* somebody types the address */
        {NULL, "cross-site", "navigate", 0, 0, 1, 0}, /* a link to a picture */
        {NULL, NULL, NULL, 1, 0, 1, 403},             /* a cookie, and nobody says from where */
        {NULL, NULL, NULL, 0, 1, 1, 403},
        {"http://evil.example", NULL, NULL, 1, 0, 1, 403},
        {"http://evil.example", NULL, NULL, 1, 0, 0, 403}, /* a foreign page that has a token */
        {"http://evil.example", NULL, NULL, 0, 1, 1, 403},
        {"null", NULL, NULL, 1, 0, 1, 403},                   /* a sandboxed frame */
        {"https://localhost:7421", NULL, NULL, 1, 0, 1, 403}, /* another scheme */
        {"evil://localhost:7421", NULL, NULL, 1, 0, 1, 403},
        {"http://localhost:7422", NULL, NULL, 1, 0, 1, 403}, /* another service of this machine */
        {"http://127.0.0.1:7421", NULL, NULL, 1, 0, 1, 403}, /* not the host that was asked */
        {"http://localhost:7421.evil.example", NULL, NULL, 1, 0, 1, 403},
        {"http://localhost:742", NULL, NULL, 1, 0, 1, 403},
        {NULL, "cross-site", "no-cors", 0, 0, 1, 403}, /* a foreign page's picture element */
        {NULL, "same-site", "cors", 0, 0, 1, 403},     /* another port's page */
        {NULL, "cross-site", NULL, 0, 0, 1, 403},
        {"http://localhost:7421", "cross-site", "navigate", 1, 0, 1, 403}, /* a foreign form */
    };
    struct guard guard = guard_of("127.0.0.1", NULL, 0);

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        struct error why = {0};
        struct guard_headers_of asked = {.host = "localhost:7421", .origin = rows[i].origin, .fetch_site = rows[i].site,
                                         .fetch_mode = rows[i].mode, .changes = rows[i].changes,
                                         .is_socket = rows[i].is_socket, .by_cookie = rows[i].by_cookie, .is_api = 1};
        unsigned answer = guard_check(&guard, &asked, &why);
        if (answer != rows[i].answer)
            fail_msg("row %zu: %u, not %u", i + 1, answer, rows[i].answer);
        assert_int_equal(why.text[0] != 0, answer != 0);
    }
}

static void test_tokens(void **state)
{
    char out[GUARD_TOKEN_MAX + 1], longest[GUARD_TOKEN_MAX + 32] = "Bearer ";

    (void)state;
    assert_true(guard_bearer("Bearer azt_12", out));
    assert_string_equal(out, "azt_12");
    assert_true(guard_bearer("BEARER  a.b-c~d+e/f=", out));
    assert_string_equal(out, "a.b-c~d+e/f=");
    assert_false(guard_bearer(NULL, out) || guard_bearer("", out) || guard_bearer("Bearer", out) || guard_bearer("Bearer ", out));
    assert_false(guard_bearer("Basic dXNlcg==", out) || guard_bearer("Bearer a\"b", out) || guard_bearer("Bearer \xc3\xa4", out));
    memset(longest + 7, 'a', GUARD_TOKEN_MAX);
    assert_true(guard_bearer(longest, out));
    longest[7 + GUARD_TOKEN_MAX] = 'a';
    assert_false(guard_bearer(longest, out));
    assert_string_equal(out, "");

    assert_true(guard_cookie("azulejo_session_7421=1.2.abc", 7421, out));
    assert_string_equal(out, "1.2.abc");
    assert_true(guard_cookie("a=b; azulejo_session_7422=x; azulejo_session_7421=y;c", 7421, out));
    assert_string_equal(out, "y");
    assert_false(guard_cookie("xazulejo_session_7421=1; azulejo_session_74210=2; azulejo_session_742=3", 7421, out));
    assert_false(guard_cookie("azulejo_session_7421", 7421, out) || guard_cookie("azulejo_session_7421=", 7421, out));
    assert_false(guard_cookie(NULL, 7421, out) || guard_cookie("; ;;", 7421, out));
}

static void test_lines(void **state)
{
    (void)state;
    for (int i = 0; i < GUARD_LINES; i++) {
        const size_t size = strlen(guard_lines[i].name);
        assert_true(size > 1 && guard_lines[i].name[size - 1] == ':');
        assert_null(strpbrk(guard_lines[i].value, "\r\n"));
    }
    assert_null(strstr(guard_lines[0].value, "unsafe"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_loopback_hosts), cmocka_unit_test(test_other_hosts), cmocka_unit_test(test_default_ports),
        cmocka_unit_test(test_loopback),       cmocka_unit_test(test_origins),     cmocka_unit_test(test_tokens),
        cmocka_unit_test(test_lines),
    };
    return cmocka_run_group_tests_name("web_guard", tests, NULL, NULL);
}
