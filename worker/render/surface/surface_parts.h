/* surface_parts: the inside of surface, shared by its files; only they include this.
 *
 * surface.c          where a hit is, and how a ray leaves it
 * surface_shade.c    the shading frame and the material's values there
 * surface_texture.c  texture lookups; alpha and emission of a point
 */
#pragma once

#include "worker/render/base/gate.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* Does a texture count in this slot, or the factor alone? */
static inline int slot_is_read(const struct render_slot *slot)
{
    return calls_for(EFFECTS_ALL, EFFECT_TEXTURE) && slot->image;
}
