#include "scenes/sky/wheat.h"

#include <math.h>
#include <string.h>

#include "scenes/sky/noise.h"

#define PI 3.14159265358979323846

/* Metres. The sower's rows are closer in truth; at this distance the eye can part them. */
#define ROW 0.2
#define PLANTS 0.028 /* from one to the next in a row */
#define EAR_LENGTH 0.1
#define EAR_RADIUS 0.0085
#define STALK_RADIUS 0.0025
#define LEAF_RADIUS 0.006
#define HIGHEST 1.16 /* no ear is above this */
#define BOUT 3.0     /* what the sower sows at once */
#define TRACKS 18.0  /* from one pair of the tractor's tracks to the next */
#define ROWS_AZIMUTH (PI * 97 / 180)

/* Plants are followed one by one up to NEAR and are a mean beyond FAR. */
#define NEAR 16.0
#define FAR 32.0

enum { CELLS_MAX = 400, SHADOW_CELLS_MAX = 40, MEAN_RAYS = 600 };

struct ray {
    double from[3], to[3]; /* to: unit vector */
};

enum part { SOIL, EAR, STALK, LEAF };

struct meeting {
    double t, along; /* along: 0 at the foot of the part, 1 at its tip */
    double normal[3];
    enum part part;
    uint32_t plant;
};

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* A place in the field: across the rows and along them. */
static void rows_of(const struct wheat *w, double x, double z, double *across, double *along)
{
    *along = x * w->along[0] + z * w->along[1];
    *across = z * w->along[0] - x * w->along[1];
}

/* Does a wheel run here? Two tracks 1.8 m apart, each half a metre wide. */
static int in_track(double across)
{
    double at = fabs(remainder(across - 4.5, TRACKS));

    return fabs(at - 0.9) < 0.25;
}

/* A row is left out where the sower turned. */
static int between_bouts(double across) { return fabs(remainder(across - 1.5, BOUT)) < 0.16; }

/* The brightness of the crop at a place against its mean: patches of soil, and wind. */
static double tone_at(double across, double along, uint32_t seed)
{
    return 1 + 0.22 * noise_sum(across / 45, along / 70, 0.5, 3, seed + 11) +
           0.16 * noise_sum(across / 6, along / 17, 0.5, 3, seed + 12);
}

/* How much greener than ripe: 0 to 0.5, in patches. */
static double green_at(double across, double along, uint32_t seed)
{
    return 0.5 * smooth_step(0.05, 0.6, noise_sum(across / 28, along / 60, 7.5, 3, seed + 13));
}

/* A round rod from `foot` along `span`. */
static void meet_rod(const struct ray *ray, const double foot[3], const double span[3], double radius, enum part part,
                     uint32_t plant, struct meeting *nearest)
{
    double to_foot[3] = {foot[0] - ray->from[0], foot[1] - ray->from[1], foot[2] - ray->from[2]};
    double b = dot(ray->to, span), c = dot(span, span), d = dot(ray->to, to_foot);
    double e = dot(span, to_foot), s = (b * d - e) / fmax(c - b * b, 1e-12), t, gap[3], apart;

    s = fmin(fmax(s, 0), 1);
    t = d + s * b;
    for (int i = 0; i < 3; i++)
        gap[i] = t * ray->to[i] - to_foot[i] - s * span[i];
    apart = dot(gap, gap);
    if (part == EAR) /* slimmer at both ends */
        radius *= 0.45 + 0.55 * sqrt(fmax(1 - (2 * s - 0.8) * (2 * s - 0.8), 0));
    if (apart > radius * radius)
        return;
    t -= sqrt(radius * radius - apart);
    if (t < 1e-4 || t >= nearest->t)
        return;
    nearest->t = t;
    nearest->along = s;
    nearest->part = part;
    nearest->plant = plant;
    for (int i = 0; i < 3; i++)
        nearest->normal[i] = (ray->from[i] + t * ray->to[i] - foot[i] - s * span[i]) / radius;
}

/* The plant of a cell of the field, in which the ray is at `lowest` or higher: a bent stalk, its ear, and a
 * leaf. */
static void meet_plant(const struct wheat *w, const struct ray *ray, int row, int number, double lowest,
                       struct meeting *nearest)
{
    const double c = w->along[0], s = w->along[1];
    uint32_t plant = noise_hash(row, number, 3, w->seed);
    double across = (row + 0.5 + 0.5 * (noise_number(plant, 0) - 0.5)) * ROW;
    double along = (number + noise_number(plant, 1)) * PLANTS;
    double height = WHEAT_TOP_M - EAR_LENGTH + 0.24 * (noise_number(plant, 2) - 0.5) +
                    0.08 * (noise_number(noise_hash(row, number >> 6, 4, w->seed), 0) - 0.5);
    double turn, lean, x, z;

