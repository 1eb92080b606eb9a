/* draco: one mesh of KHR_draco_mesh_compression, decoded by libdraco, which is C++ and stays behind this interface. */
#pragma once

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct draco_mesh;

/* Decode a stream. It must hold exactly `triangles` triangles and `points` points: what its head says of them is looked at
 * before memory is taken. Returns NULL, or what is wrong, in words that follow the place. The caller owns *out, which is
 * NULL in that case. */
const char *draco_mesh_open(const uint8_t *stream, size_t size_bytes, size_t points, size_t triangles,
                            struct draco_mesh **out);
void draco_mesh_free(struct draco_mesh *mesh);

/* out[3 * triangles]. */
void draco_mesh_indices(const struct draco_mesh *mesh, uint32_t *out);

enum draco_type { DRACO_INT8, DRACO_UINT8, DRACO_INT16, DRACO_UINT16, DRACO_UINT32, DRACO_FLOAT };

/* The attribute of the stream's number `id`, out[points][components] of `type`. Returns NULL, or what is wrong. */
const char *draco_mesh_attribute(const struct draco_mesh *mesh, uint32_t id, int components, enum draco_type type,
                                 void *out);

#ifdef __cplusplus
}
#endif
