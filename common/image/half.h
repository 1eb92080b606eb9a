/* half: IEEE 754 binary16, converted in integer arithmetic: the same bits everywhere. */
#pragma once

#include <stdint.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"

#define HALF_MAX 65504.0f

/* Exact; NaN stays NaN, infinity infinity. */
static inline float half_to_float(uint16_t half)
{
    uint32_t sign = (uint32_t)(half & 0x8000) << 16;
    uint32_t exponent = (half >> 10) & 0x1f;
    uint32_t mantissa = half & 0x3ff;

    if (exponent == 0x1f)
        return float_from_bits(sign | 0x7f800000u | mantissa << 13);
    if (exponent == 0) { /* zero and subnormals: mantissa * 2^-24 */
        float value = (float)mantissa * 0x1p-24f;
        return sign ? -value : value;
    }
    return float_from_bits(sign | (exponent + 112) << 23 | mantissa << 13);
}

/* To nearest, ties to even. Magnitudes that round above HALF_MAX become infinity. */
static inline uint16_t half_from_float(float value)
{
    uint32_t bits = float_bits(value);
    uint16_t sign = (uint16_t)(bits >> 16 & 0x8000);
    uint32_t magnitude = bits & 0x7fffffffu;
    uint32_t kept, dropped, shift, tie;

    if (magnitude > 0x7f800000u)
        return sign | 0x7e00; /* NaN */
    if (magnitude >= 0x477ff000u)
        return sign | 0x7c00; /* 65520 and above */
    if (magnitude < (SAFEGUARD(HALF_SUBNORMAL) ? 0x33000001u : 0x38800000u))
        return sign;                /* 2^-25 and below */
    if (magnitude >= 0x38800000u) { /* normal: 2^-14 and above */
        kept = magnitude - 0x38000000u;
        shift = 13;
    } else { /* subnormal: in steps of 2^-24 */
        kept = (magnitude & 0x7fffffu) | 0x800000u;
        shift = 126 - (magnitude >> 23);
    }
    dropped = kept & ((1u << shift) - 1);
    tie = 1u << (shift - 1);
    kept >>= shift;
    if ((dropped > tie || (dropped == tie && (kept & 1))) && SAFEGUARD(HALF_NEAREST))
        kept++; /* a carry into the exponent is right */
    return (uint16_t)(sign | kept);
}
