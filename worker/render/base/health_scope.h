/* health_scope: where a rendering thread counts what went wrong (common/film/health.h).
 *
 * A guard that gives something up because it is not a usable number calls the function of its kind below, in the branch
 * that gives up: `if (!(pdf > 0)) return health_density(pdf);`. Most of what guards refuse is sound (a density of 0, a
 * direction below the horizon) and is not counted. What is usable pays nothing.
 *
 * The counters are the thread's own, as the profiler's place is: a lobe or a light does not know which sample it works
 * for. The pixel loop (tile.c) sets them up, and asks after each sample which kinds it noted. Outside of it nothing is
 * counted.
 */
#pragma once

#include <math.h>

#include "common/film/health.h"
#include "common/math/vec.h"

struct health_scope {
    uint64_t *count; /* [HEALTH_KINDS]; NULL: nothing is counted */
    uint32_t noted;  /* a bit per kind, since it was last cleared */
};
extern _Thread_local struct health_scope health_scope __attribute__((tls_model("local-exec")));

_Static_assert(HEALTH_KINDS <= 32, "health_scope.noted has a bit for each");

/* Count one of the kind. */
void health_note(enum health_kind kind) __attribute__((cold, noinline));

/* The guards' functions count a value that is not finite or out of range; all return 0, which is what
 * a guard returns. A density of 0 is sound. */
static inline int health_density(real pdf)
{
    if (!(pdf >= 0 && pdf < INFINITY))
        health_note(HEALTH_BAD_DENSITIES);
    return 0;
}

/* Of length 1, within 5 %. NaN is not. */
static inline int health_direction_is_good(struct vec3 w)
{
    real length2 = vec3_length_squared(w);

    return length2 > REAL(0.9) && length2 < REAL(1.1);
}

static inline int health_direction(struct vec3 w)
{
    if (!health_direction_is_good(w))
        health_note(HEALTH_BAD_DIRECTIONS);
    return 0;
}

/* The squared distance (m^2) to where a direction leads; 0 has none, which is sound. */
static inline int health_distance(real squared)
{
    if (!(squared >= 0 && squared < INFINITY))
        health_note(HEALTH_BAD_DIRECTIONS);
    return 0;
}

/* Weights, values of lobes, radiance of lights: finite and not negative. */
static inline int health_weight_is_good(struct vec3 w)
{
    return w.x >= 0 && w.y >= 0 && w.z >= 0 && w.x < INFINITY && w.y < INFINITY && w.z < INFINITY;
}

static inline int health_throughput(struct vec3 weight)
{
    if (!health_weight_is_good(weight))
        health_note(HEALTH_BAD_THROUGHPUTS);
    return 0;
}

/* What is scattered in a direction and its density, of which at least one was refused. */
void health_value(struct vec3 value, real pdf) __attribute__((cold, noinline));

static inline int health_basis(const struct basis *basis)
{
    if (!health_direction_is_good(basis->n) || !health_direction_is_good(basis->s) ||
        !health_direction_is_good(basis->t))
        health_note(HEALTH_BAD_BASES);
    return 0;
}
