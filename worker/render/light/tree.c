#include "worker/render/light/tree.h"

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/base/health_scope.h"

/* Tolerance of the bounds against rounding: cosines and sines of angles near 0 are only accurate to
 * the root of float's precision. */
#define COSINE_SLACK REAL(1e-3)
/* A light that may contribute keeps at least these odds in its pair, by depth: the other one may be hidden, which importance does
 * not know. They halve, so that the more important light of every pair loses an eighth of its samples at most. The last ones, of
 * all that is deeper, bound the weights of the power heuristic, and one turn does not use up the numbers' resolution (2^-24). */
static const real pair_odds_min[] = {0x1p-4f, 0x1p-5f, 0x1p-6f, 0x1p-7f, 0x1p-8f, 0x1p-9f, 0x1p-10f};
enum { PAIR_ODDS_DEPTHS = sizeof pair_odds_min / sizeof *pair_odds_min };

static inline real cosine_slack(void) { return SAFEGUARD(LIGHT_TREE_SLACK) ? COSINE_SLACK : 0; }

static inline real safe_sqrt(real x) { return x > 0 ? real_sqrt(x) : 0; }

/* cos and sin of max(0, a - b), of angles 0..pi. */
static inline real cos_less(real sin_a, real cos_a, real sin_b, real cos_b)
{
    return cos_a >= cos_b ? 1 : cos_a * cos_b + sin_a * sin_b;
}

static inline real sin_less(real sin_a, real cos_a, real sin_b, real cos_b)
{
    return cos_a >= cos_b ? 0 : sin_a * cos_b - cos_a * sin_b;
}

static real importance(const struct light_node *node, struct vec3 p, struct vec3 n)
{
    struct vec3 to_p = vec3_sub(p, node->centre);
    real distance_squared = vec3_length_squared(to_p), distance;
    real cos_axis, sin_axis, cos_ball, sin_ball, sin_free, cos_free, cosine;

    /* Inside the sphere, light may come from any direction and leave in any direction. */
    if (distance_squared <= node->radius_squared || !(distance_squared > REAL(1e-36)))
        return node->intensity / real_max(node->radius_squared, REAL(1e-36));
    if (distance_squared > node->reach_squared)
        return 0;
    distance = real_sqrt(distance_squared);
    sin_ball = node->radius_squared / distance_squared;
    cos_ball = safe_sqrt(1 - sin_ball);
    sin_ball = real_sqrt(sin_ball);

    cos_axis = vec3_dot(to_p, node->axis) / distance;
    if (node->two_sided)
        cos_axis = real_abs(cos_axis);
    sin_axis = safe_sqrt(1 - cos_axis * cos_axis);
    /* The smallest angle between the direction to p and a normal. */
    cos_free = cos_less(sin_axis, cos_axis, node->sin_spread, node->cos_spread);
    sin_free = sin_less(sin_axis, cos_axis, node->sin_spread, node->cos_spread);
    cosine = cos_less(sin_free, cos_free, sin_ball, cos_ball);
    if (cosine < node->cos_emission - cosine_slack())
        return 0;
    cosine = real_max(cosine, cosine_slack());

    if (!vec3_is_black(n)) {
        real cos_p = -vec3_dot(to_p, n) / distance;

        cos_p = cos_less(safe_sqrt(1 - cos_p * cos_p), cos_p, sin_ball, cos_ball);
        if (cos_p < -cosine_slack())
            return 0;
        cosine *= real_max(cos_p, cosine_slack());
    }
    return node->intensity * cosine / distance_squared;
}

static inline real bounded_odds(real odds, int depth)
{
    const real least = pair_odds_min[depth < PAIR_ODDS_DEPTHS ? depth : PAIR_ODDS_DEPTHS - 1];

    if (!SAFEGUARD(LIGHT_TREE_ODDS))
        return odds;
    return real_min(real_max(odds, least), 1 - least);
}

/* Odds of the left of two siblings, whose parent is at that depth; negative: neither can contribute. */
static real left_odds(const struct light_node *pair, const float32 *seen, struct vec3 p, struct vec3 n, int depth)
{
    real left = importance(&pair[0], p, n), right = importance(&pair[1], p, n), sum;

    if (seen && pair->known) {
        left *= (real)seen[pair[0].known - 1];
        right *= (real)seen[pair[1].known - 1];
    }
    sum = left + right;

    if (!(sum > 0))
        return (real)health_density(sum) - 1;
    if (!(left > 0))
        return 0;
    if (!(right > 0))
        return 1;
    if (!(sum < INFINITY))
        return 0.5f;
    return bounded_odds(left / sum, depth);
}

int light_tree_choose(const struct light_tree *tree, const float32 *seen, struct vec3 p, struct vec3 n, real *u,
                      real *v, uint32_t *item, real *odds)
{
    const struct light_node *node = tree->nodes;
    real *number = u, *other = v;
    uint32_t at;

    *odds = 1;
    for (int depth = 0; node->leaf_count == 0; depth++) {
        const struct light_node *pair = &tree->nodes[node->first];
        real left = left_odds(pair, seen, p, n, depth), *spent = number;

        if (left < 0)
            return 0;
        if (*number < left) {
            *number = light_rescaled(*number, 0, left);
            *odds *= left;
            node = &pair[0];
        } else {
            *number = light_rescaled(*number, left, 1 - left);
            *odds *= 1 - left;
            node = &pair[1];
        }
        number = other;
        other = spent;
    }
    at = node->first;
    while (at + 1 < node->first + node->leaf_count && *number >= tree->share_start[tree->order[at + 1]])
        at++;
    *item = tree->order[at];
    if (node->leaf_count > 1) {
        if (!(tree->share[*item] > 0))
            return 0;
        *number = light_rescaled(*number, tree->share_start[*item], tree->share[*item]);
        *odds *= tree->share[*item];
    }
    return 1;
}

real light_tree_odds(const struct light_tree *tree, const float32 *seen, struct vec3 p, struct vec3 n, uint32_t item)
{
    const struct light_node *node = tree->nodes;
    uint64_t trail;
    real odds = 1;
    int depth = 0;

    if (tree->node_count == 0 || !(tree->share[item] > 0))
        return 0;
    for (trail = tree->trail[item]; node->leaf_count == 0; trail >>= 1) {
        const struct light_node *pair = &tree->nodes[node->first];
        real left = left_odds(pair, seen, p, n, depth++);

        if (left < 0)
            return 0;
        odds *= trail & 1 ? 1 - left : left;
        node = &pair[trail & 1];
    }
    return node->leaf_count > 1 ? odds * tree->share[item] : odds;
}
