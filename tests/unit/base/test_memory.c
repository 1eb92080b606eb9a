/* Freed memory is kept for the next block, and given back when that is asked for. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>
#include <sys/resource.h>

#include "common/base/memory.h"

enum { BLOCKS = 40, BLOCK_BYTES = 100 << 10, PAGE_BYTES = 4096, ROUNDS = 50 };

static long page_faults(void)
{
    struct rusage usage;

    assert_int_equal(getrusage(RUSAGE_SELF, &usage), 0);
    return usage.ru_minflt;
}

/* Blocks as films' records have them: all made and filled, then all freed. */
static void come_and_go(void)
{
    void *blocks[BLOCKS];

    for (int i = 0; i < BLOCKS; i++) {
        blocks[i] = mem_alloc(BLOCK_BYTES);
        assert_non_null(blocks[i]);
        memset(blocks[i], i, BLOCK_BYTES);
    }
    for (int i = 0; i < BLOCKS; i++)
        mem_free(blocks[i]);
}

static void test_keep(void **state)
{
    const long of_all = BLOCKS * (BLOCK_BYTES / PAGE_BYTES);
    long before;

    (void)state;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    skip(); /* their memory is their own */
#endif
    mem_keep();
    come_and_go();
    before = page_faults();
    for (int i = 0; i < ROUNDS; i++)
        come_and_go();
    assert_true(page_faults() - before < of_all); /* without it, as many in each round */
    mem_trim();
    before = page_faults();
    come_and_go();
    assert_true(page_faults() - before > of_all / 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_keep)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
