/* surface_sphere: a hit on a true sphere made into a place that can be shaded. The mesh that stands in
 * for it (MESH_SPHERE) has the texture coordinates and tangents: those of its triangle in the
 * direction of the place. scene/world_sphere.h tells which instances are spheres. */
#ifndef AZULEJO_RENDER_SURFACE_SPHERE_H
#define AZULEJO_RENDER_SURFACE_SPHERE_H

#include "worker/render/accel/accel.h"
#include "worker/render/surface/surface.h"
#include "worker/render/world.h"

struct world_sphere {
    struct accel_sphere shape;
    int inward;     /* the front is the inner side */
    int located;    /* what is shaded depends on the place: find its triangle at every hit */
};

/* Rows of the grid that shape_sphere makes: twice as many columns, from the pole at -z on, two
 * triangles a cell but one at the poles. 0: that is not the count of one. */
uint32_t surface_sphere_rows(uint32_t triangles);
/* The triangle that covers the direction from the centre, and the weights there. */
uint32_t surface_sphere_triangle(const struct world_mesh *mesh, const double p[3],
                                 double weight[3]);

/* surface_from_hit for a sphere. */
void surface_on_sphere(const struct render_scene *scene, const struct ray *ray,
                       const struct hit *hit, struct surface *s);

/* Sets the mesh's vertices, weights and area for the place; returns the mesh's triangle. */
uint32_t surface_locate(const struct render_scene *scene, struct surface *s);

#endif
