/* land: what stands behind a wheat field: its far edge with a hedge and trees, and three rows of
 * hills with woods and fields, each hazier than the one before. */
#pragma once

#include <stdint.h>

#include "scenes/sky/wheat.h"

struct land {
    struct wheat wheat;
    uint32_t seed;
};

void land_init(struct land *land, const struct daylight *light, uint32_t seed);
/* The highest that any land reaches, radians over the level. */
#define LAND_HIGHEST_RAD 0.115
/* The land's light from a direction, cd/m2; 0 if there is the sky. */
int land_light(const struct land *land, double azimuth_rad, double elevation_rad, double rgb[3]);
