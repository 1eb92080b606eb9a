/* tree_build: the tree of lights, by the surface area orientation heuristic of Conty Estevez and Kulla 2018
 * (tree.h). */
#include "worker/render/light/tree.h"

#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"

enum {
    BUCKETS = 12,
    /* From this depth on sets are halved in their given order: 2^31 lights need at most 64 turns. */
    DEPTH_HALVE = 32,
    LEAF_MAX = 4,
    /* Above this many lights only the longest axis is tried and normals have no weight: that high
     * in the tree nearly every cone is full. */
    COARSE_COUNT = 4096,
};

/* Triangles of one flat light must cover this share of their bounding circle's area. */
#define LAMP_COVER_MIN 0.25f

/* ---- cones and boxes, when building ------------------------------------------------------ */

static int cone_is_full(const struct light_bounds *b) { return b->spread_rad >= REAL_PI; }

static void cone_fill(struct light_bounds *b)
{
    b->axis = vec3_make(0, 0, 1);
    b->spread_rad = REAL_PI;
}

static real angle_between(struct vec3 a, struct vec3 b)
{
    /* Kahan's formula: also accurate near 0 and pi, where the arc cosine is not. */
    return 2 * real_atan2(vec3_length(vec3_sub(a, b)), vec3_length(vec3_add(a, b)));
}

/* v turned about the unit axis k, perpendicular to it. */
static struct vec3 turned(struct vec3 v, struct vec3 k, real angle)
{
    real sine, cosine;

    real_sincos(angle, &sine, &cosine);
    return vec3_normalize(vec3_mad(vec3_scale(v, cosine), vec3_cross(k, v), sine));
}

/* Extend a's cone to contain b's: the smallest cone around both (Conty Estevez and Kulla 2018, algorithm 1). */
static void cone_grow(struct light_bounds *a, const struct light_bounds *b)
{
    struct vec3 axis_b = b->axis, across;
    real between, spread;

    if (cone_is_full(a))
        return;
    if (cone_is_full(b)) {
        cone_fill(a);
        return;
    }
    if (a->two_sided && b->two_sided && vec3_dot(a->axis, axis_b) < 0)
        axis_b = vec3_neg(axis_b);
    between = angle_between(a->axis, axis_b);
    if (between + b->spread_rad <= a->spread_rad)
        return;
    if (between + a->spread_rad <= b->spread_rad) {
        a->axis = axis_b;
        a->spread_rad = b->spread_rad;
        return;
    }
    spread = 0.5f * (a->spread_rad + between + b->spread_rad);
    across = vec3_normalize(vec3_cross(a->axis, axis_b));
    if (spread >= REAL_PI || vec3_is_black(across)) {
        cone_fill(a);
        return;
    }
    a->axis = turned(a->axis, across, spread - a->spread_rad);
    a->spread_rad = spread;
}

static struct vec3 vec3_lower(struct vec3 a, struct vec3 b)
{
    return vec3_make(real_min(a.x, b.x), real_min(a.y, b.y), real_min(a.z, b.z));
}

static struct vec3 vec3_upper(struct vec3 a, struct vec3 b)
{
    return vec3_make(real_max(a.x, b.x), real_max(a.y, b.y), real_max(a.z, b.z));
}

/* `cones`: also bound the normals; otherwise only what the coarse splits need. */
static void bounds_grow(struct light_bounds *a, const struct light_bounds *b, int cones)
{
    if (!(a->intensity > 0)) {
        *a = *b;
        return;
    }
    a->min = vec3_lower(a->min, b->min);
    a->max = vec3_upper(a->max, b->max);
    a->intensity += b->intensity;
    if (!cones)
        return;
    cone_grow(a, b);
    a->emission_rad = real_max(a->emission_rad, b->emission_rad);
    a->reach = real_max(a->reach, b->reach);
    a->two_sided |= b->two_sided;
    a->area += b->area;
}

