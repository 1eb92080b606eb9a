#include "worker/render/path/interior.h"

#include <string.h>

#include "worker/render/path/crossing.h"
#include "worker/render/path/path.h"

/* The search looks at this many boundaries at most. */
enum { CROSSINGS_MAX = 1024 };

static void cross(struct interior *entered, struct interior *left, uint32_t body, int front)
{
    if (front)
        interior_add(entered, body);
    else if (!interior_remove(entered, body))
        interior_add(left, body);
}

void interior_find_camera(struct render_scene *scene)
{
    static const struct sampler any;
    const struct transform *view = &scene->camera.to_world;
    /* Any direction works; this one is unlikely to be parallel to a wall of a modelled room. */
    struct ray ray = {.origin = {view->m[0][3], view->m[1][3], view->m[2][3]},
                      .direction = {REAL(0.48), REAL(0.64), REAL(0.6)}, .t_max = INFINITY};
    struct path_query query = {&any, 0};
    struct interior entered = {0}, left = {0};
    struct crossing_group group;
    struct surface s;
    struct hit hit;

    memset(&scene->camera_interior, 0, sizeof scene->camera_interior);
    scene->camera_interior.medium = scene->fog;
    if (scene->volume_rule != VOLUMES_NESTED)
        return;
    for (int i = 0; i < CROSSINGS_MAX && accel_intersect(scene->accel, &ray, &query, &hit); i++) {
        surface_from_hit(scene, &ray, &hit, &s);
        /* In a mix, the part that bounds a volume counts. */
        s.material = interior_filling(scene, s.instance->material);
        crossing_gather(scene, &ray, &query, 0, &s, &group);
        for (uint32_t k = 0; k < group.count; k++)
            cross(&entered, &left, group.faces[k].instance->body, group.faces[k].front);
        surface_leave(&s, ray.direction, &ray);
        query.ray_number++;
    }
    /* An open or inward-wound mesh may be left first and entered later. */
    for (uint32_t i = 0; i < entered.count; i++)
        interior_remove(&left, entered.entry[i]);
    /* The body that the ray leaves first is the innermost: it was entered last. */
    for (uint32_t i = left.count; i-- > 0;)
        interior_add(&scene->camera_interior, left.entry[i]);
}
