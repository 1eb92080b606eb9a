#include "scenes/sky/sky.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "scenes/sky/atmosphere.h"
#include "scenes/sky/field.h"

#define PI 3.14159265358979323846
#define RAD(degrees) ((degrees) * (PI / 180))

/* The sky is smooth but for its phase functions, so it is computed on a coarse grid: nodes
 * are denser towards the horizon, and half the azimuths do by symmetry. */
enum { ELEVATIONS = 64, AZIMUTHS = 48, SUN_RINGS = 400, SUN_SPOKES = 1000, SUN_HEIGHTS = 64 };

struct sky {
    struct atmosphere *atmosphere;
    double sun_elevation_rad, sun_azimuth_rad;
    struct sky_radiance grid[ELEVATIONS][AZIMUTHS];
};

static double elevation_of_node(double t) { return PI / 2 * t * t; }

static void fill_grid(struct sky *sky)
{
    for (int e = 0; e < ELEVATIONS; e++)
        for (int k = 0; k < AZIMUTHS; k++)
            atmosphere_sky(sky->atmosphere, sky->sun_elevation_rad, elevation_of_node((double)e / (ELEVATIONS - 1)),
                           PI * k / (AZIMUTHS - 1), &sky->grid[e][k]);
}

static int split(double t, int nodes, double *fraction)
{
    double at = fmin(fmax(t, 0), 1) * (nodes - 1);
    int i = (int)at < nodes - 1 ? (int)at : nodes - 2;

    *fraction = at - i;
    return i;
}

/* cd/m2 as linear Rec. 709; `azimuth_rad` is relative to the sun's. */
static void sky_radiance_at(const struct sky *sky, double elevation_rad, double azimuth_rad, double rgb[3])
{
    double fe, fk, cosine, rayleigh, mie;
    int e = split(sqrt(elevation_rad / (PI / 2)), ELEVATIONS, &fe);
    int k = split(fabs(remainder(azimuth_rad, 2 * PI)) / PI, AZIMUTHS, &fk);
    const double weights[4] = {(1 - fe) * (1 - fk), (1 - fe) * fk, fe * (1 - fk), fe * fk};
    const struct sky_radiance *nodes[4] = {&sky->grid[e][k], &sky->grid[e][k + 1],
                                           &sky->grid[e + 1][k], &sky->grid[e + 1][k + 1]};

    cosine = sin(elevation_rad) * sin(sky->sun_elevation_rad) +
             cos(elevation_rad) * cos(sky->sun_elevation_rad) * cos(azimuth_rad);
    rayleigh = atmosphere_phase_rayleigh(cosine);
    mie = atmosphere_phase_mie(cosine);
    for (int c = 0; c < 3; c++) {
        rgb[c] = 0;
        for (int i = 0; i < 4; i++)
            rgb[c] += weights[i] * (nodes[i]->rayleigh[c] * rayleigh + nodes[i]->mie[c] * mie + nodes[i]->rest[c]);
        rgb[c] = fmax(rgb[c], 0); /* a blue outside Rec. 709 */
    }
}

/* Irradiance of the ground by the sky without the sun, by the midpoint rule. */
static void sky_irradiance(const struct sky *sky, double rgb[3])
{
    enum { ROWS = 90, COLUMNS = 180 };

    rgb[0] = rgb[1] = rgb[2] = 0;
    for (int y = 0; y < ROWS; y++)
        for (int x = 0; x < COLUMNS; x++) {
            double elevation = PI / 2 * (y + 0.5) / ROWS, azimuth = 2 * PI * (x + 0.5) / COLUMNS;
            double weight = sin(elevation) * cos(elevation) * (PI / 2 / ROWS) * (2 * PI / COLUMNS);
            double light[3];

            sky_radiance_at(sky, elevation, azimuth, light);
            for (int c = 0; c < 3; c++)
                rgb[c] += light[c] * weight;
        }
}

static void put(struct image *out, uint32_t x, uint32_t y, const double rgb[3])
{
    float *p = out->pixels + 3 * ((size_t)y * out->width + x);

    for (int c = 0; c < 3; c++)
        p[c] += (float)(rgb[c] / SKY_CANDELAS_PER_UNIT);
}

/* A texel has the radiance of its centre. */
static void paint_sky(const struct sky *sky, struct image *out, const double ground[3])
{
    for (uint32_t y = 0; y < out->height; y++) {
        double elevation = PI / 2 - PI * (y + 0.5) / out->height;

        for (uint32_t x = 0; x < out->width; x++) {
            double azimuth = 2 * PI * ((x + 0.5) / out->width - 0.5), rgb[3];

            if (elevation < 0) {
                put(out, x, y, ground);
                continue;
            }
            sky_radiance_at(sky, elevation, azimuth - sky->sun_azimuth_rad, rgb);
            put(out, x, y, rgb);
        }
    }
}

/* The sun's radiance by ring and height over the horizon: its light changes over its own disc
 * when it stands low. */
struct sun_table {
    double lowest_rad, step_rad;
    double rgb[SUN_HEIGHTS][3]; /* of the middle of the disc, as seen at a height */
};

static void fill_sun_table(const struct sky *sky, struct sun_table *t)
{
    t->lowest_rad = sky->sun_elevation_rad - SUN_RADIUS_RAD;
    t->step_rad = 2 * SUN_RADIUS_RAD / (SUN_HEIGHTS - 1);
    for (int i = 0; i < SUN_HEIGHTS; i++)
        atmosphere_sun(sky->atmosphere, t->lowest_rad + t->step_rad * i, 0, t->rgb[i]);
}

