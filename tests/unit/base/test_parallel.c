/* A loop by several threads: every index once, in pieces that do not depend on the threads. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <sched.h>
#include <stdatomic.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/system/parallel.h"

enum { COUNT_MAX = 1000 };

struct visits {
    size_t count, grain;
    atomic_int seen[COUNT_MAX], wrong_pieces;
};

static void visit(void *user, size_t begin, size_t end)
{
    struct visits *v = user;
    size_t grain = v->grain ? v->grain : 1;

    if (begin >= end || begin % grain != 0 || end - begin > grain || end > v->count ||
        (end - begin < grain && end != v->count))
        atomic_fetch_add(&v->wrong_pieces, 1);
    for (size_t i = begin; i < end && i < COUNT_MAX; i++)
        atomic_fetch_add(&v->seen[i], 1);
    sched_yield(); /* so that others get a piece, too */
}

static void test_every_index_once(void **state)
{
    static const unsigned threads[] = {0, 1, 2, 5, PARALLEL_THREADS_MAX, 100000};
    static const size_t counts[] = {0, 1, 2, 7, 64, COUNT_MAX}, grains[] = {0, 1, 3, 64, 2000};
    static struct visits v;

    (void)state;
    for (size_t t = 0; t < sizeof threads / sizeof *threads; t++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
            for (size_t g = 0; g < sizeof grains / sizeof *grains; g++) {
                memset(&v, 0, sizeof v);
                v.count = counts[c];
                v.grain = grains[g];
                parallel_for(threads[t], counts[c], grains[g], visit, &v);
                assert_int_equal(v.wrong_pieces, 0);
                for (size_t i = 0; i < COUNT_MAX; i++)
                    assert_int_equal(v.seen[i], i < counts[c]);
            }
}

static void nested(void *user, size_t begin, size_t end)
{
    for (size_t i = begin; i < end; i++)
        parallel_for(2, COUNT_MAX, 10, visit, (struct visits *)user + i);
}

static void test_loops_within_loops(void **state)
{
    static struct visits v[3];

    (void)state;
    for (int k = 0; k < 3; k++) {
        v[k].count = COUNT_MAX;
        v[k].grain = 10;
    }
    parallel_for(3, 3, 1, nested, v);
    for (int k = 0; k < 3; k++)
        for (size_t i = 0; i < COUNT_MAX; i++)
            assert_int_equal(v[k].seen[i], 1);
}

static void burn(void *user, size_t begin, size_t end)
{
    uint64_t until_ns = clock_thread_cpu_ns() + (end - begin) * 5 * NS_PER_MS;

    (void)user;
    while (clock_thread_cpu_ns() < until_ns)
        ;
}

/* What the others computed is counted, in loops within loops, too. */
static void burn_nested(void *user, size_t begin, size_t end)
{
    for (size_t i = begin; i < end; i++)
        parallel_for(2, 4, 1, burn, user);
}

static void test_cpu_time(void **state)
{
    uint64_t begin_ns = parallel_cpu_ns();

    (void)state;
    parallel_for(4, 4, 1, burn, NULL);
    assert_true(parallel_cpu_ns() - begin_ns >= 20 * NS_PER_MS);
    begin_ns = parallel_cpu_ns();
    parallel_for(2, 4, 1, burn_nested, NULL);
    assert_true(parallel_cpu_ns() - begin_ns >= 80 * NS_PER_MS);
}

static void test_processors(void **state)
{
    (void)state;
    assert_true(parallel_processors() >= 1);
    assert_true(parallel_processors() <= PARALLEL_THREADS_MAX);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_index_once),
        cmocka_unit_test(test_loops_within_loops),
        cmocka_unit_test(test_cpu_time),
        cmocka_unit_test(test_processors),
    };
    return cmocka_run_group_tests_name("parallel", tests, NULL, NULL);
}
