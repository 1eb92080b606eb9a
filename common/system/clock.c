#include "common/system/clock.h"

#include <time.h>

static uint64_t read_clock_ns(clockid_t id)
{
    struct timespec now;

    clock_gettime(id, &now);
    return (uint64_t)now.tv_sec * NS_PER_SECOND + (uint64_t)now.tv_nsec;
}

uint64_t clock_monotonic_ns(void) { return read_clock_ns(CLOCK_MONOTONIC); }

uint64_t clock_boot_ns(void) { return read_clock_ns(CLOCK_BOOTTIME); }

uint64_t clock_thread_cpu_ns(void) { return read_clock_ns(CLOCK_THREAD_CPUTIME_ID); }

int64_t clock_wall_ns(void) { return (int64_t)read_clock_ns(CLOCK_REALTIME); }

int64_t clock_wall_s(void) { return (int64_t)time(NULL); }
