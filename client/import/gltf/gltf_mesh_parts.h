/* gltf_mesh_parts: shared by the readers of a primitive. */
#pragma once

#include "client/import/gltf/gltf.h"

/* gltf_deform.c: the targets of a primitive, of which there must be `wanted`. */
status gltf_targets_read(struct gltf *g, json_t *primitive, const struct gltf_place *at, size_t wanted,
                         struct mesh_source *mesh) MUST_CHECK;
/* Apply the targets with these weights to the mesh, and remove them. */
status gltf_targets_bake(struct gltf *g, const struct gltf_place *at, const float *weights,
                         struct mesh_source *mesh) MUST_CHECK;
/* The joints of each vertex; *joint_max is raised to the highest of them. */
status gltf_skin_read(struct gltf *g, json_t *attributes, const struct gltf_place *at, struct mesh_source *mesh,
                      uint32_t *joint_max) MUST_CHECK;

/* gltf_draco.c: give the accessors of a primitive what its Draco stream holds, if it has one. */
status gltf_draco_read(struct gltf *g, json_t *primitive, json_t *attributes, const struct gltf_place *at,
                       uint64_t mode) MUST_CHECK;
/* Take it from them again. */
void gltf_draco_release(struct gltf *g, json_t *primitive, json_t *attributes);
