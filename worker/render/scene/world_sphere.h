/* world_sphere: instances whose meshes stand in for spheres (MESH_SPHERE), as true spheres.
 *
 * What stands still, is scaled alike along all axes, has no alpha and shines evenly is intersected
 * and sampled as a sphere. The mesh remains for texture coordinates and tangents: they are those of
 * its triangle in the direction of the place. All else is the mesh that it is.
 */
#ifndef AZULEJO_RENDER_WORLD_SPHERE_H
#define AZULEJO_RENDER_WORLD_SPHERE_H

#include "worker/render/accel/accel.h"
#include "worker/render/world.h"

/* Which instances are spheres; the materials and instances are known. ERR_NO_MEMORY. */
status world_spheres_find(struct render_scene *w, const struct scene *scene, struct error *err)
    MUST_CHECK;

/* Give the accel the instance's sphere, if it is one; the bounds with the camera are known. */
void world_sphere_give(const struct render_scene *w, const struct world_instance *instance,
                       struct accel_instance *out);

#endif
