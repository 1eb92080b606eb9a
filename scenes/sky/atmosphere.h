/* atmosphere: sunlight scattered by a clear, spherical atmosphere, seen from the ground.
 *
 * Air (Rayleigh), aerosol (Mie) and ozone over a sphere; single scattering is integrated
 * along the view ray, further orders are added as isotropic light after Hillaire 2020 ("A
 * Scalable and Production Ready Sky and Atmosphere Rendering Technique", EGSR, section 5.5).
 * Everything is computed at ATMOSPHERE_WAVELENGTHS wavelengths and handed out as linear Rec. 709
 * in photometric units: 1 is 1 cd/m2 (radiance) or 1 lux (irradiance).
 */
#pragma once

enum { ATMOSPHERE_WAVELENGTHS = 16 };

struct spectrum {
    double at[ATMOSPHERE_WAVELENGTHS]; /* W per m2 (and sr) and nm */
};

struct atmosphere;

/* `turbidity`: how much thicker air and aerosol together are than air alone at 550 nm, 1
 * (no aerosol) to 10. `ground_albedo` 0..1. NULL when out of memory. */
struct atmosphere *atmosphere_new(double turbidity, double ground_albedo);
void atmosphere_free(struct atmosphere *a);

/* Light arriving at the ground from elevation `elevation_rad` >= 0, `azimuth_rad` beside the sun,
 * for each kind of scattering without its phase function (multiply by atmosphere_phase_*), and
 * the isotropic rest. Linear Rec. 709. */
struct sky_radiance {
    double rayleigh[3], mie[3], rest[3];
};
void atmosphere_sky(const struct atmosphere *a, double sun_elevation_rad, double elevation_rad, double azimuth_rad,
                    struct sky_radiance *out);

/* Phase functions, per steradian, by the cosine of the angle to the sun. */
double atmosphere_phase_rayleigh(double cosine);
double atmosphere_phase_mie(double cosine);

/* Radiance of the sun's disc seen at `elevation_rad`, `radius` of 0 (centre) to 1 (limb) from
 * its middle. Black below the horizon. */
void atmosphere_sun(const struct atmosphere *a, double elevation_rad, double radius, double rgb[3]);

/* Half the sun's angular diameter of 0.533 degrees. */
#define SUN_RADIUS_RAD (0.533 / 2 * 3.14159265358979323846 / 180)
