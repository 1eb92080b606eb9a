#include "scenes/sky/field.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "scenes/sky/clouds.h"
#include "scenes/sky/land.h"
#include "scenes/sky/noise.h"

#define PI 3.14159265358979323846

/* Clouds have soft hulls: they are computed at a third of the map's size and interpolated. */
enum { CLOUD_TEXELS = 3, HORIZON_SAMPLES = 4, NEAR_SAMPLES = 2 };

struct painting {
    struct image *map;
    double unit;
    struct clouds clouds;
    struct land land;
    struct image veil; /* red, green, blue of the clouds in cd/m2, and what passes between them */
    uint32_t seed;
};

static double elevation_of(const struct image *map, double y) { return PI / 2 - PI * y / map->height; }

static double azimuth_of(const struct image *map, double x) { return 2 * PI * (x / map->width - 0.5); }

static void fill_veil(void *user, size_t begin, size_t end)
{
    struct painting *p = user;

    for (size_t y = begin; y < end; y++)
        for (uint32_t x = 0; x < p->veil.width; x++) {
            double elevation = PI / 2 * (1 - (y + 0.5) / p->veil.height), rgb[3];
            double azimuth = azimuth_of(&p->veil, x + 0.5), passes;
            const double direction[3] = {cos(elevation) * cos(azimuth), sin(elevation),
                                         cos(elevation) * sin(azimuth)};
            float *out = p->veil.pixels + 4 * (y * p->veil.width + x);

            passes = clouds_light(&p->clouds, direction, rgb);
            for (int c = 0; c < 3; c++)
                out[c] = (float)rgb[c];
            out[3] = (float)passes;
        }
}

/* The clouds at a texel of the map, bilinear between the veil's. */
static void veil_at(const struct painting *p, uint32_t x, uint32_t y, double light[4])
{
    double at_x = (x + 0.5) / p->map->width * p->veil.width - 0.5;
    double at_y = 2 * (y + 0.5) / p->map->height * p->veil.height - 0.5;
    double fx = at_x - floor(at_x), fy = at_y - floor(at_y);
    uint32_t w = p->veil.width, h = p->veil.height;

    memset(light, 0, 4 * sizeof *light);
    for (int i = 0; i < 4; i++) {
        uint32_t column = (uint32_t)((int)floor(at_x) + (i & 1) + (int)w) % w;
        uint32_t row = (uint32_t)fmin(fmax(floor(at_y) + (i >> 1), 0), h - 1.0);
        double weight = (i & 1 ? fx : 1 - fx) * (i >> 1 ? fy : 1 - fy);
        const float *from = p->veil.pixels + 4 * ((size_t)row * w + column);

        for (int c = 0; c < 4; c++)
            light[c] += weight * (double)from[c];
    }
}

/* The mean of the land over a texel, and the share of the texel that it covers. */
static double land_at(const struct painting *p, uint32_t x, uint32_t y, double rgb[3])
{
    double middle = elevation_of(p->map, y + 0.5);
    int n = middle > -0.05 ? HORIZON_SAMPLES : middle > -0.36 ? NEAR_SAMPLES : 1, covered = 0;

    rgb[0] = rgb[1] = rgb[2] = 0;
    for (int i = 0; i < n * n; i++) {
        uint32_t h = noise_hash((int)x, (int)y, i, p->seed + 1);
        double sx = x + (i % n + noise_number(h, 0)) / n, sy = y + (i / n + noise_number(h, 1)) / n;
        double light[3];

        if (!land_light(&p->land, azimuth_of(p->map, sx), elevation_of(p->map, sy), light))
            continue;
        covered++;
        for (int c = 0; c < 3; c++)
            rgb[c] += light[c] / (n * n);
    }
    return (double)covered / (n * n);
}

/* How many texels of a row are as narrow as one: near the feet the map stretches the ground. */
static uint32_t alike(const struct image *map, uint32_t y)
{
    double elevation = elevation_of(map, y + 0.5);

    return elevation > -PI / 4 ? 1 : (uint32_t)fmin(1 / cos(elevation), map->width);
}

static void paint_rows(void *user, size_t begin, size_t end)
{
    struct painting *p = user;

    for (size_t row = begin; row < end; row++) {
        uint32_t y = (uint32_t)row, same = alike(p->map, y);

        for (uint32_t x = 0; x < p->map->width; x++) {
            float *texel = p->map->pixels + 3 * (row * p->map->width + x);
            double cloud[4] = {0, 0, 0, 1}, land[3] = {0, 0, 0}, covered = 0;

            if (elevation_of(p->map, y) > 0)
                veil_at(p, x, y, cloud);
            if (x % same) {
                memcpy(texel, texel - 3, 3 * sizeof *texel);
                continue;
            }
            if (elevation_of(p->map, y + 1.0) < LAND_HIGHEST_RAD)
                covered = land_at(p, x, y, land);
            for (int c = 0; c < 3; c++)
                texel[c] =
                    (float)((1 - covered) * ((double)texel[c] * cloud[3] + cloud[c] / p->unit) + land[c] / p->unit);
        }
    }
}

status field_paint(struct image *map, double unit, const struct daylight *light, uint32_t seed, struct error *err)
{
    struct painting *p = mem_calloc(1, sizeof *p);
    status st;

    if (!p)
        return error_no_memory(err, "the field");
    p->map = map;
    p->unit = unit;
    p->seed = seed;
    p->clouds = (struct clouds){.light = light, .seed = seed};
    land_init(&p->land, light, seed);
    st = image_init(&p->veil, map->width / CLOUD_TEXELS + 1, map->height / 2 / CLOUD_TEXELS + 1, 4, err);
    if (st == STATUS_OK) {
        parallel_for(0, p->veil.height, 1, fill_veil, p);
        parallel_for(0, map->height, 4, paint_rows, p);
    }
    image_release(&p->veil);
    mem_free(p);
    return st;
}
