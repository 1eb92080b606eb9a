/* render_motion: where a moving instance is at a moment of the shutter. Private to worker/render.
 *
 * These functions compute from the steps what Embree computes from them, except for rounding: matrices and vertices are
 * interpolated linearly between steps. Code that evaluates a hit again calls these; they cost nothing if nothing moves.
 */
#pragma once

#include "worker/render/base/gate.h"
#include "worker/render/render_scene.h"

/* Does the instance move while the shutter is open? */
static inline int instance_is_moving(const struct render_instance *instance)
{
    return calls_for(EFFECTS_ALL, EFFECT_MOTION_BLUR) && instance->motion_steps > 0;
}

/* The instance's matrix at `time`, interpolated between steps, in double. */
static inline struct transform_d motion_matrix(const struct render_instance *instance, real time)
{
    struct transform_d out;
    real f;
    uint32_t segment = motion_segment(time, instance->motion_steps, &f);
    const struct transform *a = &instance->motion_to_world[segment], *b = a + 1;

    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out.m[r][c] = (1 - (double)f) * (double)a->m[r][c] + (double)f * (double)b->m[r][c];
    return out;
}

static inline void motion_transformed(const struct transform_d *m, const float32 *p, double out[3])
{
    for (int a = 0; a < 3; a++)
        out[a] = m->m[a][0] * (double)p[0] + m->m[a][1] * (double)p[1] + m->m[a][2] * (double)p[2] + m->m[a][3];
}

static inline void motion_corners(const struct render_mesh *mesh, const struct render_instance *instance,
                                  const uint32_t vertex[3], real time, double corner[3][3])
{
    if (instance->motion_positions) {
        real f;
        uint32_t segment = motion_segment(time, instance->motion_steps, &f);
        const float32 *from = instance->motion_positions[segment];
        const float32 *to = instance->motion_positions[segment + 1];
        for (int k = 0; k < 3; k++)
            for (int a = 0; a < 3; a++) {
                size_t i = 3 * (size_t)vertex[k] + (size_t)a;
                corner[k][a] = (1 - (double)f) * (double)from[i] + (double)f * (double)to[i];
            }
    } else {
        struct transform_d m = motion_matrix(instance, time);
        for (int k = 0; k < 3; k++)
            motion_transformed(&m, mesh->positions + 3 * (size_t)vertex[k], corner[k]);
    }
}

/* The corners of the triangle with these vertices in world space at `time`; exact for what is
 * baked and stands still. */
static inline void corners_of_triangle(const struct render_scene *scene, const struct render_instance *instance,
                                       const uint32_t vertex[3], real time, double corner[3][3])
{
    const struct render_mesh *mesh = &scene->meshes[instance->mesh];

    if (instance_is_moving(instance)) {
        motion_corners(mesh, instance, vertex, time, corner);
        return;
    }
    for (int k = 0; k < 3; k++) {
        if (instance->instance_positions) {
            const float32 *p = instance->instance_positions + 3 * (size_t)vertex[k];
            for (int a = 0; a < 3; a++)
                corner[k][a] = (double)p[a];
        } else {
            const float32 *p = mesh->positions + 3 * (size_t)vertex[k];
            for (int a = 0; a < 3; a++) {
                const real *row = instance->to_world.m[a];
                corner[k][a] = (double)row[0] * (double)p[0] + (double)row[1] * (double)p[1] +
                               (double)row[2] * (double)p[2] + (double)row[3];
            }
        }
    }
}

/* For the moving: see below. */
struct transform render_motion_to_object(const struct render_instance *instance, real time);
struct transform render_motion_to_world(const struct render_instance *instance, real time);

/* The instance's transforms at `time`, for normals and tangents. Of a skinned one, whose vectors
 * are the world's already, the identity. */
static inline struct transform instance_to_object_at(const struct render_instance *instance, real time)
{
    if (instance_is_moving(instance))
        return render_motion_to_object(instance, time);
    return instance->to_object;
}

static inline struct transform instance_to_world_at(const struct render_instance *instance, real time)
{
    if (instance_is_moving(instance))
        return render_motion_to_world(instance, time);
    return instance->to_world;
}

/* The mesh's vertex normals and tangents as the frame has them at the shutter's opening: deformed
 * or not; NULL: none. */
static inline const float32 *instance_normals(const struct render_instance *instance, const struct render_mesh *mesh)
{
    if (instance->deformed_normals)
        return instance->deformed_normals;
    return mesh->normals;
}

static inline const float32 *instance_tangents(const struct render_instance *instance, const struct render_mesh *mesh)
{
    if (instance->deformed_tangents)
        return instance->deformed_tangents;
    return mesh->tangents;
}
