/* world_sphere: instances whose meshes stand in for spheres (MESH_SPHERE), as true spheres.
 *
 * What stands still, is scaled alike along all axes, has no alpha and shines evenly is intersected
 * and sampled as a sphere. The mesh remains for texture coordinates and tangents: they are those of
 * its triangle in the direction of the place. All else is the mesh that it is.
 */
#ifndef AZULEJO_RENDER_WORLD_SPHERE_H
#define AZULEJO_RENDER_WORLD_SPHERE_H

#include "worker/render/accel/accel.h"
#include "worker/render/surface/surface.h"
#include "worker/render/world.h"

struct world_sphere {
    struct accel_sphere shape;
    int inward;     /* the front is the inner side */
    int located;    /* what is shaded depends on the place: find its triangle at every hit */
};

/* Which instances are spheres; the materials and instances are known. ERR_NO_MEMORY. */
status world_spheres_find(struct render_scene *w, const struct scene *scene, struct error *err)
    MUST_CHECK;

/* Give the accel the instance's sphere, if it is one; the bounds with the camera are known. */
void world_sphere_give(const struct render_scene *w, const struct world_instance *instance,
                       struct accel_instance *out);

/* surface_from_hit for a sphere. */
void surface_on_sphere(const struct render_scene *scene, const struct ray *ray,
                       const struct hit *hit, struct surface *s);

/* Sets the mesh's vertices, weights and area for the place; returns the mesh's triangle. */
uint32_t surface_locate(const struct render_scene *scene, struct surface *s);

#endif
