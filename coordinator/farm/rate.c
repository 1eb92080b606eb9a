#include "coordinator/farm/rate.h"

#include <string.h>

#include "common/system/clock.h"

void rate_add(struct rate *rate, uint64_t amount, uint64_t now_ns)
{
    uint64_t second = now_ns / NS_PER_SECOND;

    if (rate->first_ns == 0 || second >= rate->second + RATE_SECONDS) {
        memset(rate, 0, sizeof *rate);
        rate->first_ns = now_ns ? now_ns : 1;
        rate->second = second;
    }
    for (; rate->second < second; rate->second++)
        rate->bucket[(rate->second + 1) % RATE_SECONDS] = 0;
    rate->bucket[second % RATE_SECONDS] += amount;
}

double rate_per_second(const struct rate *rate, uint64_t now_ns)
{
    uint64_t second = now_ns / NS_PER_SECOND, sum = 0, begin_ns;
    double span_s;

    if (rate->first_ns == 0 || second >= rate->second + RATE_SECONDS)
        return 0;
    for (uint64_t i = 0; i < RATE_SECONDS; i++) {
        uint64_t s = rate->second - i;
        if (i <= rate->second && s + RATE_SECONDS > second)
            sum += rate->bucket[s % RATE_SECONDS];
    }
    begin_ns = second >= RATE_SECONDS - 1 ? (second - (RATE_SECONDS - 1)) * NS_PER_SECOND : 0;
    if (begin_ns < rate->first_ns)
        begin_ns = rate->first_ns;
    span_s = (double)(now_ns - begin_ns) / 1e9;
    /* The first results come in a burst, which is not a rate yet. */
    return span_s < 0.25 ? (double)sum / 0.25 : (double)sum / span_s;
}