static real component(struct vec3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

static real centre_on(const struct light_bounds *b, int axis)
{
    return 0.5f * component(b->min, axis) + 0.5f * component(b->max, axis);
}

/* Half the box's surface area; `least` keeps that of flat and straight sets above 0. */
static real box_measure(const struct light_bounds *b, real least)
{
    struct vec3 d = vec3_add(vec3_sub(b->max, b->min), vec3_splat(least));

    return d.x * d.y + d.y * d.z + d.z * d.x;
}

/* Solid angle of the directions in which light may leave, weighted by the cosine beyond the
 * normals' cone (Conty Estevez and Kulla 2018, equation 1). */
static real cone_measure(const struct light_bounds *b)
{
    real o = b->spread_rad, w = real_min(o + b->emission_rad, REAL_PI);

    return 2 * REAL_PI * (1 - real_cos(o)) +
           REAL_PI / 2 * (2 * w * real_sin(o) - real_cos(o - 2 * w) - 2 * o * real_sin(o) + real_cos(o));
}

/* ---- building ---------------------------------------------------------------------------- */

struct builder {
    struct light_tree *tree;
    const struct light_bounds *bounds;
    real intensity_scale;
};

struct split {
    int axis;
    real low, scale; /* bucket = (centre - low) * scale */
    int last_left;   /* the last bucket of the left side */
};

static int bucket_of(real centre, real low, real scale)
{
    int bucket = (int)((centre - low) * scale);

    return bucket < 0 ? 0 : bucket >= BUCKETS ? BUCKETS - 1 : bucket;
}

static real side_cost(const struct light_bounds *b, real least, int cones)
{
    return b->intensity > 0 ? b->intensity * box_measure(b, least) * (cones ? cone_measure(b) : 1) : 0;
}

/* The cheapest split of the set on one axis; its cost, or infinity. */
static real try_axis(const struct builder *b, const uint32_t *items, uint32_t count, int axis, struct vec3 low,
                     struct vec3 high, int cones, struct split *out)
{
    struct light_bounds buckets[BUCKETS] = {0}, side = {0};
    struct vec3 size = vec3_sub(high, low);
    real longest = vec3_max(size), extent = component(size, axis), best = INFINITY;
    real from_left[BUCKETS], scale = (real)BUCKETS / extent;

    if (!(extent > 0) || !isfinite(scale))
        return INFINITY;
    for (uint32_t i = 0; i < count; i++) {
        const struct light_bounds *item = &b->bounds[items[i]];
        int k = bucket_of(centre_on(item, axis), component(low, axis), scale);

        bounds_grow(&buckets[k], item, cones);
    }
    for (int k = 0; k < BUCKETS; k++) {
        if (buckets[k].intensity > 0)
            bounds_grow(&side, &buckets[k], cones);
        from_left[k] = side_cost(&side, REAL(1e-3) * longest, cones);
    }
    memset(&side, 0, sizeof side);
    for (int k = BUCKETS - 1; k > 0; k--) {
        real cost;

        if (buckets[k].intensity > 0)
            bounds_grow(&side, &buckets[k], cones);
        cost = (from_left[k - 1] + side_cost(&side, REAL(1e-3) * longest, cones)) * (longest / extent);
        if (from_left[k - 1] > 0 && side.intensity > 0 && cost < best) {
            best = cost;
            *out = (struct split){axis, component(low, axis), scale, k - 1};
        }
    }
    return best;
}

/* Move the left side's lights to the front; returns how many there are. */
static uint32_t partition(const struct builder *b, uint32_t *items, uint32_t count, const struct split *split)
{
    uint32_t left = 0;

    for (uint32_t i = 0; i < count; i++) {
        real centre = centre_on(&b->bounds[items[i]], split->axis);

        if (bucket_of(centre, split->low, split->scale) <= split->last_left) {
            uint32_t item = items[i];
            items[i] = items[left];
            items[left++] = item;
        }
    }
    return left;
}

static uint32_t split_items(const struct builder *b, uint32_t *items, uint32_t count, uint32_t depth)
{
    struct vec3 low = vec3_splat(INFINITY), high = vec3_splat(-INFINITY), size;
    real best = INFINITY;
    struct split split = {0};
    uint32_t left = 0;
    int cones = count <= COARSE_COUNT;

    if (depth >= DEPTH_HALVE || count == 2)
        return count / 2;
    for (uint32_t i = 0; i < count; i++) {
        const struct light_bounds *item = &b->bounds[items[i]];
        struct vec3 centre = vec3_make(centre_on(item, 0), centre_on(item, 1), centre_on(item, 2));

        low = vec3_lower(low, centre);
        high = vec3_upper(high, centre);
    }
    size = vec3_sub(high, low);
    for (int axis = 0; axis < 3; axis++) {
        struct split found = {0};
        real cost;

        if (!cones && component(size, axis) < vec3_max(size))
            continue;
        cost = try_axis(b, items, count, axis, low, high, cones, &found);
        if (cost < best) {
            best = cost;
            split = found;
        }
    }
    if (best < INFINITY)
        left = partition(b, items, count, &split);
    return left > 0 && left < count ? left : count / 2;
}

/* Do the lights form one flat light? */
static int is_one_lamp(const struct builder *b, const uint32_t *items, uint32_t count)
{
    struct light_bounds all = b->bounds[items[0]];
    struct vec3 size;

    if (count > LEAF_MAX || !(all.area > 0))
        return 0;
    for (uint32_t i = 1; i < count; i++) {
        const struct light_bounds *item = &b->bounds[items[i]];

        if (item->lamp != all.lamp || !(item->area > 0) || item->two_sided != all.two_sided)
            return 0;
        bounds_grow(&all, item, 1);
    }
    size = vec3_sub(all.max, all.min);
    return all.spread_rad < REAL(1e-3) && all.area >= LAMP_COVER_MIN * REAL_PI / 4 * vec3_length_squared(size);
}

static void node_set(struct light_node *node, const struct light_bounds *b, real intensity_scale)
{
    real radius = 0.5f * vec3_length(vec3_sub(b->max, b->min)) * (1 + 0x1p-18f);

    node->centre = vec3_lerp(b->min, b->max, 0.5f);
    node->radius_squared = radius * radius;
    node->axis = b->axis;
    if (cone_is_full(b)) {
        node->cos_spread = -1;
        node->sin_spread = 0;
    } else {
        real_sincos(b->spread_rad, &node->sin_spread, &node->cos_spread);
    }
    node->cos_emission = real_cos(b->emission_rad);
    node->reach_squared = (b->reach + radius) * (b->reach + radius) * (1 + 0x1p-18f);
    node->intensity = b->intensity * intensity_scale;
    node->two_sided = b->two_sided != 0;
}

static struct light_bounds leaf_set(const struct builder *b, struct light_node *node, uint32_t first, uint32_t count,
                                    uint64_t trail)
{
    const uint32_t *items = b->tree->order + first;
    struct light_bounds all = {0};
    real start = 0;

    for (uint32_t i = 0; i < count; i++)
        bounds_grow(&all, &b->bounds[items[i]], 1);
    for (uint32_t i = 0; i < count; i++) {
        real share = i + 1 < count ? b->bounds[items[i]].intensity / all.intensity : 1 - start;

        b->tree->trail[items[i]] = trail;
        b->tree->share_start[items[i]] = start;
        b->tree->share[items[i]] = share > 0 ? share : 0;
        start += share;
    }
    node->first = first;
    node->leaf_count = (uint16_t)count;
    node_set(node, &all, b->intensity_scale);
    return all;
}

/* Depth is bounded: see DEPTH_HALVE. */
static struct light_bounds build(struct builder *b, uint32_t at, uint32_t first, uint32_t count, uint32_t depth,
                                 uint64_t trail)
{
    struct light_tree *tree = b->tree;
    struct light_bounds all, right;
    uint32_t left, children;

    if (count == 1 || is_one_lamp(b, tree->order + first, count))
        return leaf_set(b, &tree->nodes[at], first, count, trail);
    left = split_items(b, tree->order + first, count, depth);
    children = tree->node_count;
    tree->node_count += 2;
    all = build(b, children, first, left, depth + 1, trail);
    right = build(b, children + 1, first + left, count - left, depth + 1, trail | (uint64_t)1 << depth);
    bounds_grow(&all, &right, 1);
    tree->nodes[at].first = children;
    tree->nodes[at].leaf_count = 0;
    node_set(&tree->nodes[at], &all, b->intensity_scale);
    return all;
}

status light_tree_init(struct light_tree *tree, const struct light_bounds *bounds, uint32_t count, struct error *err)
{
    struct builder b = {tree, bounds, 0};
    double total = 0;
    uint32_t lit = 0;

    memset(tree, 0, sizeof *tree);
    for (uint32_t i = 0; i < count; i++)
        if (bounds[i].intensity > 0) {
            lit++;
            total += (double)bounds[i].intensity;
        }
    if (lit == 0)
        return STATUS_OK;
    tree->item_count = count;
    tree->nodes = mem_calloc(2 * (size_t)lit, sizeof *tree->nodes);
    tree->order = mem_alloc_array(lit, sizeof *tree->order);
    tree->trail = mem_calloc(count, sizeof *tree->trail);
    tree->share_start = mem_calloc(count, sizeof *tree->share_start);
    tree->share = mem_calloc(count, sizeof *tree->share);
    if (!tree->nodes || !tree->order || !tree->trail || !tree->share_start || !tree->share) {
        light_tree_release(tree);
        return error_no_memory(err, "the tree of lights");
    }
    for (uint32_t i = 0, at = 0; i < count; i++)
        if (bounds[i].intensity > 0)
            tree->order[at++] = i;
    b.intensity_scale = (real)(1 / total);
    tree->node_count = 1;
    (void)build(&b, 0, 0, lit, 0, 0);
    return STATUS_OK;
}

void light_tree_release(struct light_tree *tree)
{
    mem_free(tree->nodes);
    mem_free(tree->order);
    mem_free(tree->trail);
    mem_free(tree->share_start);
    mem_free(tree->share);
    memset(tree, 0, sizeof *tree);
}
