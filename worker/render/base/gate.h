/* gate: may an effect act here?
 *
 *     if (calls_for(scene->effects, EFFECT_FOG)) ...     does this frame call for it?
 *     if (calls_for(b->effects, EFFECT_SHEEN)) ...       does this surface?
 *     if (calls_for(EFFECTS_ALL, EFFECT_TEXTURE)) ...    can anything that this kernel renders?
 *
 * What runs at every path vertex (Makefile: KERNEL_SRC) is compiled once for each kernel, with
 * KERNEL_EFFECTS a constant set, so that the compiler removes the branch where the kernel lacks the
 * effect. Compiled on their own, as in the unit tests, the same files cover every effect.
 *
 * Rule: the gate may leave out only work whose result is known when the effect is absent (a weight of
 * 0, an empty stack), so every kernel that covers a scene gives the same bits.
 */
#pragma once

#include "common/scene/kernel_sets.h"

#ifndef KERNEL_EFFECTS
#define KERNEL_EFFECTS EFFECTS_ALL
#endif

/* Is any of `effects` in the set that is called for, and can the kernel simulate it? */
static inline __attribute__((always_inline)) int calls_for(uint64_t set, uint64_t effects)
{
    return (set & effects & (KERNEL_EFFECTS)) != 0;
}
