/* bodies: which meshes bound one volume together, and which volumes are open.
 *
 * A body is all that one material bounds (worker/render/path/interior.h), so meshes of one material need
 * no decision. What is looked for here are meshes of several materials that are closed only
 * together: they share edges that are open in each of them. Vertices are the same where their
 * places in the world, as floats and at rest, are equal.
 *
 * A surface is closed when each of its edges is passed as often one way as the other: then the
 * winding count of any point is well defined, whatever else the surface does.
 */
#ifndef AZULEJO_IMPORT_BODIES_H
#define AZULEJO_IMPORT_BODIES_H

#include "client/import/builder/builder.h"

/* Sets scene_instance.body and sealed, and warns of volumes that are open or wound inwards. Does nothing
 * under VOLUMES_BOUNDARIES. ERR_NO_MEMORY. */
status bodies_find(struct builder *b) MUST_CHECK;

#endif
