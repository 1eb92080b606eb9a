/* crossing: a ray passes a face of a volume, and all faces that coincide with it, as one event.
 *
 * Floats cannot separate faces closer than ACCEL_COINCIDENT_ULPS: liquid that fills its glass, stacked slabs. They are
 * crossed together. The ray leaves all of them, so each is crossed exactly once and no light is created or lost. It
 * refracts by the ratio of the indices before the first face and behind the last. An opaque face among them stops the
 * ray, which then has not left the volume that it is in: glass touches the table it stands on, with no air between.
 *
 * A thin wall among them lies on the outer side of the face that refracts, as a separate sheet with no air between. A
 * path meets the two one after the other at the same place: what goes from one towards the other meets it next, without
 * tracing a ray, and no light arrives from there. A wall on faces that do not refract is crossed together with them. Of
 * several walls at one place one counts. render_touch.h finds which faces may coincide with others when the scene is
 * built; at all other faces there is no search.
 */
#pragma once

#include <math.h>
#include <string.h>

#include "worker/render/base/exact.h"
#include "worker/render/base/gate.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/path/interior.h"
#include "worker/render/path/path.h"

/* Indices whose ratio differs from 1 by less than this count as equal. */
#define CROSSING_SAME_IOR 1e-6

struct crossing {
    struct interior beyond; /* the volumes behind the faces */
    int is_boundary;        /* there is a boundary */
    int together;           /* several faces are crossed; ior and ior_outside then hold: */
    real ior;               /* index on the inner side of the face that shades, relative to */
    real ior_outside;       /* the index on its outer side */
    int next_side;          /* not 0: if the path continues on that side of the face that shades (1:
                               the ray's side), it meets */
    struct hit next;        /* this face at the same place */
};

/* The faces that coincide where a ray met a face. */
struct crossing_group {
    struct surface faces[RAY_LEFT_MAX]; /* faces of volumes */
    struct surface wall;
    uint32_t count; /* of `faces` */
    int walled;     /* there is a thin wall */
    int stops;      /* an opaque face is among them */
};

static inline int crossing_touches(const struct surface *s)
{
    return s->instance->touches && s->instance->touches[s->triangle] && SAFEGUARD(CONTACT_TOGETHER);
}

/* Turn the hit into a surface. Near boundaries take the first of faces that lie close together.
 * Only faces that are crossed together may be met in any order: at a rim thinner than their
 * distance the ray would otherwise enter a body by the face that it leaves by. */
static inline void crossing_first(const struct render_scene *scene, const struct ray *ray,
                                  const struct path_query *query, struct hit *hit, struct surface *s)
{
    PROFILE_STAGE(SURFACE);
    surface_from_hit(scene, ray, hit, s);
    if (s->contacts && accel_refine(scene->accel, ray, query, (double)s->t, crossing_touches(s), hit))
        surface_from_hit(scene, ray, hit, s);
}

/* Are two faces parts of one sheet that is split into two meshes (a shared corner, met from the
 * same side)? Within one mesh, accel decides this. */
static inline int crossing_repeats(const struct render_scene *scene, const struct surface *a, const struct surface *b)
{
    double x[3][3], y[3][3];

    if (a->instance->body != b->instance->body || a->front != b->front)
        return 0;
    triangle_exact_corners(scene, a->number, a->triangle, a->time, x);
    triangle_exact_corners(scene, b->number, b->triangle, b->time, y);
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

/* Add the face to the group if it is of a kind that counts. */
static inline void crossing_add(struct crossing_group *group, const struct surface *face)
{
    if (face->material->flags & MATERIAL_BOUNDS) {
        group->faces[group->count++] = *face;
    } else if (!group->walled && (face->material->flags & MATERIAL_TWO_WAY)) {
        group->wall = *face;
        group->walled = 1;
    }
}

/* Collect the faces at `s` that are to be crossed, `s` first: volume faces that the ray has not left yet, and a thin
 * wall. If one of them is opaque, *s becomes it. All but *s are listed in s->others. */
static inline void crossing_gather(const struct render_scene *scene, const struct ray *ray,
                                   const struct path_query *query, real mix, struct surface *s,
                                   struct crossing_group *group)
{
    struct hit met = {s->number, s->triangle}, others[RAY_LEFT_MAX - 1];
    struct contact contacts[RAY_LEFT_MAX - 1];
    uint32_t found, kept = 0;
    double place[3];

    group->count = 0;
    group->stops = group->walled = 0;
    exact_vec(s->p, place);
    for (int a = 0; a < 3; a++)
        place[a] += s->rest[a];
    found = accel_coincident(scene->accel, ray, &met, place, query, contacts, RAY_LEFT_MAX - 1);
    if (found > RAY_LEFT_MAX - 1 || FAULT(CROWDED_PLACE))
        health_note(HEALTH_CROWDED_PLACES);
    crossing_add(group, s);
    for (uint32_t i = 0; i < found && i < RAY_LEFT_MAX - 1; i++) {
        struct surface face;
        int repeats = contacts[i].repeats;
        if (crossing_excepts(ray, &contacts[i].hit))
            continue;
        others[kept++] = contacts[i].hit;
        surface_from_hit(scene, ray, &contacts[i].hit, &face);
        surface_resolve_mix(scene, &face, mix);
        if (!group->stops && !(face.material->flags & (MATERIAL_BOUNDS | MATERIAL_TWO_WAY))) {
            *s = face;
            others[kept - 1] = met;
            group->stops = 1;
        }
        for (uint32_t k = 0; k < group->count && !repeats; k++)
            repeats = crossing_repeats(scene, &group->faces[k], &face);
        if (!repeats)
            crossing_add(group, &face);
    }
    s->other_count = kept;
    memcpy(s->others, others, kept * sizeof *others);
}

/* Order: a face that refracts before one that does not, then by priority, then by the body's row. */
static inline int crossing_precedes(const struct render_scene *scene, const struct surface *a, const struct surface *b)
{
    uint32_t body_a = a->instance->body, body_b = b->instance->body;
    int priority_a = interior_filling(scene, body_a)->m.priority;
    int priority_b = interior_filling(scene, body_b)->m.priority;

    if (crossing_refracts(a) != crossing_refracts(b))
        return crossing_refracts(a);
    return priority_a != priority_b ? priority_a > priority_b : body_a < body_b;
}

/* The face that shades: the one of higher priority among the bodies before and behind. Ties go to
 * the lower row, so that both directions of travel agree. -1: no boundary. */
static inline int crossing_choose(const struct render_scene *scene, const struct interior *in,
                                  const struct interior *out, const struct surface *faces, uint32_t count)
{
    int before = interior_top(scene, in), after = interior_top(scene, out), chosen = -1;
    uint32_t row[2] = {before < 0 ? UINT32_MAX : in->entry[before],
                       after < 0 ? UINT32_MAX : out->entry[after]};

    if (row[0] == row[1])
        return -1;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t body = faces[i].instance->body;
        if ((body == row[0] || body == row[1]) && (chosen < 0 || crossing_precedes(scene, &faces[i], &faces[chosen])))
            chosen = (int)i;
    }
    return chosen;
}

