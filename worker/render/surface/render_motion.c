#include "worker/render/surface/render_motion.h"

static const struct transform identity = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};

struct transform render_motion_to_world(const struct render_instance *instance, real time)
{
    struct transform_d m;

    if (!instance->motion_to_world)
        return instance->skinned ? identity : instance->to_world;
    m = motion_matrix(instance, time);
    return transform_from_d(&m);
}

struct transform render_motion_to_object(const struct render_instance *instance, real time)
{
    struct transform_d m, inverse;

    if (!instance->motion_to_world)
        return instance->skinned ? identity : instance->to_object;
    m = motion_matrix(instance, time);
    transform_d_invert(&m, &inverse); /* flat at this moment: the identity, as at rest */
    return transform_from_d(&inverse);
}

void triangle_exact_corners(const void *scene_, uint32_t instance_index, uint32_t triangle, real time,
                            double corner[3][3])
{
    const struct render_scene *scene = scene_;
    const struct render_instance *instance = &scene->instances[instance_index];

    corners_of_triangle(scene, instance, triangle_vertices(&scene->meshes[instance->mesh], triangle), time, corner);
}
