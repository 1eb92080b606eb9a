/* The operators, one a file. Private to common/tonemap. */
#ifndef AZULEJO_TONEMAP_OPERATORS_H
#define AZULEJO_TONEMAP_OPERATORS_H

#include "common/tonemap/tonemap.h"

extern const struct tonemap_operator tonemap_linear;
extern const struct tonemap_operator tonemap_gamma;
extern const struct tonemap_operator tonemap_reinhard;

/* Luminance of linear Rec. 709 in double: three large floats must not overflow. */
static inline double tonemap_luminance(const float rgb[3])
{
    return 0.212656 * (double)rgb[0] + 0.715158 * (double)rgb[1] + 0.072186 * (double)rgb[2];
}

#endif
