#include "scenes/sky/land.h"

#include <math.h>

#include "scenes/sky/noise.h"

#define PI 3.14159265358979323846
#define RAD(degrees) ((degrees) * (PI / 180))

/* The wheat field: level up to SLOPE_FROM, then it rises to its edge. Metres. */
#define SLOPE_FROM 60.0
#define EDGE 400.0
#define HAZE_LENGTH 9000.0

enum { TREES = 170 }; /* places for one, round the horizon */

/* Noise round the horizon, without a seam. */
static double around(double azimuth, double waves, double level, int octaves, uint32_t seed)
{
    double radius = waves / (2 * PI);

    return noise_sum(radius * cos(azimuth), level, radius * sin(azimuth), octaves, seed);
}

/* Height of the field's edge over its foot, metres. */
static double rise_at(const struct land *land, double azimuth)
{
    return 14 + 12 * around(azimuth, 5, 0.5, 2, land->seed + 31);
}

/* Where a direction meets the field: the distance along the ground, or 0 over its edge. The crop's
 * top is at TOP - EYE + a (r - SLOPE_FROM)^2 beyond SLOPE_FROM. */
static double field_distance(double rise, double tangent, double *slope)
{
    double drop = WHEAT_EYE_M - WHEAT_TOP_M, a, b, root, r;

    *slope = 0;
    if (tangent * SLOPE_FROM < -drop)
        return drop / -tangent;
    /* a x^2 - tangent x - (drop + tangent SLOPE_FROM) = 0 with x = r - SLOPE_FROM */
    a = rise / ((EDGE - SLOPE_FROM) * (EDGE - SLOPE_FROM));
    b = drop + tangent * SLOPE_FROM;
    root = tangent * tangent + 4 * a * b;
    if (root < 0)
        return 0;
    r = SLOPE_FROM + (tangent + sqrt(root)) / (2 * a);
    *slope = 2 * a * (r - SLOPE_FROM);
    return r <= EDGE ? r : 0;
}

static double edge_elevation(const struct land *land, double azimuth)
{
    return atan((rise_at(land, azimuth) - WHEAT_EYE_M + WHEAT_TOP_M) / EDGE);
}

static void haze_over(const struct daylight *light, double azimuth, double distance, double rgb[3])
{
    double haze[3], share = 1 - exp(-distance / HAZE_LENGTH);

    daylight_haze(light, azimuth, haze);
    for (int c = 0; c < 3; c++)
        rgb[c] = mix(rgb[c], haze[c], share);
}

/* Leaves of a round crown: brighter towards the sun, dark between the twigs. `x`, `y`: place in
 * the crown, -1 to 1. */
static void crown_light(const struct daylight *light, double azimuth, double x, double y, double grain, double rgb[3])
{
    static const double leaves[3] = {.085, .115, .035};
    double out = sqrt(fmax(1 - x * x - y * y, 0)); /* towards the eye */
    double right[3] = {-sin(azimuth), 0, cos(azimuth)}, ahead[3] = {cos(azimuth), 0, sin(azimuth)};
    double cosine = 0, albedo[3];
    const double normal[3] = {x * right[0] - out * ahead[0], y, x * right[2] - out * ahead[2]};

    for (int c = 0; c < 3; c++)
        cosine += normal[c] * light->to_sun[c];
    for (int c = 0; c < 3; c++)
        albedo[c] = leaves[c] * fmin(fmax(1 + 0.9 * grain, 0.25), 2);
    daylight_matt(light, albedo, fmax(0.25 + 0.75 * cosine, 0.02), 0.5 + 0.35 * y, rgb);
}

/* Tree number `number`, if there is one: a crown of several lumps. `x`: radians right of the left
 * end of its place; `y`: over the ground. */
static int tree_light(const struct land *land, int number, double x, double y, double azimuth, double grain,
                      double rgb[3])
{
    uint32_t h = noise_hash(number, 0, 7, land->seed);
    double clump = around(2 * PI * number / TREES, 9, 3.5, 2, land->seed + 43);
    double wide = RAD(.4 + .8 * noise_number(h, 0) * noise_number(h, 0));
    double tall = wide * (.9 + .7 * noise_number(h, 1)), nearest = 1e9, at[2] = {0, 0};

    if (noise_number(h, 3) > 0.3 + 1.3 * clump)
        return 0;
    x -= (0.15 + 0.7 * noise_number(h, 2)) * (2 * PI / TREES);
    for (int lump = 0; lump < 6; lump++) {
        double size = lump ? 0.34 + 0.3 * noise_number(h, 20 + lump) : 0.75;
        double off = lump ? 1.3 * (noise_number(h, 10 + lump) - 0.5) : 0;
        double up = lump ? 0.35 + 0.95 * noise_number(h, 30 + lump) * (1 - fabs(off)) : 0.75;
        double lx = (x / wide - off) / size, ly = (y / tall - up) / size;
        double far = sqrt(lx * lx + ly * ly);

        if (far < nearest) {
            nearest = far;
            at[0] = mix(lx, x / wide, 0.5);
            at[1] = mix(ly, y / tall - 0.75, 0.5);
        }
    }
    if (nearest > 0.85 + 0.5 * grain)
        return 0;
    crown_light(land->wheat.light, azimuth, fmin(fmax(at[0], -0.9), 0.9), fmin(fmax(at[1], -0.9), 0.9), grain, rgb);
    return 1;
}

