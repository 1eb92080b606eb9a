#include "worker/render/bsdf/dispersion.h"

#include "common/math/elementary.h"

float dispersion_ior(float n_d, float dispersion, float nm)
{
    float n;

    if (!(dispersion > 0.0f && n_d > 1.0f && nm > 0.0f))
        return n_d;
    n = n_d + (n_d - 1.0f) * (dispersion * (1.0f / 20.0f)) * (523655.0f / (nm * nm) - 1.5168f);
    return n > 1.0f ? (n < 1e4f ? n : 1e4f) : 1.0f;
}

/* A Gaussian with different widths (nm) on its two sides. */
static float lobe(float nm, float peak, float below, float above)
{
    float t = (nm - peak) / (nm < peak ? below : above);
    return det_exp(-0.5f * t * t);
}

float wavelength_sample(float u, struct vec3 *rgb_weight)
{
    /* Density proportional to sech^2((nm - CENTRE) / WIDTH), near the mean of the three
     * sensitivities (Radziszewski, Boryczko and Alda 2009 use this form), inverted with the tanh of
     * both ends. */
    const float centre = 530.0f, width = 120.0f;
    const float low = -0.84828364f, high = 0.91912087f; /* tanh((380 - c) / w), (720 - c) / w */
    float t = low + (high - low) * (u > 0.0f ? (u < 1.0f ? u : 1.0f) : 0.0f);
    float nm = centre + 0.5f * width * det_log((1.0f + t) / (1.0f - t));
    float inverse_density = width * (high - low) / (1.0f - t * t);
    float x, y, z;

    nm = nm > DISPERSION_NM_MIN ? (nm < DISPERSION_NM_MAX ? nm : DISPERSION_NM_MAX)
                                : DISPERSION_NM_MIN;
    /* Wyman, Sloan and Shirley 2013 (JCGT 2(2)): fit of the CIE 1931 colour matching functions. */
    x = 1.056f * lobe(nm, 599.8f, 37.9f, 31.0f) + 0.362f * lobe(nm, 442.0f, 16.0f, 26.7f) -
        0.065f * lobe(nm, 501.1f, 20.4f, 26.2f);
    y = 0.821f * lobe(nm, 568.8f, 46.9f, 40.5f) + 0.286f * lobe(nm, 530.9f, 16.3f, 31.1f);
    z = 1.217f * lobe(nm, 437.0f, 11.8f, 36.0f) + 0.681f * lobe(nm, 459.0f, 26.0f, 13.8f);
    /* To Rec. 709, each row over its own integral from 380 to 720 nm, so that an equal-energy light
     * is white. */
    rgb_weight->x = (3.2404542f * x - 1.5371385f * y - 0.4985314f * z) *
                    (7.790644758e-3f * inverse_density);
    rgb_weight->y = (-0.9692660f * x + 1.8760108f * y + 0.0415560f * z) *
                    (9.849546185e-3f * inverse_density);
    rgb_weight->z = (0.0556434f * x - 0.2040259f * y + 1.0572252f * z) *
                    (1.0302251085e-2f * inverse_density);
    return nm;
}
