/* light_pilot: what light arrives in the scene, before it is rendered.
 *
 * Paths of pixels all over the picture, of random numbers that no picture uses, find the surfaces that light is asked
 * for on; from there rays find what arrives, and that makes the emitters' guides (light/environment/sky_guide.h,
 * light/lamp_guide.h).
 */
#pragma once

#include "common/base/status.h"

struct render_scene;

/* Make scene->emitters.environment.guide and scene->emitters.guide, if the job asks for them. The scene is complete but for
 * them. */
status light_pilot_run(struct render_scene *scene, struct error *err) MUST_CHECK;
