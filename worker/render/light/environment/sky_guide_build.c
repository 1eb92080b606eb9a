/* sky_guide_build: the guide from what a pilot found. The same bits for any number of threads. */
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "worker/render/base/sampler.h"
#include "worker/render/light/environment/environment_light.h"
#include "worker/render/light/environment/environment_map.h"
#include "worker/render/light/environment/sky_guide.h"

/* A region has at most so many points of the pilot; a district, of which regions are parts, at most so many. */
enum { REGION_POINTS = 24, DISTRICT_POINTS = 16 * REGION_POINTS };
/* Directions that are tried in each cell and window, from points by turns: of a district, and then of its regions, there
 * only in cells from which, or from whose neighbours, something arrived in the district. Squares of whole numbers or twice
 * such. */
enum { DISTRICT_RAYS = 8, REGION_RAYS = 16, WINDOW_RAYS = 64, PARTS_MAX = SKY_CELLS + WINDOWS_MAX };
/* A part's share of a region's choices is at least this of what it has by light and cosine, whatever arrives: for what the
 * pilot did not see. A sun that is missed costs most: parts with more than BRIGHT of all light keep more. */
#define UNSEEN_SHARE 0.1
#define UNSEEN_BRIGHT_SHARE 0.5
#define BRIGHT 0.02
/* A neighbour's share in what arrives from a cell: a few rays do not see its edges. */
#define NEIGHBOUR_SHARE 0.12
/* The district's, likewise. */
#define DISTRICT_SHARE 0.1
/* A region reaches so far beyond its points, of their extent: elsewhere the pilot has not been. */
#define BOX_MARGIN 0.25f
/* Where the variance of a direct light's sample is less than so many times its squared mean, other noise is more. */
#define NOISE_MIN 6
/* A region is guided if that lowers the variance of its direct light to this: far, for the map's samples are better
 * stratified. A district's regions are looked at if it lowers the district's to the other, and a scene is guided where at
 * least so many of the pilot's points are. */
#define REGION_GAIN 0.4
#define DISTRICT_GAIN 0.6
#define SCENE_POINTS 0.1

/* ---- regions ---------------------------------------------------------------------------------- */

/* A district or a region. */
struct stretch {
    uint32_t first, count; /* of the order */
    uint32_t district;     /* of a region */
};

struct key {
    real at; /* along the axis that is split */
    uint32_t point;
};

struct growth {
    const struct sky_pilot *pilot;
    struct key *order; /* [pilot->count] the points, by leaf */
    struct sky_node *nodes;
    uint32_t node_count;
    struct stretch *districts, *regions;
    uint32_t district_count, region_count;
};

static real place(const struct growth *g, uint32_t point, uint32_t axis)
{
    const struct vec3 p = g->pilot->points[point].p;

    return axis == 0 ? p.x : axis == 1 ? p.y : p.z;
}

/* By place; no two points are alike. */
static int compare_keys(const void *a_, const void *b_)
{
    const struct key *a = a_, *b = b_;

    return a->at != b->at ? (a->at > b->at) - (a->at < b->at) : (a->point > b->point) - (a->point < b->point);
}

static uint32_t longest_axis(const struct growth *g, uint32_t first, uint32_t count, real *extent)
{
    uint32_t best = 0;

    *extent = -1;
    for (uint32_t axis = 0; axis < 3; axis++) {
        real low = INFINITY, high = -INFINITY;

        for (uint32_t i = first; i < first + count; i++) {
            low = real_min(low, place(g, g->order[i].point, axis));
            high = real_max(high, place(g, g->order[i].point, axis));
        }
        if (high - low > *extent) {
            *extent = high - low;
            best = axis;
        }
    }
    return best;
}

