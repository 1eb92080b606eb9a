/* track: values of materials, textures, lights, cameras and instances that change with time (glTF's
 * KHR_animation_pointer).
 *
 * A frame has the values of its own time: what changes while the shutter is open does not blur. They are kept in the
 * range that scene_validate() demands, which a spline may leave between its keys.
 */
#pragma once

#include "common/base/status.h"
#include "common/scene/material.h"
#include "common/scene/scene.h"
#include "common/scene/settings.h"

/* Fields of TRACK_LIGHT and TRACK_CAMERA; TRACK_INSTANCE has 0 alone. */
enum scene_track_light { TRACK_LIGHT_INTENSITY, TRACK_LIGHT_RANGE, TRACK_LIGHT_INNER_CONE, TRACK_LIGHT_OUTER_CONE };
enum scene_track_camera { TRACK_CAMERA_YFOV, TRACK_CAMERA_YMAG };

/* Fields of TRACK_MATERIAL, and of a texture's three: the row's place on the wire. */
uint32_t scene_track_value(enum material_value_number value);
uint32_t scene_track_texture(enum material_texture slot);

/* How many numbers the track's value has, and their range. 0: there is no such field. */
int scene_track_count(const struct scene_track *track, float *least, float *most);

/* Below 0 if `a` comes before `b` in a scene's tracks, 0: both animate the same. */
int scene_track_compare(const struct scene_track *a, const struct scene_track *b);

/* Does a value change of anything but another camera? */
int scene_tracks_change(const struct scene *scene, uint32_t camera);

/* The scene in a frame: it shares everything with `scene`, which must outlive it, but what its tracks change, and has no
 * tracks. Release it with scene_copy_release (move.h), also after a failure. ERR_NO_MEMORY. */
status scene_at_frame(struct scene *out, const struct scene *scene, const struct render_settings *settings,
                      uint32_t frame, struct error *err) MUST_CHECK;
