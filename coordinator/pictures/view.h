/* view: where a frame's camera stands where the shutter opens, and where what it shows is in another frame's picture. */
#pragma once

#include "common/scene/scene.h"
#include "common/scene/settings.h"

/* Matrices for columns. `to_screen` gives (x w, y w, ..., w): 0, 0 is the picture's upper left corner, 1, 1 its lower right, of the
 * whole picture of a region. */
struct scene_view {
    int has_camera; /* none without the scene, or with a camera that has no inverse */
    int has_screen; /* none of a panorama */
    double to_camera[4][4], to_screen[4][4];
};

enum scene_space {
    SPACE_OF_FILE,  /* metres, in the file's coordinates */
    SPACE_OF_SCENE, /* the same relative to scene->origin, as positions are rendered */
};
status scene_view_find(const struct scene *scene, const struct render_settings *settings, uint32_t frame,
                       enum scene_space from, struct scene_view *view, struct error *err) MUST_CHECK;

/* From a frame's picture to another's: the cameras, and what moves as a whole. */
struct scene_way {
    struct scene_view here, there;
    uint32_t instance_count;
    struct transform_d *moves; /* [instances] from where it stands here to where it stands there, in SPACE_OF_SCENE */
    uint8_t *moved;            /* [instances] it does */
    uint32_t moved_count;
};
/* ERR_NO_MEMORY, ERR_INPUT as scene_pose_init. Release it, also after a failure. */
status scene_way_find(const struct scene *scene, const struct render_settings *settings, uint32_t from, uint32_t to,
                      struct scene_way *way, struct error *err) MUST_CHECK;
void scene_way_release(struct scene_way *way);
/* Both pictures show every point in the same pixel, but for skins and morphs. */
int scene_way_is_still(const struct scene_way *way);
int scene_way_camera_stands(const struct scene_way *way);
/* The camera stands, or what it shows can be followed: not while a panorama moves. */
int scene_way_is_known(const struct scene_way *way);
/* For each pixel of the picture: the pixel (row-major) in which the other shows the same point; -1: none. `positions`:
 * [3][height][width], each pixel's point in SPACE_OF_SCENE; `objects`: [height][width], AOV_OBJECT_ID, NULL: nothing is taken
 * to move but the camera. Both views have a screen. */
void scene_way_follow(const struct scene_way *way, const struct render_settings *settings, const float *positions,
                      const float *objects, int32_t *source);