/* Half of the points to each child, down to regions. `district`: the one around, UINT32_MAX: not yet. */
static void grow(struct growth *g, uint32_t node, uint32_t first, uint32_t count, uint32_t district)
{
    const uint32_t half = count / 2, children = g->node_count;
    real extent;
    uint32_t axis;

    g->nodes[node].axis = SKY_LEAF;
    g->nodes[node].child = SKY_NOWHERE;
    if (count == 0)
        return;
    axis = longest_axis(g, first, count, &extent);
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

static void grow_sides(struct growth *g)
{
    uint32_t first = 0;

    g->node_count = SKY_SIDES;
    for (uint32_t side = 0; side < SKY_SIDES; side++) {
        uint32_t count = 0;

        for (uint32_t i = 0; i < g->pilot->count; i++)
            if (sky_side_of(g->pilot->points[i].n) == side)
                g->order[first + count++].point = i;
        grow(g, side, first, count, UINT32_MAX);
        first += count;
    }
}

/* ---- a region's distribution ------------------------------------------------------------------ */

/* A direction that was tried. */
struct trial {
    uint32_t point;
    real density; /* within its cell or window */
    real light;   /* luminance times cosine / pi of what arrives */
    real cosine;
    struct vec3 direction;
};

struct building {
    struct growth growth;
    struct sky_guide *guide;
    const struct environment_light *light;
    double light_of_all;          /* of the parts */
    float32 (*sights)[PARTS_MAX]; /* [district_count] what arrives there from each part, 0..1 */
    double *before, *after;       /* [region_count] variance of the direct light, by the map and by the guide */
    _Atomic int failed;
};

static uint32_t windows_of(const struct environment *env) { return env->part_count - environment_first_window(env); }

/* Parts: the cells, then the windows. */
static const struct density *part_of(const struct building *b, uint32_t part)
{
    const struct environment *env = b->light->map;

    return part < SKY_CELLS ? &b->guide->cells[part] : &env->parts[environment_first_window(env) + part - SKY_CELLS];
}

/* Try directions in a part. Returns how much of them arrives, weighted by the squared cosine: 0..1; -1: none is above the
 * surfaces. */
static double try_part(const struct building *b, const struct stretch *in, uint32_t part, uint32_t rays,
                       struct trial *trials)
{
    const struct environment *env = b->light->map;
    const struct sky_pilot *pilot = b->growth.pilot;
    const uint32_t across = rays >= 64 ? 8 : rays >= 16 ? 4 : 2, down = rays / across;
    const real share = part < SKY_CELLS ? 1 : environment_part_share(env, environment_first_window(env) + part - SKY_CELLS);
    double open = 0, arrived = 0;

    for (uint32_t k = 0; k < rays; k++) {
        const uint32_t key = hash_u32((in->first * PARTS_MAX + part) * WINDOW_RAYS + k);
        const uint32_t point = b->growth.order[in->first + hash_u32(key) % in->count].point;
        const real u = ((real)(int32_t)(k % across) + unit_float(hash_u32(key ^ 0x68bc21ebu))) / (real)(int32_t)across;
        const real v = ((real)(int32_t)(k / across) + unit_float(hash_u32(key ^ 0x02e5be93u))) / (real)(int32_t)down;
        struct density_choice choice;
        struct trial *t = &trials[k];
        real arrives = 0;
        double weight;

        density_choose(part_of(b, part), real_min(u, REAL_BELOW_ONE), real_min(v, REAL_BELOW_ONE), &choice);
        t->point = point;
        t->density = choice.pdf / share;
        t->direction = vec3_normalize(environment_from_map(env, environment_chosen(&choice)));
        t->cosine = real_max(vec3_dot(t->direction, pilot->points[point].n), 0);
        if (t->cosine > 0)
            arrives = pilot->arrives(pilot->user, point, t->direction);
        t->light = arrives > 0 ? arrives * t->cosine * REAL_INV_PI *
                                     vec3_luminance(environment_radiance(env, t->direction)) : 0;
        weight = (double)(t->cosine * t->cosine);
        open += weight;
        arrived += weight * (double)(arrives * arrives);
    }
    return open > 0 ? arrived / open : -1;
}

/* What arrives from a part; of a cell, its neighbours' a little, of those that are known. */
static double smoothed(const double *arrives, uint32_t part)
{
    const uint32_t row = part / SKY_COLUMNS, column = part % SKY_COLUMNS;
    const uint32_t beside[4] = {row * SKY_COLUMNS + (column + SKY_COLUMNS - 1) % SKY_COLUMNS,
                                row * SKY_COLUMNS + (column + 1) % SKY_COLUMNS, row > 0 ? part - SKY_COLUMNS : part,
                                row + 1 < SKY_ROWS ? part + SKY_COLUMNS : part};
    double own = arrives[part], sum;

    if (part >= SKY_CELLS || own < 0)
        return own;
    sum = own;
    for (int k = 0; k < 4; k++)
        sum += arrives[beside[k]] >= 0 ? NEIGHBOUR_SHARE * (arrives[beside[k]] - own) : 0;
    return sum;
}

/* Around the points of a stretch. */
static void find_box(const struct growth *g, const struct stretch *in, struct sky_region *out)
{
    for (uint32_t axis = 0; axis < 3; axis++) {
        real low = INFINITY, high = -INFINITY;

        for (uint32_t i = in->first; i < in->first + in->count; i++) {
            low = real_min(low, place(g, g->order[i].point, axis));
            high = real_max(high, place(g, g->order[i].point, axis));
        }
        out->low[axis] = low - BOX_MARGIN * (high - low);
        out->high[axis] = high + BOX_MARGIN * (high - low);
    }
}

static status region_init(const struct building *b, const struct stretch *in, const double *weights,
                          struct sky_region *out, struct error *err)
{
    const uint32_t windows = windows_of(b->light->map);
    double cells = 0, all = 0, sum = 0;

    find_box(&b->growth, in, out);

    out->window_start = mem_calloc((size_t)windows + 1, sizeof *out->window_start);
    NEED(out->window_start, err, "the environment's guide");
    for (uint32_t i = 0; i < SKY_CELLS + windows; i++) {
        cells += i < SKY_CELLS ? weights[i] : 0;
        all += weights[i];
    }
    out->window_share = (real)((all - cells) / all);
    for (uint32_t i = 0; i < windows && all > cells; i++) {
        out->window_start[i] = (real)(sum / (all - cells));
        sum += weights[SKY_CELLS + i];
    }
    out->window_start[windows] = 1;
    TRY(distribution_init(&out->cells, SKY_ROWS, SKY_COLUMNS, err));
    for (uint32_t row = 0; row < SKY_ROWS; row++)
        distribution_set_row(&out->cells, row, weights + row * SKY_COLUMNS);
    if (!distribution_finish(&out->cells))
        out->window_share = 1;
    return STATUS_OK;
}

static void region_release(struct sky_region *region)
{
    distribution_release(&region->cells);
    mem_free(region->window_start);
    memset(region, 0, sizeof *region);
}

/* The direct light of a diffuse surface by multiple importance sampling, one sample by light sampling and one by the
 * cosine: means and second moments of the two. */
struct moments {
    double light, light2, scattered, scattered2;
};

static double variance_of(const struct moments *m)
{
    return m->light2 - m->light * m->light + m->scattered2 - m->scattered * m->scattered;
}

/* A trial, of which the light sampling has density q. */
static void add_trial(const struct trial *t, double q, double count, struct moments *m)
{
    const double p = (double)t->cosine / PI_D, sum = q * q + p * p, f = (double)t->light;
    const double share = 1 / ((double)t->density * count);

    m->light += f * q * q / sum * share;
    m->light2 += f * f * q * q * q / (sum * sum) * share;
    m->scattered += f * p * p / sum * share;
    m->scattered2 += f * f * p * p * p / (sum * sum) * share;
}

static void add_trials(const struct building *b, const struct sky_region *region, const struct trial *trials,
                       uint32_t count, struct moments *by_map, struct moments *by_guide)
{
    const struct sky_pilot *pilot = b->growth.pilot;

    for (uint32_t k = 0; k < count; k++) {
        const struct trial *t = &trials[k];
        const struct sky_point *point = &pilot->points[t->point];
        const struct light_context context = {.p = point->p, .n = point->n};
        real pdf;

        if (!(t->light > 0))
            continue;
        (void)environment_light_radiance(b->light, &context, t->direction, &pdf);
        add_trial(t, (double)(pdf * pilot->odds), count, by_map);
        pdf = sky_guide_pdf(b->guide, b->light->map, region, t->direction);
        add_trial(t, (double)(pdf * pilot->odds), count, by_guide);
    }
}

/* What was tried in a stretch. */
struct trials {
    double open[PARTS_MAX];    /* mean squared cosine to the part's middle, over the points */
    double arrives[PARTS_MAX]; /* what share of that arrives */
    struct trial trial[PARTS_MAX][WINDOW_RAYS];
};

static void measure_open(const struct building *b, const struct stretch *in, uint32_t parts, double *open)
{
    for (uint32_t part = 0; part < parts; part++) {
        struct vec3 direction;
        struct density_choice choice;

        open[part] = 0;
        if (!(part_of(b, part)->cells.total > 0))
            continue;
        density_choose(part_of(b, part), 0.5f, 0.5f, &choice);
        direction = vec3_normalize(environment_from_map(b->light->map, environment_chosen(&choice)));
        for (uint32_t i = in->first; i < in->first + in->count; i++) {
            const real cosine = vec3_dot(direction, b->growth.pilot->points[b->growth.order[i].point].n);

            open[part] += cosine > 0 ? (double)(cosine * cosine) / in->count : 0;
        }
    }
}

/* The distribution of a stretch, and the direct light's variance by the map and by it. `sight`, [parts], what arrives in
 * its district: only in such parts it is looked at; NULL: in all. Nothing arrives: *out stays empty. */
static status stretch_learn(const struct building *b, const struct stretch *in, const float32 *sight, uint32_t rays,
                            struct trials *trials, struct sky_region *out, double *before, double *after,
                            struct error *err)
{
    const uint32_t parts = SKY_CELLS + windows_of(b->light->map);
    const double share = sight ? DISTRICT_SHARE : 0;
    struct moments by_map = {0}, by_guide = {0};
    double weights[PARTS_MAX], least[PARTS_MAX], opens = 0, arrives = 0, unseen = 0, mean;

    *before = *after = 0;
    measure_open(b, in, parts, trials->open);
    for (uint32_t part = 0; part < parts; part++)
        trials->arrives[part] = !(part_of(b, part)->cells.total > 0) ? -1
                                : sight && !(sight[part] > 0)       ? 0
                                : try_part(b, in, part, part < SKY_CELLS ? rays : WINDOW_RAYS, trials->trial[part]);
    for (uint32_t part = 0; part < parts; part++) {
        const double light = part_of(b, part)->cells.total;
        const double seen = fmax(smoothed(trials->arrives, part), 0);

        weights[part] = light * sqrt(trials->open[part] * ((1 - share) * seen + share * (sight ? (double)sight[part] : 0)));
        arrives += weights[part];
        opens += light * sqrt(trials->open[part]);
    }
    if (!(arrives > 0))
        return STATUS_OK;
    for (uint32_t part = 0; part < parts; part++) {
        const double light = part_of(b, part)->cells.total;

        least[part] = (light > BRIGHT * b->light_of_all ? UNSEEN_BRIGHT_SHARE : UNSEEN_SHARE) * light *
                      sqrt(trials->open[part]) / opens;
        unseen += least[part];
    }
    for (uint32_t part = 0; part < parts; part++)
        weights[part] = (1 - unseen) * weights[part] / arrives + least[part];
    TRY(region_init(b, in, weights, out, err));
    for (uint32_t part = 0; part < parts; part++)
        if (trials->arrives[part] >= 0 && (!sight || sight[part] > 0))
            add_trials(b, out, trials->trial[part], part < SKY_CELLS ? rays : WINDOW_RAYS, &by_map, &by_guide);
    mean = by_map.light + by_map.scattered;
    *before = variance_of(&by_map);
    *after = *before > NOISE_MIN * mean * mean ? variance_of(&by_guide) : *before;
    return STATUS_OK;
}

static void learn_districts(void *user, size_t begin, size_t end)
{
    struct building *b = user;
    struct trials *trials = mem_alloc_array(1, sizeof *trials);
    struct error err;

    for (size_t i = begin; i < end; i++) {
        struct sky_region region = {0};
        double before, after;

        if (!trials || stretch_learn(b, &b->growth.districts[i], NULL, DISTRICT_RAYS, trials, &region, &before, &after,
                                     &err) != STATUS_OK)
            atomic_store(&b->failed, 1);
        else if (after < DISTRICT_GAIN * before)
            for (uint32_t part = 0; part < SKY_CELLS + windows_of(b->light->map); part++) /* else its regions see nothing */
                b->sights[i][part] = (float32)fmax(smoothed(trials->arrives, part), 0);
        region_release(&region);
    }
    mem_free(trials);
}

static void learn_regions(void *user, size_t begin, size_t end)
{
    struct building *b = user;
    struct trials *trials = mem_alloc_array(1, sizeof *trials);
    struct error err;

    for (size_t i = begin; i < end; i++) {
        const struct stretch *in = &b->growth.regions[i];

        if (!trials || stretch_learn(b, in, b->sights[in->district], REGION_RAYS, trials, &b->guide->regions[i],
                                     &b->before[i], &b->after[i], &err) != STATUS_OK)
            atomic_store(&b->failed, 1);
    }
    mem_free(trials);
}

/* ---- the guide --------------------------------------------------------------------------------- */

/* Give the leaves below the node their regions' new numbers, and take out nodes that tell nothing apart. */
static void prune(struct sky_guide *g, uint32_t node, const uint32_t *kept)
{
    struct sky_node *n = &g->nodes[node], *child = g->nodes + n->child;

    if (n->axis == SKY_LEAF) {
        n->child = n->child == SKY_NOWHERE ? SKY_NOWHERE : kept[n->child];
        return;
    }
    prune(g, n->child, kept);
    prune(g, n->child + 1, kept);
    if (child[0].axis == SKY_LEAF && child[0].child == SKY_NOWHERE && child[1].axis == SKY_LEAF &&
        child[1].child == SKY_NOWHERE)
        *n = (struct sky_node){0, SKY_LEAF, SKY_NOWHERE};
}

static void choose_regions(struct building *b, uint32_t *kept)
{
    struct sky_guide *g = b->guide;
    uint32_t count = 0, points = 0;

    for (uint32_t i = 0; i < b->growth.region_count; i++) {
        kept[i] = SKY_NOWHERE;
        if (!(b->after[i] < REGION_GAIN * b->before[i])) {
            region_release(&g->regions[i]);
            continue;
        }
        points += b->growth.regions[i].count;
        if (count != i) {
            g->regions[count] = g->regions[i];
            memset(&g->regions[i], 0, sizeof g->regions[i]);
        }
        kept[i] = count++;
    }
    g->region_count = count;
    if (points == 0 || points < SCENE_POINTS * b->growth.pilot->count) {
        sky_guide_release(g);
        return;
    }
    for (uint32_t side = 0; side < SKY_SIDES; side++)
        prune(g, side, kept);
}

status sky_guide_init(struct sky_guide *out, const struct environment_light *light, const struct sky_pilot *pilot,
                      struct error *err)
{
    const size_t count = pilot->count;
    struct sky_guide made = {0}, *const g = &made; /* while it is made, the light is sampled without it */
    struct building b = {.guide = g, .light = light, .growth.pilot = pilot};
    uint32_t *kept = mem_alloc_array(count + 1, sizeof *kept);
    status s = STATUS_OK;

    memset(out, 0, sizeof *out);
    b.growth.order = mem_alloc_array(count + 1, sizeof *b.growth.order);
    b.growth.regions = mem_alloc_array(count + 1, sizeof *b.growth.regions);
    b.growth.districts = mem_alloc_array(count + 1, sizeof *b.growth.districts);
    g->nodes = b.growth.nodes = mem_calloc(2 * count + SKY_SIDES, sizeof *g->nodes);
    g->cells = mem_calloc(SKY_CELLS, sizeof *g->cells);
    if (!kept || !b.growth.order || !b.growth.regions || !b.growth.districts || !g->nodes || !g->cells)
        s = error_no_memory(err, "the environment's guide");
    if (s == STATUS_OK)
        s = environment_cells_build(light->map, SKY_COLUMNS, SKY_ROWS, g->cells, err);
    if (s == STATUS_OK) {
        for (uint32_t part = 0; part < SKY_CELLS + windows_of(light->map); part++)
            b.light_of_all += part_of(&b, part)->cells.total;
        grow_sides(&b.growth);
        g->region_count = b.growth.region_count;
        g->regions = mem_calloc((size_t)b.growth.region_count + 1, sizeof *g->regions);
        b.before = mem_calloc((size_t)b.growth.region_count + 1, sizeof *b.before);
        b.after = mem_calloc((size_t)b.growth.region_count + 1, sizeof *b.after);
        b.sights = mem_calloc((size_t)b.growth.district_count + 1, sizeof *b.sights);
        if (!g->regions || !b.before || !b.after || !b.sights)
            s = error_no_memory(err, "the environment's guide");
    }
    if (s == STATUS_OK) {
        parallel_for(pilot->threads, b.growth.district_count, 1, learn_districts, &b);
        parallel_for(pilot->threads, b.growth.region_count, 8, learn_regions, &b);
        if (atomic_load(&b.failed))
            s = error_no_memory(err, "the environment's guide");
    }
    if (s == STATUS_OK)
        choose_regions(&b, kept);
    else
        sky_guide_release(g);
    *out = made;
    mem_free(kept);
    mem_free(b.growth.order);
    mem_free(b.growth.regions);
    mem_free(b.growth.districts);
    mem_free(b.sights);
    mem_free(b.before);
    mem_free(b.after);
    return s;
}

void sky_guide_release(struct sky_guide *g)
{
    for (uint32_t i = 0; g->regions && i < g->region_count; i++)
        region_release(&g->regions[i]);
    for (uint32_t i = 0; g->cells && i < SKY_CELLS; i++)
        density_release(&g->cells[i]);
    mem_free(g->regions);
    mem_free(g->nodes);
    mem_free(g->cells);
    memset(g, 0, sizeof *g);
}
