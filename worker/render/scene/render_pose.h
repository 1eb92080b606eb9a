/* render_pose: the moments of a frame. Private to worker/render.
 *
 * What moves while the shutter is open is evaluated RENDER_STEPS_MAX times. It gets the fewest steps
 * that keep every evaluated moment within a thousandth of its extent.
 */
#pragma once

#include "common/scene/effects.h"
#include "common/scene/pose.h"
#include "worker/render/camera/camera.h"
#include "worker/render/light/punctual.h"

enum { RENDER_STEPS_MAX = CAMERA_STEPS_MAX }; /* a power of two, plus one */

struct render_poses {
    const struct scene *scene;
    uint32_t count; /* 1: at the shutter's opening; RENDER_STEPS_MAX: evenly until it closes */
    struct scene_pose at[RENDER_STEPS_MAX];
};

/* The poses that the frame needs: more than one only if something can move while the shutter is
 * open. Reads `scene` until freed (NULL does nothing). */
status poses_new(struct render_poses **out, const struct scene *scene, const struct render_settings *settings,
                 uint32_t frame, struct error *err) MUST_CHECK;
void poses_free(struct render_poses *poses);

/* The camera at the shutter's opening, and how it moves; `steps` has room for CAMERA_STEPS_MAX and
 * must live as long as *motion. */
void poses_camera(const struct render_poses *poses, uint32_t camera, struct scene_camera *out, struct transform *steps,
                  struct camera_motion *motion);

/* A light at the shutter's opening. */
void poses_light(const struct render_poses *poses, uint32_t light, struct scene_light *out);
/* How it moves: the number of steps, 0 if it does not move or is black. */
uint32_t poses_light_motion(const struct render_poses *poses, uint32_t light,
                            struct punctual_pose steps[RENDER_STEPS_MAX]);

/* track[k] holds `points` points at moment k. Returns the largest power of two stride whose chords
 * keep all points within the tolerance. `extent`: size of what moves. */
uint32_t motion_stride(const float32 *const track[RENDER_STEPS_MAX], size_t points, real extent);
