/* pbrt_spectrum: spectra of pbrt scenes, and their linear Rec. 709 colours.
 *
 * pbrt renders with wavelengths and its film makes Rec. 709 of them; we render with RGB. A reflectance, an index or a
 * coefficient becomes the RGB that it has under D65, so that a constant spectrum c is (c, c, c). The spectrum of a
 * light keeps its colour only, scaled to luminance 1: that is what pbrt-v4 does to lights too. Deterministic.
 */
#pragma once

#include <stddef.h>

/* Linear between samples. */
struct spectrum {
    const double *samples; /* [count][2]: wavelength in nm, ascending; value */
    size_t count;
    int extended; /* beyond its ends: the end's value if set, else 0 */
};

double spectrum_at(const struct spectrum *s, double lambda_nm);

/* The RGB under D65; may be negative or above 1 where the colour is outside of Rec. 709. */
void spectrum_reflectance(const struct spectrum *s, double out[3]);

/* The RGB of the light itself: luminance 1 and no negative channel; 0: it is black. */
int spectrum_light(const struct spectrum *s, double out[3]);
/* Its luminance, where a constant spectrum of 1 has 1. */
double spectrum_luminance(const struct spectrum *s);
/* The colour of a black body of 100..1e6 K (clamped). Returns its luminance where its spectrum's largest value is 1, as
 * spectrum_luminance() has it. */
double spectrum_blackbody(double kelvin, double out[3]);

/* "metal-Au-eta", ... NULL: unknown. */
const struct spectrum *spectrum_named(const char *name);
/* "stdillum-D50", "illum-acesD60", ... 0: unknown. */
int spectrum_named_light(const char *name, double out[3]);
/* "glass-BK7", ...: index at the d line and Abbe number. 0: unknown. */
int spectrum_named_glass(const char *name, double *index, double *abbe);
/* The same for any spectrum; abbe is 0 when the index does not fall with the wavelength. */
void spectrum_glass(const struct spectrum *s, double *index, double *abbe);

/* A metal: the eta and k at R, G, B whose reflectance at normal incidence is the RGB under D65
 * of the spectral reflectance, with an eta as near the spectrum's as that allows. */
void spectrum_conductor(const struct spectrum *eta, const struct spectrum *k, double eta_rgb[3], double k_rgb[3]);

/* Reflectance at normal incidence of a complex index seen from air. */
double conductor_normal_reflectance(double eta, double k);

/* CIE xyY with Y = 1 to Rec. 709, negative channels cut off. */
void chromaticity_to_rgb(double x, double y, double out[3]);
void xyz_to_rgb(const double xyz[3], double out[3]);
