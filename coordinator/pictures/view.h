/* view: where a frame's camera stands where the shutter opens, and what moves on its screen because of that. */
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

/* Both cameras show a point that does not move in the same place. */
int scene_views_agree(const struct scene_view *a, const struct scene_view *b);
/* For each pixel of a picture by `here`: the pixel (row-major) in which `there` shows the same point, if that does not move itself;
 * -1: none. `positions`: [3][height][width], each pixel's point in SPACE_OF_SCENE. Both views have a screen. */
void scene_view_follow(const struct scene_view *here, const struct scene_view *there,
                       const struct render_settings *settings, const float *positions, int32_t *source);
