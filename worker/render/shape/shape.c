#include "worker/render/shape/shape.h"

#define ROW_MESH(prefix)
#define ROW_WHOLE(prefix)                                                               \
    .bounds = prefix##_bounds, .crossings = prefix##_crossings, .same = prefix##_same,  \
    .near_triangle = prefix##_near_triangle, .near_same = prefix##_near_same,           \
    .place = prefix##_place, .cover = prefix##_cover, .fits = prefix##_fits,            \
    .create = prefix##_new,
#define ROW(KIND, prefix, STANDS_IN, FACES)                          \
    [SHAPE_##KIND] = {.stands_in = STANDS_IN, .end = prefix##_end,   \
                      .plane = prefix##_plane, .corners = prefix##_corners, ROW_##FACES(prefix)},

const struct shape_row shape_rows[SHAPE_KIND_COUNT] = {SHAPE_KINDS(ROW)};
