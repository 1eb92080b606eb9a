/* charge: to which effect's account the time of a rendering thread goes, for whoever looks from
 * outside (worker/profile.h).
 *
 * Work that only one effect asks for is that effect's own, the innermost one's where they lie in
 * each other: CHARGE_SCOPE. A ray, and the geometry and the material of what it meets, are the
 * doing of whatever sent it: the kind of light that was chosen, or the lobe that scattered; these
 * stay charged until the path charges somebody else. What any picture needs (the camera's rays,
 * what they meet, sums) is nobody's. docs/EFFECTS.md has the rule for users.
 *
 * A charge is one store of a byte of the thread's own. It changes no result.
 */
#ifndef AZULEJO_RENDER_CHARGE_H
#define AZULEJO_RENDER_CHARGE_H

#include <stdint.h>

#include "common/scene/effects.h"
#include "worker/render/watched.h"

/* One of EFFECT_ACCOUNTS. */
extern _Thread_local watched_byte charge_now __attribute__((tls_model("local-exec")));

enum { CHARGE_NOBODY = 0 };
#define CHARGE_OF(name) ((uint8_t)(EFFECT_BIT_##name + 1))

static inline uint8_t charge_get(void)
{
    return WATCHED_GET(charge_now);
}

static inline void charge_set(uint8_t account)
{
    WATCHED_SET(charge_now, account);
}

static inline uint8_t charge_swap(uint8_t account)
{
    uint8_t before = charge_get();

    charge_set(account);
    return before;
}

static inline void charge_back(const uint8_t *before)
{
    charge_set(*before);
}

/* From here on, until the next charge. */
#define CHARGE(name) charge_set(CHARGE_OF(name))

/* From here to the end of the block; then to whoever was charged before. */
#define CHARGE_SCOPE(name) CHARGE_SCOPE_AT(CHARGE_OF(name), __LINE__)
#define CHARGE_SCOPE_OF(account) CHARGE_SCOPE_AT(account, __LINE__)
#define CHARGE_SCOPE_AT(account, line) CHARGE_SCOPE_NAMED(account, line)
#define CHARGE_SCOPE_NAMED(account, line) \
    __attribute__((cleanup(charge_back), unused)) const uint8_t charge_before_##line = \
        charge_swap(account)

#endif
