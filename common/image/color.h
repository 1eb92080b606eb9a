/* color: the sRGB transfer function, deterministic (common/math/elementary). */
#ifndef AZULEJO_IMAGE_COLOR_H
#define AZULEJO_IMAGE_COLOR_H

#include <stdint.h>

/* IEC 61966-2-1, piecewise; input clamped to 0..1. */
float srgb_encode(float linear);
float srgb_decode(float encoded);

/* A table of srgb_decode(i / 255), built once, thread-safe. */
const float *srgb_decode_table(void);

#endif
