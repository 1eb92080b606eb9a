/* charge: the earlier names of profile_scope.h. */
#ifndef AZULEJO_RENDER_CHARGE_H
#define AZULEJO_RENDER_CHARGE_H

#include "worker/render/profile_scope.h"

enum { CHARGE_NOBODY = 0 };
#define CHARGE_OF(name) PROFILE_ACCOUNT(name)
#define CHARGE_SCOPE(name) PROFILE_EFFECT(name)
#define CHARGE_SCOPE_OF(account) PROFILE_EFFECT_ACCOUNT(account)
/* Until the scope that surrounds it ends, or the next stage begins. */
#define CHARGE(name) charge_set(CHARGE_OF(name))

static inline uint8_t charge_get(void)
{
    return WATCHED_GET(profile_place.account);
}

static inline void charge_set(uint8_t account)
{
    (void)profile_enter(account);
}

#endif
