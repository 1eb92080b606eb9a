/* polygon: faces of any size become triangles. PLY and OBJ share it.
 *
 * A face's corners are numbers into a table of positions. Convex faces become fans, concave ones
 * are cut ear by ear (Meisters 1975; Eberly, "Triangulation by Ear Clipping", 2015) in the plane of
 * their Newell normal. A face that crosses itself, or bends so much that no ear is left, becomes a
 * fan: its outline is kept, but its triangles may overlap.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum {
    POLYGON_CORNERS_MAX = 1 << 20,      /* of one face */
    POLYGON_CLIP_CORNERS_MAX = 1 << 10, /* larger concave faces become fans: clipping takes at least
                                           quadratic time */
};

/* Scratch memory that grows with the largest face; zero-initialise. */
struct polygon_scratch {
    double *flat; /* [2] corners in the plane */
    uint32_t *next, *previous;
    size_t flat_capacity, next_capacity, previous_capacity;
    size_t fans; /* faces so far without ears, or too large for clipping */
};

void polygon_scratch_release(struct polygon_scratch *scratch);

/* Cut the face corners[0..count) into count - 2 triangles; `out` takes 3 (count - 2) numbers
 * 0..count-1 of corners, wound as the face is. 3 <= count <= POLYGON_CORNERS_MAX;
 * `positions` are float[3] each, finite. The same face gives the same triangles. */
void polygon_triangulate(struct polygon_scratch *scratch, const float *positions, const uint32_t *corners, size_t count,
                         uint32_t *out);
