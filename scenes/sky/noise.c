#include "scenes/sky/noise.h"

#include <math.h>

uint32_t noise_hash(int x, int y, int z, uint32_t seed)
{
    uint32_t h = seed * 0x9e3779b9u ^ (uint32_t)x * 0x85ebca6bu;

    h = (h ^ (h >> 15)) * 0x2c1b3c6du ^ (uint32_t)y * 0xc2b2ae35u;
    h = (h ^ (h >> 13)) * 0x297a2d39u ^ (uint32_t)z * 0x27d4eb2fu;
    h = (h ^ (h >> 16)) * 0x7feb352du;
    h = (h ^ (h >> 15)) * 0x846ca68bu;
    return h ^ (h >> 16);
}

double noise_number(uint32_t hash, int n) { return noise_hash((int)hash, n, 0, 0x5bd1e995u) / 4294967296.0; }

double smooth_step(double from, double to, double x)
{
    double t = fmin(fmax((x - from) / (to - from), 0), 1);

    return t * t * (3 - 2 * t);
}

double mix(double a, double b, double share_of_b) { return a + (b - a) * share_of_b; }

/* The slope of a lattice point towards (x, y, z): one of the twelve edges of a cube. */
static double slope(uint32_t hash, double x, double y, double z)
{
    double u = (hash & 8) ? y : x, v = (hash & 12) == 12 ? x : (hash & 8) ? z : (hash & 4) ? z : y;

    return ((hash & 1) ? -u : u) + ((hash & 2) ? -v : v);
}

static double noise_at(double x, double y, double z, uint32_t seed)
{
    double whole[3] = {floor(x), floor(y), floor(z)};
    double at[3] = {x - whole[0], y - whole[1], z - whole[2]}, weight[3], sum = 0;

    for (int i = 0; i < 3; i++)
        weight[i] = at[i] * at[i] * at[i] * (at[i] * (at[i] * 6 - 15) + 10);
    for (int corner = 0; corner < 8; corner++) {
        int cx = corner & 1, cy = corner >> 1 & 1, cz = corner >> 2;
        uint32_t hash = noise_hash((int)whole[0] + cx, (int)whole[1] + cy, (int)whole[2] + cz, seed);

        sum += (cx ? weight[0] : 1 - weight[0]) * (cy ? weight[1] : 1 - weight[1]) * (cz ? weight[2] : 1 - weight[2]) *
               slope(hash >> 8, at[0] - cx, at[1] - cy, at[2] - cz);
    }
    return sum;
}

double noise_sum(double x, double y, double z, int octaves, uint32_t seed)
{
    double sum = 0, size = 0.5, scale = 1;

    for (int i = 0; i < octaves; i++) {
        sum += size * noise_at(x * scale, y * scale, z * scale, seed + (uint32_t)i);
        size *= 0.5;
        scale *= 2.03; /* not 2: the octaves' zeros do not meet */
    }
    return sum;
}
