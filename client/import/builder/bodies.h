/* bodies: finds meshes that bound one volume together, and volumes that are open.
 *
 * A body is everything that one material bounds (worker/render/path/interior.h), so meshes of one material need no
 * decision. This file finds meshes of several materials that are closed only together: they share edges that are open
 * in each of them. Vertices are the same if their positions in the world, as floats and at rest, are equal.
 *
 * A surface is closed if each of its edges is used equally often in both directions: then the winding number of any
 * point is well defined, whatever the surface's shape.
 */
#pragma once

#include "client/import/builder/builder.h"

/* Sets scene_instance.body and sealed, and warns of volumes that are open or wound inwards. Does nothing
 * under VOLUMES_BOUNDARIES. */
status bodies_find(struct builder *b) MUST_CHECK;
