/* field: paints a wheat field under a summer sky into a map that holds the clear sky already. */
#pragma once

#include "common/image/image.h"
#include "scenes/sky/daylight.h"

/* `map`: latitude-longitude as in sky.h, without the sun's disc, in units of `unit` cd/m2. Clouds
 * are put before its sky, and the land before both. The same `seed`, the same field. ERR_NO_MEMORY. */
status field_paint(struct image *map, double unit, const struct daylight *light, uint32_t seed,
                   struct error *err) MUST_CHECK;
