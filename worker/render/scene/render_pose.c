/* render_pose: the moments of a frame. */
#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "worker/render/scene/render_pose.h"

/* A chord may deviate from the path by this share of the size of what moves. */
#define CHORD_TOLERANCE REAL(1e-3)
/* The tolerance is at least this share of the coordinates: floats are no more precise. */
#define COORDINATE_TOLERANCE REAL(1e-6)

status poses_new(struct render_poses **out, const struct scene *scene, const struct render_settings *settings,
                 uint32_t frame, struct error *err)
{
    struct render_poses *poses = mem_calloc(1, sizeof *poses);
    double open_s, close_s;

    *out = NULL;
    NEED(poses, err, "the scene's poses");
    poses->scene = scene;
    scene_shutter(scene, settings, frame, &open_s, &close_s);
    if (scene->channel_count == 0 || (settings->without & EFFECT_MOTION_BLUR))
        close_s = open_s;
    do {
        double share = (double)poses->count / (RENDER_STEPS_MAX - 1);
        status s = scene_pose_init(&poses->at[poses->count], scene, open_s + share * (close_s - open_s), err);
        if (s != STATUS_OK) {
            poses_free(poses);
            return s;
        }
        poses->count++;
    } while (close_s > open_s && poses->count < RENDER_STEPS_MAX);
    *out = poses;
    return STATUS_OK;
}

void poses_free(struct render_poses *poses)
{
    if (!poses)
        return;
    for (uint32_t i = 0; i < poses->count; i++)
        scene_pose_release(&poses->at[i]);
    mem_free(poses);
}

/* Is every moment within `tolerance` of the chords between each `stride`-th? */
static int stride_fits(const float32 *const track[RENDER_STEPS_MAX], size_t points, uint32_t stride, real tolerance)
{
    for (uint32_t k = 0; k < RENDER_STEPS_MAX; k++) {
        const float32 *a = track[k / stride * stride], *b, *p = track[k];
        real f = (real)(k % stride) / (real)stride;
        if (k % stride == 0)
            continue;
        b = track[k / stride * stride + stride];
        for (size_t i = 0; i < points; i++) {
            real square = 0;
            for (size_t c = 3 * i; c < 3 * i + 3; c++) {
                real miss = (1 - f) * a[c] + f * b[c] - p[c];
                square += miss * miss;
            }
            if (!(square <= tolerance * tolerance))
                return 0;
        }
    }
    return 1;
}

static real largest_of(const float32 *values, size_t count)
{
    real largest = 0;

    for (size_t i = 0; i < count; i++)
        largest = real_max(real_abs(values[i]), largest);
    return largest;
}

uint32_t motion_stride(const float32 *const track[RENDER_STEPS_MAX], size_t points, real extent)
{
    real tolerance = CHORD_TOLERANCE * extent;
    real floor_ = COORDINATE_TOLERANCE *
                  real_max(largest_of(track[0], 3 * points), largest_of(track[RENDER_STEPS_MAX - 1], 3 * points));
    uint32_t stride = RENDER_STEPS_MAX - 1;

    while (stride > 1 && !stride_fits(track, points, stride, real_max(tolerance, floor_)))
        stride /= 2;
    return stride;
}

static void vec3_store(struct vec3 v, float32 out[3])
{
    out[0] = (float32)v.x;
    out[1] = (float32)v.y;
    out[2] = (float32)v.z;
}

void poses_camera(const struct render_poses *poses, uint32_t camera, struct scene_camera *out, struct transform *steps,
                  struct camera_motion *motion)
{
    struct transform at[RENDER_STEPS_MAX];
    float32 axes[RENDER_STEPS_MAX][9], place[RENDER_STEPS_MAX][3];
    real reach = 0;
    const float32 *axes_track[RENDER_STEPS_MAX], *place_track[RENDER_STEPS_MAX];
    uint32_t stride, other;
    int moves = 0;

    memset(motion, 0, sizeof *motion);
    pose_camera(&poses->at[0], poses->scene, camera, out);
    if (poses->count == 1)
        return;
    motion->shutter_open = 1;
    for (uint32_t k = 0; k < RENDER_STEPS_MAX; k++) {
        struct scene_camera posed;
        pose_camera(&poses->at[k], poses->scene, camera, &posed);
        at[k] = transform_from_d(&posed.to_world);
        moves |= memcmp(&at[k], &at[0], sizeof *at) != 0;
        for (int r = 0; r < 3; r++) {
            for (int c = 0; c < 3; c++)
                axes[k][3 * c + r] = (float32)at[k].m[r][c];
            place[k][r] = (float32)at[k].m[r][3];
            reach = real_max(reach, real_abs(place[k][r] - place[0][r]));
        }
        axes_track[k] = axes[k];
        place_track[k] = place[k];
    }
    if (!moves)
        return;
    stride = motion_stride(axes_track, 3, 1);
    other = motion_stride(place_track, 1, reach);
    stride = stride < other ? stride : other;
    motion->steps = (RENDER_STEPS_MAX - 1) / stride + 1;
    motion->to_world = steps;
    for (uint32_t k = 0; k < motion->steps; k++)
        steps[k] = at[k * stride];
}

void poses_light(const struct render_poses *poses, uint32_t light, struct scene_light *out)
{
    pose_light(&poses->at[0], poses->scene, light, out);
}

uint32_t poses_light_motion(const struct render_poses *poses, uint32_t light,
                            struct punctual_pose steps[RENDER_STEPS_MAX])
{
    float32 axes[RENDER_STEPS_MAX][12], place[RENDER_STEPS_MAX][3];
    real reach = 0;
    const float32 *axes_track[RENDER_STEPS_MAX], *place_track[RENDER_STEPS_MAX];
    const float32 *intensity = poses->scene->lights[light].intensity;
    uint32_t stride, other, count;
    int moves = 0;

    if (poses->count == 1 || poses->scene->lights[light].node < 0 ||
        (intensity[0] == 0 && intensity[1] == 0 && intensity[2] == 0))
        return 0;
    for (uint32_t k = 0; k < RENDER_STEPS_MAX; k++) {
        struct scene_light posed;
        pose_light(&poses->at[k], poses->scene, light, &posed);
        punctual_pose_of(&steps[k], &posed);
        moves |= memcmp(&steps[k], &steps[0], sizeof *steps) != 0;
        vec3_store(steps[k].position, place[k]);
        vec3_store(steps[k].direction, axes[k]);
        for (size_t a = 0; a < 3; a++)
            vec3_store(steps[k].axis[a], axes[k] + 3 + 3 * a);
        reach = real_max(reach, vec3_length(vec3_sub(steps[k].position, steps[0].position)));
        axes_track[k] = axes[k];
        place_track[k] = place[k];
    }
    if (!moves)
        return 0;
    stride = motion_stride(axes_track, 4, 1);
    other = motion_stride(place_track, 1, reach);
    stride = stride < other ? stride : other;
    count = (RENDER_STEPS_MAX - 1) / stride + 1;
    for (uint32_t k = 0; k < count; k++)
        steps[k] = steps[k * stride];
    return count;
}
