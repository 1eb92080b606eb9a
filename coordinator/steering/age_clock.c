#include "coordinator/steering/age_clock.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "common/base/duration.h"
#include "common/system/clock.h"

void age_clock_begin(struct age_clock *clock, int64_t wait_s, int64_t wall_s, uint64_t boot_ns)
{
    *clock = (struct age_clock){.wait_s = wait_s, .wall_s = wall_s, .boot_ns = boot_ns, .since_ns = boot_ns};
}

int64_t age_clock_look(struct age_clock *clock, int64_t wall_s, uint64_t boot_ns)
{
    int64_t jump_s = wall_s - clock->wall_s - (int64_t)((boot_ns - clock->boot_ns) / NS_PER_SECOND);

    clock->wall_s = wall_s;
    clock->boot_ns = boot_ns;
    if (llabs(jump_s) <= AGE_CLOCK_JUMP_S)
        return 0;
    clock->since_ns = boot_ns;
    clock->jump_s = jump_s;
    return jump_s;
}

uint64_t age_clock_left_ns(const struct age_clock *clock)
{
    uint64_t passed_ns = clock->boot_ns - clock->since_ns, wait_ns = (uint64_t)clock->wait_s * NS_PER_SECOND;

    return passed_ns < wait_ns ? wait_ns - passed_ns : 0;
}

enum age_verdict age_clock_judge(const struct age_clock *clock, int64_t newest_s, int asked)
{
    if (clock->wall_s < newest_s - AGE_CLOCK_JUMP_S)
        return AGES_BEFORE;
    if (age_clock_left_ns(clock) == 0)
        return AGES_COUNT;
    if (clock->jump_s)
        return AGES_JUMPED;
    return asked ? AGES_COUNT : AGES_WAIT;
}

static const char *utc_text(char out[32], int64_t seconds)
{
    time_t when = (time_t)seconds;
    struct tm utc;

    if (!gmtime_r(&when, &utc) || strftime(out, 32, "%Y-%m-%d %H:%M UTC", &utc) == 0)
        snprintf(out, 32, "%" PRId64, seconds);
    return out;
}

void age_clock_text(char out[AGE_CLOCK_TEXT_MAX + 1], const struct age_clock *clock, enum age_verdict verdict,
                    int64_t newest_s)
{
    char now[32], newest[32], jump[DURATION_TEXT_SIZE], wait[DURATION_TEXT_SIZE];
    int64_t jump_s = llabs(clock->jump_s);

    jump_s += jump_s > 3600 ? AGE_CLOCK_JUMP_S : 0; /* not "59 days" where a second is missing */
    utc_text(now, clock->wall_s);
    duration_text(wait, clock->wait_s);
    switch (verdict) {
    case AGES_BEFORE:
        snprintf(out, AGE_CLOCK_TEXT_MAX + 1,
                 "the clock says %s, but the store knows of %s: nothing is removed by age before the clock is set right", now,
                 utc_text(newest, newest_s));
        return;
    case AGES_JUMPED:
        snprintf(out, AGE_CLOCK_TEXT_MAX + 1,
                 "the clock jumped %s by %s, to %s: nothing is removed by age for %s from then on (--age-wait)",
                 clock->jump_s < 0 ? "back" : "ahead", duration_words(jump, jump_s), now, wait);
        return;
    case AGES_WAIT:
        snprintf(out, AGE_CLOCK_TEXT_MAX + 1,
                 "the clock says %s: what is old by it is removed %s after the start (--age-wait), or by 'azulejo gc'",
                 now, wait);
        return;
    default: out[0] = 0;
    }
}
