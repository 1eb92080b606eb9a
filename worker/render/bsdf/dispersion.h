/* dispersion: the index of refraction at a wavelength, and which wavelength to follow. */
#pragma once

#include "common/math/vec.h"

#define DISPERSION_NM_MIN 380.0f
#define DISPERSION_NM_MAX 720.0f

/* Cauchy's formula through n_d (at 587.6 nm) with the Abbe number 20 / dispersion, as in
 * KHR_materials_dispersion; at least 1. dispersion <= 0, or n_d = 0 (Fresnel 1): n_d. */
real dispersion_ior(real n_d, real dispersion, real nm);

/* Choose a wavelength (nm, DISPERSION_NM_MIN..MAX) with u in [0,1), more often where the eye is sensitive. *rgb_weight
 * is its colour in linear Rec. 709 over that density. Its mean over u is (1,1,1), so white stays white. Components of
 * single wavelengths may be negative: only their mean is a colour. */
real wavelength_sample(real u, struct vec3 *rgb_weight);
