/* The operators, one a file, and what they share. Private to common/tonemap. */
#pragma once

#include "common/tonemap/operator.h"

/* One row per operator, in the order in which they are listed; the first is the default. */
#define TONEMAP_OPERATORS(X) \
    X(reinhard02)            \
    X(drago03)               \
    X(mantiuk08)             \
    X(mantiuk06)             \
    X(aces)                  \
    X(aces_hill)             \
    X(agx)                   \
    X(pbr_neutral)           \
    X(hable)                 \
    X(lut)                   \
    X(gamma)                 \
    X(normalize)             \
    X(linear)

#define TONEMAP_DECLARE(name) extern const struct tonemap_operator tonemap_##name;
TONEMAP_OPERATORS(TONEMAP_DECLARE)

/* is_local of an operator that always is. */
int tonemap_always_local(const double *values);

/* The weights of luminance in linear Rec. 709. */
static const double tonemap_weights[3] = {0.212656, 0.715158, 0.072186};

/* Luminance in double: three large floats must not overflow. */
static inline double tonemap_luminance(const float rgb[3])
{
    return tonemap_weights[0] * (double)rgb[0] + tonemap_weights[1] * (double)rgb[1] +
           tonemap_weights[2] * (double)rgb[2];
}

/* Call row(user, rgb[width][3], width) for every line of the frame's picture, on its threads. */
void tonemap_each_row(const struct tonemap_frame *frame, void (*row)(const void *user, float *rgb, uint32_t width),
                      const void *user);

/* The luminance, or largest channel, below which `percent` (0..100) of the frame's pixels lie, as a
 * float, exactly (nearest rank); 0 if no pixel counts. Pixels without light do not count, nor do
 * those with a channel of FLT_MAX, which stands for values that were not finite. ERR_NO_MEMORY. */
enum tonemap_of { TONEMAP_LUMINANCE, TONEMAP_LARGEST_CHANNEL };
status tonemap_percentile_of(double *out, const struct image *image, enum tonemap_of of, double percent,
                             unsigned threads, struct error *err) MUST_CHECK;

/* The matrix for linear Rec. 709 that makes a light of that colour temperature look like D65
 * (Bradford). Below 4000 K the Planckian locus, above it the CIE daylight locus. */
void tonemap_white_balance(double kelvin, double out[3][3]);
