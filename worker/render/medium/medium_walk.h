/* medium_walk: a ray's way through a grid, block by block, each with the largest density in it.
 *
 * The walk stops at tentative collisions: with the majorant's density everywhere they would be all the
 * collisions there are. null_collisions.c says which of them are real. Every call steps on, so a walk ends
 * whatever the rounding. Private to null_collisions.c.
 */
#pragma once

#include <string.h>

#include "worker/render/medium/medium_data.h"

/* Where a ray is in a grid (Amanatides & Woo 1987, over blocks). */
struct medium_walk {
    const struct render_medium *medium;
    struct vec3 origin, direction; /* in cells, per metre */
    real t, until, end;            /* metres: now, end of the block, end of the walk */
    int32_t block[3];
    real majorant;  /* density, of the block */
    uint32_t steps; /* tentative collisions */
    int lost;       /* there were too many: the ray is absorbed */
};

static inline real medium_component(struct vec3 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

/* Find where the ray leaves the block, and the block's majorant. */
static inline void medium_walk_enter(struct medium_walk *walk)
{
    const struct render_medium *medium = walk->medium;
    real until = walk->end;

    for (int axis = 0; axis < 3; axis++) {
        real d = medium_component(walk->direction, axis);
        int32_t plane = (walk->block[axis] + (d > 0.0f)) * MEDIUM_BLOCK_SIDE;

        if (d != 0.0f)
            until = real_min(((real)plane - medium_component(walk->origin, axis)) / d, until);
    }
    walk->until = real_max(until, walk->t);
    walk->majorant =
        medium->block_max[((size_t)walk->block[2] * medium->blocks[1] + (size_t)walk->block[1]) * medium->blocks[0] +
                          (size_t)walk->block[0]];
}

/* Step to the next block; 0 at the end. Every axis whose plane was met steps, so each call steps at
 * least one axis and the walk ends whatever the rounding. */
static inline int medium_walk_next(struct medium_walk *walk)
{
    const struct render_medium *medium = walk->medium;
    real nearest = INFINITY;
    real at[3];
    int stepped = -1;

    if (!(walk->until < walk->end))
        return 0;
    walk->t = walk->until;
    for (int axis = 0; axis < 3; axis++) {
        real d = medium_component(walk->direction, axis);
        int32_t plane = (walk->block[axis] + (d > 0.0f)) * MEDIUM_BLOCK_SIDE;

        at[axis] = d != 0.0f ? ((real)plane - medium_component(walk->origin, axis)) / d : INFINITY;
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
static inline int medium_walk_start(struct medium_walk *walk, const struct render_medium *medium, const struct ray *ray)
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
        real p = medium_component(walk->origin, axis) + walk->t * medium_component(walk->direction, axis);
        int32_t last = (int32_t)medium->blocks[axis] - 1;

        p *= 1.0f / MEDIUM_BLOCK_SIDE;
        walk->block[axis] = p > 0.0f ? p < (real)last ? (int32_t)p : last : 0;
    }
    medium_walk_enter(walk);
    return 1;
}

/* Continue to the next tentative collision. `*depth` (optical depth for `rate` per density) is used
 * up from block to block. 0: the walk has ended; it may be lost. */
static inline int medium_walk_collide(struct medium_walk *walk, real rate, real *depth)
{
    for (;;) {
        real majorant = rate * walk->majorant;
        real room = walk->until - walk->t;

        if (majorant * room > *depth) {
            walk->t = real_min(walk->t + *depth / majorant, walk->until);
            walk->lost = ++walk->steps >= MEDIUM_STEPS_MAX;
            return !walk->lost;
        }
        *depth -= majorant * room;
        if (!medium_walk_next(walk))
            return 0;
    }
}

static inline real medium_lerp(real a, real b, real t) { return a + (b - a) * t; }

/* The density at the walk's position over the block's majorant, 0..1. Trilinear between the cells'
 * centres; within half a cell of the box's sides, the value of the outermost cells. */
static inline real medium_walk_density(const struct medium_walk *walk)
{
    const struct render_medium *medium = walk->medium;
    size_t low[3], high[3];
    real part[3], row[4];

    for (int axis = 0; axis < 3; axis++) {
        real p = medium_component(walk->origin, axis) + walk->t * medium_component(walk->direction, axis) - 0.5f;
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
    row[0] = medium_lerp(medium_lerp(row[0], row[1], part[1]), medium_lerp(row[2], row[3], part[1]), part[2]);
    /* Rounding may make either larger than the other. */
    return real_min(row[0] / walk->majorant, 1.0f);
}
