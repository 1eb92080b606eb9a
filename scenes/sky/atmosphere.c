#include "scenes/sky/atmosphere.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"

#define PI 3.14159265358979323846

/* Lengths in km. */
#define GROUND_RADIUS 6360.0
#define TOP_RADIUS 6460.0
#define OBSERVER_HEIGHT 0.002
#define RAYLEIGH_HEIGHT 8.0
#define MIE_HEIGHT 1.2
#define OZONE_PEAK 25.0
#define OZONE_HALF_WIDTH 15.0

/* Scattering of sea-level air, per km, at 1 um; times wavelength^-4. */
#define RAYLEIGH_AT_1UM 1.24062e-3
/* Aerosol: Angstrom exponent, single-scattering albedo, asymmetry (rural values). */
#define MIE_ANGSTROM 1.3
#define MIE_ALBEDO 0.92
#define MIE_G 0.76
/* Ozone's largest number density for a column of 300 Dobson units in a triangle, per km and m2:
 * 300 * 2.687e20 / m2 over 15 km. */
#define OZONE_PEAK_DENSITY (300 * 2.687e20 / OZONE_HALF_WIDTH)

enum {
    VIEW_STEPS = 64,
    COLUMN_STEPS = 48,
    COLUMN_HEIGHTS = 48,
    COLUMN_ANGLES = 128,
    MULTIPLE_HEIGHTS = 16,
    MULTIPLE_ANGLES = 24,
    MULTIPLE_STEPS = 20,
    MULTIPLE_POLAR = 6, /* directions over the sphere: polar times 2 polar */
};

#define FIRST_NM 400.0
#define STEP_NM 20.0

/* The sun above the atmosphere, W / m2 / nm, 400 to 700 nm in steps of 20 (ASTM G173-03,
 * extraterrestrial, averaged). */
static const double sun_irradiance[ATMOSPHERE_WAVELENGTHS] = {
    1.728, 1.689, 1.912, 2.020, 1.934, 1.917, 1.869, 1.851,
    1.834, 1.815, 1.753, 1.682, 1.605, 1.556, 1.474, 1.410};

/* Ozone's absorption cross section (Chappuis band), 1e-25 m2. */
static const double ozone_section[ATMOSPHERE_WAVELENGTHS] = {
    0.015, 0.055, 0.158, 0.367, 0.775, 1.480, 2.139, 3.091,
    4.266, 4.398, 5.019, 3.740, 2.662, 1.852, 1.209, 0.746};

/* How much of each constituent lies along a path: km at sea-level (ozone: at peak) density. */
struct columns {
    double rayleigh, mie, ozone;
};

struct atmosphere {
    double ground_albedo;
    /* Per km at sea level (ozone: at its peak). */
    double rayleigh[ATMOSPHERE_WAVELENGTHS];
    double mie[ATMOSPHERE_WAVELENGTHS]; /* extinction */
    double ozone[ATMOSPHERE_WAVELENGTHS];
    double to_rgb[ATMOSPHERE_WAVELENGTHS][3]; /* from W to lm, summed over wavelength */
    struct columns columns[COLUMN_HEIGHTS][COLUMN_ANGLES];
    struct spectrum multiple[MULTIPLE_HEIGHTS][MULTIPLE_ANGLES];
};

/* ---- colour ------------------------------------------------------------------------------ */

/* A lobe of two half Gaussians. */
static double lobe(double nm, double peak, double below, double above)
{
    double t = (nm - peak) * (nm < peak ? below : above);

    return exp(-0.5 * t * t);
}

/* CIE 1931 2-degree colour matching, multi-lobe fit of Wyman, Sloan, Shirley 2013 ("Simple
 * Analytic Approximations to the CIE XYZ Color Matching Functions", JCGT 2(2), table 1). */
static void color_matching(double nm, double xyz[3])
{
    xyz[0] = 0.362 * lobe(nm, 442.0, 0.0624, 0.0374) + 1.056 * lobe(nm, 599.8, 0.0264, 0.0323) -
             0.065 * lobe(nm, 501.1, 0.0490, 0.0382);
    xyz[1] = 0.821 * lobe(nm, 568.8, 0.0213, 0.0247) + 0.286 * lobe(nm, 530.9, 0.0613, 0.0322);
    xyz[2] = 1.217 * lobe(nm, 437.0, 0.0845, 0.0278) + 0.681 * lobe(nm, 459.0, 0.0385, 0.0725);
}

/* XYZ to linear Rec. 709 (IEC 61966-2-1). */
static const double xyz_to_rgb[3][3] = {{3.2404542, -1.5371385, -0.4985314},
                                        {-0.9692660, 1.8760108, 0.0415560},
                                        {0.0556434, -0.2040259, 1.0572252}};

