#include "scenes/sky/clouds.h"

#include <math.h>

#include "scenes/sky/noise.h"

#define PI 3.14159265358979323846

/* Metres. */
#define BASE 1150.0
#define TOP 2300.0
#define CELL 2600.0 /* one cloud, or none, in each square of this side */
#define FARTHEST 30000.0
#define HAZE_LENGTH 26000.0
#define STEP 45.0
#define EXTINCTION 0.022 /* of the densest part, per metre */

enum { SUN_STEPS = 6, SCATTERINGS = 4 };

/* How deep a place is inside the smooth body of a cloud: 1 at its heart, 0 at its hull. */
static double body_at(const struct clouds *clouds, const double p[3])
{
    int cx = (int)floor(p[0] / CELL), cz = (int)floor(p[2] / CELL);
    double deepest = 0;

    for (int i = -1; i <= 1; i++)
        for (int k = -1; k <= 1; k++) {
            uint32_t h = noise_hash(cx + i, cz + k, 1, clouds->seed);
            double size = 380 + 760 * noise_number(h, 0) * noise_number(h, 1), x, z;

            if (noise_number(h, 2) > 0.62)
                continue;
            x = (p[0] - (cx + i + 0.2 + 0.6 * noise_number(h, 3)) * CELL) / size;
            z = (p[2] - (cz + k + 0.2 + 0.6 * noise_number(h, 4)) * CELL) / size;
            if (x * x + z * z > 2)
                continue;
            /* A dome: three lumps of different heights on one base. */
            for (int lump = 0; lump < 3; lump++) {
                double turn = 2 * PI * noise_number(h, 5 + lump), off = lump ? 0.5 : 0;
                double wide = lump ? 0.6 : 1, lx = (x - off * cos(turn)) / wide;
                double lz = (z - off * sin(turn)) / wide;
                double high = size * (0.55 + 0.45 * noise_number(h, 9 + lump)) * (lump ? 0.8 : 1);
                double y = (p[1] - BASE) / high;

                deepest = fmax(deepest, 1 - sqrt(lx * lx + lz * lz + y * y));
            }
        }
    return deepest;
}

/* 0 to 1. The hull is worn by noise: puffs above, threads at the base. */
static double density_at(const struct clouds *clouds, const double p[3], int octaves)
{
    double body = p[1] < BASE - 30 || p[1] > TOP ? 0 : body_at(clouds, p), puffs, toward[3], length;

    if (!(body > 0))
        return 0;
    length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    for (int i = 0; i < 3; i++)
        toward[i] = p[i] / length;
    body -= 2 * smooth_step(cos(PI / 180 * 16), cos(PI / 180 * 9),
                            toward[0] * clouds->light->to_sun[0] + toward[1] * clouds->light->to_sun[1] +
                                toward[2] * clouds->light->to_sun[2]);
    puffs = noise_sum(p[0] / 420, p[1] / 360, p[2] / 420, octaves, clouds->seed + 21);
    return smooth_step(0, 0.12, body - 0.34 + 0.75 * puffs) * smooth_step(BASE - 30, BASE + 60, p[1] + 60 * puffs);
}

/* Optical depth towards the sun, in steps that grow. */
static double depth_to_sun(const struct clouds *clouds, const double p[3])
{
    double depth = 0, step = 30, at = 15;

    for (int i = 0; i < SUN_STEPS; i++) {
        double q[3];

        for (int c = 0; c < 3; c++)
            q[c] = p[c] + at * clouds->light->to_sun[c];
        depth += EXTINCTION * step * density_at(clouds, q, 3);
        at += step * 1.35;
        step *= 1.7;
    }
    return depth;
}

static double phase(double cosine, double g) { return (1 - g * g) / (4 * PI * pow(1 + g * g - 2 * g * cosine, 1.5)); }

/* Sunlight after one and more scatterings: each further one is dimmer, sees the sun through less,
 * and has lost more of its direction (Wrenninge, Kulla and Lundqvist 2013, "Oz: The Great and
 * Volumetric", SIGGRAPH talks). */
static double scattered(double depth, double cosine)
{
    double sum = 0, dim = 1;

    for (int i = 0; i < SCATTERINGS; i++) {
        sum += dim * exp(-dim * depth) * mix(phase(cosine, -0.15), phase(cosine, 0.8 * dim), 0.6);
        dim *= 0.5;
    }
    return sum;
}

double clouds_light(const struct clouds *clouds, const double direction[3], double rgb[3])
{
    const struct daylight *light = clouds->light;
    double from = BASE - 30, passes = 1, cosine = 0, mean_distance = 0, haze[3], veil;
    double t = from / fmax(direction[1], 1e-6), end = TOP / fmax(direction[1], 1e-6);

    rgb[0] = rgb[1] = rgb[2] = 0;
    for (int c = 0; c < 3; c++)
        cosine += direction[c] * light->to_sun[c];
    /* The same start for neighbours would show as rings. */
    t += STEP * noise_number(noise_hash((int)(direction[0] * 1e6), (int)(direction[1] * 1e6), (int)(direction[2] * 1e6),
                                        clouds->seed),
                             0);
    while (t < fmin(end, FARTHEST) && passes > 0.01) {
        double step = STEP * (1 + t / 8000);
        double p[3] = {t * direction[0], t * direction[1], t * direction[2]};
        double density = density_at(clouds, p, 5), stays, height;

        if (density > 0) {
            stays = exp(-EXTINCTION * density * step);
            height = fmin(fmax((p[1] - BASE) / 700, 0), 1);
            for (int c = 0; c < 3; c++)
                rgb[c] += passes * (1 - stays) *
                          (light->sun_lux[c] * scattered(depth_to_sun(clouds, p), cosine) +
                           light->sky_lux[c] / PI * (0.45 + 0.55 * height));
            mean_distance += passes * (1 - stays) * t;
            passes *= stays;
        }
        t += step;
    }
    if (passes >= 1)
        return 1;
    mean_distance /= 1 - passes;
    veil = 1 - exp(-mean_distance / HAZE_LENGTH);
    daylight_haze(light, atan2(direction[2], direction[0]), haze);
    for (int c = 0; c < 3; c++)
        rgb[c] = mix(rgb[c], haze[c] * (1 - passes), veil);
    return passes;
}