/* A hedge at the field's edge, with trees. */
static int hedge_light(const struct land *land, double azimuth, double elevation, double rgb[3])
{
    const struct daylight *light = land->wheat.light;
    double at = azimuth / (2 * PI) * TREES, ground = edge_elevation(land, azimuth) - RAD(.05);
    double grain = around(azimuth, 2600, elevation * 415, 4, land->seed + 41);
    int middle = (int)floor(at), found = 0;
    double hedge = RAD(.22) * (1 + 0.6 * around(azimuth, 300, 0.5, 3, land->seed + 42));

    for (int i = middle - 1; i <= middle + 1; i++)
        found |= tree_light(land, (i % TREES + TREES) % TREES, (at - i) * (2 * PI / TREES), elevation - ground, azimuth,
                            grain, rgb);
    if (!found && elevation < ground + hedge * (1 + 0.5 * grain)) {
        crown_light(light, azimuth, 0, 2 * (elevation - ground) / hedge - 1.2, grain, rgb);
        found = 1;
    }
    if (found)
        haze_over(light, azimuth, EDGE, rgb);
    return found;
}

struct hill {
    double distance_m, mean_deg, range_deg, waves, wood; /* wood: -1 none to 1 all */
};

static const struct hill hills[] = {
    {1300, 2.5, 2.0, 9, -0.1}, {3200, 3.3, 2.4, 13, 0.1}, {9000, 4.0, 2.6, 17, 0.6}};

enum { HILLS = sizeof hills / sizeof *hills };

static double hill_top(const struct land *land, int k, double azimuth)
{
    const struct hill *hill = &hills[k];

    return RAD(hill->mean_deg + hill->range_deg * around(azimuth, hill->waves, 0.5, 3, land->seed + 50 + (uint32_t)k));
}

/* Fields are cells of a skewed grid over the hill's face; hedges run between them. */
static void fields_colour(const struct land *land, int k, double azimuth, double down, double albedo[3])
{
    static const double crops[6][3] = {{.50, .38, .16}, {.20, .26, .08}, {.16, .22, .07},
                                       {.42, .34, .15}, {.27, .28, .11}, {.34, .26, .15}};
    double bent = 0.35 * around(azimuth, 40, 4 * down, 2, land->seed + 60 + (uint32_t)k);
    double across = azimuth / (2 * PI) * (46 + 20 * k) + 0.6 * down + bent, deep = down * 3.2 + bent;
    uint32_t h = noise_hash((int)floor(across), (int)floor(deep), k, land->seed + 61);
    const double *crop = crops[h % 6];
    double edge = fmin(fmin(across - floor(across), 1 - (across - floor(across))),
                       fmin(deep - floor(deep), 1 - (deep - floor(deep))));
    double dark = edge < 0.05 + 0.02 * k ? 0.45 : 1;

    for (int c = 0; c < 3; c++)
        albedo[c] = crop[c] * dark * (0.85 + 0.3 * noise_number(h, 1));
}

static int hill_light(const struct land *land, int k, double azimuth, double elevation, double rgb[3])
{
    static const double leaves[3] = {.055, .080, .030};
    const struct daylight *light = land->wheat.light;
    uint32_t seed = land->seed + 70 + (uint32_t)k;
    double grain = around(azimuth, 1500 * (1 + k), elevation * 240 * (1 + k), 3, seed);
    double smooth = hill_top(land, k, azimuth), down, wood, albedo[3], lean, sun;
    double crest = smooth + RAD(.16 - .04 * k) * fmax(grain, -0.2) *
                                smooth_step(-0.1, 0.15, around(azimuth, 60, 0.5, 2, seed + 9) + hills[k].wood);

    if (elevation > crest)
        return 0;
    /* 0 at the crest, growing downwards; perspective makes fields flatter near the crest. */
    down = sqrt(fmax(smooth - elevation, 0) / RAD(1.2));
    wood = smooth_step(0.02, 0.08,
                       around(azimuth, 34, 2.2 * down, 3, seed + 5) * 1.2 + 0.35 * hills[k].wood +
                           (elevation > smooth ? 1 : 0));
    fields_colour(land, k, azimuth, down, albedo);
    for (int c = 0; c < 3; c++)
        albedo[c] = mix(albedo[c] * (1 + 0.15 * grain), leaves[c] * fmin(fmax(1 + 1.2 * grain, 0.3), 2), wood);
    /* The face leans towards us; its flanks turn with the crest. */
    lean = (hill_top(land, k, azimuth + RAD(1)) - hill_top(land, k, azimuth - RAD(1))) / RAD(2);
    sun = 0.94 * light->to_sun[1] - 0.3 * (light->to_sun[0] * cos(azimuth) + light->to_sun[2] * sin(azimuth)) -
          0.8 * lean * (light->to_sun[2] * cos(azimuth) - light->to_sun[0] * sin(azimuth));
    daylight_matt(light, albedo, fmax(sun, 0.05), 0.9, rgb);
    haze_over(light, azimuth, hills[k].distance_m, rgb);
    return 1;
}

int land_light(const struct land *land, double azimuth_rad, double elevation_rad, double rgb[3])
{
    double slope, distance = field_distance(rise_at(land, azimuth_rad), tan(elevation_rad), &slope);

    if (distance > 0) {
        const double direction[3] = {cos(elevation_rad) * cos(azimuth_rad), sin(elevation_rad),
                                     cos(elevation_rad) * sin(azimuth_rad)};

        wheat_light(&land->wheat, direction, distance, slope, rgb);
        haze_over(land->wheat.light, azimuth_rad, distance, rgb);
        return 1;
    }
    if (hedge_light(land, azimuth_rad, elevation_rad, rgb))
        return 1;
    for (int k = 0; k < HILLS; k++)
        if (hill_light(land, k, azimuth_rad, elevation_rad, rgb))
            return 1;
    return 0;
}

void land_init(struct land *land, const struct daylight *light, uint32_t seed)
{
    land->seed = seed;
    wheat_init(&land->wheat, light, seed);
}
