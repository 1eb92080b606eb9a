/* scene_sample: a scene with every table filled and every field off its default, without
 * blobs, for tests of the description itself. */
#pragma once

#include "common/scene/scene.h"

/* Two meshes, two images, two textures, three materials, three instances, five lights, two
 * cameras, an environment map with two portals, three nodes, five channels, a skin, two media
 * (one with a grid), fog. Instance 2 is skinned, instance 1 stands on a node that has a matrix,
 * 0 on none. Aborts when out of memory. */
void scene_sample(struct scene *out);

/* The blob size that the mesh's counts call for; a digest that depends on `seed`. */
void scene_sample_blob(struct scene_mesh *mesh, uint8_t seed);
