/* wheat: a field of ripe wheat, sown in rows, around an eye at WHEAT_EYE_M over the ground. Near
 * the eye it is made of ears, stalks and leaves; further away of their mean light, with the
 * rows, tracks and patches that are still seen. */
#pragma once

#include <stdint.h>

#include "scenes/sky/daylight.h"

#define WHEAT_EYE_M 1.9
#define WHEAT_TOP_M 0.9 /* of the crop, in the mean */

enum { WHEAT_SECTORS = 48 };

struct wheat {
    const struct daylight *light;
    uint32_t seed;
    double along[2];               /* unit vector (x, z) along the rows */
    double mean[WHEAT_SECTORS][3]; /* cd/m2 of the crop seen at a low angle, by azimuth */
};

void wheat_init(struct wheat *wheat, const struct daylight *light, uint32_t seed);
/* The light from unit direction `direction` that meets the field `distance_m` away, measured
 * along the ground, where the field slopes by `slope` (tangent) against the view. cd/m2. */
void wheat_light(const struct wheat *wheat, const double direction[3], double distance_m, double slope, double rgb[3]);
