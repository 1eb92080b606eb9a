/* path_on: does a path go on, and how wide is its beam behind a vertex? */
#include "worker/render/path/path_parts.h"

/* Russian roulette ends a path with a probability of at most 95 %. */
#define ROULETTE_SURVIVAL_MIN REAL(0.05)
/* After a scattering event the beam widens by this share of the spacing of such samples, and by at
 * most this much per metre. */
#define CONE_SHARE 0.25f
#define CONE_SPREAD_MAX 0.25f

__attribute__((noinline)) void path_mark(struct path *path)
{
    const uint32_t max = path->scene->settings.max_depth;
    const uint32_t marks[] = {max / 4, max / 2, max, UINT32_MAX};            /* of DEPTH_QUARTER, _HALF, _ENDED */
    const real carried = vec3_luminance(path->throughput) * path->eta_scale; /* as if it were outside of glass */

    for (; path->depth >= marks[path->tally.marks]; path->tally.marks++) {
        if (carried >= 0 && carried < INFINITY)
            path->stats->work.depth.sum[DEPTH_QUARTER + path->tally.marks] += (double)carried;
        if (DEPTH_QUARTER + path->tally.marks == DEPTH_HALF)
            path->tally.at_half = vec3_luminance(path->radiance);
    }
    path->tally.mark = marks[path->tally.marks];
}

/* What is left of the light. Radiance shrinks by eta^2 where it enters a denser medium, and grows
 * again where it leaves: that is no reason to end a path. */
static real path_left(const struct path *path)
{
    return vec3_max(path->throughput) * (SAFEGUARD(ROULETTE_ETA) ? path->eta_scale : 1);
}

/* This bounds the weight of what survives. */
static real at_least_survival(real survival)
{
    return SAFEGUARD(ROULETTE_FLOOR) ? real_max(survival, ROULETTE_SURVIVAL_MIN) : survival;
}

int russian_roulette(struct path *path, struct path_notes *notes, real u)
{
    real survival = path_left(path);

    if (survival < 1) {
        survival = at_least_survival(survival);
        notes->survival = survival;
        if (!(u < survival))
            return 0;
        path->throughput = vec3_scale(path->throughput, 1 / survival);
    }
    return 1;
}

void path_widen(struct path *path, real t)
{
    real spread;

    path->cone.width += t * path->cone.spread;
    if (path->specular || !(path->pdf > 0))
        return;
    spread = real_min(CONE_SHARE / real_sqrt(path->pdf), CONE_SPREAD_MAX);
    path->cone.spread = real_max(path->cone.spread, spread);
}
