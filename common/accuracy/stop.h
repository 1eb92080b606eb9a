/* stop: when a frame has enough samples, and which tiles get them.
 *
 * The first rule that is met ends the frame. The cap on a pixel's samples is not here but in render_settings.spp,
 * because workers need it: it determines which passes are short. A limit ends a frame with the results that have come: its
 * samples cannot be reproduced from the rules, and it keeps its schedule (schedule.h).
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/accuracy/allocate.h"
#include "common/base/status.h"
#include "common/schema/settings.h"

enum {
    STOP_TEXT_SIZE = 64,
    SPP_MIN_DEFAULT = 16, /* spp_min of rules with a target */
};
#define STOP_LIMIT_MS_MAX ((uint64_t)1 << 40) /* 34 years */
#define STOP_RAYS_MAX 1000000000000000ull

struct stop_rules {
    int has_target;
    struct allocation_target target; /* error of the picture */
    int adaptive;                    /* tiles get samples in rounds, where they help most */
#define STOP_OPTION(...)
#define STOP_SETTING(o, KIND, type, name, ...) type name;
    STOP_RULES(STOP_OPTION, STOP_SETTING, )
#undef STOP_OPTION
#undef STOP_SETTING
};

enum stop_name {
#define STOP_OPTION(o, name, ...) STOP_##name,
#define STOP_SETTING(o, KIND, type, name, ...) STOP_##name,
    STOP_RULES(STOP_OPTION, STOP_SETTING, )
#undef STOP_OPTION
#undef STOP_SETTING
    STOP_COUNT
};
extern const struct setting stop_rules_rows[STOP_COUNT];

/* Is the frame rendered in rounds? If not, every tile gets all that the cap allows. */
static inline int stop_has_rounds(const struct stop_rules *rules) { return rules->adaptive || rules->has_target; }

static inline int stop_has_limit(const struct stop_rules *rules)
{
    return rules->time_limit_ms > 0 || rules->core_limit_ms > 0 || rules->max_rays > 0;
}
/* Does any rule but the cap on samples end a frame? */
static inline int stop_ends_a_frame(const struct stop_rules *rules)
{
    return rules->has_target || stop_has_limit(rules);
}

/* ERR_INPUT names the value and its range. */
status stop_rules_validate(const struct stop_rules *rules, struct error *err) MUST_CHECK;

/* "2/255", "1%", "45dB". ERR_USAGE. */
status stop_target_parse(const char *text, struct allocation_target *out, struct error *err) MUST_CHECK;
const char *stop_target_text(char out[STOP_TEXT_SIZE], const struct allocation_target *target);
/* Does `a` demand a better picture than `b`? Only targets of one measure compare. */
int stop_target_is_stricter(const struct allocation_target *a, const struct allocation_target *b);

/* "2/255, at most 4096 samples a pixel, 10m a frame", for people. */
enum { STOP_RULES_TEXT_SIZE = 192 };
const char *stop_rules_text(char out[STOP_RULES_TEXT_SIZE], const struct stop_rules *rules, uint32_t spp);

/* Why a frame's samples ended. The numbers are the wire's FrameEnd and the store's. */
enum frame_end {
    FRAME_END_NONE,     /* it continues */
    FRAME_END_CAP,      /* every pixel has all samples */
    FRAME_END_TARGET,
    FRAME_END_TIME,
    FRAME_END_CORES,
    FRAME_END_CANCEL,   /* also for older frames about which nothing else is known */
    FRAME_END_SCHEDULE, /* it has what another picture's schedule says */
    FRAME_END_FINISH,   /* a person wanted the picture now */
    FRAME_END_MISSED,   /* reported in place of TARGET if the picture's error is larger; never stored */
    FRAME_END_RAYS,
    FRAME_END_COUNT
};
/* It has the samples that were requested. */
static inline int frame_end_is_whole(enum frame_end end)
{
    return end == FRAME_END_CAP || end == FRAME_END_TARGET || end == FRAME_END_SCHEDULE;
}
/* "ended by the time limit", for people; after it: how many samples. */
const char *frame_end_text(enum frame_end end);
