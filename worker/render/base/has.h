/* has: which effects the code being compiled must be able to simulate.
 *
 * What runs at every path vertex (path*.c, tile.c, surface*.c, camera.c, bsdf/) is compiled once
 * for each kernel variant (worker/render/path/kernels/), with KERNEL_EFFECTS a constant set, so
 * that the compiler removes `if (HAS(SHEEN) && ...)` and its branch where no sheen can occur. In
 * bsdf/ a lobe's row names its effects (bsdf.h). Compiled on their own, as in the unit tests, the
 * same files cover every effect.
 *
 * Rule: HAS() may leave out only work whose result is known when the effect is absent (a weight of
 * 0, an empty stack), so every variant that covers a scene gives the same bits.
 */
#ifndef AZULEJO_RENDER_HAS_H
#define AZULEJO_RENDER_HAS_H

#include "common/scene/effects.h"

#ifndef KERNEL_EFFECTS
#define KERNEL_EFFECTS EFFECTS_ALL
#endif
/* And does this scene need it? (The user may have switched it off: settings.without.) */
#define ACTIVE(scene, name) (HAS(name) && ((scene)->effects >> EFFECT_BIT_##name & 1) != 0)
#define HAS(name) (((KERNEL_EFFECTS) >> EFFECT_BIT_##name & 1) != 0)

#endif