static void set_colors(struct atmosphere *a)
{
    for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++) {
        double xyz[3];

        color_matching(FIRST_NM + STEP_NM * i, xyz);
        for (int c = 0; c < 3; c++)
            a->to_rgb[i][c] =
                683.0 * STEP_NM * (xyz_to_rgb[c][0] * xyz[0] + xyz_to_rgb[c][1] * xyz[1] + xyz_to_rgb[c][2] * xyz[2]);
    }
}

static void spectrum_to_rgb(const struct atmosphere *a, const struct spectrum *s, double rgb[3])
{
    rgb[0] = rgb[1] = rgb[2] = 0;
    for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++)
        for (int c = 0; c < 3; c++)
            rgb[c] += a->to_rgb[i][c] * s->at[i];
}

/* ---- what lies along a path -------------------------------------------------------------- */

static void set_coefficients(struct atmosphere *a, double turbidity)
{
    double air_550 = RAYLEIGH_AT_1UM * pow(0.55, -4) * RAYLEIGH_HEIGHT; /* vertical depth */
    double aerosol_550 = (turbidity - 1) * air_550 / MIE_HEIGHT;        /* per km */

    for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++) {
        double um = (FIRST_NM + STEP_NM * i) / 1000;

        a->rayleigh[i] = RAYLEIGH_AT_1UM * pow(um, -4);
        a->mie[i] = aerosol_550 * pow(um / 0.55, -MIE_ANGSTROM);
        a->ozone[i] = OZONE_PEAK_DENSITY * ozone_section[i] * 1e-25;
    }
}

/* Densities relative to sea level (ozone: to its peak) at a height. */
static struct columns densities(double height)
{
    struct columns d = {exp(-height / RAYLEIGH_HEIGHT), exp(-height / MIE_HEIGHT),
                        1 - fabs(height - OZONE_PEAK) / OZONE_HALF_WIDTH};

    if (d.ozone < 0)
        d.ozone = 0;
    return d;
}

/* Along a ray that leaves radius r with cosine mu to the vertical: where it meets a sphere. */
static double distance_to_top(double r, double mu)
{
    return -r * mu + sqrt(r * r * (mu * mu - 1) + TOP_RADIUS * TOP_RADIUS);
}

/* Negative when the ray misses the ground. */
static double distance_to_ground(double r, double mu)
{
    double discriminant = r * r * (mu * mu - 1) + GROUND_RADIUS * GROUND_RADIUS;

    if (mu >= 0 || discriminant < 0)
        return -1;
    return -r * mu - sqrt(discriminant);
}

static double radius_at(double r, double mu, double distance)
{
    return sqrt(distance * distance + 2 * r * mu * distance + r * r);
}

static double height_at(double r, double mu, double distance)
{
    return fmax(radius_at(r, mu, distance) - GROUND_RADIUS, 0);
}

/* Steps get longer with the distance: most of the matter is near. */
static double step_edge(double length, int index, int steps)
{
    double t = (double)index / steps;

    return length * t * t;
}

static struct columns integrate_columns(double r, double mu)
{
    double length = distance_to_top(r, mu);
    struct columns sum = {0, 0, 0};

    for (int i = 0; i < COLUMN_STEPS; i++) {
        double from = step_edge(length, i, COLUMN_STEPS);
        double to = step_edge(length, i + 1, COLUMN_STEPS);
        struct columns d = densities(height_at(r, mu, (from + to) / 2));

        sum.rayleigh += d.rayleigh * (to - from);
        sum.mie += d.mie * (to - from);
        sum.ozone += d.ozone * (to - from);
    }
    return sum;
}

/* Nodes are denser near the ground and near the horizon. */
static double height_of_node(double t) { return (TOP_RADIUS - GROUND_RADIUS) * t * t * t; }
static double node_of_height(double height) { return cbrt(fmax(height, 0) / (TOP_RADIUS - GROUND_RADIUS)); }
/* The lowest cosine that does not meet the ground, at a height. */
static double horizon_cosine(double height)
{
    double sine = GROUND_RADIUS / (GROUND_RADIUS + height);

    return -sqrt(fmax(1 - sine * sine, 0));
}

static void set_columns(struct atmosphere *a)
{
    for (int h = 0; h < COLUMN_HEIGHTS; h++) {
        double height = height_of_node((double)h / (COLUMN_HEIGHTS - 1));
        double lowest = horizon_cosine(height);

        for (int k = 0; k < COLUMN_ANGLES; k++) {
            double t = (double)k / (COLUMN_ANGLES - 1);

            a->columns[h][k] = integrate_columns(GROUND_RADIUS + height, lowest + (1 - lowest) * t * t);
        }
    }
}