/* Bodies are not counted (VOLUMES_BOUNDARIES): multiply all indices. */
static inline int crossing_multiply(const struct surface *faces, uint32_t count, struct crossing *out)
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
    out->is_boundary = 1;
    if (chosen < 0) { /* bare interfaces, thin walls between media */
        out->together = 0;
        return 0;
    }
    out->is_boundary = fabs(ratio - 1) > CROSSING_SAME_IOR;
    out->ior = (real)(faces[chosen].front ? ratio : 1 / ratio);
    out->ior_outside = 1;
    return chosen;
}

/* Shade `face` instead of *s: swap the two in the list of faces to leave. */
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

/* Continue from *s, on the ray's side (1) or the other (-1), to another face at the same place. */
static inline void crossing_go_on(struct crossing *out, int side, const struct surface *next)
{
    out->next_side = side;
    out->next = (struct hit){next->number, next->triangle};
}

/* The wall on faces that were crossed, of which *s shades. A path from outside meets first what
 * lies before the wall. `between`: the path comes from the wall. */
static inline void crossing_wall(const struct interior *in, int between, struct surface *wall, struct surface *s,
                                 struct crossing *out)
{
    if (!out->is_boundary || s->material->m.kind == MATERIAL_INTERFACE) {
        crossing_shade(s, wall);
        out->is_boundary = 1;
        out->together = 0;
    } else if (between) {
        crossing_go_on(out, 1, wall);
    } else if (s->front) {
        crossing_go_on(out, -1, s);
        crossing_shade(s, wall);
        out->beyond = *in;
        out->together = 0;
    } else {
        crossing_go_on(out, -1, wall);
    }
}

/* Cross those of the faces that enter a body, or leave one. Counted bodies are entered first: leaving takes away a body's last
 * entry, so what lies across two halves of one body stays the innermost. Else the body that is entered last tells the medium. */
static inline void crossing_pass(const struct render_scene *scene, const struct crossing_group *group, int first,
                                 struct crossing *out)
{
    const int enters = (scene->volume_rule == VOLUMES_NESTED) == first;

    for (uint32_t i = 0; i < group->count; i++) {
        const struct interior before = out->beyond;
        if (group->faces[i].front == enters)
            interior_cross(scene, &before, &group->faces[i], &out->beyond, &out->is_boundary);
    }
}

/* Cross the face `s` that the ray met, with all faces that coincide. *s becomes the face that shades and lists the
 * others as faces to leave. `mix`: random number that chooses parts of mixes. `counted`: the indices follow the bodies
 * that the ray is in. `between`: the path comes from another face at this place (next_side). */
static inline void crossing_find(const struct render_scene *scene, const struct ray *ray,
                                 const struct path_query *query, real mix, int counted, int between,
                                 const struct interior *in, struct surface *s, struct crossing *out)
{
    struct crossing_group group;
    int chosen = 0;

    PROFILE_STAGE(SURFACE);
    out->together = out->next_side = 0;
    out->is_boundary = 1;
    out->beyond = *in;
    if (!crossing_touches(s)) {
        if (s->material->flags & MATERIAL_BOUNDS)
            interior_cross(scene, in, s, &out->beyond, &out->is_boundary);
        return;
    }
    crossing_gather(scene, ray, query, mix, s, &group);
    if (group.stops || group.count == 0)
        return;
    if (between && !(s->material->flags & MATERIAL_BOUNDS)) { /* from the faces to the wall */
        crossing_go_on(out, 1, &group.faces[0]);
        return;
    }
    if (group.count == 1) {
        interior_cross(scene, in, &group.faces[0], &out->beyond, &out->is_boundary);
    } else {
        crossing_pass(scene, &group, 1, out);
        crossing_pass(scene, &group, 0, out);
        out->together = 1;
        chosen = counted ? crossing_choose(scene, in, &out->beyond, group.faces, group.count)
                         : crossing_multiply(group.faces, group.count, out);
        if (counted)
            out->is_boundary = chosen >= 0;
    }
    crossing_shade(s, &group.faces[chosen > 0 ? chosen : 0]);
    if (counted && out->together) {
        out->ior = interior_ior(scene, s->front ? &out->beyond : in);
        out->ior_outside = interior_ior(scene, s->front ? in : &out->beyond);
    }
    if (group.walled)
        crossing_wall(in, between, &group.wall, s, out);
}
