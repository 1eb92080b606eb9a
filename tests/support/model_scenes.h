/* model_scenes: the scenes whose pictures must not depend on how their file is written. All stand
 * within some 6 m of the origin, on coordinates that are multiples of 2^-12 m. */
#pragma once

#include "tests/support/model.h"

typedef void model_scene(struct model *m);

/* A room without a front wall below a sky with a picture: matte walls, a metal ball, a glossy box, a
 * lamp with two sides and one with one, a bulb, a point light and a spot light. As pbrt the glossy box
 * and the one-sided lamp are matte and two-sided, and ball and bulb true spheres (model_room_pbrt). */
model_scene model_room, model_room_plain_sky, model_room_pbrt;
/* A tumbler whose inner faces are its water's, a block of ice in the water, all of them coloured. */
model_scene model_glass;
/* Haze in a closed room, a box of dense white medium that touches the floor, a box of smoke (pbrt). */
model_scene model_fog;
/* A fine pattern that runs to the horizon, bumps, cut-out holes; and with one of two surfaces with
 * holes blended, which asks a hash of the triangle's corners whether a ray passes. */
model_scene model_textures, model_veil;
/* A box that travels and turns, a ball that changes its shape, a bar that bends, and the camera. */
model_scene model_animation;
/* What glTF, pbrt and OBJ can all say: matte surfaces, one with a picture, and lamps; and what glTF
 * and pbrt can: a point light, a block of coloured glass. */
model_scene model_plain, model_plain_glass;