static double mix(double a, double b, double t) { return a + (b - a) * t; }

static struct columns columns_mix(struct columns a, struct columns b, double t)
{
    return (struct columns){mix(a.rayleigh, b.rayleigh, t), mix(a.mie, b.mie, t), mix(a.ozone, b.ozone, t)};
}

static int split(double t, int nodes, double *fraction)
{
    double at = fmin(fmax(t, 0), 1) * (nodes - 1);
    int i = (int)at;

    if (i > nodes - 2)
        i = nodes - 2;
    *fraction = at - i;
    return i;
}

/* From a point up to the sun; 0 when the earth is in between. */
static int columns_to_sun(const struct atmosphere *a, double height, double mu, struct columns *out)
{
    double lowest = horizon_cosine(height), fh, fk;
    int h, k;

    if (mu < lowest)
        return 0;
    h = split(node_of_height(height), COLUMN_HEIGHTS, &fh);
    k = split(sqrt((mu - lowest) / (1 - lowest)), COLUMN_ANGLES, &fk);
    *out = columns_mix(columns_mix(a->columns[h][k], a->columns[h][k + 1], fk),
                       columns_mix(a->columns[h + 1][k], a->columns[h + 1][k + 1], fk), fh);
    return 1;
}

static double transmittance(const struct atmosphere *a, const struct columns *c, int i)
{
    return exp(-(a->rayleigh[i] * c->rayleigh + a->mie[i] * c->mie + a->ozone[i] * c->ozone));
}

/* ---- scattering -------------------------------------------------------------------------- */

/* A ray seen from radius r: what one more order of scattering along it brings. */
struct march {
    struct spectrum rayleigh, mie; /* single scattering of the sun, no phase function */
    struct spectrum scattered;     /* of a uniform radiance 1 everywhere */
    struct spectrum rest;          /* of the multiply scattered light */
    struct columns passed;
};

static void multiple_at(const struct atmosphere *a, double height, double sun_mu, struct spectrum *out)
{
    double fh, fk;
    int h = split(node_of_height(height), MULTIPLE_HEIGHTS, &fh);
    int k = split(sun_mu * 0.5 + 0.5, MULTIPLE_ANGLES, &fk);

    for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++)
        out->at[i] = mix(mix(a->multiple[h][k].at[i], a->multiple[h][k + 1].at[i], fk),
                         mix(a->multiple[h + 1][k].at[i], a->multiple[h + 1][k + 1].at[i], fk), fh);
}

/* March from radius r along (mu, and cosine `nu` to the sun) over `length`. The sun stands at
 * cosine sun_mu at the start. Within a step the light is attenuated analytically. */
static void march_ray(const struct atmosphere *a, double r, double mu, double nu, double sun_mu, double length,
                      int steps, int with_rest, struct march *m)
{
    memset(m, 0, sizeof *m);
    for (int s = 0; s < steps; s++) {
        double from = step_edge(length, s, steps), to = step_edge(length, s + 1, steps);
        double middle = (from + to) / 2, dx = to - from;
        double radius = radius_at(r, mu, middle), height = fmax(radius - GROUND_RADIUS, 0);
        double sun_here = fmin(fmax((r * sun_mu + middle * nu) / radius, -1), 1);
        struct columns d = densities(height), sun;
        struct spectrum rest;
        int lit = columns_to_sun(a, height, sun_here, &sun);

        if (with_rest)
            multiple_at(a, height, sun_here, &rest);
        for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++) {
            double air = a->rayleigh[i] * d.rayleigh, aerosol = a->mie[i] * d.mie;
            double extinction = air + aerosol + a->ozone[i] * d.ozone;
            double through = transmittance(a, &m->passed, i);
            double share = through * (extinction * dx > 1e-9 ? -expm1(-extinction * dx) / extinction : dx);
            double light = lit ? sun_irradiance[i] * transmittance(a, &sun, i) : 0;

            aerosol *= MIE_ALBEDO;
            m->rayleigh.at[i] += share * air * light;
            m->mie.at[i] += share * aerosol * light;
            m->scattered.at[i] += share * (air + aerosol);
            if (with_rest)
                m->rest.at[i] += share * (air + aerosol) * rest.at[i];
        }
        m->passed.rayleigh += d.rayleigh * dx;
        m->passed.mie += d.mie * dx;
        m->passed.ozone += d.ozone * dx;
    }
}

/* The mean radiance at one place after two and more scatterings: Hillaire's equations 5 to 10,
 * with the ground's reflection. */
