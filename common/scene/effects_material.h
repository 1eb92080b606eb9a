/* effects_material: what one material needs. Internal to effects.c; only it includes this. */
#ifndef AZULEJO_SCENE_EFFECTS_MATERIAL_H
#define AZULEJO_SCENE_EFFECTS_MATERIAL_H

#include "common/scene/effects.h"

struct material_effects {
    uint64_t set;
    int invisible;      /* its alpha makes it invisible everywhere */
    int transmits;      /* light passes through it somewhere, thin or refracting */
    int bounds_volume;  /* the path must track whether it is inside */
};

/* `m` after scene_material_reduce, and not a MATERIAL_MIX, on one mesh. A texture can lower its
 * factor to anything. Culling and media depend on the rest of the scene: they are not in the
 * set. */
void effects_of_material(const struct scene_material *m, const struct scene_mesh *mesh,
                         struct material_effects *out);

#endif
