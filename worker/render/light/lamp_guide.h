/* lamp_guide: which lamps' light arrives where.
 *
 * The tree of lights (tree.h) knows how bright and how near a lamp is, and not what stands between. In a house most of
 * what it chooses may be behind walls, or inside a shade. The guide divides the scene into regions (learned/regions.h) and has
 * for each of them, for the uppermost nodes of the tree, what of their light arrives there: the importance of a node is
 * multiplied by that. What a pilot did not see keeps a tenth of its importance, and the tree's bounds on the odds of a pair
 * hold as ever, so whatever the guide believes, pictures stay unbiased.
 *
 * A region in which that would not lower the variance of the direct light clearly has no such figures. So open scenes have
 * no guide, and cost nothing.
 *
 * It depends on what sky_guide.h says of the sky's. After learned light choice (Vevoda et al. 2018).
 */
#pragma once

#include "worker/render/light/light.h"
#include "worker/render/light/learned/moments.h"
#include "worker/render/light/learned/regions.h"
#include "worker/render/light/tree.h"

struct lamp_guide {
    struct regions at;    /* none: there is no guide */
    uint32_t known_count; /* nodes of the tree that it knows: light_node.known is 1 to this */
    float32 *seen;        /* [at.count][known_count] factors of their importance, above 0, at most 1 */
};

/* A light that was chosen at a point, by the tree alone. */
struct lamp_trial {
    struct light_trial trial; /* `light`: if all of it arrived */
    uint32_t item;            /* of the tree */
    real odds;                /* of the item among all */
    real arrives;             /* 0..1 */
};

struct lamp_pilot {
    const struct pilot_point *points;
    uint32_t count;
    /* Choose a light at the point by u and v, and try what of it arrives. 0: none. Called by several threads. */
    int (*choose)(void *user, uint32_t point, real u, real v, struct lamp_trial *out);
    void *user;
    unsigned threads;
};

/* Notes in the tree which nodes are known. ERR_NO_MEMORY. */
status lamp_guide_init(struct lamp_guide *g, struct light_tree *tree, const struct lamp_pilot *pilot,
                       struct error *err) MUST_CHECK;
void lamp_guide_release(struct lamp_guide *g);

/* What arrives at the context, for light_tree_choose; NULL: it is not known. */
static inline const float32 *lamp_guide_seen(const struct lamp_guide *g, const struct light_context *context)
{
    const uint32_t region = g->at.count ? regions_find(&g->at, context->p, context->n) : REGION_NOWHERE;

    return region == REGION_NOWHERE ? NULL : g->seen + (size_t)region * g->known_count;
}