static void set_multiple_at(struct atmosphere *a, double height, double sun_mu, struct spectrum *out)
{
    double r = GROUND_RADIUS + fmax(height, OBSERVER_HEIGHT);
    double sun_sine = sqrt(fmax(1 - sun_mu * sun_mu, 0));
    struct spectrum second = {{0}}, again = {{0}};
    int around = 2 * MULTIPLE_POLAR, count = MULTIPLE_POLAR * around;

    for (int p = 0; p < MULTIPLE_POLAR; p++)
        for (int q = 0; q < around; q++) {
            double mu = 1 - 2 * (p + 0.5) / MULTIPLE_POLAR; /* equal solid angles */
            double sine = sqrt(1 - mu * mu), phi = 2 * PI * (q + 0.5) / around;
            double nu = mu * sun_mu + sine * sun_sine * cos(phi);
            double ground = distance_to_ground(r, mu);
            double length = ground >= 0 ? ground : distance_to_top(r, mu);
            double ground_mu = (r * sun_mu + length * nu) / GROUND_RADIUS;
            struct columns sun;
            struct march m;
            int lit;

            march_ray(a, r, mu, nu, sun_mu, length, MULTIPLE_STEPS, 0, &m);
            lit = ground >= 0 && ground_mu > 0 && columns_to_sun(a, 0, fmin(ground_mu, 1), &sun);
            for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++) {
                second.at[i] += (m.rayleigh.at[i] + m.mie.at[i]) / (4 * PI) / count;
                again.at[i] += m.scattered.at[i] / count;
                if (lit)
                    second.at[i] += transmittance(a, &m.passed, i) * a->ground_albedo / PI * ground_mu *
                                    sun_irradiance[i] * transmittance(a, &sun, i) / count;
            }
        }
    for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++)
        out->at[i] = second.at[i] / (1 - fmin(again.at[i], 0.99));
}

struct atmosphere *atmosphere_new(double turbidity, double ground_albedo)
{
    struct atmosphere *a = mem_calloc(1, sizeof *a);

    if (!a)
        return NULL;
    a->ground_albedo = ground_albedo;
    set_coefficients(a, turbidity);
    set_colors(a);
    set_columns(a);
    for (int h = 0; h < MULTIPLE_HEIGHTS; h++)
        for (int k = 0; k < MULTIPLE_ANGLES; k++)
            set_multiple_at(a, height_of_node((double)h / (MULTIPLE_HEIGHTS - 1)), 2.0 * k / (MULTIPLE_ANGLES - 1) - 1,
                            &a->multiple[h][k]);
    return a;
}

void atmosphere_free(struct atmosphere *a) { mem_free(a); }

void atmosphere_sky(const struct atmosphere *a, double sun_elevation_rad, double elevation_rad, double azimuth_rad,
                    struct sky_radiance *out)
{
    double r = GROUND_RADIUS + OBSERVER_HEIGHT, mu = sin(elevation_rad);
    double sun_mu = sin(sun_elevation_rad);
    double nu = mu * sun_mu + cos(elevation_rad) * cos(sun_elevation_rad) * cos(azimuth_rad);
    struct march m;

    march_ray(a, r, mu, nu, sun_mu, distance_to_top(r, mu), VIEW_STEPS, 1, &m);
    spectrum_to_rgb(a, &m.rayleigh, out->rayleigh);
    spectrum_to_rgb(a, &m.mie, out->mie);
    spectrum_to_rgb(a, &m.rest, out->rest);
}

double atmosphere_phase_rayleigh(double cosine) { return 3 / (16 * PI) * (1 + cosine * cosine); }

/* Cornette and Shanks 1992. */
double atmosphere_phase_mie(double cosine)
{
    const double g = MIE_G;

    return 3 / (8 * PI) * (1 - g * g) / (2 + g * g) * (1 + cosine * cosine) / pow(1 + g * g - 2 * g * cosine, 1.5);
}

void atmosphere_sun(const struct atmosphere *a, double elevation_rad, double radius, double rgb[3])
{
    double solid_angle = 2 * PI * (1 - cos(SUN_RADIUS_RAD));
    double mu = sqrt(fmax(1 - radius * radius, 0));
    struct columns c;
    struct spectrum s;

    rgb[0] = rgb[1] = rgb[2] = 0;
    if (elevation_rad < 0 || !columns_to_sun(a, OBSERVER_HEIGHT, sin(elevation_rad), &c))
        return;
    for (int i = 0; i < ATMOSPHERE_WAVELENGTHS; i++) {
        /* Limb darkening mu^alpha of Hestroffer and Magnan 1998; its mean over the disc is
         * 2 / (alpha + 2). */
        double alpha = -0.023 + 0.292 / ((FIRST_NM + STEP_NM * i) / 1000);

        s.at[i] = sun_irradiance[i] / solid_angle * transmittance(a, &c, i) * pow(mu, alpha) * (alpha + 2) / 2;
    }
    spectrum_to_rgb(a, &s, rgb);
}
