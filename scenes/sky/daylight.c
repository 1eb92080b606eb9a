#include "scenes/sky/daylight.h"

#include <math.h>

#include "scenes/sky/noise.h"

#define PI 3.14159265358979323846

void daylight_haze(const struct daylight *light, double azimuth_rad, double rgb[3])
{
    double turn = azimuth_rad / (2 * PI), at = (turn - floor(turn)) * DAYLIGHT_AZIMUTHS;
    int i = (int)at % DAYLIGHT_AZIMUTHS, k = (i + 1) % DAYLIGHT_AZIMUTHS;

    for (int c = 0; c < 3; c++)
        rgb[c] = mix(light->haze[i][c], light->haze[k][c], at - floor(at));
}

void daylight_matt(const struct daylight *light, const double albedo[3], double sun, double sky, double rgb[3])
{
    for (int c = 0; c < 3; c++)
        rgb[c] = albedo[c] / PI * (light->sun_lux[c] * sun + light->sky_lux[c] * sky);
}
