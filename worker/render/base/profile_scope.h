/* profile_scope: what a rendering thread is doing, for the sampling profiler that reads it from another thread
 * (worker/profile.h).
 *
 *     PROFILE_STAGE(TRACE);      the thread traces, until the next stage
 *     PROFILE_EFFECT(TEXTURE);   it works for this effect, until the end of the block
 *
 * Stages are those of common/scene/stages.h. A new stage begins without an effect. The marks are at the borders of the
 * renderer's parts: tracing, surfaces, media, camera, a row of the table of lobes or of lights. The integrator does not
 * know which effect a ray belongs to.
 *
 * A mark stores one or two bytes that belong to the thread; it changes no result. The bytes are volatile, not atomic:
 * compilers treat an atomic access as a barrier to all memory and reload registers, which made frames 1 % slower. Every
 * processor stores a byte in one piece; the thread sanitizer cannot know that, so it gets the atomic.
 */
#pragma once

#include <stdint.h>

#include "common/scene/effects.h"
#include "common/scene/stages.h"

#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define WATCHED_ATOMIC 1
#endif
#endif
#if defined(__SANITIZE_THREAD__) && !defined(WATCHED_ATOMIC)
#define WATCHED_ATOMIC 1
#endif

#ifdef WATCHED_ATOMIC
#include <stdatomic.h>
typedef _Atomic uint8_t watched_byte;
#define WATCHED_GET(byte) atomic_load_explicit(&(byte), memory_order_relaxed)
#define WATCHED_SET(byte, value) atomic_store_explicit(&(byte), value, memory_order_relaxed)
#else
typedef volatile uint8_t watched_byte;
#define WATCHED_GET(byte) (byte)
#define WATCHED_SET(byte, value) ((void)((byte) = (value)))
#endif

struct profile_place {
    watched_byte stage;   /* its number + 1; 0: the thread renders nothing */
    watched_byte account; /* of EFFECT_ACCOUNTS: an effect's bit + 1; 0: no effect */
};
extern _Thread_local struct profile_place profile_place __attribute__((tls_model("local-exec")));

enum { PROFILE_NO_EFFECT = 0 };
#define PROFILE_ACCOUNT(name) ((uint8_t)(EFFECT_BIT_##name + 1))

static inline void profile_stage(uint8_t stage)
{
    WATCHED_SET(profile_place.stage, stage);
    WATCHED_SET(profile_place.account, 0);
}

static inline uint8_t profile_enter(uint8_t account)
{
    uint8_t before = WATCHED_GET(profile_place.account);

    WATCHED_SET(profile_place.account, account);
    return before;
}

static inline void profile_exit(const uint8_t *before) { WATCHED_SET(profile_place.account, *before); }

/* For a row of a table: until the end of the enclosing scope, or the next stage. */
static inline void profile_account(uint8_t account) { WATCHED_SET(profile_place.account, account); }

static inline uint8_t profile_account_now(void) { return WATCHED_GET(profile_place.account); }

#define PROFILE_STAGE(name) profile_stage((uint8_t)(STAGE_##name + 1))
#define PROFILE_IDLE() profile_stage(0)
#define PROFILE_EFFECT(name) PROFILE_EFFECT_ACCOUNT(PROFILE_ACCOUNT(name))
/* A stage, and an effect (an account) until the end of the block. */
#define PROFILE_STAGE_EFFECT(stage, account) \
    PROFILE_STAGE(stage);                    \
    PROFILE_EFFECT_ACCOUNT(account)
/* The same as PROFILE_EFFECT for an account that is known at run time only. */
#define PROFILE_EFFECT_ACCOUNT(account) PROFILE_EFFECT_AT(account, __LINE__)
#define PROFILE_EFFECT_AT(account, line) PROFILE_EFFECT_NAMED(account, line)
#define PROFILE_EFFECT_NAMED(account, line) \
    __attribute__((cleanup(profile_exit), unused)) const uint8_t profile_before_##line = \
        profile_enter(account)
