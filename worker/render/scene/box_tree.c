#include "worker/render/scene/box_tree.h"

#include <math.h>

#include "common/base/memory.h"
#include "worker/render/base/sampler.h"

enum { LEAF_BOXES = 4 };

struct node {
    struct render_box box; /* around its boxes */
    int asks;              /* one of its boxes asks */
};

struct box_tree {
    const struct render_box *boxes;
    const uint8_t *asks;
    uint32_t *order;        /* [count] boxes, those of one leaf side by side */
    struct node *nodes;     /* the root is 1, the halves of k are 2k and 2k + 1 */
    uint32_t count, leaves; /* `leaves` is a power of two; leaf i is node leaves + i */
    box_tree_visit *visit;
    void *user;
};

static const struct render_box nothing = {{INFINITY, INFINITY, INFINITY},
                                         {-INFINITY, -INFINITY, -INFINITY}};

static void enclose(struct render_box *box, const struct render_box *other)
{
    for (int a = 0; a < 3; a++) {
        box->low[a] = real_min(box->low[a], other->low[a]);
        box->high[a] = real_max(box->high[a], other->high[a]);
    }
}

static int overlap(const struct render_box *a, const struct render_box *b)
{
    return a->low[0] <= b->high[0] && b->low[0] <= a->high[0] && a->low[1] <= b->high[1] && b->low[1] <= a->high[1] &&
           a->low[2] <= b->high[2] && b->low[2] <= a->high[2];
}

/* Twice the middle. */
static real middle(const struct render_box *box, int axis) { return box->low[axis] + box->high[axis]; }

/* The axis along which the middles are farthest apart. */
static int widest_axis(const struct box_tree *tree, uint32_t begin, uint32_t end)
{
    struct render_box middles = nothing;
    int widest = 0;

    for (uint32_t i = begin; i < end; i++) {
        const struct render_box *box = &tree->boxes[tree->order[i]];
        for (int a = 0; a < 3; a++) {
            middles.low[a] = real_min(middles.low[a], middle(box, a));
            middles.high[a] = real_max(middles.high[a], middle(box, a));
        }
    }
    for (int a = 1; a < 3; a++)
        if (middles.high[a] - middles.low[a] > middles.high[widest] - middles.low[widest])
            widest = a;
    return widest;
}

static void swap(uint32_t *a, uint32_t *b)
{
    uint32_t kept = *a;

    *a = *b;
    *b = kept;
}

/* Quickselect (Hoare 1961, "Algorithm 65: Find"): afterwards no middle before `nth` is larger than one from there on. A
 * hash chooses the pivot, so no arrangement of a mesh makes it bad each time. */
static void halve(const struct box_tree *tree, int axis, int64_t begin, int64_t nth, int64_t end)
{
    uint32_t *order = tree->order;

    while (end - begin > 1) {
        uint64_t any = hash_u64((uint64_t)(begin ^ end << 32)) % (uint64_t)(end - begin);
        real pivot = middle(&tree->boxes[order[begin + (int64_t)any]], axis);
        int64_t low = begin, high = end - 1;

        while (low <= high) {
            while (middle(&tree->boxes[order[low]], axis) < pivot)
                low++;
            while (middle(&tree->boxes[order[high]], axis) > pivot)
                high--;
            if (low <= high)
                swap(&order[low++], &order[high--]);
        }
        if (nth > high && nth < low)
            return; /* it is the pivot */
        if (nth >= low)
            begin = low;
        else
            end = high + 1;
    }
}

static uint32_t split(uint32_t begin, uint32_t end) { return begin + (end - begin) / 2; }

static void build(struct box_tree *tree, uint32_t node, uint32_t begin, uint32_t end)
{
    struct node *out = &tree->nodes[node];

    *out = (struct node){nothing, 0};
    if (node >= tree->leaves) {
        for (uint32_t i = begin; i < end; i++) {
            enclose(&out->box, &tree->boxes[tree->order[i]]);
            out->asks |= tree->asks[tree->order[i]];
        }
        return;
    }
    halve(tree, widest_axis(tree, begin, end), begin, split(begin, end), end);
    build(tree, 2 * node, begin, split(begin, end));
    build(tree, 2 * node + 1, split(begin, end), end);
    for (uint32_t half = 2 * node; half <= 2 * node + 1; half++) {
        enclose(&out->box, &tree->nodes[half].box);
        out->asks |= tree->nodes[half].asks;
    }
}

struct leaf {
    const struct node *node;
    uint32_t begin, end; /* in `order` */
};

/* Pairs of the leaf with itself or with a later leaf. */
static int visit_leaves(const struct box_tree *tree, const struct leaf *leaf, uint32_t begin, uint32_t end)
{
    for (uint32_t i = leaf->begin; i < leaf->end; i++) {
        uint32_t a = tree->order[i];
        for (uint32_t k = begin > i ? begin : i + 1; k < end; k++) {
            uint32_t b = tree->order[k];
            if ((tree->asks[a] | tree->asks[b]) && overlap(&tree->boxes[a], &tree->boxes[b]) &&
                tree->visit(tree->user, a, b))
                return 1;
        }
    }
    return 0;
}

/* Pairs of the leaf with all nodes below, except those before it. */
static int visit_below(const struct box_tree *tree, const struct leaf *leaf, uint32_t node, uint32_t begin,
                       uint32_t end)
{
    const struct node *other = &tree->nodes[node];

    if (end <= leaf->begin || !(leaf->node->asks | other->asks) || !overlap(&leaf->node->box, &other->box))
        return 0;
    if (node >= tree->leaves)
        return visit_leaves(tree, leaf, begin, end);
    return visit_below(tree, leaf, 2 * node, begin, split(begin, end)) ||
           visit_below(tree, leaf, 2 * node + 1, split(begin, end), end);
}

static int visit_all(const struct box_tree *tree, uint32_t node, uint32_t begin, uint32_t end)
{
    const struct leaf leaf = {&tree->nodes[node], begin, end};

    if (node >= tree->leaves)
        return visit_below(tree, &leaf, 1, 0, tree->count);
    return visit_all(tree, 2 * node, begin, split(begin, end)) || visit_all(tree, 2 * node + 1, split(begin, end), end);
}

status box_tree_pairs(const struct render_box *boxes, const uint8_t *asks, uint32_t count, box_tree_visit *visit,
                      void *user, struct error *err)
{
    struct box_tree tree = {.boxes = boxes, .asks = asks, .count = count, .leaves = 1,
                            .visit = visit, .user = user};
    status s = STATUS_OK;

    while ((uint64_t)tree.leaves * LEAF_BOXES < count)
        tree.leaves *= 2;
    tree.order = mem_alloc_array(count, sizeof *tree.order);
    tree.nodes = mem_alloc_array(2 * (size_t)tree.leaves, sizeof *tree.nodes);
    if (tree.order && tree.nodes) {
        for (uint32_t i = 0; i < count; i++)
            tree.order[i] = i;
        build(&tree, 1, 0, count);
        (void)visit_all(&tree, 1, 0, count);
    } else {
        s = error_no_memory(err, "a tree of boxes");
    }
    mem_free(tree.order);
    mem_free(tree.nodes);
    return s;
}
