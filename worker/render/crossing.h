/* crossing: a ray passes a face of a volume, and all that coincide with it, as one event.
 *
 * Faces closer than ACCEL_COINCIDENT_ULPS cannot be kept apart in floats: liquid that fills its
 * glass, stacked slabs. They are crossed at once. The ray leaves all of them, so each is crossed
 * exactly once, and light is neither made nor lost: what it refracts by is the ratio of the indices
 * before the first face and behind the last. An opaque face among them stops the ray, which has
 * then not left what it is in: glass on a table touches it without air.
 * Which faces have others at them is found when the scene is built (world_touch.h); elsewhere
 * nothing is looked for.
 */
#ifndef AZULEJO_RENDER_CROSSING_H
#define AZULEJO_RENDER_CROSSING_H

#include <math.h>
#include <string.h>

#include "worker/render/exact.h"
#include "worker/render/has.h"
#include "worker/render/interior.h"
#include "worker/render/path.h"

/* Indices whose ratio differs from 1 by less are one. */
#define CROSSING_SAME_IOR 1e-6

struct crossing {
    struct interior beyond; /* what the ray is in behind the faces */
    int real;               /* there is a boundary */
    int together;           /* several faces: then */
    float ior;              /* the index on the inner side of the one that shades, relative to */
    float ior_outside;      /* that on its outer side */
};

static inline int crossing_touches(const struct surface *s)
{
    return s->instance->touches && s->instance->touches[s->triangle];
}

/* Do two faces lie in one sheet, cut into two meshes: a corner in common, met from one side? Those
 * of one mesh the accel tells apart. */
static inline int crossing_repeats(const struct render_scene *scene, const struct surface *a,
                                   const struct surface *b)
{
    double x[3][3], y[3][3];

    if (a->instance->body != b->instance->body || a->front != b->front)
        return 0;
    world_exact_corners(scene, a->number, a->triangle, a->time, x);
    world_exact_corners(scene, b->number, b->triangle, b->time, y);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            if (memcmp(x[i], y[k], sizeof x[i]) == 0)
                return 1;
    return 0;
}

static inline int crossing_same(const struct hit *a, const struct hit *b)
{
    return a->instance == b->instance && a->triangle == b->triangle;
}

/* Does the ray start or end on the face? */
static inline int crossing_excepts(const struct ray *ray, const struct hit *face)
{
    for (uint32_t i = 0; i < ray->left_count; i++)
        if (crossing_same(&ray->left[i], face))
            return 1;
    return ray->reaches && crossing_same(&ray->end, face);
}

static inline int crossing_refracts(const struct surface *s)
{
    return s->material->m.kind == MATERIAL_SURFACE && s->material->m.refractive;
}

/* The faces at `s` that are to be crossed, itself first: volumes' faces that the ray has not left
 * yet. *stops: an opaque one is among them, which *s becomes. All but *s itself are put down in
 * s->others. */
static inline uint32_t crossing_gather(const struct render_scene *scene, const struct ray *ray,
                                       const struct path_query *query, float mix,
                                       struct surface *s, struct surface faces[RAY_LEFT_MAX],
                                       int *stops)
{
    struct hit met = {s->number, s->triangle}, others[RAY_LEFT_MAX - 1];
    struct contact contacts[RAY_LEFT_MAX - 1];
    uint32_t found, count = 0, kept = 0;
    double place[3];

    *stops = 0;
    exact_vec(s->p, place);
    for (int a = 0; a < 3; a++)
        place[a] += s->rest[a];
    found = accel_coincident(scene->accel, ray, &met, place, query, contacts, RAY_LEFT_MAX - 1);
    if (s->material->flags & MATERIAL_BOUNDS)
        faces[count++] = *s;
    for (uint32_t i = 0; i < found && i < RAY_LEFT_MAX - 1; i++) {
        struct surface *face = &faces[count];
        int repeats = contacts[i].repeats;
        if (crossing_excepts(ray, &contacts[i].hit))
            continue;
        others[kept++] = contacts[i].hit;
        surface_from_hit(scene, ray, &contacts[i].hit, face);
        surface_resolve_mix(scene, face, mix);
        if (!*stops && !(face->material->flags & (MATERIAL_BOUNDS | MATERIAL_TWO_WAY))) {
            *s = *face;
            others[kept - 1] = met;
            *stops = 1;
        }
        for (uint32_t k = 0; k < count && !repeats; k++)
            repeats = crossing_repeats(scene, &faces[k], face);
        if (!repeats && (face->material->flags & MATERIAL_BOUNDS))
            count++;
    }
    s->other_count = kept;
    memcpy(s->others, others, kept * sizeof *others);
    return count;
}

