/* interior: which volumes a ray is inside of.
 *
 * Refractive objects and media are volumes with a priority. Where several overlap the one of the
 * highest priority is there, of equals the one entered last; boundaries of the others are none
 * (Schmidt & Budge 2002, "Simple Nested Dielectrics in Ray Traced Images").
 */
#ifndef AZULEJO_RENDER_INTERIOR_H
#define AZULEJO_RENDER_INTERIOR_H

#include "worker/render/surface.h"
#include "worker/render/world.h"

/* The entry that is really there: the highest priority, of equals the last entered; -1: none. */
static inline int interior_top(const struct render_scene *scene, const struct interior *in)
{
    int top = -1;

    for (uint32_t i = 0; i < in->count; i++)
        if (top < 0 || scene->materials[in->material[i]].m.priority >=
                           scene->materials[in->material[top]].m.priority)
            top = (int)i;
    return top;
}

static inline void interior_remove(struct interior *in, uint32_t instance)
{
    for (uint32_t i = in->count; i-- > 0;)
        if (in->instance[i] == instance) {
            for (uint32_t k = i + 1; k < in->count; k++) {
                in->instance[k - 1] = in->instance[k];
                in->material[k - 1] = in->material[k];
            }
            in->count--;
            return;
        }
}

/* Entering a volume more than the list holds forgets it: the leaving then finds none. */
static inline void interior_add(struct interior *in, uint32_t instance, uint32_t material)
{
    if (in->count < INTERIOR_MAX) {
        in->instance[in->count] = instance;
        in->material[in->count++] = material;
    }
}

/* What the ray is in beyond the surface; *real is 0 where one of higher priority goes on. */
static inline void interior_cross(const struct render_scene *scene, const struct interior *in,
                           const struct surface *s, struct interior *out, int *real)
{
    uint32_t instance = (uint32_t)(s->instance - scene->instances);
    uint32_t material = (uint32_t)(s->material - scene->materials);
    int top;

    *out = *in;
    if (s->front) {
        interior_add(out, instance, material);
        top = interior_top(scene, out);
        *real = top >= 0 && out->instance[top] == instance;
        return;
    }
    top = interior_top(scene, in);
    /* A volume that was never entered (the camera is in it) counts as the only one. */
    *real = top < 0 || in->instance[top] == instance;
    interior_remove(out, instance);
}

/* Find the volumes around the camera: those that a ray from it leaves more often than it enters.
 * Needs the accel; sets scene->camera_interior. */
void interior_find_camera(struct render_scene *scene);

#endif
