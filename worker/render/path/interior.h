/* interior: which volumes a ray is inside.
 *
 * VOLUMES_NESTED. Refractive objects and media are bodies with a priority. Where several overlap, the one of highest
 * priority fills the space. Ties go to the one entered last, which is the innermost of nested bodies. Boundaries of the
 * others are ignored (Schmidt & Budge 2002, "Simple Nested Dielectrics in Ray Traced Images").
 *
 * A body is everything that one material bounds, wherever it is and in however many meshes: a hollow ball whose walls
 * are two primitives, a ball in two halves, water in two files. Its winding count is the number of its entries in the
 * list: a front face adds one, a back face removes the last one. There is a boundary only where the body on top of the
 * list changes. So overlapping parts of one body act as their union, a wall that is wound inwards ends the body, and
 * closed copies of one mesh far apart do not affect one another. (A separate body for each connected part would show
 * the faces of a part within another.) A mirroring transform also reverses the mesh's winding (surface.front), so it
 * changes nothing here. Meshes of several materials that are closed only together bound one body (scene_instance.body);
 * its interior follows the one material that fills it.
 * happens inside of it follows the one material that fills it.
 *
 * A back face of a body that the ray is not in (an open mesh, a wall wound inwards that sticks out) adds an owed entry,
 * which the next front face of the body removes. Both are boundaries unless the ray is in another body, so open meshes
 * look the same as without the count.
 *
 * VOLUMES_BOUNDARIES. There is no list: each face is a boundary and names the medium behind it.
 */
#pragma once

#include "common/base/safeguard.h"
#include "worker/render/base/fault.h"
#include "worker/render/base/health_scope.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* Marks an entry of a body that was left more often than entered. */
#define INTERIOR_OWED 0x80000000u
_Static_assert(SCENE_MATERIALS_MAX <= INTERIOR_OWED, "a material's row leaves the mark free");

/* What fills the body of an entry. */
static inline const struct render_material *interior_filling(const struct render_scene *scene, uint32_t entry)
{
    return &scene->materials[scene->materials[entry].filling];
}

/* The entry that fills the space: the highest priority, then the last entered. -1: none. */
static inline int interior_top(const struct render_scene *scene, const struct interior *in)
{
    int top = -1, highest = 0;

    for (uint32_t i = 0; i < in->count; i++) {
        int priority;
        if (in->entry[i] & INTERIOR_OWED)
            continue;
        priority = interior_filling(scene, in->entry[i])->m.priority;
        if (top < 0 || priority >= highest || !SAFEGUARD(BODY_PRIORITY)) {
            top = (int)i;
            highest = priority;
        }
    }
    return top;
}

/* The material that fills the body on top; NULL: none. */
static inline const struct render_material *interior_around(const struct render_scene *scene, const struct interior *in)
{
    int top = interior_top(scene, in);

    return top < 0 ? NULL : interior_filling(scene, in->entry[top]);
}

/* Its index of refraction. */
static inline real interior_ior(const struct render_scene *scene, const struct interior *in)
{
    const struct render_material *around = interior_around(scene, in);

    return around && around->m.kind == MATERIAL_SURFACE && around->m.refractive && around->m.ior >= 1 ? around->m.ior
                                                                                                      : 1;
}

/* Remove the last such entry. 0: there is none. */
static inline int interior_remove(struct interior *in, uint32_t entry)
{
    for (uint32_t i = in->count; i-- > 0;)
        if (in->entry[i] == entry) {
            for (uint32_t k = i + 1; k < in->count; k++)
                in->entry[k - 1] = in->entry[k];
            in->count--;
            return 1;
        }
    return 0;
}

/* When the list is full, entering is not recorded; leaving then finds no entry. */
static inline void interior_add(struct interior *in, uint32_t entry)
{
    if (in->count < INTERIOR_MAX)
        in->entry[in->count++] = entry;
    else
        health_note(HEALTH_LOST_BODIES);
}

/* Cross one face of a body. 0: the ray leaves it without having entered it. */
static inline int interior_turn(struct interior *in, uint32_t body, int enters)
{
    uint32_t paid = enters ? body | INTERIOR_OWED : body;

    if (!FAULT(LOST_BODY) && interior_remove(in, paid))
        return 1;
    if (enters || SAFEGUARD(BODY_OWED))
        interior_add(in, enters ? body : body | INTERIOR_OWED);
    return enters;
}

/* The volumes behind the surface. *is_boundary is 0 where the same body continues. */
static inline void interior_cross(const struct render_scene *scene, const struct interior *in, const struct surface *s,
                                  struct interior *out, int *is_boundary)
{
    const struct scene_material *m = &s->material->m;
    int before, after;

    *out = *in;
    *is_boundary = 1;
    if (scene->volume_rule == VOLUMES_BOUNDARIES) {
        if (m->medium != m->medium_outside)
            out->medium = s->front ? m->medium : m->medium_outside;
        return;
    }
    if (!interior_turn(out, s->instance->body, s->front) &&
        scene->materials[s->instance->body].flags & MATERIAL_ENCLOSES)
        health_note(HEALTH_LOST_BODIES); /* of open meshes it is sound */
    before = interior_top(scene, in);
    after = interior_top(scene, out);
    if (before >= 0 || after >= 0)
        *is_boundary = before < 0 || after < 0 || in->entry[before] != out->entry[after];
}

/* Find the bodies around the camera: those that a ray from it leaves more often than it enters.
 * Needs the accel; sets scene->camera_interior. */
void interior_find_camera(struct render_scene *scene);
