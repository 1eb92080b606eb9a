#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "protocol/address.h"

static void test_good(void **state)
{
    static const struct { const char *text, *host; int port; } good[] = {
        {"localhost", "localhost", 7420}, {"farm:1", "farm", 1}, {"10.0.0.1:65535", "10.0.0.1", 65535},
        {":99", "127.0.0.1", 99}, {"[::1]", "::1", 7420}, {"[::1]:80", "::1", 80}, {"::1", "::1", 7420},
    };
    char host[32];
    uint16_t port;

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        assert_int_equal(address_parse(good[i].text, "127.0.0.1", 1, host, sizeof host, &port, NULL), STATUS_OK);
        assert_string_equal(host, good[i].host);
        assert_int_equal(port, good[i].port);
    }
}

static void test_bad(void **state)
{
    static const char *const bad[] = {"", ":", "host:", "host:0", "host:65536", "host:x", "host:1x",
                                      "host:-1", "[::1", "[]", "[]:1", "[::1]x", "host: 1"};
    struct error err = {0};
    char host[32];
    uint16_t port;

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        assert_int_equal(address_parse(bad[i], "127.0.0.1", 1, host, sizeof host, &port, &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, bad[i]));
    }
}

static void test_limits(void **state)
{
    char host[32];
    uint16_t port;

    (void)state;
    /* 31 bytes fit into 32, 32 do not; port 0 and every address only where they are asked for. */
    assert_int_equal(address_parse("aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "", 1, host, sizeof host, &port, NULL),
                     STATUS_OK);
    assert_int_equal(address_parse("aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa", "", 1, host, sizeof host, &port, NULL),
                     STATUS_ERR_USAGE);
    assert_int_equal(address_parse(":0", "", 0, host, sizeof host, &port, NULL), STATUS_OK);
    assert_string_equal(host, "");
    assert_int_equal(port, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_good),
        cmocka_unit_test(test_bad),
        cmocka_unit_test(test_limits),
    };
    return cmocka_run_group_tests_name("address", tests, NULL, NULL);
}
