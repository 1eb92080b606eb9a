/* path_sink: what is wanted of a path besides its radiance: the output variables of what the camera's ray
 * met, a record of the path (record.h), counters of what went wrong, and faults that tests ask for.
 *
 * The integrator (path.c) hands each vertex over once, complete, and the path at its end. Nothing here
 * changes what a path computes. Private to path.c.
 */
#pragma once

#include "worker/render/base/fault.h"
#include "worker/render/path/path_parts.h"
#include "worker/render/path/record_path.h"

/* What the camera's ray met, for the output variables. */
static __attribute__((noinline)) void sink_first_vertex(const struct path *path, struct path_vertex *v,
                                                        enum path_end end, struct path_record *record)
{
    const struct render_scene *scene = path->scene;
    const struct surface *s = &v->s;

    if (v->met == PATH_MET_ESCAPE)
        record->passed = (path->throughput.x + path->throughput.y + path->throughput.z) / 3;
    if (v->met != PATH_MET_SURFACE)
        return;
    if (end == PATH_DEPTH || end == PATH_UNLIT) /* it scatters nothing, so nothing has shaded it */
        surface_shade(scene, &v->s, vec3_neg(path->ray.direction), &v->params);
    record->hit = 1;
    record->distance = s->t;
    record->position = beyond_boundaries(scene, s->p, s->rest);
    record->normal = s->basis.n;
    record->albedo = v->params.base_color;
    record->instance = (uint32_t)(s->instance - scene->instances);
    record->material = (uint32_t)(s->material - scene->materials);
    record->triangle = surface_locate(scene, &v->s);
    record->b1 = s->b1;
    record->b2 = s->b2;
    surface_uv(s, &record->u, &record->v);
}

/* What a denoiser is guided by: mirrors and clear glass are looked through, up to the first vertex with a lobe that
 * has a density. `emitted`: what the path's radiance gained at the vertex other than by light sampling. */
static __attribute__((noinline)) void sink_features(const struct path *path, struct path_vertex *v, struct vec3 emitted,
                                                    enum path_end end, struct path_record *record)
{
    const int scattered = end == PATH_GOES_ON && v->dimension != DIMENSION_VERTEX + path->depth * DIMENSIONS_PER_VERTEX;
    const int unshaded = end == PATH_DEPTH || end == PATH_UNLIT;

    if (v->dimension == DIMENSION_VERTEX)
        record->weight = vec3_splat(1);
    if (v->met == PATH_MET_MEDIUM) { /* a cloud's light is as noisy as a wall's: it is none of an emitter */
        record->is_rough = 1;
        record->rough_albedo = record->weight;
        record->length += v->medium_t;
        return;
    }
    record->emission = vec3_add(record->emission, emitted);
    if (v->met == PATH_MET_ESCAPE) {
        record->is_rough = 1;
        record->length = 0;
        return;
    }
    record->length += v->s.t;
    if ((end == PATH_GOES_ON && !scattered) || end == PATH_BOUNDARIES) /* between equal indices: it is no surface */
        return;
    if (!unshaded && end != PATH_BEHIND && v->bsdf.has_delta && !v->bsdf.has_smooth) {
        if (scattered)
            record->weight = vec3_mul(record->weight, v->sample.weight);
        return;
    }
    if (unshaded && v->dimension != DIMENSION_VERTEX)
        surface_shade(path->scene, &v->s, vec3_neg(path->ray.direction), &v->params);
    record->is_rough = 1;
    record->rough_albedo = vec3_mul(record->weight, v->params.base_color);
    record->rough_normal = v->s.basis.n;
}

/* Not inlined: it would keep the vertex in memory for the sake of those that scatter nothing. */
static __attribute__((noinline)) void sink_unscattered(const struct basis *basis) { health_basis(basis); }

static inline void sink_vertex_begins(const struct path *path, struct path_vertex *v, struct path_notes *notes)
{
    notes->added[FROM_PATH] = vec3_splat(0);
    if (KERNEL_RECORDS) {
        record_vertex_begins(path, v, notes);
        light_pilot_vertex_begins(path);
    }
}

/* The path has met a surface, and the light that it emits is added. */
static inline void sink_sight(struct path *path)
{
    if (path->depth > 0 || path->tally.sight != SIGHT_NOTHING)
        return;
    path->tally.sight = SIGHT_SURFACE;
    path->tally.shone = vec3_luminance(path->radiance);
}

/* The vertex is complete. `record` may be NULL. */
static inline void sink_vertex(struct path *path, struct path_vertex *v, const struct path_notes *notes,
                               enum path_end end, struct path_record *record)
{
    if (record && v->dimension == DIMENSION_VERTEX)
        sink_first_vertex(path, v, end, record);
    if (record && path->scene->settings.aovs & (AOV_FEATURES | 1u << AOV_EMISSION) && !record->is_rough)
        sink_features(path, v, notes->added[FROM_PATH], end, record);
    if (end == PATH_BEHIND || end == PATH_ABSORBED) /* is that its basis' fault? */
        sink_unscattered(&v->s.basis);
    if (KERNEL_RECORDS) {
        record_vertex_ends(path, v, notes, end);
        light_pilot_vertex_ends(v, notes);
    }
    if (FAULT(NAN_DIRECTION))
        path->ray.direction = vec3_normalize(vec3_splat(NAN));
    if (FAULT(NAN_THROUGHPUT))
        path->throughput.x = NAN;
    if (FAULT(ENDLESS_PATH))
        path->depth = SETTINGS_DEPTH_MAX;
}

/* A lamp is what shines brighter than all that it reflects. */
static inline int sees_subject(const struct path *path)
{
    return path->tally.sight == SIGHT_MEDIUM ||
           (path->tally.sight == SIGHT_SURFACE && !(path->tally.shone > 0 && vec3_luminance(path->radiance) < 2 * path->tally.shone));
}

/* The path has ended. What it carries stays bad once it is, so it is looked at once, here. */
static inline void sink_path(const struct path *path, enum path_end end)
{
    const struct vec3 t = path->throughput;
    const real more = vec3_luminance(path->radiance) - path->tally.at_half;

    if (!(t.x + t.y + t.z < INFINITY))
        health_note(HEALTH_BAD_THROUGHPUTS);
    if (!(vec3_length_squared(path->ray.direction) > 0.5f)) /* of no number a normalised vector is 0 */
        health_note(HEALTH_BAD_DIRECTIONS);
    if (path->depth >= SETTINGS_DEPTH_MAX || end == PATH_BOUNDARIES)
        health_note(HEALTH_GUARDED_PATHS);
    /* What the path has brought since the mark of half the depth. */
    if (DEPTH_QUARTER + path->tally.marks > DEPTH_HALF && more > 0 && more < INFINITY)
        path->stats->work.depth.sum[DEPTH_GATHERED] += (double)more;
    path->stats->work.subject_samples += (uint64_t)sees_subject(path);
}
