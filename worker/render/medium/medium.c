#include "worker/render/base/health_scope.h"
#include "worker/render/medium/medium.h"

#include <string.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/medium/medium_data.h"
#include "worker/render/base/profile_scope.h"

/* Below this transmittance, ratio tracking plays Russian roulette. */
#define MEDIUM_ROULETTE_BELOW 0.0625f

static real medium_next(struct medium_random *random)
{
    return sampler_hash(random->sampler, random->key, random->drawn++);
}

/* Optical depth of the next collision: exponentially distributed, for u in [0,1). */
static real medium_depth_of(real u)
{
    return -real_log(1.0f - u);
}

/* Choose one of the three channels with equal probability; *u becomes a new number in [0,1). */
static int medium_channel(real *u)
{
    real scaled = *u * 3.0f;
    int channel = scaled < 1.0f ? 0 : scaled < 2.0f ? 1 : 2;

    *u = real_min(scaled - (real)channel, REAL_BELOW_ONE);
    return channel;
}

static struct vec3 medium_vec(const real x[3])
{
    return (struct vec3){x[0], x[1], x[2]};
}

/* ---- homogeneous -------------------------------------------------------------------------- */

/* exp(-extinction * metres). Extinction 0 loses nothing, at any distance. */
static real medium_beer(real extinction, real metres)
{
    return extinction > 0.0f || !SAFEGUARD(MEDIUM_CLEAR) ? real_exp(-extinction * metres) : 1.0f;
}

/* Integral of exp(-extinction t) from 0 to `metres`. An infinite segment without extinction would
 * emit infinitely; it counts as 0. */
static real medium_beer_integral(real extinction, real metres)
{
    double depth = (double)extinction * (double)metres;

    if (!SAFEGUARD(MEDIUM_THIN))
        return (1.0f - real_exp(-extinction * metres)) / extinction;
    if (!(metres < INFINITY))
        return extinction > 0.0f ? 1.0f / extinction : 0.0f;
    if (depth < 1e-5)
        return (real)((double)metres * (1.0 - 0.5 * depth));
    return (real)((1.0 - det_exp_d(-depth)) / (double)extinction);
}

static struct vec3 medium_homogeneous_emission(const struct world_medium *medium, real metres)
{
    real sum[3];

    for (int c = 0; c < 3; c++)
        sum[c] = medium->emission[c] > 0.0f
                     ? real_min(medium->emission[c] *
                                     medium_beer_integral(medium->extinction[c], metres),
                                 MEDIUM_RADIANCE_MAX)
                     : 0.0f;
    return medium_vec(sum);
}

/* The free path of a uniformly chosen channel. The balance heuristic divides by the mean of the
 * three channels' densities, so no weight exceeds 3. The densities are relative to the chosen
 * channel's, whose optical depth is below 17, so none overflows or underflows. */
static void medium_sample_homogeneous(const struct world_medium *medium, real t_max, real u,
                                      struct medium_event *out)
{
    int chosen = medium->chromatic ? medium_channel(&u) : 0;
    real extinction = medium->extinction[chosen];
    real distance = extinction > 0.0f ? medium_depth_of(u) / extinction : INFINITY;
    real part[3], weight[3], mean = 0.0f;

    out->scattered = distance < t_max;
    out->distance = out->scattered ? distance : t_max;
    for (int c = 0; c < 3; c++) {
        real difference = medium->extinction[c] - extinction;

        part[c] = difference != 0.0f ? real_exp(-difference * out->distance) : 1.0f;
        mean += out->scattered ? part[c] * medium->extinction[c] : part[c];
    }
    mean *= 1.0f / REAL(3.0);
    for (int c = 0; c < 3; c++)
        weight[c] = (out->scattered ? part[c] * medium->scattering[c] : part[c]) / mean;
    out->weight = medium_vec(weight);
}

/* ---- grids: a walk through the blocks ----------------------------------------------------- */

/* Where a ray is in a grid (Amanatides & Woo 1987, over blocks). */
struct medium_walk {
    const struct world_medium *medium;
    struct vec3 origin, direction;    /* in cells, per metre */
    real t, until, end;              /* metres: now, end of the block, end of the walk */
    int32_t block[3];
    real majorant;                   /* density, of the block */
    uint32_t steps;
};

