/* sky_guide_build: the guide from what a pilot found. The same bits for any number of threads. */
#include <stdatomic.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "worker/render/base/sampler.h"
#include "worker/render/light/environment/environment_light.h"
#include "worker/render/light/environment/environment_map.h"
#include "worker/render/light/environment/sky_guide.h"
#include "worker/render/light/learned/moments.h"

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
/* Where the variance of a direct light's sample is less than so many times its squared mean, other noise is more. */
#define NOISE_MIN 6
/* A region is guided if that lowers the variance of its direct light to this: far, for the map's samples are better
 * stratified. A district's regions are looked at if it lowers the district's to the other, and a scene is guided where at
 * least so many of the pilot's points are. */
#define REGION_GAIN 0.4
#define DISTRICT_GAIN 0.6
#define SCENE_POINTS 0.1

/* ---- a region's distribution ------------------------------------------------------------------ */

/* A direction that was tried. */
struct trial {
    struct light_trial of; /* `density`: within its cell or window */
    uint32_t point;
    struct vec3 direction;
};

struct building {
    struct region_growth growth;
    const struct sky_pilot *pilot;
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
    const struct sky_pilot *pilot = b->pilot;
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
        t->of.density = choice.pdf / share;
        t->direction = vec3_normalize(environment_from_map(env, environment_chosen(&choice)));
        t->of.cosine = real_max(vec3_dot(t->direction, pilot->points[point].n), 0);
        if (t->of.cosine > 0)
            arrives = pilot->arrives(pilot->user, point, t->direction);
        t->of.light = arrives > 0 ? arrives * t->of.cosine * REAL_INV_PI *
                                     vec3_luminance(environment_radiance(env, t->direction)) : 0;
        weight = (double)(t->of.cosine * t->of.cosine);
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

static status region_init(const struct building *b, const double *weights, struct sky_region *out, struct error *err)
{
    const uint32_t windows = windows_of(b->light->map);
    double cells = 0, all = 0, sum = 0;

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

static void add_trials(const struct building *b, const struct sky_region *region, const struct trial *trials,
                       uint32_t count, struct light_moments *by_map, struct light_moments *by_guide)
{
    const struct sky_pilot *pilot = b->pilot;

    for (uint32_t k = 0; k < count; k++) {
        const struct trial *t = &trials[k];
        const struct pilot_point *point = &pilot->points[t->point];
        const struct light_context context = {.p = point->p, .n = point->n};
        real pdf;

        if (!(t->of.light > 0))
            continue;
        (void)environment_light_radiance(b->light, &context, t->direction, &pdf);
        light_moments_add(by_map, &t->of, (double)(pdf * pilot->odds), count);
        pdf = sky_guide_pdf(b->guide, b->light->map, region, t->direction);
        light_moments_add(by_guide, &t->of, (double)(pdf * pilot->odds), count);
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
            const real cosine = vec3_dot(direction, b->pilot->points[b->growth.order[i].point].n);

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
    struct light_moments by_map = {0}, by_guide = {0};
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
    TRY(region_init(b, weights, out, err));
    for (uint32_t part = 0; part < parts; part++)
        if (trials->arrives[part] >= 0 && (!sight || sight[part] > 0))
            add_trials(b, out, trials->trial[part], part < SKY_CELLS ? rays : WINDOW_RAYS, &by_map, &by_guide);
    mean = light_moments_mean(&by_map);
    *before = light_moments_variance(&by_map);
    *after = *before > NOISE_MIN * mean * mean ? light_moments_variance(&by_guide) : *before;
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

/* None are kept in a scene that is not guided. */
static status choose_regions(struct building *b, struct error *err)
{
    struct sky_guide *g = b->guide;
    uint8_t *keep = mem_calloc((size_t)b->growth.region_count + 1, 1);
    uint32_t count = 0, points = 0;
    status s;

    NEED(keep, err, "the environment's guide");
    for (uint32_t i = 0; i < b->growth.region_count; i++) {
        keep[i] = b->after[i] < REGION_GAIN * b->before[i];
        if (!keep[i]) {
            region_release(&g->regions[i]);
            continue;
        }
        points += b->growth.regions[i].count;
        if (count != i) {
            g->regions[count] = g->regions[i];
            memset(&g->regions[i], 0, sizeof g->regions[i]);
        }
        count++;
    }
    s = points > 0 && points >= SCENE_POINTS * b->pilot->count ? region_growth_finish(&b->growth, keep, &g->at, err)
                                                               : STATUS_OK;
    mem_free(keep);
    return s;
}

status sky_guide_init(struct sky_guide *out, const struct environment_light *light, const struct sky_pilot *pilot,
                      struct error *err)
{
    struct sky_guide made = {0}, *const g = &made; /* while it is made, the light is sampled without it */
    struct building b = {.guide = g, .light = light, .pilot = pilot};
    status s = region_growth_init(&b.growth, pilot->points, pilot->count, err);

    memset(out, 0, sizeof *out);
    g->cells = mem_calloc(SKY_CELLS, sizeof *g->cells);
    if (s == STATUS_OK && !g->cells)
        s = error_no_memory(err, "the environment's guide");
    THEN(s, environment_cells_build(light->map, SKY_COLUMNS, SKY_ROWS, g->cells, err));
    if (s == STATUS_OK) {
        for (uint32_t part = 0; part < SKY_CELLS + windows_of(light->map); part++)
            b.light_of_all += part_of(&b, part)->cells.total;
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
    THEN(s, choose_regions(&b, err));
    if (g->at.count == 0) {
        for (uint32_t i = 0; g->regions && i < b.growth.region_count; i++)
            region_release(&g->regions[i]);
        sky_guide_release(g);
    }
    *out = made;
    region_growth_release(&b.growth);
    mem_free(b.sights);
    mem_free(b.before);
    mem_free(b.after);
    return s;
}

void sky_guide_release(struct sky_guide *g)
{
    for (uint32_t i = 0; g->regions && i < g->at.count; i++)
        region_release(&g->regions[i]);
    for (uint32_t i = 0; g->cells && i < SKY_CELLS; i++)
        density_release(&g->cells[i]);
    mem_free(g->regions);
    regions_release(&g->at);
    mem_free(g->cells);
    memset(g, 0, sizeof *g);
}
