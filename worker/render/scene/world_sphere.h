/* world_sphere: instances whose meshes represent spheres (MESH_SPHERE), as true spheres.
 *
 * A sphere that does not move, is scaled alike along all axes, has no alpha and emits uniformly is
 * intersected and sampled as a sphere. The mesh remains for texture coordinates and tangents, which
 * are those of its triangle in the hit's direction. All other instances stay meshes.
 */
#ifndef AZULEJO_RENDER_WORLD_SPHERE_H
#define AZULEJO_RENDER_WORLD_SPHERE_H

#include "worker/render/accel/accel.h"
#include "worker/render/world.h"

/* Find which instances are spheres; materials and instances must be known. ERR_NO_MEMORY. */
status world_spheres_find(struct render_scene *w, const struct scene *scene, struct error *err)
    MUST_CHECK;

/* Give the accel the instance's sphere, if it is one; the bounds including the camera are known. */
void world_sphere_give(const struct render_scene *w, const struct world_instance *instance,
                       struct accel_instance *out);

#endif
