#include "coordinator/pictures/view.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/scene/move.h"
#include "common/scene/pose.h"
#include "common/scene/track.h"

/* To the camera's coordinates: x to the right, y up, z forward, as OpenEXR has it. */
static int find_to_camera(struct scene_view *view, const double origin[3], const struct transform_d *to_world)
{
    struct transform_d in;

    if (!transform_d_invert(to_world, &in))
        return 0;
    for (int r = 0; r < 3; r++) {
        const double sign = r == 2 ? -1 : 1;
        view->to_camera[r][3] = sign * in.m[r][3];
        for (int c = 0; c < 3; c++) {
            view->to_camera[r][c] = sign * in.m[r][c];
            view->to_camera[r][3] -= view->to_camera[r][c] * origin[c];
        }
    }
    view->to_camera[3][3] = 1;
    return 1;
}

static void find_to_screen(struct scene_view *view, const struct scene_camera *camera, const struct render_settings *s)
{
    const double aspect = (double)settings_whole_width(s) / (double)settings_whole_height(s);
    const int perspective = camera->kind == CAMERA_PERSPECTIVE;
    const double half = perspective ? (double)det_tan((float)camera->yfov_rad * 0.5f) : (double)camera->ymag;
    double screen[4][4] = {{0}};

    screen[0][0] = 0.5 / (half * aspect);
    screen[1][1] = -0.5 / half;
    screen[0][perspective ? 2 : 3] = screen[1][perspective ? 2 : 3] = 0.5;
    /* With perspective the third coordinate becomes 1/z, so that the matrix has an inverse. */
    screen[2][perspective ? 3 : 2] = 1;
    screen[3][perspective ? 2 : 3] = 1;
    for (int r = 0; r < 4; r++)
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 4; k++)
                view->to_screen[r][c] += screen[r][k] * view->to_camera[k][c];
    view->has_screen = 1;
}

static status pose_at(const struct scene *scene, const struct render_settings *settings, uint32_t frame,
                      struct scene_pose *pose, struct error *err)
{
    double open_s, close_s;

    scene_shutter(scene, settings, frame, &open_s, &close_s);
    return scene_pose_init(pose, scene, open_s, err);
}

status scene_view_find(const struct scene *scene, const struct render_settings *settings, uint32_t frame,
                       enum scene_space from, struct scene_view *view, struct error *err)
{
    static const double nowhere[3] = {0, 0, 0};
    struct scene_camera camera = {0};
    struct scene_pose pose = {0};
    struct scene at;
    status s;

    memset(view, 0, sizeof *view);
    if (settings->camera >= scene->camera_count)
        return STATUS_OK;
    s = scene_at_frame(&at, scene, settings, frame, err);
    THEN(s, pose_at(&at, settings, frame, &pose, err));
    if (s == STATUS_OK)
        pose_camera(&pose, &at, settings->camera, &camera);
    scene_pose_release(&pose);
    scene_copy_release(&at);
    TRY(s);
    view->has_camera = find_to_camera(view, from == SPACE_OF_FILE ? scene->origin : nowhere, &camera.to_world);
    if (view->has_camera && camera.kind != CAMERA_PANORAMA)
        find_to_screen(view, &camera, settings);
    return STATUS_OK;
}

/* Pixels from the whole picture's corner; 0: behind the camera. */
static int project(const struct scene_view *view, const struct render_settings *s, const double point[3], double out[2])
{
    double at[4];

    for (int r = 0; r < 4; r++)
        at[r] = view->to_screen[r][0] * point[0] + view->to_screen[r][1] * point[1] + view->to_screen[r][2] * point[2] +
                view->to_screen[r][3];
    if (!(at[3] > 0))
        return 0;
    out[0] = at[0] / at[3] * settings_whole_width(s);
    out[1] = at[1] / at[3] * settings_whole_height(s);
    return 1;
}

