#include "worker/render/camera/view.h"

static struct vec3 point_at(const struct render_scene *scene, uint32_t instance, uint32_t triangle, real b1, real b2,
                            real time)
{
    struct vec3 corner[3];

    triangle_of_instance(scene, &scene->instances[instance], triangle, time, corner);
    return vec3_add(corner[0], vec3_add(vec3_scale(vec3_sub(corner[1], corner[0]), b1),
                                        vec3_scale(vec3_sub(corner[2], corner[0]), b2)));
}

void view_motion(const struct render_scene *scene, uint32_t instance, uint32_t triangle, real b1, real b2, real out[2])
{
    out[0] = out[1] = 0;
    camera_motion_vector(&scene->camera, point_at(scene, instance, triangle, b1, b2, 0),
                         point_at(scene, instance, triangle, b1, b2, 1), out);
}
