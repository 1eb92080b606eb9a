#include "worker/render/light/learned/regions.h"

#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"

/* A region reaches so far beyond its points, of their extent. */
#define BOX_MARGIN 0.25f

static real place(const struct region_growth *g, uint32_t point, uint32_t axis)
{
    const struct vec3 p = g->points[point].p;

    return axis == 0 ? p.x : axis == 1 ? p.y : p.z;
}

/* By place; no two points are alike. */
static int compare_keys(const void *a_, const void *b_)
{
    const struct region_key *a = a_, *b = b_;

    return a->at != b->at ? (a->at > b->at) - (a->at < b->at) : (a->point > b->point) - (a->point < b->point);
}

static void find_extent(const struct region_growth *g, const struct stretch *in, struct region_box *out)
{
    for (uint32_t axis = 0; axis < 3; axis++) {
        real low = INFINITY, high = -INFINITY;

        for (uint32_t i = in->first; i < in->first + in->count; i++) {
            low = real_min(low, place(g, g->order[i].point, axis));
            high = real_max(high, place(g, g->order[i].point, axis));
        }
        out->low[axis] = low;
        out->high[axis] = high;
    }
}

/* Half of the points to each child, down to regions. `district`: the one around, UINT32_MAX: not yet. */
static void grow(struct region_growth *g, uint32_t node, uint32_t first, uint32_t count, uint32_t district)
{
    const uint32_t half = count / 2, children = g->node_count;
    struct region_box box;
    uint32_t axis = 0;
    real extent;

    g->nodes[node].axis = REGION_LEAF;
    g->nodes[node].child = REGION_NOWHERE;
    if (count == 0)
        return;
    find_extent(g, &(struct stretch){first, count, 0}, &box);
    for (uint32_t i = 1; i < 3; i++)
        if (box.high[i] - box.low[i] > box.high[axis] - box.low[axis])
            axis = i;
    extent = box.high[axis] - box.low[axis];
    if (district == UINT32_MAX && (count <= DISTRICT_POINTS || !(extent > 0))) {
        district = g->district_count++;
        g->districts[district] = (struct stretch){first, count, district};
    }
    if (count <= REGION_POINTS || !(extent > 0)) {
        g->nodes[node].child = g->region_count;
        g->regions[g->region_count++] = (struct stretch){first, count, district};
        return;
    }
    for (uint32_t i = first; i < first + count; i++)
        g->order[i].at = place(g, g->order[i].point, axis);
    qsort(g->order + first, count, sizeof *g->order, compare_keys);
    g->nodes[node].axis = axis;
    g->nodes[node].at = g->order[first + half].at;
    g->nodes[node].child = children;
    g->node_count += 2;
    grow(g, children, first, half, district);
    grow(g, children + 1, first + half, count - half, district);
}

status region_growth_init(struct region_growth *g, const struct pilot_point *points, uint32_t count, struct error *err)
{
    uint32_t first = 0;

    memset(g, 0, sizeof *g);
    g->points = points;
    g->point_count = count;
    g->order = mem_alloc_array((size_t)count + 1, sizeof *g->order);
    g->regions = mem_alloc_array((size_t)count + 1, sizeof *g->regions);
    g->districts = mem_alloc_array((size_t)count + 1, sizeof *g->districts);
    g->nodes = mem_calloc(2 * (size_t)count + REGION_SIDES, sizeof *g->nodes);
    if (!g->order || !g->regions || !g->districts || !g->nodes)
        return error_no_memory(err, "the parts of the scene");
    g->node_count = REGION_SIDES;
    for (uint32_t side = 0; side < REGION_SIDES; side++) {
        uint32_t in = 0;

        for (uint32_t i = 0; i < count; i++)
            if (region_side(points[i].n) == side)
                g->order[first + in++].point = i;
        grow(g, side, first, in, UINT32_MAX);
        first += in;
    }
    return STATUS_OK;
}

void region_growth_release(struct region_growth *g)
{
    mem_free(g->order);
    mem_free(g->regions);
    mem_free(g->districts);
    mem_free(g->nodes);
    memset(g, 0, sizeof *g);
}

/* ---- those that are kept ------------------------------------------------------------------------ */

/* Give the leaves below the node their regions' new numbers, and take out nodes that tell nothing apart. */
static void prune(struct region_node *nodes, uint32_t node, const uint32_t *numbers)
{
    struct region_node *n = &nodes[node], *child = nodes + n->child;

    if (n->axis == REGION_LEAF) {
        n->child = n->child == REGION_NOWHERE ? REGION_NOWHERE : numbers[n->child];
        return;
    }
    prune(nodes, n->child, numbers);
    prune(nodes, n->child + 1, numbers);
    if (child[0].axis == REGION_LEAF && child[0].child == REGION_NOWHERE && child[1].axis == REGION_LEAF &&
        child[1].child == REGION_NOWHERE)
        *n = (struct region_node){0, REGION_LEAF, REGION_NOWHERE};
}

status region_growth_finish(struct region_growth *g, const uint8_t *keep, struct regions *out, struct error *err)
{
    uint32_t *numbers = mem_alloc_array((size_t)g->region_count + 1, sizeof *numbers);

    memset(out, 0, sizeof *out);
    out->boxes = mem_alloc_array((size_t)g->region_count + 1, sizeof *out->boxes);
    if (!numbers || !out->boxes) {
        mem_free(numbers);
        regions_release(out);
        return error_no_memory(err, "the parts of the scene");
    }
    for (uint32_t i = 0; i < g->region_count; i++) {
        struct region_box *box = &out->boxes[out->count];

        numbers[i] = REGION_NOWHERE;
        if (!keep[i])
            continue;
        find_extent(g, &g->regions[i], box);
        for (int axis = 0; axis < 3; axis++) {
            const real margin = BOX_MARGIN * (box->high[axis] - box->low[axis]);

            box->low[axis] -= margin;
            box->high[axis] += margin;
        }
        numbers[i] = out->count++;
    }
    out->nodes = g->nodes;
    g->nodes = NULL;
    for (uint32_t side = 0; side < REGION_SIDES; side++)
        prune(out->nodes, side, numbers);
    mem_free(numbers);
    return STATUS_OK;
}

void regions_release(struct regions *regions)
{
    mem_free(regions->boxes);
    mem_free(regions->nodes);
    memset(regions, 0, sizeof *regions);
}