static int agree(const struct scene_view *a, const struct scene_view *b)
{
    return a->has_camera && b->has_camera && a->has_screen == b->has_screen &&
           memcmp(a->to_camera, b->to_camera, sizeof a->to_camera) == 0 &&
           memcmp(a->to_screen, b->to_screen, sizeof a->to_screen) == 0;
}

/* ---- from one frame to another --------------------------------------------------------------- */

/* An instance that is hidden by a scale of 0 in either frame stays where it is. */
static void find_moves(struct scene_way *way, const struct scene *scene, const struct scene_pose *here, const struct scene_pose *there)
{
    for (uint32_t i = 0; i < way->instance_count; i++) {
        const struct transform_d from = pose_instance(here, scene, i), to = pose_instance(there, scene, i);
        struct transform_d back;
        if (memcmp(&from, &to, sizeof from) == 0 || !transform_d_invert(&from, &back))
            continue;
        way->moves[i] = transform_d_multiply(&to, &back);
        way->moved[i] = 1;
        way->moved_count++;
    }
}

status scene_way_find(const struct scene *scene, const struct render_settings *settings, uint32_t from, uint32_t to,
                      struct scene_way *way, struct error *err)
{
    struct scene_pose here = {0}, there = {0};
    status s;

    memset(way, 0, sizeof *way);
    TRY(scene_view_find(scene, settings, from, SPACE_OF_SCENE, &way->here, err));
    TRY(scene_view_find(scene, settings, to, SPACE_OF_SCENE, &way->there, err));
    if (!way->here.has_camera)
        return STATUS_OK;
    way->instance_count = scene->instance_count;
    way->moves = mem_alloc_array(scene->instance_count + 1, sizeof *way->moves);
    way->moved = mem_calloc(scene->instance_count + 1, 1);
    NEED(way->moves && way->moved, err, "what moves");
    s = pose_at(scene, settings, from, &here, err);
    THEN(s, pose_at(scene, settings, to, &there, err));
    if (s == STATUS_OK)
        find_moves(way, scene, &here, &there);
    scene_pose_release(&there);
    scene_pose_release(&here);
    return s;
}

void scene_way_release(struct scene_way *way)
{
    mem_free(way->moved);
    mem_free(way->moves);
    memset(way, 0, sizeof *way);
}

int scene_way_camera_stands(const struct scene_way *way) { return agree(&way->here, &way->there); }

int scene_way_is_still(const struct scene_way *way) { return scene_way_camera_stands(way) && way->moved_count == 0; }

int scene_way_is_known(const struct scene_way *way)
{
    return scene_way_camera_stands(way) || (way->here.has_screen && way->there.has_screen);
}

/* A pixel's point lies anywhere in it: what it moves by is added to the pixel itself. */
static int64_t follow(const struct scene_way *way, const struct render_settings *s, const double point[3],
                      const double moved[3], uint32_t x, uint32_t y)
{
    double from[2], to[2], u, v;

    if (!project(&way->here, s, point, from) || !project(&way->there, s, moved, to))
        return -1;
    u = floor(x + to[0] - from[0] + 0.5);
    v = floor(y + to[1] - from[1] + 0.5);
    return u >= 0 && v >= 0 && u < s->width && v < s->height ? (int64_t)v * s->width + (int64_t)u : -1;
}

void scene_way_follow(const struct scene_way *way, const struct render_settings *settings, const float *positions,
                      const float *objects, int32_t *source)
{
    const size_t pixels = (size_t)settings->width * settings->height;

    for (size_t p = 0; p < pixels; p++) {
        const double point[3] = {(double)positions[p], (double)positions[pixels + p], (double)positions[2 * pixels + p]};
        const uint32_t number = objects && objects[p] > 0 ? (uint32_t)objects[p] : 0;
        double moved[3] = {point[0], point[1], point[2]};
        if (number > 0 && number <= way->instance_count && way->moved[number - 1])
            transform_d_point(&way->moves[number - 1], point, moved);
        source[p] = (int32_t)follow(way, settings, point, moved, (uint32_t)(p % settings->width), (uint32_t)(p / settings->width));
    }
}
