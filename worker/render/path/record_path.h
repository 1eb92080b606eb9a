/* record_path: the hooks that look at a whole path or vertex (record_hooks.h). Private to path*.c. */
#ifndef AZULEJO_RENDER_RECORD_PATH_H
#define AZULEJO_RENDER_RECORD_PATH_H

#include "worker/render/path/interior.h"
#include "worker/render/path/path_parts.h"

#if KERNEL_RECORDS

_Static_assert((int)RECORD_BODIES_MAX >= (int)INTERIOR_MAX, "a record holds all bodies that a path is in");

/* The ray has been traced; v->s is valid if it met something. */
static void record_begin(const struct path *path, int met, const struct path_vertex *v)
{
    struct record_vertex *r = record_vertex_next();

    if (!r)
        return;
    r->kind = met ? RECORD_SURFACE : RECORD_ESCAPE;
    r->depth = path->depth;
    r->throughput = path->throughput;
    r->t = met ? v->s.t : INFINITY;
    for (uint32_t i = 0; i < path->interior.count; i++) {
        r->bodies[i].material = path->interior.entry[i] & ~INTERIOR_OWED;
        r->bodies[i].owed = (path->interior.entry[i] & INTERIOR_OWED) != 0;
    }
    r->body_count = path->interior.count;
}

/* Boundaries and mixes are resolved: what the vertex is is known. */
static void record_surface(const struct path *path, const struct path_vertex *v)
{
    const struct surface *s = &v->s;
    struct record_vertex *r = record_vertex();

    if (!r)
        return;
    r->p = world_outside(path->scene, s->p, s->rest);
    r->ng = s->ng;
    r->t = s->t;
    r->front = s->front;
    r->instance = (int32_t)(s->instance - path->scene->instances);
    r->mesh = (int32_t)s->instance->mesh;
    r->material = (int32_t)(s->material - path->scene->materials);
    r->triangle = s->triangle;
    r->throughput = path->throughput;
}

static int32_t record_medium(const struct path *path, const struct world_medium *medium)
{
    for (uint32_t i = 0; i < path->scene->medium_count; i++)
        if (path->scene->media[i] == medium)
            return (int32_t)i;
    return -1;
}

/* It is scattered, or ends, `t` metres along its ray. */
static void record_in_medium(const struct path *path, real t)
{
    struct record_vertex *r = record_vertex();

    if (!r)
        return;
    r->kind = RECORD_MEDIUM;
    r->p = t < INFINITY ? vec3_mad(path->ray.origin, path->ray.direction, t) : path->ray.origin;
    r->p = world_outside(path->scene, r->p, NULL);
    r->t = t;
}

static void record_direction(const struct path *path, struct vec3 weight, real pdf, int delta)
{
    struct record_vertex *r = record_vertex();

    if (!r)
        return;
    r->scattered = 1;
    r->direction = path->ray.direction;
    r->weight = weight;
    r->pdf = pdf;
    r->delta = delta;
}

static void record_light_found(const struct light_sample *light)
{
    struct record_vertex *r = record_vertex();

    if (!r)
        return;
    r->light.found = 1;
    r->light.direction = light->direction;
    r->light.distance = light->distance;
    r->light.radiance = light->radiance;
    r->light.pdf = light->pdf;
    r->light.delta = light->delta;
}

#endif

#endif
