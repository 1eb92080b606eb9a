/* surface_parts: the inside of surface, shared by its files; only they include this.
 *
 * surface.c          where a hit is, and how a ray leaves it
 * surface_shade.c    the shading frame and the material's values there
 * surface_texture.c  texture lookups; alpha and emission of a point
 */
#ifndef AZULEJO_RENDER_SURFACE_PARTS_H
#define AZULEJO_RENDER_SURFACE_PARTS_H

#include "worker/render/base/has.h"
#include "worker/render/surface/surface.h"
#include "worker/render/world.h"

/* Does a texture count in this slot, or the factor alone? */
static inline int world_slot_is_read(const struct world_slot *slot)
{
    return HAS(TEXTURE) && slot->image;
}

#endif