    if (lowest > height + EAR_LENGTH + EAR_RADIUS || in_track(across) || between_bouts(across))
        return;
    turn = 2 * PI * noise_number(plant, 3);
    lean = 0.25 + 0.5 * noise_number(plant, 4);
    x = along * c - across * s;
    z = along * s + across * c;
    {
        const double bend[2] = {lean * cos(turn) + 0.35 * c,
                                lean * sin(turn) + 0.35 * s}; /* wind */
        const double foot[3] = {x, 0, z}, stalk[3] = {bend[0] * 0.08, height, bend[1] * 0.08};
        const double neck[3] = {x + stalk[0], height, z + stalk[2]};
        const double ear[3] = {bend[0] * EAR_LENGTH, EAR_LENGTH, bend[1] * EAR_LENGTH};
        double from = height * (0.45 + 0.35 * noise_number(plant, 7));
        const double leaf_foot[3] = {x + stalk[0] * from / height, from,
                                     z + stalk[2] * from / height};
        const double leaf[3] = {0.16 * cos(turn + 2), 0.12 * (noise_number(plant, 8) - 0.3),
                                0.16 * sin(turn + 2)};

        meet_rod(ray, neck, ear, EAR_RADIUS * (0.8 + 0.5 * noise_number(plant, 5)), EAR, plant, nearest);
        if (lowest > height)
            return;
        meet_rod(ray, foot, stalk, STALK_RADIUS, STALK, plant, nearest);
        if (noise_number(plant, 6) < 0.6 && lowest < from + 0.1)
            meet_rod(ray, leaf_foot, leaf, LEAF_RADIUS, LEAF, plant, nearest);
    }
}

/* Walk through the field's cells from `t`, at most `cells` of them and while the ray is among the plants: the
 * first part that it meets, or the soil. 0 if it leaves the crop upwards, or meets nothing. */
static int meet_crop(const struct wheat *w, const struct ray *ray, double t, int cells, struct meeting *nearest)
{
    double across, along, across_step, along_step, next[2], delta[2], enters = t;
    int at[2], step[2];

    *nearest = (struct meeting){.t = ray->to[1] < 0 ? -ray->from[1] / ray->to[1] : INFINITY, .part = SOIL,
                                .normal = {0, 1, 0}};
    rows_of(w, ray->from[0] + t * ray->to[0], ray->from[2] + t * ray->to[2], &across, &along);
    rows_of(w, ray->to[0], ray->to[2], &across_step, &along_step);
    {
        double place[2] = {across / ROW, along / PLANTS};
        double speed[2] = {across_step / ROW, along_step / PLANTS};

        for (int i = 0; i < 2; i++) {
            at[i] = (int)floor(place[i]);
            step[i] = speed[i] < 0 ? -1 : 1;
            delta[i] = 1 / fmax(fabs(speed[i]), 1e-9);
            next[i] = t + (speed[i] < 0 ? place[i] - at[i] : at[i] + 1 - place[i]) * delta[i];
        }
    }
    for (int n = 0; n < cells; n++) {
        int axis = next[1] < next[0];
        double leaves = next[axis];
        double height = ray->from[1] + leaves * ray->to[1]; /* where the ray leaves the cell */

        meet_plant(w, ray, at[0], at[1], fmin(height, ray->from[1] + enters * ray->to[1]), nearest);
        if (nearest->t <= leaves)
            return 1;
        if (ray->to[1] > 0 && height > HIGHEST)
            return 0;
        enters = leaves;
        at[axis] += step[axis];
        next[axis] += delta[axis];
    }
    return 0;
}

static void colour_of(const struct wheat *w, const struct meeting *m, double across, double along, double albedo[3])
{
    static const double ripe[4][3] = {
        {.20, .15, .095}, {.72, .50, .20}, {.62, .46, .20}, {.50, .41, .19}};
    static const double young[3] = {.34, .38, .12};
    double green = green_at(across, along, w->seed) * (m->part == SOIL ? 0 : 1);
    double shade = m->part == SOIL ? 1 : 0.75 + 0.5 * noise_number(m->plant, 9);

    if (m->part == EAR) /* grains, in two lines */
        shade *= 0.82 + 0.18 * cos(m->along * 2 * PI * 9 + 2 * noise_number(m->plant, 10));
    if (m->part == LEAF)
        green = fmin(green + 0.35 * noise_number(m->plant, 11), 1);
    shade *= tone_at(across, along, w->seed);
    for (int c = 0; c < 3; c++)
        albedo[c] = fmin(mix(ripe[m->part][c], young[c], green) * shade, 0.95);
}

