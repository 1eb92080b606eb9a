/* The operators, one a file, and what they share. Private to common/tonemap. */
#ifndef AZULEJO_TONEMAP_OPERATORS_H
#define AZULEJO_TONEMAP_OPERATORS_H

#include "common/tonemap/tonemap.h"

extern const struct tonemap_operator tonemap_linear;
extern const struct tonemap_operator tonemap_normalize;
extern const struct tonemap_operator tonemap_gamma;
extern const struct tonemap_operator tonemap_reinhard02;
extern const struct tonemap_operator tonemap_drago03;
extern const struct tonemap_operator tonemap_aces;
extern const struct tonemap_operator tonemap_aces_hill;
extern const struct tonemap_operator tonemap_mantiuk08;
extern const struct tonemap_operator tonemap_mantiuk06;
extern const struct tonemap_operator tonemap_agx;
extern const struct tonemap_operator tonemap_pbr_neutral;
extern const struct tonemap_operator tonemap_hable;
extern const struct tonemap_operator tonemap_lut;

/* Luminance of linear Rec. 709 in double: three large floats must not overflow. */
static inline double tonemap_luminance(const float rgb[3])
{
    return 0.212656 * (double)rgb[0] + 0.715158 * (double)rgb[1] + 0.072186 * (double)rgb[2];
}

/* Call row(user, rgb[width][3], width) for every line of the frame's picture, on its threads. */
void tonemap_each_row(const struct tonemap_frame *frame,
                      void (*row)(const void *user, float *rgb, uint32_t width), const void *user);

/* The luminance below which `percent` (0..100) of the pixels with positive luminance lie, as a
 * float, exactly (nearest rank); 0 if there is none. Pixels that are not finite do not count.
 * ERR_NO_MEMORY. */
status tonemap_percentile(double *out, const struct image *image, double percent,
                          unsigned threads, struct error *err) MUST_CHECK;

/* The matrix by which linear Rec. 709 is multiplied so that a light of that colour temperature
 * looks like D65 (Bradford). Below 4000 K the Planckian locus, above it the CIE daylight locus. */
void tonemap_white_balance(double kelvin, double out[3][3]);

#endif
