/* regions: the scene's surfaces in parts, by the side that a surface faces and by place. What a pilot learned about light
 * is kept for each part: sky_guide.h, lamp_guide.h.
 *
 * A kd-tree for each side halves the pilot's points until a part has few. A part holds around its points; elsewhere the
 * pilot has not been, and nothing is known.
 */
#pragma once

#include <stdint.h>

#include "common/base/status.h"
#include "common/math/vec.h"

enum { REGION_SIDES = 6, REGION_LEAF = 3 };

/* Of the kd-tree over places: `axis` 0..2: places below `at` go to `child`, others to the node behind it. REGION_LEAF:
 * `child` is a region, or REGION_NOWHERE. */
#define REGION_NOWHERE UINT32_MAX
struct region_node {
    real at;
    uint32_t axis, child;
};

struct region_box {
    real low[3], high[3];
};

struct regions {
    uint32_t count;
    struct region_box *boxes;  /* [count] where each holds */
    struct region_node *nodes; /* first the root of each side */
};

/* The side that a surface faces: of the axis that its normal is nearest to. */
static inline uint32_t region_side(struct vec3 n)
{
    const real x = real_abs(n.x), y = real_abs(n.y), z = real_abs(n.z);

    return x >= y && x >= z ? n.x < 0 : y >= z ? 2 + (n.y < 0) : 4 + (n.z < 0);
}

/* The region of a surface at p that faces n (unit; black: any side, which is in none); REGION_NOWHERE. There are some. */
static inline uint32_t regions_find(const struct regions *regions, struct vec3 p, struct vec3 n)
{
    const real place[3] = {p.x, p.y, p.z};
    const struct region_node *node;

    if (vec3_is_black(n))
        return REGION_NOWHERE;
    node = regions->nodes + region_side(n);
    while (node->axis != REGION_LEAF)
        node = regions->nodes + node->child + (place[node->axis] >= node->at);
    if (node->child == REGION_NOWHERE)
        return REGION_NOWHERE;
    for (int axis = 0; axis < 3; axis++)
        if (place[axis] < regions->boxes[node->child].low[axis] || place[axis] > regions->boxes[node->child].high[axis])
            return REGION_NOWHERE;
    return node->child;
}

/* ---- making them -------------------------------------------------------------------------------- */

/* A point at which the pilot asked for light. */
struct pilot_point {
    struct vec3 p, n; /* world; unit geometric normal, on the side that is lit */
};

/* A region has at most so many points of the pilot; a district, of which regions are parts, at most so many. */
enum { REGION_POINTS = 24, DISTRICT_POINTS = 16 * REGION_POINTS };

/* A district or a region: these points of the order. */
struct stretch {
    uint32_t first, count;
    uint32_t district; /* of a region */
};

struct region_key {
    real at;
    uint32_t point;
};

struct region_growth {
    const struct pilot_point *points;
    uint32_t point_count;
    struct region_key *order; /* [point_count] the points, by region */
    struct stretch *districts, *regions;
    uint32_t district_count, region_count, node_count;
    struct region_node *nodes;
};

/* Divide the points, which must outlive *g. ERR_NO_MEMORY. */
status region_growth_init(struct region_growth *g, const struct pilot_point *points, uint32_t count,
                          struct error *err) MUST_CHECK;
/* The regions that are to be kept, in their order, which become *out: the k-th one is region k. `keep`: [region_count].
 * ERR_NO_MEMORY. */
status region_growth_finish(struct region_growth *g, const uint8_t *keep, struct regions *out, struct error *err) MUST_CHECK;
void region_growth_release(struct region_growth *g);
void regions_release(struct regions *regions);
