/* studio: light and a ground for a model that comes with neither camera nor light, so that its first picture shows it.
 *
 * The light is a small lat-long map: a soft box before the model at the left, a weaker one at the right, a bright
 * ceiling, and a dim room around. It stands as the camera does that framing.c adds. The ground is a matte grey square below
 * the model that fills the picture. Same bits on every machine. */
#pragma once

#include "client/import/builder/builder.h"

/* Light the scene. Once, after hand-over. */
status studio_light(struct builder *b) MUST_CHECK;

/* Put the ground below the model. `low_y_m`: the model's lowest height; `distance_m` > 0: from the camera to `center`. */
status studio_ground(struct builder *b, const double center[3], double low_y_m, double distance_m) MUST_CHECK;
