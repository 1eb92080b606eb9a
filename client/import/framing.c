#include <math.h>

#include "client/import/builder.h"
#include "common/math/elementary.h"

/* Vertical field of view of a camera that we choose, and where it stands: glTF assets face
 * +Z, so it looks from there, turned to the right and raised. */
static const float frame_fov_rad = 40 * PI_F / 180;
static const float frame_azimuth_rad = 30 * PI_F / 180;
static const float frame_elevation_rad = 22 * PI_F / 180;
/* A little air around the scene. */
static const double frame_margin = 1.06;

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static int normalize(double v[3])
{
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    double length;

    if (!(largest > 0) || !isfinite(largest))
        return 0;
    for (int i = 0; i < 3; i++)
        v[i] /= largest; /* neither under- nor overflow in the squares */
    length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; i++)
        v[i] /= length;
    return 1;
}

int transform_d_to_rigid(const struct transform_d *m, struct transform *out)
{
    double axis[3][3]; /* right, up, back */

    for (int i = 0; i < 3; i++) {
        axis[2][i] = m->m[i][2];
        axis[1][i] = m->m[i][1];
    }
    /* The viewing direction stays exact, up is made square to it; a mirrored node gives a
     * proper rotation all the same. */
    if (!normalize(axis[2]) || !normalize(axis[1]))
        return 0;
    cross(axis[1], axis[2], axis[0]);
    if (!normalize(axis[0]))
        return 0;
    cross(axis[2], axis[0], axis[1]);
    for (int i = 0; i < 3; i++) {
        for (int c = 0; c < 3; c++)
            out->m[i][c] = (float)axis[c][i];
        out->m[i][3] = (float)m->m[i][3];
    }
    return transform_is_finite(out);
}

/* How far from the centre the camera must stand for the corners of every instance's box to
 * be in the picture. `axes` are the camera's. */
static double distance_needed(const struct scene *scene, const double center[3],
                              const struct transform *axes, double tangent)
{
    double needed = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_mesh *mesh = &scene->meshes[scene->instances[i].mesh];
        const struct transform_d m = transform_to_d(&scene->instances[i].to_world);
        for (int corner = 0; corner < 8; corner++) {
            double at[3], seen[3];
            for (int r = 0; r < 3; r++) {
                at[r] = m.m[r][3] - center[r];
                for (int c = 0; c < 3; c++)
                    at[r] += m.m[r][c] *
                             (double)(corner >> c & 1 ? mesh->bounds_max[c] : mesh->bounds_min[c]);
            }
            for (int c = 0; c < 3; c++)
                seen[c] = at[0] * (double)axes->m[0][c] + at[1] * (double)axes->m[1][c] +
                          at[2] * (double)axes->m[2][c];
            /* In the frame when max(|x|, |y|) <= (distance - z) * tangent: a square one, so
             * that every landscape picture holds it. */
            needed = fmax(needed, seen[2] + fmax(fabs(seen[0]), fabs(seen[1])) *
                                                frame_margin / tangent);
        }
    }
    return needed > 0 && isfinite(needed) ? needed : 1;
}

void camera_frame_scene(const struct scene *scene, struct scene_camera *out)
{
    double center[3] = {0, 0, 0}, distance;
    struct transform_d view = transform_d_identity();
    float low[3], high[3], sin_a, cos_a, sin_e, cos_e;

    det_sincos(frame_azimuth_rad, &sin_a, &cos_a);
    det_sincos(frame_elevation_rad, &sin_e, &cos_e);
    view.m[0][2] = (double)(sin_a * cos_e);
    view.m[1][2] = (double)sin_e;
    view.m[2][2] = (double)(cos_a * cos_e);
    for (int i = 0; i < 3; i++)
        view.m[i][1] = i == 1;
    scene_camera_default(out);
    out->yfov_rad = frame_fov_rad;
    if (!transform_d_to_rigid(&view, &out->to_world)) /* constants: cannot happen */
        return;
    if (scene_bounds(scene, low, high))
        for (int i = 0; i < 3; i++)
            center[i] = ((double)low[i] + (double)high[i]) / 2;
    distance = distance_needed(scene, center, &out->to_world, (double)det_tan(frame_fov_rad / 2));
    for (int i = 0; i < 3; i++)
        out->to_world.m[i][3] = (float)(center[i] + view.m[i][2] * distance);
}
