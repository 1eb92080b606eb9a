/* world_shape: instances whose meshes stand in for shapes (shape/shape.h).
 *
 * What stands still, is scaled alike along all axes, has no alpha and shines evenly is intersected
 * and sampled as the shape. All else is the mesh that it is.
 */
#ifndef AZULEJO_RENDER_WORLD_SHAPE_H
#define AZULEJO_RENDER_WORLD_SHAPE_H

#include "worker/render/accel/accel.h"
#include "worker/render/world.h"

/* Which instances have shapes; the materials and instances are known. ERR_NO_MEMORY. */
status world_shapes_find(struct render_scene *w, const struct scene *scene, struct error *err)
    MUST_CHECK;

/* Give the accel the instance's shape, if it has one; the bounds with the camera are known. */
void world_shape_give(const struct render_scene *w, const struct world_instance *instance,
                      struct accel_instance *out);

#endif
