/* effects_material: what one material calls for. The inside of effects.c; only it includes this. */
#ifndef AZULEJO_SCENE_EFFECTS_MATERIAL_H
#define AZULEJO_SCENE_EFFECTS_MATERIAL_H

#include "common/scene/effects.h"

struct material_effects {
    uint64_t set;
    int invisible;      /* by its alpha it is nowhere there */
    int transmits;      /* somewhere light passes through it, thin or refracting */
    int bounds_volume;  /* the path must keep count of being inside */
};

/* `m` as scene_material_reduce left it, and no MATERIAL_MIX, on one mesh. A texture can lower its
 * factor to anything. Culling and media depend on the rest of the scene: not in the set. */
void effects_of_material(const struct scene_material *m, const struct scene_mesh *mesh,
                         struct material_effects *out);

#endif
