/* warp: random numbers to directions, in float, with the same bits on every machine. */
#pragma once

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

/* sin and cos of |x| <= pi/4: Taylor polynomials whose remainders (x^11/11!, x^10/10!)
 * are below half an ulp of float. */
static inline void sincos_octant(real x, real *sine, real *cosine)
{
#ifdef AZULEJO_DOUBLE
    real_sincos(x, sine, cosine);
#else
    real x2 = x * x;

    *sine = x + x * x2 *
                    (-REAL(1.6666667e-1) +
                     x2 * (REAL(8.3333333e-3) + x2 * (-REAL(1.9841270e-4) + x2 * REAL(2.7557319e-6))));
    *cosine = 1.0f + x2 * (-0.5f + x2 * (REAL(4.1666667e-2) + x2 * (-REAL(1.3888889e-3) + x2 * REAL(2.4801587e-5))));
#endif
}

/* sin and cos of u turns (2 pi u), u in [0, 1]. */
static inline void sincos_turn(real u, real *sine, real *cosine)
{
    int quadrant = (int)(4.0f * u + 0.5f);
    real s, c, swap;

    sincos_octant((4.0f * u - (real)quadrant) * (0.5f * REAL_PI), &s, &c);
    swap = quadrant & 1 ? s : c;
    s = quadrant & 1 ? c : s;
    c = swap;
    *sine = quadrant & 2 ? -s : s;
    *cosine = (quadrant + 1) & 2 ? -c : c;
}

/* Cosine-distributed direction, z > 0; density z / pi. Shirley and Chiu's concentric map
 * (1997), which keeps a point set's stratification. */
static inline struct vec3 cosine_hemisphere(real u, real v)
{
    real a = 2.0f * u - 1.0f, b = 2.0f * v - 1.0f, a2 = a * a, b2 = b * b, r2, s, c, z2;
    struct vec3 w;

    if (a2 > b2) {
        sincos_octant(0.25f * REAL_PI * (b / a), &s, &c);
        w.x = a * c;
        w.y = a * s;
        r2 = a2;
    } else {
        sincos_octant(b2 > 0.0f ? 0.25f * REAL_PI * (a / b) : 0.0f, &s, &c);
        w.x = b * s;
        w.y = b * c;
        r2 = b2;
    }
    /* The rim itself (a = -1) must not yield z = 0, which has no density. */
    z2 = 1.0f - r2;
    w.z = real_sqrt(z2 > REAL(1e-7) || !SAFEGUARD(COSINE_RIM) ? z2 : REAL(1e-7));
    return w;
}
