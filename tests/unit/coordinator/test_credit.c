/* What a worker is trusted with. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "common/system/clock.h"
#include "coordinator/frame/credit.h"

#define BEGIN_NS (100 * NS_PER_SECOND)

static void a_claim_is_not_believed(void **state)
{
    struct credit credit;

    (void)state;
    credit_init(&credit, 4096);
    assert_int_equal(credit.threads, CREDIT_THREADS_FIRST);
    credit_init(&credit, 3);
    assert_int_equal(credit.threads, 3);
}

/* One second of CPU time a thread and second, on so many threads, holding plenty. */
static uint64_t deliver(struct credit *credit, uint32_t threads, unsigned seconds, uint64_t now_ns)
{
    for (unsigned i = 0; i < seconds; i++) {
        now_ns += NS_PER_SECOND;
        credit_delivered(credit, 10000, threads * NS_PER_SECOND, now_ns);
    }
    return now_ns;
}

static void results_raise_it_up_to_the_claim(void **state)
{
    struct credit credit;
    uint64_t now_ns = BEGIN_NS;

    (void)state;
    credit_init(&credit, 100);
    credit_lent(&credit, 0, now_ns);
    now_ns = deliver(&credit, 16, 2, now_ns);
    assert_int_equal(credit.threads, CREDIT_GROWTH * 16);
    now_ns = deliver(&credit, 32, 2, now_ns);
    assert_int_equal(credit.threads, CREDIT_GROWTH * 32);
    deliver(&credit, 64, 2, now_ns);
    assert_int_equal(credit.threads, 100);
}

static void slow_results_lower_it_but_waiting_does_not(void **state)
{
    struct credit credit;
    uint64_t now_ns = BEGIN_NS;

    (void)state;
    credit_init(&credit, 64);
    credit.threads = 64;
    credit_lent(&credit, 0, now_ns);
    now_ns = deliver(&credit, 1, 2, now_ns);
    assert_int_equal(credit.threads, 32); /* by half at most */
    deliver(&credit, 1, 10, now_ns);
    assert_int_equal(credit.threads, CREDIT_GROWTH);

    /* The same results of a worker that had nothing else to do. */
    credit_init(&credit, 64);
    credit.threads = 64;
    credit_lent(&credit, 0, now_ns);
    for (int i = 0; i < 10; i++) {
        now_ns += NS_PER_SECOND;
        credit_delivered(&credit, 1, NS_PER_SECOND, now_ns);
    }
    assert_int_equal(credit.threads, 64);
}

static void a_lapse_halves_it_once_for_all_leases_of_its_time(void **state)
{
    struct credit credit;
    uint64_t now_ns = BEGIN_NS;

    (void)state;
    credit_init(&credit, 64);
    for (int i = 0; i < 5; i++) /* five leases that lapse together */
        credit_lapsed(&credit, BEGIN_NS - NS_PER_SECOND, now_ns);
    assert_int_equal(credit.threads, CREDIT_THREADS_FIRST / 2);
    credit_lapsed(&credit, now_ns, now_ns + NS_PER_SECOND); /* a later one */
    assert_int_equal(credit.threads, CREDIT_THREADS_FIRST / 4);
    for (int i = 2; i < 10; i++)
        credit_lapsed(&credit, now_ns + (uint64_t)i * NS_PER_SECOND, now_ns + (uint64_t)i * NS_PER_SECOND);
    assert_int_equal(credit.threads, 1);
    /* Results bring it back. */
    credit_lent(&credit, 0, now_ns);
    for (int i = 0; i < 12; i++)
        now_ns = deliver(&credit, credit.threads, 2, now_ns);
    assert_int_equal(credit.threads, 64);
}

static void proof_ages_and_standstill_is_seen(void **state)
{
    struct credit credit;

    (void)state;
    credit_init(&credit, 4);
    assert_false(credit_is_proven(&credit, BEGIN_NS));
    credit_lent(&credit, 0, BEGIN_NS);
    assert_false(credit_is_stuck(&credit, 3, 5, BEGIN_NS + 4));
    assert_true(credit_is_stuck(&credit, 3, 5, BEGIN_NS + 5));
    assert_false(credit_is_stuck(&credit, 0, 5, BEGIN_NS + 5)); /* it holds nothing */
    credit_delivered(&credit, 3, 1, BEGIN_NS + 5);
    assert_false(credit_is_stuck(&credit, 3, 5, BEGIN_NS + 9));
    assert_true(credit_is_proven(&credit, BEGIN_NS + NS_PER_SECOND));
    assert_false(credit_is_proven(&credit, BEGIN_NS + 5 + CREDIT_PROVEN_MS * NS_PER_MS));
    credit_lapsed(&credit, BEGIN_NS + 6, BEGIN_NS + 7);
    assert_true(credit_is_stuck(&credit, 0, 5, BEGIN_NS + 7)); /* until it delivers again */
    credit_delivered(&credit, 0, 1, BEGIN_NS + 8);
    assert_false(credit_is_stuck(&credit, 0, 5, BEGIN_NS + 8));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_claim_is_not_believed),
        cmocka_unit_test(results_raise_it_up_to_the_claim),
        cmocka_unit_test(slow_results_lower_it_but_waiting_does_not),
        cmocka_unit_test(a_lapse_halves_it_once_for_all_leases_of_its_time),
        cmocka_unit_test(proof_ages_and_standstill_is_seen),
    };
    return cmocka_run_group_tests_name("credit", tests, NULL, NULL);
}