/* A face that refracts before one that does not, then by priority, then by the body's row. */
static inline int crossing_precedes(const struct render_scene *scene, const struct surface *a,
                                    const struct surface *b)
{
    uint32_t body_a = a->instance->body, body_b = b->instance->body;
    int priority_a = interior_filling(scene, body_a)->m.priority;
    int priority_b = interior_filling(scene, body_b)->m.priority;

    if (crossing_refracts(a) != crossing_refracts(b))
        return crossing_refracts(a);
    return priority_a != priority_b ? priority_a > priority_b : body_a < body_b;
}

/* The face that shades: of the bodies before and behind, that of the higher priority, of equals that
 * of the lower row, so that both ways are alike. -1: no boundary. */
static inline int crossing_choose(const struct render_scene *scene, const struct interior *in,
                                  const struct interior *out, const struct surface *faces,
                                  uint32_t count)
{
    int before = interior_top(scene, in), after = interior_top(scene, out), chosen = -1;
    uint32_t row[2] = {before < 0 ? UINT32_MAX : in->entry[before],
                       after < 0 ? UINT32_MAX : out->entry[after]};

    if (row[0] == row[1])
        return -1;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t body = faces[i].instance->body;
        if ((body == row[0] || body == row[1]) &&
            (chosen < 0 || crossing_precedes(scene, &faces[i], &faces[chosen])))
            chosen = (int)i;
    }
    return chosen;
}

/* Where bodies are not counted: the product of all indices. */
static inline int crossing_multiply(const struct surface *faces, uint32_t count,
                                    struct crossing *out)
{
    int chosen = -1;
    double ratio = 1;

    for (uint32_t i = 0; i < count; i++) {
        double ior = (double)faces[i].material->m.ior;
        if (!crossing_refracts(&faces[i]))
            continue;
        if (chosen < 0)
            chosen = (int)i;
        if (ior > 0)
            ratio *= faces[i].front ? ior : 1 / ior;
    }
    out->real = 1;
    if (chosen < 0) { /* bare interfaces, thin walls between media */
        out->together = 0;
        return 0;
    }
    out->real = fabs(ratio - 1) > CROSSING_SAME_IOR;
    out->ior = (float)(faces[chosen].front ? ratio : 1 / ratio);
    out->ior_outside = 1;
    return chosen;
}

/* Shade `face` instead of *s: of those to leave, it and *s change places. */
static inline void crossing_shade(struct surface *s, struct surface *face)
{
    const struct hit met = {s->number, s->triangle}, shading = {face->number, face->triangle};

    face->other_count = s->other_count;
    memcpy(face->others, s->others, sizeof s->others);
    for (uint32_t i = 0; i < face->other_count; i++)
        if (crossing_same(&face->others[i], &shading))
            face->others[i] = met;
    *s = *face;
}

/* Cross the face `s` that the ray met, with all that coincide; *s becomes the one that shades, and
 * knows the others as those to leave. `mix`: what decides between the parts of mixes. `counted`:
 * the indices follow the bodies that the ray is in. */
static inline void crossing_find(const struct render_scene *scene, const struct ray *ray,
                                 const struct path_query *query, float mix, int counted,
                                 const struct interior *in, struct surface *s,
                                 struct crossing *out)
{
    struct surface faces[RAY_LEFT_MAX];
    uint32_t count = 0;
    int chosen = 0, stops;

    out->together = 0;
    out->real = 1;
    out->beyond = *in;
    if (crossing_touches(s)) {
        count = crossing_gather(scene, ray, query, mix, s, faces, &stops);
        if (stops || count == 0)
            return;
    } else {
        if (s->material->flags & MATERIAL_BOUNDS)
            interior_cross(scene, in, s, &out->beyond, &out->real);
        return;
    }
    if (count == 1) {
        interior_cross(scene, in, &faces[0], &out->beyond, &out->real);
    } else {
        for (uint32_t i = 0; i < count; i++) {
            const struct interior before = out->beyond;
            interior_cross(scene, &before, &faces[i], &out->beyond, &out->real);
        }
        out->together = 1;
        chosen = counted ? crossing_choose(scene, in, &out->beyond, faces, count)
                         : crossing_multiply(faces, count, out);
        if (counted)
            out->real = chosen >= 0;
    }
    crossing_shade(s, &faces[chosen > 0 ? chosen : 0]);
    if (counted && out->together) {
        out->ior = interior_ior(scene, s->front ? &out->beyond : in);
        out->ior_outside = interior_ior(scene, s->front ? in : &out->beyond);
    }
}

#endif
