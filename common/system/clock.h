/* clock: durations come from the monotonic clock, calendar stamps from the wall clock. */
#pragma once

#include <stdint.h>

#define NS_PER_SECOND 1000000000ull
#define NS_PER_MS 1000000ull

uint64_t clock_monotonic_ns(void);
uint64_t clock_boot_ns(void);       /* as that one, and goes on while the machine is suspended */
uint64_t clock_thread_cpu_ns(void); /* CPU time of the calling thread */
int64_t clock_wall_ns(void);        /* since 1970-01-01 UTC */
int64_t clock_wall_s(void);         /* seconds since 1970-01-01 UTC */
