/* color: the sRGB transfer function and colour spaces, deterministic (common/math/elementary). */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* IEC 61966-2-1, piecewise; input clamped to 0..1, NaN is 0. */
float srgb_encode(float linear);
float srgb_decode(float encoded);

/* srgb_encode of `count` values, in place and quick: from a table, within 1e-7 of it, monotone. */
void srgb_encode_row(float *values, size_t count);

/* A table of srgb_decode(i / 255), built once, thread-safe. */
const float *srgb_decode_table(void);

/* CIE 1931 x, y of an RGB space's primaries and white. */
struct color_primaries {
    double red[2], green[2], blue[2], white[2];
};

extern const struct color_primaries color_rec709; /* white D65 */
extern const struct color_primaries color_xyz;    /* XYZ seen as an RGB space */

int color_primaries_equal(const struct color_primaries *a, const struct color_primaries *b);

/* The matrix that takes linear RGB of `from` to linear Rec. 709, whites adapted after
 * Bradford (no adaptation when `from` is XYZ). 0 when the primaries make no colour space. */
int color_to_rec709(const struct color_primaries *from, double out[3][3]);

/* The matrix on linear Rec. 709 that makes a light of this chromaticity (CIE 1931 x, y) look like
 * D65, after Bradford. 0 when there is none. */
int color_white_to_d65(const double white[2], double out[3][3]);

/* 0 when singular. `out` may be `m`. */
int color_matrix_invert(const double m[3][3], double out[3][3]);
