#include "worker/render/bsdf/dispersion.h"

#include "common/math/elementary.h"

real dispersion_ior(real n_d, real dispersion, real nm)
{
    real n;

    if (!(dispersion > 0.0f && n_d > 1.0f && nm > 0.0f))
        return n_d;
    n = n_d + (n_d - 1.0f) * (dispersion * (1.0f / REAL(20.0))) * (523655.0f / (nm * nm) - REAL(1.5168));
    return n > 1.0f ? (n < 1e4f ? n : 1e4f) : 1.0f;
}

/* A Gaussian with different widths (nm) on its two sides. */
static real lobe(real nm, real peak, real below, real above)
{
    real t = (nm - peak) / (nm < peak ? below : above);
    return real_exp(-0.5f * t * t);
}

real wavelength_sample(real u, struct vec3 *rgb_weight)
{
    /* Density proportional to sech^2((nm - CENTRE) / WIDTH), near the mean of the three sensitivities (Radziszewski,
     * Boryczko and Alda 2009 use this form), inverted with the tanh of both ends. */
    const real centre = 530.0f, width = 120.0f;
    const real low = -REAL(0.84828364), high = REAL(0.91912087); /* tanh((380 - c) / w), (720 - c) / w */
    real t = low + (high - low) * (u > 0.0f ? (u < 1.0f ? u : 1.0f) : 0.0f);
    real nm = centre + 0.5f * width * real_log((1.0f + t) / (1.0f - t));
    real inverse_density = width * (high - low) / (1.0f - t * t);
    real x, y, z;

    nm = nm > DISPERSION_NM_MIN ? (nm < DISPERSION_NM_MAX ? nm : DISPERSION_NM_MAX) : DISPERSION_NM_MIN;
    /* Wyman, Sloan and Shirley 2013 (JCGT 2(2)): fit of the CIE 1931 colour matching functions. */
    x = REAL(1.056) * lobe(nm, REAL(599.8), REAL(37.9), 31.0f) + REAL(0.362) * lobe(nm, 442.0f, 16.0f, REAL(26.7)) -
        REAL(0.065) * lobe(nm, REAL(501.1), REAL(20.4), REAL(26.2));
    y = REAL(0.821) * lobe(nm, REAL(568.8), REAL(46.9), 40.5f) + REAL(0.286) * lobe(nm, REAL(530.9), REAL(16.3), REAL(31.1));
    z = REAL(1.217) * lobe(nm, 437.0f, REAL(11.8), 36.0f) + REAL(0.681) * lobe(nm, 459.0f, 26.0f, REAL(13.8));
    /* To Rec. 709, each row over its own integral from 380 to 720 nm, so that an equal-energy light is white. */
    rgb_weight->x =
        (REAL(3.2404542) * x - REAL(1.5371385) * y - REAL(0.4985314) * z) * (REAL(7.790644758e-3) * inverse_density);
    rgb_weight->y =
        (-REAL(0.9692660) * x + REAL(1.8760108) * y + REAL(0.0415560) * z) * (REAL(9.849546185e-3) * inverse_density);
    rgb_weight->z =
        (REAL(0.0556434) * x - REAL(0.2040259) * y + REAL(1.0572252) * z) * (REAL(1.0302251085e-2) * inverse_density);
    return nm;
}
