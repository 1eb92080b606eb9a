/* age_clock: can the wall clock be right, so that what is old by it may be removed?
 *
 *   begin --even for wait_s--> believed
 *     ^                            |
 *     +--------- a jump -----------+
 *
 * A clock that is wrong for a moment would remove everything. So ages wait after a start and after each jump, in which
 * time somebody, or a time server, can set it right; and they never count by a clock that shows a moment before
 * something that the store knows to have happened. A person who asks for the removal need not wait after a start.
 */
#pragma once

#include <stdint.h>

enum {
    AGE_CLOCK_JUMP_S = 60,    /* more than time servers correct in one step of a clock that runs */
    AGE_CLOCK_TEXT_MAX = 255,
};

struct age_clock {
    int64_t wait_s;
    int64_t wall_s;    /* as of the last look, seconds since 1970, */
    uint64_t boot_ns;  /* and the clock that goes on in suspended machines */
    uint64_t since_ns; /* even since then */
    int64_t jump_s;    /* the jump at since_ns; 0: the start */
};

enum age_verdict { AGES_COUNT, AGES_WAIT, AGES_JUMPED, AGES_BEFORE };

void age_clock_begin(struct age_clock *clock, int64_t wait_s, int64_t wall_s, uint64_t boot_ns);
/* At each tick. The seconds by which the clock has jumped since the last one; 0: it goes on evenly. */
int64_t age_clock_look(struct age_clock *clock, int64_t wall_s, uint64_t boot_ns);
/* As of the last look. newest_s: the latest moment that the store knows. asked: by a person. */
enum age_verdict age_clock_judge(const struct age_clock *clock, int64_t newest_s, int asked);
/* Until AGES_WAIT or AGES_JUMPED is over, in nanoseconds. */
uint64_t age_clock_left_ns(const struct age_clock *clock);
/* What is wrong, for people; empty for AGES_COUNT. */
void age_clock_text(char out[AGE_CLOCK_TEXT_MAX + 1], const struct age_clock *clock, enum age_verdict verdict,
                    int64_t newest_s);
