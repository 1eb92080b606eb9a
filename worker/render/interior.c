#include "worker/render/interior.h"

#include <string.h>

#include "worker/render/path.h"

/* Boundaries that the search looks at, at most. */
enum { CROSSINGS_MAX = 1024 };

void interior_find_camera(struct render_scene *scene)
{
    static const struct sampler nobody;
    const struct transform *view = &scene->camera.to_world;
    /* Any direction would do; one that no wall of a modelled room is parallel to. */
    struct ray ray = {.origin = {view->m[0][3], view->m[1][3], view->m[2][3]},
                      .direction = {0.48f, 0.64f, 0.6f}, .t_max = INFINITY};
    struct path_query query = {&nobody, 0};
    struct interior entered = {0};
    struct surface s;
    struct hit hit;

    memset(&scene->camera_interior, 0, sizeof scene->camera_interior);
    for (int i = 0; i < CROSSINGS_MAX && accel_intersect(scene->accel, &ray, &query, &hit); i++) {
        surface_from_hit(scene, &ray, &hit, &s);
        if (s.material->flags & MATERIAL_BOUNDS) {
            uint32_t material = (uint32_t)(s.material - scene->materials), before = entered.count;
            if (s.front) {
                interior_add(&entered, hit.instance, material);
            } else {
                interior_remove(&entered, hit.instance);
                if (entered.count == before)
                    interior_add(&scene->camera_interior, hit.instance, material);
            }
        }
        surface_leave(&s, ray.direction, &ray);
        query.ray_number++;
    }
}
