/* sky: a latitude-longitude picture of the sky, for environment lights.
 *
 * Direction and texel: u = 0.5 + azimuth / 360 degrees, v = 0 at the zenith (+Y) to 1 below.
 * Azimuth 0 is +X (the picture's middle), 90 is +Z (three quarters), 180 is -X (the edges),
 * 270 is -Z (one quarter). One unit of the picture is 10 kcd/m2 = 10 000 lux/sr, so that a clear
 * sky is about 0.2 to 1 and the sun about 1e5.
 */
#pragma once

#include "common/image/image.h"

#define SKY_CANDELAS_PER_UNIT 10000.0 /* cd/m2 */

struct sky_settings {
    uint32_t width, height;   /* pixels */
    double sun_elevation_deg; /* -5 to 90 */
    double sun_azimuth_deg;
    double turbidity;     /* 1 to 10 */
    double ground_albedo; /* 0 to 1 */
    int no_sun;           /* leave out the disc, keep its light on sky and ground */
    int field;            /* a wheat field with hills, and clouds, instead of grey ground */
    uint32_t seed;        /* of the field: another one, another landscape */
};

/* Illuminance of a horizontal plane at the ground, lux. */
struct sky_report {
    double sun_lux, sky_lux;
};

/* `out` is initialised here; 3 channels. `report` may be NULL. */
status sky_make(struct image *out, const struct sky_settings *settings, struct sky_report *report,
                struct error *err) MUST_CHECK;