/* Cut the disc into pieces of equal solid angle and give each piece's light to the texel that
 * it falls into: whatever the map's size, nothing is lost and no texel counts twice. With
 * `out` NULL only *horizontal (illuminance of the ground as linear Rec. 709) is computed. */
static void paint_sun(const struct sky *sky, struct image *out, double horizontal[3])
{
    double solid_angle = 2 * PI * (1 - cos(SUN_RADIUS_RAD)) / ((double)SUN_RINGS * SUN_SPOKES);
    double se = sin(sky->sun_elevation_rad), ce = cos(sky->sun_elevation_rad);
    double whole[3];
    struct sun_table table;

    horizontal[0] = horizontal[1] = horizontal[2] = 0;
    fill_sun_table(sky, &table);
    atmosphere_sun(sky->atmosphere, PI / 2, 0, whole);
    for (int ring = 0; ring < SUN_RINGS; ring++) {
        /* Equal areas: the radius is the root of the share of the disc inside. */
        double share = (ring + 0.5) / SUN_RINGS;
        double cosine = 1 - share * (1 - cos(SUN_RADIUS_RAD)), sine = sqrt(1 - cosine * cosine);
        double limb[3];

        /* Limb darkening does not depend on the height: take it from the zenith. */
        atmosphere_sun(sky->atmosphere, PI / 2, sine / sin(SUN_RADIUS_RAD), limb);
        for (int spoke = 0; spoke < SUN_SPOKES; spoke++) {
            double turn = 2 * PI * (spoke + 0.5 * (ring % 2)) / SUN_SPOKES;
            double up = sine * cos(turn), aside = sine * sin(turn); /* in the sun's frame */
            double elevation = asin(fmin(fmax(cosine * se + up * ce, -1), 1));
            double azimuth = sky->sun_azimuth_rad + atan2(aside, cosine * ce - up * se);
            double at = (elevation - table.lowest_rad) / table.step_rad, fraction, light[3];
            int i;

            if (elevation < 0)
                continue;
            i = split(at / (SUN_HEIGHTS - 1), SUN_HEIGHTS, &fraction);
            for (int c = 0; c < 3; c++) {
                double middle = table.rgb[i][c] + (table.rgb[i + 1][c] - table.rgb[i][c]) * fraction;

                light[c] = fmax(middle * limb[c] / whole[c], 0) * solid_angle;
                horizontal[c] += light[c] * sin(elevation);
            }
            if (out) {
                double u = azimuth / (2 * PI) + 0.5, v = 0.5 - elevation / PI;
                uint32_t y = (uint32_t)fmin(v * out->height, out->height - 1.0);
                uint32_t x = (uint32_t)fmin((u - floor(u)) * out->width, out->width - 1.0);
                double texel = 2 * PI / out->width * (cos(PI * y / out->height) - cos(PI * (y + 1.0) / out->height));

                for (int c = 0; c < 3; c++)
                    light[c] /= texel;
                put(out, x, y, light);
            }
        }
    }
}

static double luminance(const double rgb[3]) { return 0.212656 * rgb[0] + 0.715158 * rgb[1] + 0.072186 * rgb[2]; }

/* What the landscape stands in. A sun at the horizon gives it none of its light. */
static void describe_daylight(const struct sky *sky, const double from_sun[3], const double from_sky[3],
                              struct daylight *light)
{
    double sine = sin(sky->sun_elevation_rad), cosine = cos(sky->sun_elevation_rad);

    light->to_sun[0] = cosine * cos(sky->sun_azimuth_rad);
    light->to_sun[1] = sine;
    light->to_sun[2] = cosine * sin(sky->sun_azimuth_rad);
    for (int c = 0; c < 3; c++) {
        light->sun_lux[c] = sine > 0.01 ? from_sun[c] / sine : 0;
        light->sky_lux[c] = from_sky[c];
    }
    for (int i = 0; i < DAYLIGHT_AZIMUTHS; i++)
        sky_radiance_at(sky, RAD(1.5), 2 * PI * i / DAYLIGHT_AZIMUTHS - sky->sun_azimuth_rad, light->haze[i]);
}

status sky_make(struct image *out, const struct sky_settings *settings, struct sky_report *report, struct error *err)
{
    double from_sun[3], from_sky[3], ground[3];
    struct sky *sky;
    status st;

    memset(out, 0, sizeof *out);
    sky = mem_calloc(1, sizeof *sky);
    if (!sky)
        return error_no_memory(err, "the sky");
    sky->sun_elevation_rad = RAD(settings->sun_elevation_deg);
    sky->sun_azimuth_rad = RAD(settings->sun_azimuth_deg);
    sky->atmosphere = atmosphere_new(settings->turbidity, settings->ground_albedo);
    if (!sky->atmosphere) {
        st = error_no_memory(err, "the atmosphere");
        goto done;
    }
    st = image_init(out, settings->width, settings->height, 3, err);
    if (st != STATUS_OK)
        goto done;
    fill_grid(sky);
    sky_irradiance(sky, from_sky);
    paint_sun(sky, NULL, from_sun);
    for (int c = 0; c < 3; c++)
        ground[c] = (from_sun[c] + from_sky[c]) * settings->ground_albedo / PI;
    paint_sky(sky, out, ground);
    if (settings->field) {
        struct daylight light;

        describe_daylight(sky, from_sun, from_sky, &light);
        st = field_paint(out, SKY_CANDELAS_PER_UNIT, &light, settings->seed, err);
        if (st != STATUS_OK)
            goto done;
    }
    if (!settings->no_sun)
        paint_sun(sky, out, from_sun);
    if (report) {
        report->sun_lux = luminance(from_sun);
        report->sky_lux = luminance(from_sky);
    }
done:
    atmosphere_free(sky->atmosphere);
    mem_free(sky);
    return st;
}
