/* The same bits for any number of threads. */
#include "worker/render/light/lamp_guide.h"

#include <stdatomic.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/system/parallel.h"
#include "worker/render/base/sampler.h"

/* Nodes that a guide knows at most: pairs, from the brightest node on. */
enum { KNOWN_MAX = 126 };
_Static_assert(KNOWN_MAX <= UINT8_MAX, "light_node.known");
/* Lights that are tried for a region. */
enum { TRIALS = 192 };
/* What arrives of a node's light is found from its trials, and from what arrives of its parent's: that counts as so much of
 * the light of a mean trial. */
#define PARENT_TRIALS 1.0
/* Less counts as this, whose root is a tenth. */
#define ARRIVES_MIN 0.01
/* A region is guided if that lowers the variance of its direct light to this, and a scene where at least so many of the
 * pilot's points are. */
#define REGION_GAIN 0.95
#define SCENE_POINTS 0.1

struct building {
    struct region_growth growth;
    const struct lamp_pilot *pilot;
    const struct light_tree *tree;
    uint32_t known_count;
    float32 *seen; /* [regions][known_count] */
    uint8_t *keep; /* [regions] */
    _Atomic int failed;
};

/* Of all nodes whose children are not known, the brightest one's become it. */
static uint32_t know_nodes(struct light_tree *tree)
{
    uint32_t edge[KNOWN_MAX + 1], edge_count = 1, known = 0;

    for (uint32_t i = 0; i < tree->node_count; i++)
        tree->nodes[i].known = 0;
    edge[0] = 0;
    while (edge_count > 0 && known + 2 <= KNOWN_MAX) {
        uint32_t best = 0, first;

        for (uint32_t i = 1; i < edge_count; i++)
            if (tree->nodes[edge[i]].intensity > tree->nodes[edge[best]].intensity)
                best = i;
        first = tree->nodes[edge[best]].first;
        if (tree->nodes[edge[best]].leaf_count > 0) {
            edge[best] = edge[--edge_count];
            continue;
        }
        tree->nodes[first].known = (uint8_t)++known;
        tree->nodes[first + 1].known = (uint8_t)++known;
        edge[best] = first;
        edge[edge_count++] = first + 1;
    }
    return known;
}

/* ---- a region -------------------------------------------------------------------------------- */

static uint32_t point_of(const struct building *b, const struct stretch *in, uint32_t k)
{
    return b->growth.order[in->first + k % in->count].point;
}

static int try_one(const struct building *b, const struct stretch *in, uint32_t k, struct lamp_trial *out)
{
    const uint32_t scramble = hash_u32(in->first ^ 0x6c616d70u);
    uint32_t at[2];

    sobol_2d(k, at);
    return b->pilot->choose(b->pilot->user, point_of(b, in, k), unit_float(at[0] ^ scramble),
                            unit_float(at[1] ^ hash_u32(scramble)), out);
}

/* The light of the known nodes, and what of it arrives. Row 0 is the whole tree's. */
struct found {
    double light[KNOWN_MAX + 1], arrives[KNOWN_MAX + 1];
};

static void add_found(const struct light_tree *tree, const struct lamp_trial *t, struct found *out)
{
    const double light = (double)t->trial.light / (double)t->trial.density;
    const struct light_node *node = tree->nodes;

    out->light[0] += light;
    out->arrives[0] += light * (double)t->arrives;
    for (uint64_t trail = tree->trail[t->item]; node->leaf_count == 0; trail >>= 1) {
        node = &tree->nodes[node->first + (trail & 1)];
        if (!node->known)
            return;
        out->light[node->known] += light;
        out->arrives[node->known] += light * (double)t->arrives;
    }
}

/* From a node, whose light arrives as `parent` says, down. */
static void learn_below(const struct light_tree *tree, const struct light_node *node, const struct found *found,
                        double parent, double mean, float32 *seen)
{
    const struct light_node *pair = &tree->nodes[node->first];

    if (node->leaf_count > 0 || !pair->known)
        return;
    for (int i = 0; i < 2; i++) {
        const uint32_t known = pair[i].known;
        const double arrives =
            (found->arrives[known] + PARENT_TRIALS * mean * parent) / (found->light[known] + PARENT_TRIALS * mean);

        seen[known - 1] = (float32)sqrt(fmin(fmax(arrives, ARRIVES_MIN), 1));
        learn_below(tree, &pair[i], found, arrives, mean, seen);
    }
}

