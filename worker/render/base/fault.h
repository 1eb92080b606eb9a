/* fault: makes a few samples go wrong on purpose, so that tests see the counters of
 * common/film/health.h move. Only where AZULEJO_FAULTS is defined, which is in the worker that tests
 * link (Makefile); elsewhere FAULT(NAME) is the constant 0 and leaves nothing behind.
 *
 * The environment's AZULEJO_FAULT is a number: that of the only fault that strikes, counted from 1 in the
 * order of FAULT_MAP. It strikes one sample in FAULT_EVERY, a function of pixel and sample alone.
 */
#pragma once

/* The places that can go wrong, each in the same order as the kind that it must move. */
#define FAULT_MAP(X)   \
    X(NAN_RADIANCE)    \
    X(NEGATIVE_RADIANCE) \
    X(HUGE_RADIANCE)   \
    X(NAN_AOV)         \
    X(NAN_DIRECTION)   \
    X(ZERO_DENSITY)    \
    X(NAN_THROUGHPUT)  \
    X(NAN_BASIS)       \
    X(LOST_BODY)       \
    X(CROWDED_PLACE)   \
    X(ENDLESS_PATH)

#ifdef AZULEJO_FAULTS

#include <stdint.h>
#include <stdlib.h>

enum fault {
    FAULT_NONE,
#define FAULT_ENUM(NAME) FAULT_##NAME,
    FAULT_MAP(FAULT_ENUM)
#undef FAULT_ENUM
};
enum { FAULT_EVERY = 37 };

/* Which one strikes the sample that the thread renders. */
static _Thread_local enum fault fault_now;

static inline void fault_begin(uint32_t x, uint32_t y, uint32_t sample)
{
    const char *number = getenv("AZULEJO_FAULT");

    fault_now =
        number && (x + 3 * y + 5 * sample) % FAULT_EVERY == 4 ? (enum fault)strtoul(number, NULL, 10) : FAULT_NONE;
}

#define FAULT_BEGIN(x, y, sample) fault_begin(x, y, sample)
#define FAULT(NAME) (fault_now == FAULT_##NAME)

#else

#define FAULT_BEGIN(x, y, sample) ((void)(x), (void)(y), (void)(sample))
#define FAULT(NAME) 0

#endif
