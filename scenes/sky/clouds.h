/* clouds: fair-weather cumulus, flat below and round above, lit by the sun and the sky. */
#pragma once

#include <stdint.h>

#include "scenes/sky/daylight.h"

struct clouds {
    const struct daylight *light;
    uint32_t seed;
};

/* What clouds put before the clear sky in unit direction `direction` (+Y up): the share of the
 * sky's light that passes (returned, 0 to 1), and their own light, cd/m2. None stands before the
 * sun or within a few degrees of it. */
double clouds_light(const struct clouds *clouds, const double direction[3], double rgb[3]);
