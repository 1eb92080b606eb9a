/* caustic_pilot: how much of the picture's light comes by way of casters (caustic/casters.h), before it is rendered.
 *
 * Asking casters costs as much as several paths. Where what they send is less than a twentieth of the light in the mean
 * pixel, only one vertex in 2, 4, ... 256 asks, and what it gets counts the more. Where it is less than a hundredth, suns
 * are left to chance. */
#pragma once

#include "common/base/status.h"

struct render_scene;

/* Set scene->caster_share, and take suns, or all, from scene->casters. The scene is complete but for it. ERR_NO_MEMORY. */
status caustic_pilot_run(struct render_scene *scene, struct error *err) MUST_CHECK;