/* Ears, stalks, leaves or soil, one ray. */
static void plant_light(const struct wheat *w, const double direction[3], double rgb[3])
{
    struct ray ray = {.from = {0, WHEAT_EYE_M, 0}}, shadow;
    struct meeting met, blocking;
    double across, along, albedo[3], depth, sees, cosine, lit, through;

    memcpy(ray.to, direction, sizeof ray.to);
    if (!meet_crop(w, &ray, (WHEAT_EYE_M - HIGHEST) / -direction[1], CELLS_MAX, &met)) /* none for long */
        met = (struct meeting){.t = (WHEAT_EYE_M - 0.7 * WHEAT_TOP_M) / -direction[1], .along = 0.5,
                               .part = STALK, .normal = {0, 1, 0}};
    for (int i = 0; i < 3; i++)
        shadow.from[i] = ray.from[i] + met.t * ray.to[i] + 2e-3 * met.normal[i];
    memcpy(shadow.to, w->light->to_sun, sizeof shadow.to);
    rows_of(w, shadow.from[0], shadow.from[2], &across, &along);
    colour_of(w, &met, across, along, albedo);
    lit = !meet_crop(w, &shadow, 0, SHADOW_CELLS_MAX, &blocking);
    cosine = dot(met.normal, w->light->to_sun);
    through = met.part == SOIL ? 0 : 0.2; /* thin parts let some light through */
    depth = fmax(WHEAT_TOP_M - shadow.from[1], 0);
    sees = (0.18 + 0.82 * exp(-depth / 0.16)) * (0.6 + 0.4 * met.normal[1]);
    daylight_matt(w->light, albedo, lit * (fmax(cosine, 0) * (1 - through) + through), sees, rgb);
}

/* The mean over directions that differ a little, of an even crop. */
static void fill_mean(struct wheat *w)
{
    for (int k = 0; k < WHEAT_SECTORS; k++) {
        double sum[3] = {0, 0, 0}, weight = 0;

        for (int n = 0; n < MEAN_RAYS; n++) {
            uint32_t h = noise_hash(k, n, 5, w->seed);
            double azimuth = 2 * PI * (k + noise_number(h, 0)) / WHEAT_SECTORS;
            double elevation = -PI / 180 * (2.5 + 1.5 * noise_number(h, 1)), light[3];
            const double direction[3] = {cos(elevation) * cos(azimuth), sin(elevation),
                                         cos(elevation) * sin(azimuth)};
            double distance = (WHEAT_EYE_M - WHEAT_TOP_M) / -tan(elevation), across, along;

            rows_of(w, distance * cos(azimuth), distance * sin(azimuth), &across, &along);
            if (in_track(across) || between_bouts(across))
                continue;
            plant_light(w, direction, light);
            for (int c = 0; c < 3; c++)
                sum[c] += light[c] / tone_at(across, along, w->seed);
            weight++;
        }
        for (int c = 0; c < 3; c++)
            w->mean[k][c] = sum[c] / fmax(weight, 1);
    }
}

void wheat_init(struct wheat *wheat, const struct daylight *light, uint32_t seed)
{
    wheat->light = light;
    wheat->seed = seed;
    wheat->along[0] = cos(ROWS_AZIMUTH);
    wheat->along[1] = sin(ROWS_AZIMUTH);
    fill_mean(wheat);
}

/* The share of a gap of `width` metres in the crop that is seen into, by a ray that falls by
 * `fall` (tangent) and crosses the rows at an angle of sine `crossing`. */
static double seen_into(double width, double fall, double crossing)
{
    return smooth_step(0, 0.5, width * fall / fmax(crossing, 1e-3) / 0.5);
}

static void mean_light(const struct wheat *w, const double direction[3], double distance, double slope, double rgb[3])
{
    static const double green_tint[3] = {0.62, 0.95, 0.75};
    double flat = hypot(direction[0], direction[2]), x = direction[0] / flat, z = direction[2] / flat;
    double across, along, crossing, unused, at, gap, green, tone;
    double turn = atan2(z, x) / (2 * PI), fall = slope - direction[1] / flat;
    int i, k;

    rows_of(w, x * distance, z * distance, &across, &along);
    rows_of(w, x, z, &crossing, &unused);
    crossing = fabs(crossing);
    at = (turn - floor(turn)) * WHEAT_SECTORS - 0.5;
    i = ((int)floor(at) + WHEAT_SECTORS) % WHEAT_SECTORS;
    k = (i + 1) % WHEAT_SECTORS;
    /* Ears as one sees them: upright grains of an even size in the field. */
    tone = tone_at(across, along, w->seed) *
           (1 + 0.5 * noise_sum(turn * 2 * PI * distance / 0.09, 30 * log(distance), 0.5, 2, w->seed + 14) *
                    smooth_step(300, 30, distance));
    /* Tracks, and a wider gap between two rows where the sower turned, every 3 m. */
    gap = in_track(across) ? 0.45 + 0.55 * seen_into(0.5, fall, crossing) : 0;
    if (between_bouts(across))
        gap = fmax(gap, 0.2 + 0.5 * seen_into(0.32, fall, crossing));
    green = green_at(across, along, w->seed);
    for (int c = 0; c < 3; c++)
        rgb[c] = mix(w->mean[i][c], w->mean[k][c], at - floor(at)) * tone * (1 - 0.55 * gap) *
                 mix(1, green_tint[c], green + 0.25 * gap);
}

void wheat_light(const struct wheat *wheat, const double direction[3], double distance_m, double slope, double rgb[3])
{
    double share = smooth_step(NEAR, FAR, distance_m), near[3];

    if (share > 0)
        mean_light(wheat, direction, distance_m, slope, rgb);
    if (share >= 1)
        return;
    plant_light(wheat, direction, near);
    for (int c = 0; c < 3; c++)
        rgb[c] = share > 0 ? mix(near[c], rgb[c], share) : near[c];
}
