/* rate: events a second, over the last few seconds.
 *
 * Buckets of one second; the present second counts with the part that has passed.
 */
#pragma once

#include <stdint.h>

enum { RATE_SECONDS = 10 };

struct rate {
    uint64_t bucket[RATE_SECONDS];
    uint64_t second;   /* of the newest bucket, on the monotonic clock */
    uint64_t first_ns; /* when counting began after the last silence; 0: never */
};

void rate_add(struct rate *rate, uint64_t amount, uint64_t now_ns);

/* 0 when nothing came for RATE_SECONDS. */
double rate_per_second(const struct rate *rate, uint64_t now_ns);
