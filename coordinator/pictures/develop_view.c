/* Where a frame's camera stands, and how fast frames follow each other, as other programs read it of a header. */
#include <math.h>
#include <string.h>

#include "common/math/elementary.h"
#include "common/scene/pose.h"
#include "coordinator/pictures/develop_parts.h"

/* World (the file's coordinates) to the camera's: x to the right, y up, z forward, as OpenEXR has it. */
static int world_to_camera(const struct scene *scene, const struct transform_d *to_world, double out[3][4])
{
    struct transform_d in;

    if (!transform_d_invert(to_world, &in))
        return 0;
    for (int r = 0; r < 3; r++) {
        double sign = r == 2 ? -1 : 1;
        out[r][3] = sign * in.m[r][3];
        for (int c = 0; c < 3; c++) {
            out[r][c] = sign * in.m[r][c];
            out[r][3] -= out[r][c] * scene->origin[c];
        }
    }
    return 1;
}

/* OpenEXR's vectors are rows. */
static void store_transposed(const double from[4][4], float out[16])
{
    for (int r = 0; r < 4; r++)
        for (int c = 0; c < 4; c++)
            out[4 * c + r] = (float)from[r][c];
}

static void find_matrices(struct development_view *view, const struct scene *scene, const struct scene_camera *camera,
                          const struct render_settings *s)
{
    const double aspect = (double)settings_whole_width(s) / (double)settings_whole_height(s);
    const int perspective = camera->kind == CAMERA_PERSPECTIVE;
    double half = perspective ? (double)det_tan((float)camera->yfov_rad * 0.5f) : (double)camera->ymag;
    double to_camera[4][4] = {{0}}, to_screen[4][4] = {{0}}, to_ndc[4][4] = {{0}};

    if (!world_to_camera(scene, &camera->to_world, to_camera))
        return;
    to_camera[3][3] = 1;
    store_transposed((const double(*)[4])to_camera, view->to_camera);
    view->has_camera = 1;
    if (camera->kind == CAMERA_PANORAMA)
        return; /* no matrix says it */
    to_screen[0][0] = 0.5 / (half * aspect);
    to_screen[1][1] = -0.5 / half;
    to_screen[0][perspective ? 2 : 3] = to_screen[1][perspective ? 2 : 3] = 0.5;
    /* With perspective the third coordinate becomes 1/z, so that the matrix has an inverse. */
    to_screen[2][perspective ? 3 : 2] = 1;
    to_screen[3][perspective ? 2 : 3] = 1;
    for (int r = 0; r < 4; r++)
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 4; k++)
                to_ndc[r][c] += to_screen[r][k] * to_camera[k][c];
    store_transposed((const double(*)[4])to_ndc, view->to_ndc);
    view->has_ndc = 1;
}

/* 24, 30000/1001, or thousandths. */
static void find_rate(struct development_view *view, double fps)
{
    double whole = round(fps), film = round(fps * 1.001);

    view->rate[0] = (int32_t)round(fps * 1000);
    view->rate[1] = 1000;
    if (fabs(fps - whole) < 1e-4) {
        view->rate[0] = (int32_t)whole;
        view->rate[1] = 1;
    } else if (fabs(fps - film / 1.001) < 1e-3) {
        view->rate[0] = (int32_t)film * 1000;
        view->rate[1] = 1001;
    }
}

status development_find_view(const struct development *d, struct development_view *view, struct error *err)
{
    struct scene_camera camera;
    struct scene_pose pose;
    double open_s, close_s;

    memset(view, 0, sizeof *view);
    find_rate(view, (double)d->settings.fps);
    if (!d->described || d->settings.camera >= d->description.camera_count)
        return STATUS_OK;
    scene_shutter(&d->description, &d->settings, d->frame, &open_s, &close_s);
    TRY(scene_pose_init(&pose, &d->description, open_s, err));
    pose_camera(&pose, &d->description, d->settings.camera, &camera);
    scene_pose_release(&pose);
    find_matrices(view, &d->description, &camera, &d->settings);
    return STATUS_OK;
}
