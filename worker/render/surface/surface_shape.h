/* surface_shape: a hit on a shape (shape/shape.h) made into a place that can be shaded. The mesh that
 * stands in for it has the texture coordinates and tangents, and the differentials by which textures
 * are filtered: those of its triangle that covers the place. */
#pragma once

#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* surface_from_hit for an instance that has a shape. */
void surface_on_shape(const struct render_scene *scene, const struct ray *ray, const struct hit *hit,
                      struct surface *s);

/* The mesh's triangle at the place. Of a shape, sets the mesh's vertices, weights and area for the
 * place as well; a triangle has them already. */
uint32_t surface_locate(const struct render_scene *scene, struct surface *s);
