/* What the machine has: bounds that hold on any. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <unistd.h>
#include <cmocka.h>

#include "common/system/machine.h"

static void test_available(void **state)
{
    uint64_t all = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t available = machine_memory_available();

    (void)state;
    assert_true(available > 0);
    assert_true(available <= all);
}

/* A limit of the address space is heeded. */
static void test_address_space(void **state)
{
    struct rlimit before, limit;
    unsigned long long pages = 0;
    uint64_t used, room = 64 << 20;
    FILE *file = fopen("/proc/self/statm", "r");

    (void)state;
    assert_non_null(file);
    assert_int_equal(fscanf(file, "%llu", &pages), 1);
    fclose(file);
    used = pages * (uint64_t)sysconf(_SC_PAGESIZE);
    assert_int_equal(getrlimit(RLIMIT_AS, &before), 0);
    limit = before;
    limit.rlim_cur = used + room;
    if (before.rlim_max != RLIM_INFINITY && limit.rlim_cur > before.rlim_max)
        limit.rlim_cur = before.rlim_max;
    assert_int_equal(setrlimit(RLIMIT_AS, &limit), 0);
    used = machine_memory_available();
    assert_int_equal(setrlimit(RLIMIT_AS, &before), 0);
    assert_true(used <= room);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_available),
        cmocka_unit_test(test_address_space),
    };
    return cmocka_run_group_tests_name("machine", tests, NULL, NULL);
}
