/* effects_material: what one material needs, and what is left of it without some effects. */
#pragma once

#include "common/scene/effects.h"
#include "common/scene/scene.h"

/* Remove the effects of `without` from a material: what is left acts as if they were 0. */
void scene_material_reduce(struct scene_material *material, uint64_t without);

struct material_effects {
    uint64_t set;
    int invisible;     /* its alpha makes it invisible everywhere */
    int transmits;     /* light passes through it somewhere, thin or refracting */
    int bounds_volume; /* the path must track whether it is inside */
};

/* `m` after scene_material_reduce, and not a MATERIAL_MIX, on one mesh. A texture can lower its factor to anything.
 * Culling and media depend on the rest of the scene: they are not in the set. */
void effects_of_material(const struct scene_material *m, const struct scene_mesh *mesh, struct material_effects *out);