/* By the first `count` of the trials. */
static void learn(const struct building *b, const struct lamp_trial *trials, const uint8_t *is_lit, uint32_t count,
                  float32 *seen)
{
    struct found found = {0};

    for (uint32_t i = 0; i < b->known_count; i++)
        seen[i] = 1;
    for (uint32_t k = 0; k < count; k++)
        if (is_lit[k])
            add_found(b->tree, &trials[k], &found);
    if (found.light[0] > 0)
        learn_below(b->tree, b->tree->nodes, &found, found.arrives[0] / found.light[0], found.light[0] / count, seen);
}

/* Would the odds by the first half of the trials lower the variance of the other half? */
static int pays(const struct building *b, const struct stretch *in, const struct lamp_trial *trials, const uint8_t *is_lit)
{
    struct light_moments before = {0}, after = {0};
    float32 seen[KNOWN_MAX];

    learn(b, trials, is_lit, TRIALS / 2, seen);
    for (uint32_t k = TRIALS / 2; k < TRIALS; k++) {
        struct light_trial t = trials[k].trial;
        const struct lamp_trial *chosen = &trials[k];
        const struct pilot_point *at = &b->pilot->points[point_of(b, in, k)];
        double q;

        if (!is_lit[k] || !(chosen->arrives > 0))
            continue;
        t.light *= chosen->arrives;
        q = (double)t.density;
        light_moments_add(&before, &t, q, TRIALS / 2);
        q *= (double)light_tree_odds(b->tree, seen, at->p, at->n, chosen->item) / (double)chosen->odds;
        light_moments_add(&after, &t, q, TRIALS / 2);
    }
    return light_moments_variance(&after) < REGION_GAIN * light_moments_variance(&before);
}

static void learn_regions(void *user, size_t begin, size_t end)
{
    struct building *b = user;
    struct lamp_trial *trials = mem_alloc_array(TRIALS, sizeof *trials);
    uint8_t is_lit[TRIALS];

    if (!trials)
        atomic_store(&b->failed, 1);
    for (size_t i = begin; i < end && trials; i++) {
        const struct stretch *in = &b->growth.regions[i];
        float32 *seen = b->seen + i * b->known_count;

        for (uint32_t k = 0; k < TRIALS; k++)
            is_lit[k] = (uint8_t)(try_one(b, in, k, &trials[k]) && trials[k].trial.light > 0);
        b->keep[i] = (uint8_t)pays(b, in, trials, is_lit);
        if (b->keep[i])
            learn(b, trials, is_lit, TRIALS, seen);
    }
    mem_free(trials);
}

/* ---- the guide --------------------------------------------------------------------------------- */

static status choose_regions(struct building *b, struct lamp_guide *g, struct error *err)
{
    const size_t row = b->known_count * sizeof *b->seen;
    uint32_t points = 0, count = 0;

    for (uint32_t i = 0; i < b->growth.region_count; i++)
        if (b->keep[i]) {
            points += b->growth.regions[i].count;
            memmove(b->seen + (size_t)count++ * b->known_count, b->seen + (size_t)i * b->known_count, row);
        }
    if (points == 0 || points < SCENE_POINTS * b->pilot->count)
        return STATUS_OK;
    TRY(region_growth_finish(&b->growth, b->keep, &g->at, err));
    g->known_count = b->known_count;
    g->seen = b->seen;
    b->seen = NULL;
    return STATUS_OK;
}

status lamp_guide_init(struct lamp_guide *g, struct light_tree *tree, const struct lamp_pilot *pilot, struct error *err)
{
    struct building b = {.pilot = pilot, .tree = tree};
    status s;

    memset(g, 0, sizeof *g);
    if (tree->node_count < 2)
        return STATUS_OK;
    b.known_count = know_nodes(tree);
    s = region_growth_init(&b.growth, pilot->points, pilot->count, err);
    if (s == STATUS_OK) {
        b.seen = mem_alloc_array((size_t)b.growth.region_count * b.known_count + 1, sizeof *b.seen);
        b.keep = mem_calloc((size_t)b.growth.region_count + 1, 1);
        if (!b.seen || !b.keep)
            s = error_no_memory(err, "the lamps' guide");
    }
    if (s == STATUS_OK) {
        parallel_for(pilot->threads, b.growth.region_count, 4, learn_regions, &b);
        if (atomic_load(&b.failed))
            s = error_no_memory(err, "the lamps' guide");
    }
    THEN(s, choose_regions(&b, g, err));
    region_growth_release(&b.growth);
    mem_free(b.seen);
    mem_free(b.keep);
    return s;
}

void lamp_guide_release(struct lamp_guide *g)
{
    regions_release(&g->at);
    mem_free(g->seen);
    memset(g, 0, sizeof *g);
}
