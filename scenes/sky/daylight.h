/* daylight: the light that the parts of a landscape stand in. Linear Rec. 709, photometric. */
#pragma once

enum { DAYLIGHT_AZIMUTHS = 360 };

struct daylight {
    double to_sun[3];                  /* unit vector; +Y is up */
    double sun_lux[3];                 /* on a face that looks at the sun */
    double sky_lux[3];                 /* on the level ground, by the sky alone */
    double haze[DAYLIGHT_AZIMUTHS][3]; /* cd/m2 of the sky just over the horizon, by azimuth */
};

/* The haze in a direction, cd/m2, between the two nearest azimuths. */
void daylight_haze(const struct daylight *light, double azimuth_rad, double rgb[3]);
/* What a matt face of `albedo` sends out: `sun` is the cosine to the sun, 0 in shadow, and `sky`
 * the share of the sky that it sees. cd/m2. */
void daylight_matt(const struct daylight *light, const double albedo[3], double sun, double sky, double rgb[3]);
