/* Freed memory is kept for the next block, and given back when that is asked for. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "common/base/memory.h"

enum { BLOCKS = 40, BLOCK_BYTES = 100 << 10 };

static long resident_bytes(void)
{
    long whole, resident;
    FILE *file = fopen("/proc/self/statm", "r");

    assert_non_null(file);
    assert_int_equal(fscanf(file, "%ld %ld", &whole, &resident), 2);
    (void)fclose(file);
    return resident * sysconf(_SC_PAGESIZE);
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
    const long half = BLOCKS * (BLOCK_BYTES / 2);
    long before, kept;

    (void)state;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    skip(); /* their memory is their own */
#endif
    mem_keep();
    before = resident_bytes();
    come_and_go();
    kept = resident_bytes();
    assert_true(kept - before > half);
    mem_trim();
    assert_true(kept - resident_bytes() > half);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_keep)};

    return cmocka_run_group_tests(tests, NULL, NULL);
}
