/* pose: the position of everything that moves, at one moment.
 *
 * Evaluates the scene's nodes and animation channels: glTF 2.0's interpolation (step, linear
 * with the great circle for rotations, cubic Hermite splines), clamped to the first and last
 * key. All in double; deterministic arithmetic only (det_*), so that every machine poses alike.
 */
#pragma once

#include "common/base/status.h"
#include "common/scene/scene.h"
#include "common/scene/settings.h"

struct scene_pose {
    struct transform_d *to_world; /* [node_count] */
    double **weights;             /* [node_count] morph weights, NULL where the node has none */
    void *storage;
};

/* The pose at `time_s`, relative to the scene's origin. The caller releases it (also after a failure: it is then
 * empty).
 * ERR_INPUT when a node's transform leaves the range of SCENE_COORDINATE_MAX; a singular one is no error. */
status scene_pose_init(struct scene_pose *pose, const struct scene *scene, double time_s, struct error *err) MUST_CHECK;
void scene_pose_release(struct scene_pose *pose);

/* Number `i` of a channel's value; not of a rotation. */
double scene_channel_number(const struct scene_channel *channel, double time_s, uint32_t i);
/* Are all of its keys the same, and its tangents 0? */
int scene_channel_is_still(const struct scene_channel *channel);

/* Transforms at the pose. An object that follows no node has its own; a skinned instance has the identity. A camera's
 * is made rigid (no scale; if its axes vanish its own rotation stays). `position` and `direction` of a light that
 * follows a node are the node's origin and -Z, to_world its rigid part (each stays if the node's axes vanish). */
struct transform_d pose_instance(const struct scene_pose *pose, const struct scene *scene, uint32_t instance);
void pose_camera(const struct scene_pose *pose, const struct scene *scene, uint32_t camera, struct scene_camera *out);
void pose_light(const struct scene_pose *pose, const struct scene *scene, uint32_t light, struct scene_light *out);

/* The mesh of an instance at the pose: morph targets, then skin. positions[3][vertices] and, if the mesh has normals,
 * normals[3][vertices] (unit) and tangents [4][vertices] likewise; each may be NULL. `blob` is the mesh's, of
 * scene_mesh_layout's length. The vertices of a skinned mesh are in world space, those of any other mesh in the mesh's
 * own. A joint that mirrors flips the tangents' handedness. ERR_INPUT for a joint that the skin does not have, and for
 * vertices beyond SCENE_COORDINATE_MAX. */
status pose_deform(const struct scene_pose *pose, const struct scene *scene, uint32_t instance, const uint8_t *blob,
                   float *positions, float *normals, float *tangents, struct error *err) MUST_CHECK;
/* Is there a time at which pose_deform gives other vertices than the blob's? If in doubt, yes. */
int scene_instance_deforms(const struct scene *scene, uint32_t instance);

/* The time of a frame, seconds. */
static inline double scene_frame_s(const struct render_settings *settings, uint32_t frame)
{
    return (double)frame / (double)settings->fps;
}

/* The shutter of a frame, in seconds of the scene's time. Both ends are equal if nothing blurs (no
 * shutter, nothing that moves, or motion blur among the effects to leave out). */
void scene_shutter(const struct scene *scene, const struct render_settings *settings, uint32_t frame, double *open_s,
                   double *close_s);

/* Does anything that this camera sees differ between two frames (so that the renderer must build a
 * scene for each), or within one frame's shutter? If in doubt, yes. */
int scene_is_animated(const struct scene *scene, const struct render_settings *settings);

/* The time of the last key, seconds; 0 without any. */
double scene_duration_s(const struct scene *scene);
