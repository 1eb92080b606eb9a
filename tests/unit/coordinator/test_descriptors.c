/* How file descriptors are shared out, from limits too small to unlimited ones. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "coordinator/net/descriptors.h"

/* Whatever the limit: what is open, the reserve and the connections fit into it. */
static void test_shares_fit(void **state)
{
    (void)state;
    for (uint64_t limit = 120; limit < 200000; limit += limit / 50 + 1) {
        const uint64_t open = 20;
        struct descriptors d;
        assert_int_equal(descriptors_share(&d, limit, open, NULL), STATUS_OK);
        assert_true(d.reserve >= DESCRIPTORS_RESERVE_MIN);
        assert_true(open + d.reserve + d.connections_max <= limit);
        assert_true(d.sessions_max >= SESSIONS_MIN && d.sessions_max <= SESSIONS_MAX);
        for (uint32_t sessions = 0; sessions <= d.sessions_max; sessions++) {
            uint32_t strangers = descriptors_strangers(&d, sessions);
            assert_true(strangers >= STRANGERS_MIN && strangers <= STRANGERS_MAX);
            assert_true(sessions + strangers <= d.connections_max);
        }
    }
}

static void test_large_limits(void **state)
{
    const uint64_t limits[] = {65536, 1 << 20, UINT64_MAX};
    struct descriptors d;

    (void)state;
    for (int i = 0; i < 3; i++) {
        assert_int_equal(descriptors_share(&d, limits[i], 20, NULL), STATUS_OK);
        assert_int_equal(d.sessions_max, SESSIONS_MAX);
        assert_int_equal(d.connections_max, SESSIONS_MAX + STRANGERS_MAX);
        assert_int_equal(d.reserve, DESCRIPTORS_RESERVE_MAX);
    }
}

static void test_too_few(void **state)
{
    struct descriptors d;
    struct error err = {0};

    (void)state;
    assert_int_equal(descriptors_share(&d, 115, 20, &err), STATUS_ERR_LIMIT);
    assert_non_null(strstr(err.text, "115"));
    assert_non_null(strstr(err.text, "116"));
    assert_non_null(strstr(err.text, "LimitNOFILE"));
    assert_int_equal(descriptors_share(&d, 116, 20, &err), STATUS_OK);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shares_fit),
        cmocka_unit_test(test_large_limits),
        cmocka_unit_test(test_too_few),
    };
    return cmocka_run_group_tests_name("descriptors", tests, NULL, NULL);
}
