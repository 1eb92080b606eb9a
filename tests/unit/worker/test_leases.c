/* How much work a worker asks for. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "worker/leases.h"

/* The fewest units with which it does not ask for more. */
static uint64_t enough(struct leases *l)
{
    uint64_t held = 0;

    for (l->held = 0; leases_room(l) > 0; l->held++)
        held = l->held + 1;
    return held;
}

/* What is left when it asks lasts until the grant comes, whatever a unit takes and however far the coordinator is. */
static void what_is_left_covers_the_trip(void **state)
{
    (void)state;
    for (uint64_t unit_us = 150; unit_us < 2000000; unit_us *= 3)
        for (uint64_t trip_ms = 0; trip_ms <= 300; trip_ms += 50)
            for (unsigned threads = 1; threads <= 16; threads *= 4) {
                struct leases l = {.threads = threads, .unit_ns = unit_us * 1000};
                uint64_t left_ns, wanted_ns = trip_ms * NS_PER_MS;
                for (int i = 0; i < 20; i++)
                    leases_learn_trip(&l, trip_ms * NS_PER_MS);
                left_ns = enough(&l) * l.unit_ns / threads;
                if (wanted_ns > UNITS_PER_THREAD_MAX / 2 * l.unit_ns)
                    wanted_ns = UNITS_PER_THREAD_MAX / 2 * l.unit_ns;
                assert_true(left_ns >= wanted_ns);
                l.held = 0;
                assert_true(leases_room(&l) <= threads * UNITS_PER_THREAD_MAX);
            }
}

/* Neither long units nor a coordinator that had no work make it hoard. */
static void no_more_than_it_needs(void **state)
{
    struct leases l = {.threads = 2, .unit_ns = 10 * NS_PER_SECOND};

    (void)state;
    assert_int_equal(leases_room(&l), 2 * UNITS_PER_THREAD_MIN);
    l.unit_ns = 10 * NS_PER_MS;
    assert_int_equal(leases_room(&l), 2 * (UNITS_HOLD_MS / 10 + 1));
    for (int i = 0; i < 20; i++)
        leases_learn_trip(&l, 3600 * NS_PER_SECOND);
    assert_int_equal(leases_room(&l), 2 * (UNITS_HOLD_MAX_MS / 10 + 1));
    for (int i = 0; i < 20; i++)
        leases_learn_trip(&l, NS_PER_MS);
    assert_in_range(leases_room(&l), 2 * (UNITS_HOLD_MS / 10 + 1), 2 * (UNITS_HOLD_MS / 10 + 2));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_left_covers_the_trip),
        cmocka_unit_test(no_more_than_it_needs),
    };
    return cmocka_run_group_tests_name("leases", tests, NULL, NULL);
}