static real medium_component(struct vec3 v, int axis)
{
    return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

/* Find where the ray leaves the block, and the block's majorant. */
static void medium_walk_enter(struct medium_walk *walk)
{
    const struct world_medium *medium = walk->medium;
    real until = walk->end;

    for (int axis = 0; axis < 3; axis++) {
        real d = medium_component(walk->direction, axis);
        int32_t plane = (walk->block[axis] + (d > 0.0f)) * MEDIUM_BLOCK_SIDE;

        if (d != 0.0f)
            until = real_min(((real)plane - medium_component(walk->origin, axis)) / d, until);
    }
    walk->until = real_max(until, walk->t);
    walk->majorant = medium->block_max[((size_t)walk->block[2] * medium->blocks[1] +
                                        (size_t)walk->block[1]) *
                                           medium->blocks[0] +
                                       (size_t)walk->block[0]];
}

/* Step to the next block; 0 at the end. Every axis whose plane was met steps, so each call steps at
 * least one axis and the walk ends whatever the rounding. */
static int medium_walk_next(struct medium_walk *walk)
{
    const struct world_medium *medium = walk->medium;
    real nearest = INFINITY;
    real at[3];
    int stepped = -1;

    if (!(walk->until < walk->end))
        return 0;
    walk->t = walk->until;
    for (int axis = 0; axis < 3; axis++) {
        real d = medium_component(walk->direction, axis);
        int32_t plane = (walk->block[axis] + (d > 0.0f)) * MEDIUM_BLOCK_SIDE;

        at[axis] = d != 0.0f ? ((real)plane - medium_component(walk->origin, axis)) / d
                             : INFINITY;
        if (at[axis] < nearest) {
            nearest = at[axis];
            stepped = axis;
        }
    }
    if (stepped < 0)
        return 0;
    walk->block[stepped] += medium_component(walk->direction, stepped) > 0.0f ? 1 : -1;
    if (walk->block[stepped] < 0 || walk->block[stepped] >= (int32_t)medium->blocks[stepped])
        return 0;
    medium_walk_enter(walk);
    return 1;
}

/* 0: the ray misses the box. */
static int medium_walk_start(struct medium_walk *walk, const struct world_medium *medium,
                             const struct ray *ray)
{
    memset(walk, 0, sizeof *walk);
    walk->medium = medium;
    walk->origin = transform_point(&medium->to_cells, ray->origin);
    walk->direction = transform_vector(&medium->to_cells, ray->direction);
    walk->end = ray->t_max;
    for (int axis = 0; axis < 3; axis++) {
        real o = medium_component(walk->origin, axis), size = (real)medium->size[axis];
        real d = medium_component(walk->direction, axis), enter, leave;

        if (d == 0.0f && SAFEGUARD(GRID_AXIS)) {
            if (!(o >= 0.0f && o <= size))
                return 0;
            continue;
        }
        enter = ((d > 0.0f ? 0.0f : size) - o) / d;
        leave = ((d > 0.0f ? size : 0.0f) - o) / d;
        walk->t = real_max(enter, walk->t);
        walk->end = real_min(leave, walk->end);
    }
    if (!(walk->t < walk->end) || !(walk->end < INFINITY))
        return 0;
    for (int axis = 0; axis < 3; axis++) {
        real p = medium_component(walk->origin, axis) +
                  walk->t * medium_component(walk->direction, axis);
        int32_t last = (int32_t)medium->blocks[axis] - 1;

        p *= 1.0f / MEDIUM_BLOCK_SIDE;
        walk->block[axis] = p > 0.0f ? p < (real)last ? (int32_t)p : last : 0;
    }
    medium_walk_enter(walk);
    return 1;
}

/* Continue to the next tentative collision. `*depth` (optical depth for `rate` per density) is used
 * up from block to block. 0: the walk has ended. */
static int medium_walk_collide(struct medium_walk *walk, real rate, real *depth)
{
    for (;;) {
        real majorant = rate * walk->majorant;
        real room = walk->until - walk->t;

        if (majorant * room > *depth) {
            walk->t = real_min(walk->t + *depth / majorant, walk->until);
            walk->steps++;
            return 1;
        }
        *depth -= majorant * room;
        if (!medium_walk_next(walk))
            return 0;
    }
}

static real medium_lerp(real a, real b, real t)
{
    return a + (b - a) * t;
}

/* The density at the walk's position over the block's majorant, 0..1. Trilinear between the cells'
 * centres; within half a cell of the box's sides, the value of the outermost cells. */
static real medium_walk_density(const struct medium_walk *walk)
{
    const struct world_medium *medium = walk->medium;
    size_t low[3], high[3];
    real part[3], row[4];

    for (int axis = 0; axis < 3; axis++) {
        real p = medium_component(walk->origin, axis) +
                  walk->t * medium_component(walk->direction, axis) - 0.5f;
        real last = (real)(medium->size[axis] - 1);
        real whole;

        p = p > 0.0f ? real_min(p, last) : 0.0f;
        whole = (real)(int32_t)p;
        part[axis] = p - whole;
        low[axis] = (size_t)whole;
        high[axis] = low[axis] + (whole < last);
    }
    for (int k = 0; k < 4; k++) {
        size_t y = k & 1 ? high[1] : low[1], z = k & 2 ? high[2] : low[2];
        size_t start = (z * medium->size[1] + y) * medium->size[0];

        row[k] = medium_lerp(medium_density_at(medium->cells, start + low[0]),
                             medium_density_at(medium->cells, start + high[0]), part[0]);
    }
    row[0] = medium_lerp(medium_lerp(row[0], row[1], part[1]),
                         medium_lerp(row[2], row[3], part[1]), part[2]);
    /* Rounding may make either larger than the other. */
    return real_min(row[0] / walk->majorant, 1.0f);
}

/* ---- grids: tracking ---------------------------------------------------------------------- */

/* Delta tracking with one channel's probabilities. `through` holds, for all three channels, the
 * products of the null collisions' probabilities. The majorant's part is common to them and
 * cancels, so with the balance heuristic no weight exceeds 3 (Miller et al. 2019, section 5). */
static void medium_sample_grid(const struct world_medium *medium, const struct ray *ray, real u,
                               struct medium_random *random, struct medium_event *out)
{
    int chosen = medium->chromatic ? medium_channel(&u) : 0;
    real rate = medium->emits ? medium->glow_rate : medium->extinction_max;
    real through[3] = {1, 1, 1}, emitted[3] = {0, 0, 0};
    real depth = medium_depth_of(u);
    struct medium_walk walk;

    out->scattered = 0;
    if (medium_walk_start(&walk, medium, ray))
        while (!out->scattered && medium_walk_collide(&walk, rate, &depth)) {
            real density = medium_walk_density(&walk), mean, most = 0.0f;

            if (walk.steps >= MEDIUM_STEPS_MAX) {
                health_note(HEALTH_GUARDED_PATHS);
                through[0] = through[1] = through[2] = 0.0f;
                break;
            }
            mean = (through[0] + through[1] + through[2]) * (1.0f / REAL(3.0));
            if (medium->emits)
                for (int c = 0; c < 3; c++)
                    emitted[c] = real_min(emitted[c] + through[c] / mean * density *
                                                            medium->glow[c],
                                           MEDIUM_RADIANCE_MAX);
            density /= rate;
            if (medium_next(random) < medium->extinction[chosen] * density) {
                out->scattered = 1;
                break;
            }
            for (int c = 0; c < 3; c++) {
                through[c] *= real_max(1.0f - medium->extinction[c] * density, 0.0f);
                most = real_max(through[c], most);
            }
            /* Only their ratios matter: a long walk must not underflow. */
            for (int c = 0; c < 3; c++)
                through[c] /= most;
            depth = medium_depth_of(medium_next(random));
        }
    out->distance = out->scattered ? walk.t : ray->t_max;
    {
        real weight[3], mean = 0.0f;

        for (int c = 0; c < 3; c++)
            mean += (out->scattered ? medium->extinction[c] : 1.0f) * through[c];
        mean *= 1.0f / REAL(3.0);
        for (int c = 0; c < 3; c++)
            weight[c] = mean > 0.0f ? (out->scattered ? medium->scattering[c] : 1.0f) *
                                          through[c] / mean
                                    : 0.0f;
        out->weight = medium_vec(weight);
    }
    out->emitted = medium_vec(emitted);
}

/* Ratio tracking. Adds what the segment emits unless `emitted` is NULL. */
static struct vec3 medium_ratio_track(const struct world_medium *medium, const struct ray *ray,
                                      real u, struct medium_random *random, real *emitted)
{
    real rate = emitted ? medium->glow_rate : medium->extinction_max;
    real through[3] = {1, 1, 1}, most = 1.0f;
    real depth = medium_depth_of(u);
    struct medium_walk walk;

    if (!medium_walk_start(&walk, medium, ray))
        return medium_vec(through);
    while (most > 0.0f && medium_walk_collide(&walk, rate, &depth)) {
        real density = medium_walk_density(&walk);

        if (walk.steps >= MEDIUM_STEPS_MAX) {
            health_note(HEALTH_GUARDED_PATHS);
            return (struct vec3){0, 0, 0};
        }
        most = 0.0f;
        for (int c = 0; c < 3; c++) {
            if (emitted)
                emitted[c] = real_min(emitted[c] + through[c] * density * medium->glow[c],
                                       MEDIUM_RADIANCE_MAX);
            through[c] *= real_max(1.0f - medium->extinction[c] * density / rate, 0.0f);
            most = real_max(through[c], most);
        }
        if (most < MEDIUM_ROULETTE_BELOW) {
            real factor = medium_next(random) < 0.5f ? 2.0f : 0.0f;

            for (int c = 0; c < 3; c++)
                through[c] *= factor;
            most *= factor;
        }
        depth = medium_depth_of(medium_next(random));
    }
    return medium_vec(through);
}

/* ---- what paths call ----------------------------------------------------------------------- */

void medium_sample(const struct world_medium *medium, const struct ray *ray, real first,
                   struct medium_random *random, struct medium_event *out)
{
    real t_max = ray->t_max > 0.0f ? ray->t_max : 0.0f;

    out->emitted = (struct vec3){0, 0, 0};
    if (medium->size[0]) {
        real emitted[3] = {0, 0, 0};

        PROFILE_EFFECT(MEDIUM_GRID);
        if (medium->scatters) {
            medium_sample_grid(medium, ray, first, random, out);
            return;
        }
        out->scattered = 0;
        out->distance = t_max;
        out->weight = medium_ratio_track(medium, ray, first, random, medium->emits ? emitted : NULL);
        out->emitted = medium_vec(emitted);
        return;
    }
    if (medium->emits)
        out->emitted = medium_homogeneous_emission(medium, t_max);
    if (medium->scatters) {
        medium_sample_homogeneous(medium, t_max, first, out);
        return;
    }
    out->scattered = 0;
    out->distance = t_max;
    out->weight = (struct vec3){medium_beer(medium->extinction[0], t_max),
                                medium_beer(medium->extinction[1], t_max),
                                medium_beer(medium->extinction[2], t_max)};
}

struct vec3 medium_transmittance(const struct world_medium *medium, const struct ray *ray,
                                 struct medium_random *random)
{
    real t_max = ray->t_max > 0.0f ? ray->t_max : 0.0f;

    if (medium->size[0]) {
        PROFILE_EFFECT(MEDIUM_GRID);
        return medium_ratio_track(medium, ray, medium_next(random), random, NULL);
    }
    return (struct vec3){medium_beer(medium->extinction[0], t_max),
                         medium_beer(medium->extinction[1], t_max),
                         medium_beer(medium->extinction[2], t_max)};
}

/* 1 + g^2 - 2 g cos, as a sum of two terms >= 0, so that it does not cancel where it is smallest. */
static real medium_phase_base(real strength, real near_one, real along)
{
    if (!SAFEGUARD(MEDIUM_PHASE))
        return 1.0f + strength * strength - 2.0f * strength * along;
    return near_one * near_one + 2.0f * strength * (1.0f - along);
}

/* Henyey & Greenstein 1941. */
real medium_phase(const struct world_medium *medium, real cosine)
{
    real strength = real_abs(medium->g);
    real along = medium->g < 0.0f ? -cosine : cosine;
    real near_one = 1.0f - strength, d;

    along = along < -1.0f ? -1.0f : real_min(along, 1.0f);
    d = medium_phase_base(strength, near_one, along);
    return near_one * (1.0f + strength) / (d * real_sqrt(d)) * (0.25f * REAL_INV_PI);
}

/* The inverse of the cumulative distribution with 1 / g factored out: at g = 0 it is 2 u - 1
 * without a special case. In double: near |g| = 1 its terms cancel. */
static double medium_phase_cosine(double g, double u)
{
    double x = 2.0 * u - 1.0, rest = (1.0 - x) * (1.0 + x), d = 1.0 + g * x;
    double cosine = (x * (1.0 + g * g) + 0.5 * g * (3.0 + x * x) - 0.5 * g * g * g * rest) / (d * d);

    return cosine < -1.0 ? -1.0 : cosine > 1.0 ? 1.0 : cosine;
}

struct vec3 medium_phase_sample(const struct world_medium *medium, struct vec3 direction, real u,
                                real v)
{
    double cosine = medium_phase_cosine((double)medium->g, (double)u);
    real sine = (real)sqrt((1.0 - cosine) * (1.0 + cosine)), s, c;
    struct basis frame = basis_from_normal(direction);

    real_sincos(2.0f * REAL_PI * v, &s, &c);
    return vec3_normalize(basis_to_world(&frame, (struct vec3){sine * c, sine * s, (real)cosine}));
}
