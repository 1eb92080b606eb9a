/* path_trace: a path's rays, and the safeguard for rays that slip out of a closed mesh. */
#include "common/system/clock.h"
#include "worker/render/base/exact.h"
#include "worker/render/path/kernel.h"
#include "worker/render/path/path_parts.h"

/* ---- the safeguard: a ray that starts inside a closed mesh cannot escape --------------------- */

/* Is any of the volumes that the ray is in closed? A medium without a list of bodies has no mesh;
 * it counts as closed if the ray starts within it. */
static int starts_inside(const struct render_scene *scene, const struct interior *in, const struct ray *ray)
{
    if (scene->volume_rule == VOLUMES_BOUNDARIES)
        return in->medium >= 0 && in->medium != scene->fog && ray->left_count == 0;
    for (uint32_t i = 0; i < in->count && SAFEGUARD(LEAK_OF_BODY); i++)
        if (!(in->entry[i] & INTERIOR_OWED) && (scene->materials[in->entry[i]].flags & MATERIAL_ENCLOSES))
            return 1;
    return 0;
}

/* Can is_enclosed be true in this scene? Evaluated for every ray that escapes. */
static inline int may_leak(const struct render_scene *scene, const struct interior *in, const struct ray *ray)
{
    return scene->enclosed || (calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS) && (in->count > 0 || in->medium >= 0)) ||
           (ray->left_count > 0 && scene->instances[ray->left[0].instance].encloses);
}

/* Does the ray start inside a closed mesh? Such a ray cannot escape: if it does, it has slipped
 * through a vertex (docs/NUMERICS.md). `in`: the volumes that it is in. */
static int is_enclosed(const struct render_scene *scene, const struct interior *in, const struct ray *ray)
{
    const struct render_instance *instance;
    double corner[3][3], n[3], direction[3];

    if (ray->t_max < INFINITY)
        return 0; /* it reached its end */
    if (scene->enclosed || (calls_for(EFFECTS_ALL, COINCIDENT_EFFECTS) && starts_inside(scene, in, ray)))
        return 1;
    if (ray->left_count == 0)
        return 0;
    instance = &scene->instances[ray->left[0].instance];
    if (!instance->encloses || !SAFEGUARD(LEAK_OF_FACE))
        return 0;
    triangle_exact_corners(scene, ray->left[0].instance, ray->left[0].triangle, ray->time, corner);
    exact_normal(corner, n);
    exact_vec(ray->direction, direction);
    return instance->flipped ? exact_dot(n, direction) > 0 : exact_dot(n, direction) < 0;
}

/* Trace an escaped ray again. 0: it did escape. Kept out of the main code path, but not marked
 * `cold`: the compiler would treat all that follows an escape as cold, too. */
static __attribute__((noinline)) int leaked(const struct path *path, const struct interior *in, const struct ray *ray,
                                            struct hit *hit)
{
    if (!is_enclosed(path->scene, in, ray) || !accel_intersect_enclosed(path->scene->accel, ray, &path->query, hit))
        return 0;
    path->stats->work.leaked_rays++;
    return 1;
}

/* The same for a shadow ray that nothing blocked. */
static __attribute__((noinline)) int leaked_shadow(const struct path *path, const struct ray *ray)
{
    if (!is_enclosed(path->scene, &path->interior, ray) ||
        !accel_occluded_enclosed(path->scene->accel, ray, &path->query))
        return 0;
    path->stats->work.leaked_rays++;
    return 1;
}

/* ---- rays ------------------------------------------------------------------------------------ */

static int intersects(const struct path *path, const struct interior *in, const struct ray *ray, struct hit *hit)
{
    return accel_intersect(path->scene->accel, ray, &path->query, hit) ||
           (may_leak(path->scene, in, ray) && leaked(path, in, ray, hit));
}

static int is_blocked(const struct path *path, const struct ray *ray)
{
    return accel_occluded(path->scene->accel, ray, &path->query) ||
           (!(ray->t_max < INFINITY) && may_leak(path->scene, &path->interior, ray) && leaked_shadow(path, ray));
}

/* Embree's time, if it is to be measured (render_measure_trace): less the start, plus the end. */
static inline void trace_starts(const struct path *path)
{
    PROFILE_STAGE(TRACE);
    path->stats->work.rays++;
    if (kernel_measures_trace)
        path->stats->trace_ns -= clock_monotonic_ns();
}

static inline void trace_ends(const struct path *path)
{
    if (kernel_measures_trace)
        path->stats->trace_ns += clock_monotonic_ns();
}

int path_trace(const struct path *path, const struct interior *in, const struct ray *ray, struct hit *hit)
{
    int met;

    trace_starts(path);
    met = intersects(path, in, ray, hit);
    trace_ends(path);
    return met;
}

int path_occluded(const struct path *path, const struct ray *ray)
{
    int blocked;

    trace_starts(path);
    blocked = is_blocked(path, ray);
    trace_ends(path);
    return blocked;
}
