/* tree: a bounding volume hierarchy over lights, to choose one by what it can contribute at a point.
 *
 * Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting": every node bounds
 * its lights' positions, the directions of their normals and the angle around a normal within which they emit. On the
 * way down, a child is taken with odds in proportion to its importance: intensity, over the squared distance, times
 * bounds on both cosines. A child's importance is 0 only if none of its lights can contribute.
 *
 * A leaf holds one light, or a few triangles that form one flat light. Those are chosen by power, so that the
 * stratification of the numbers extends across the whole light.
 * Invariants: the tree is a pure function of the bounds in their order; light_tree_choose and light_tree_odds compute a
 * light's odds by the same operations in the same order.
 */
#pragma once

#include <stdint.h>

#include "common/base/safeguard.h"
#include "common/base/status.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

/* The bounds of what a light can contribute. */
struct light_bounds {
    struct vec3 min, max; /* its positions, over the whole shutter */
    struct vec3 axis;     /* unit; its normals lie within spread_rad of it */
    real spread_rad;      /* 0..pi; pi: any normal */
    real emission_rad;    /* it emits within this angle of a normal, 0..pi/2 */
    real reach;           /* metres beyond which it contributes nothing; INFINITY: none */
    real intensity;       /* W/sr in its main direction; 0: never chosen */
    real area;            /* m^2, of a flat light; 0: it has no surface */
    uint32_t lamp;        /* triangles of one flat light share a number */
    int two_sided;
};

static inline void light_bounds_add(struct light_bounds *b, struct vec3 p)
{
    b->min = vec3_make(real_min(b->min.x, p.x), real_min(b->min.y, p.y), real_min(b->min.z, p.z));
    b->max = vec3_make(real_max(b->max.x, p.x), real_max(b->max.y, p.y), real_max(b->max.z, p.z));
}

/* The rest of a number in [0, 1) that fell into the part which begins at `start` and is `size`
 * long: as good as a new one. */
static inline real light_rescaled(real number, real start, real size)
{
    real rescaled = real_max((number - start) / size, 0);

    return SAFEGUARD(LIGHT_RESCALED) ? real_min(rescaled, REAL_BELOW_ONE) : rescaled;
}

struct light_node {
    struct vec3 centre; /* of the bounding sphere */
    real radius_squared;
    struct vec3 axis;
    real cos_spread, sin_spread, cos_emission;
    real reach_squared;  /* from the centre */
    real intensity;      /* relative to the whole tree's */
    uint32_t first;      /* the left child, the right one follows it; in a leaf: into `order` */
    uint16_t leaf_count; /* 0: not a leaf */
    uint8_t two_sided;
    uint8_t known; /* its number in a guide (lamp_guide.h), from 1 on; 0: it has none, nor has its sibling */
};

struct light_tree {
    struct light_node *nodes; /* the root is the first */
    uint32_t node_count, item_count;
    uint32_t *order;   /* the lights in the order of the leaves */
    uint64_t *trail;   /* [item_count] the way to its leaf: bit k is the turn at depth k */
    real *share_start; /* [item_count] where its share of its leaf begins, and */
    real *share;       /* how large it is; 0: not in any leaf */
};

/* If no light has positive intensity, node_count is 0. */
status light_tree_init(struct light_tree *tree, const struct light_bounds *bounds, uint32_t count,
                       struct error *err) MUST_CHECK;
void light_tree_release(struct light_tree *tree);

/* Choose a light for point p with unit normal n (black: all sides). u and v, each in [0, 1), are
 * used in turns and returned rescaled. `seen`: factors, above 0, of the importance of the nodes that are known, by
 * their numbers less 1; NULL: 1. 0: no light reaches p. */
int light_tree_choose(const struct light_tree *tree, const float32 *seen, struct vec3 p, struct vec3 n, real *u,
                      real *v, uint32_t *item, real *odds);
/* The odds with which light_tree_choose chooses that light. */
real light_tree_odds(const struct light_tree *tree, const float32 *seen, struct vec3 p, struct vec3 n, uint32_t item);
