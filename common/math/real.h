/* real: the type of the renderer's arithmetic, float, or double in the build that checks it.
 *
 * `make DOUBLE=1` compiles worker/render with double. What float's rounding does to a picture is the difference
 * (docs/NUMERICS.md). What is stored or sent is `float32` in both: meshes, texels, tables, Embree's rays, sums of a
 * pass. Random numbers are the same in both, so paths are the same until a decision differs.
 *
 * The double build checks accuracy and not bits, so its elementary functions are the C library's.
 */
#pragma once

#include <math.h>

#include "common/math/elementary.h"

/* Four bytes, whatever the arithmetic is. */
typedef float float32;

#ifdef AZULEJO_DOUBLE

typedef double real;
#define REAL_NAME "double"
/* A literal that a float cannot hold exactly. */
#define REAL(literal) literal
#define REAL_BELOW_ONE 0x1.fffffffffffffp-1

static inline real real_sqrt(real x) { return sqrt(x); }
static inline real real_abs(real x) { return fabs(x); }
static inline real real_floor(real x) { return floor(x); }
static inline real real_copysign(real x, real sign) { return copysign(x, sign); }
static inline real real_ldexp(real x, int exponent) { return ldexp(x, exponent); }
static inline real real_fmax(real a, real b) { return fmax(a, b); }
static inline void real_sincos(real x, real *sine, real *cosine) { sincos(x, sine, cosine); }
static inline real real_sin(real x) { return sin(x); }
static inline real real_cos(real x) { return cos(x); }
static inline real real_tan(real x) { return tan(x); }
static inline real real_atan2(real y, real x) { return y == 0 && x == 0 ? 0 : atan2(y, x); }
static inline real real_acos(real x) { return acos(x < -1 ? -1 : x > 1 ? 1 : x); }
static inline real real_asin(real x) { return asin(x < -1 ? -1 : x > 1 ? 1 : x); }
static inline real real_exp(real x) { return exp(x); }
static inline real real_log(real x) { return log(x); }
static inline real real_pow(real x, real y) { return pow(x, y); }

/* The largest power of two that is not above m > 0, and is a normal number. */
static inline real real_power_below(real m)
{
    int exponent;

    frexp(m, &exponent);
    return m >= 0x1p-1022 ? ldexp(0.5, exponent) : 0x1p-1022;
}
static inline real real_flip(real x, int flip) { return flip ? -x : x; }
static inline uint32_t real_binade(real x, real *rest)
{
    int exponent;

    *rest = 2 * frexp(x, &exponent) - 1;
    return (uint32_t)(exponent - 1);
}

#else

typedef float real;
#define REAL_NAME "float"
#define REAL(literal) literal##f
#define REAL_BELOW_ONE ONE_MINUS_EPSILON

static inline real real_sqrt(real x) { return sqrtf(x); }
static inline real real_abs(real x) { return fabsf(x); }
static inline real real_floor(real x) { return floorf(x); }
static inline real real_copysign(real x, real sign) { return copysignf(x, sign); }
static inline real real_ldexp(real x, int exponent) { return ldexpf(x, exponent); }
static inline real real_fmax(real a, real b) { return fmaxf(a, b); }
static inline void real_sincos(real x, real *sine, real *cosine) { det_sincos(x, sine, cosine); }
static inline real real_sin(real x) { return det_sin(x); }
static inline real real_cos(real x) { return det_cos(x); }
static inline real real_tan(real x) { return det_tan(x); }
static inline real real_atan2(real y, real x) { return det_atan2(y, x); }
static inline real real_acos(real x) { return det_acos(x); }
static inline real real_asin(real x) { return det_asin(x); }
static inline real real_exp(real x) { return det_exp(x); }
static inline real real_log(real x) { return det_log(x); }
static inline real real_pow(real x, real y) { return det_pow(x, y); }
/* The largest power of two that is not above m > 0, and is a normal number. */
static inline real real_power_below(real m)
{
    uint32_t bits = float_bits(m) & 0x7f800000u;

    return bits ? float_from_bits(bits) : 0x1p-126f;
}
/* x or, where `flip` is 1, -x, without a branch. */
static inline real real_flip(real x, int flip) { return float_from_bits(float_bits(x) ^ (uint32_t)flip << 31); }
/* The exponent of x >= 1, and x / 2^exponent - 1. */
static inline uint32_t real_binade(real x, real *rest)
{
    uint32_t bits = float_bits(x);

    *rest = (real)(bits & 0x7fffff) * 0x1p-23f;
    return (bits >> 23) - 127;
}

#endif

#define REAL_PI REAL(3.14159265358979323846)
#define REAL_INV_PI REAL(0.31830988618379067154)
#define REAL_INV_2PI REAL(0.15915494309189533577)

/* One instruction each, where fmin and fmax are calls (they must check for NaN first): here `b` is
 * the result if either is NaN. */
static inline real real_max(real a, real b) { return a > b ? a : b; }
static inline real real_min(real a, real b) { return a < b ? a : b; }
