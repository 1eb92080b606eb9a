/* render_shape: instances whose meshes stand in for shapes (shape/shape.h).
 *
 * What stands still, is scaled alike along all axes, has no alpha and shines evenly is intersected
 * and sampled as the shape. All else is the mesh that it is.
 */
#pragma once

#include "worker/render/accel/accel.h"
#include "worker/render/render_scene.h"

/* Which instances have shapes; the materials and instances are known. ERR_NO_MEMORY. */
status shapes_find(struct render_scene *w, const struct scene *scene, struct error *err) MUST_CHECK;

/* Give the accel the instance's shape, if it has one; the bounds with the camera are known. */
void shape_give(const struct render_scene *w, const struct render_instance *instance, struct accel_instance *out);
