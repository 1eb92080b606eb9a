/* lat_long: a direction in a lat-long map's coordinates, and the sine and cosine of a longitude.
 *
 * In float throughout, and without a branch: polynomials good to 2e-10, so that only the rounding of the last steps
 * remains. Errors (tests/unit/render/test_lat_long.c): of u below 6e-8 turns, of the distance below 3e-7 of itself,
 * of sine and cosine below 9e-8. IEEE operations alone: the bits are the same on every machine.
 */
#pragma once

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/math/vec.h"

struct lat_long {
    real u;        /* 0.5 + longitude / (2 pi), 0 <= u < 1 */
    real distance; /* angle to the nearer pole over pi, 0..1/2 */
    int south;     /* the nearer pole is the nadir */
};

#ifdef AZULEJO_DOUBLE

static inline void lat_long_sincos(real turns, real *sine, real *cosine) { real_sincos(2 * REAL_PI * turns, sine, cosine); }

/* Angles of (x, y) over pi, 0..1: of both pairs, y by its absolute value. */
static inline void lat_long_angles(const real x[2], const real y[2], real angle[2])
{
    for (int i = 0; i < 2; i++)
        angle[i] = real_atan2(real_abs(y[i]), x[i]) * REAL_INV_PI;
}

#else

typedef real lat_long_lanes __attribute__((vector_size(16)));
typedef int32_t lat_long_bits __attribute__((vector_size(16)));

/* Of an angle in turns, 0 <= turns <= 1. Both polynomials side by side, on the eighth of a turn around the nearest
 * axis. */
static inline void lat_long_sincos(real turns, real *sine, real *cosine)
{
    const lat_long_lanes c0 = {6.2831853072f, 1}, c1 = {-41.341702153f, -19.73920865f};
    const lat_long_lanes c2 = {81.605204711f, 64.939316136f}, c3 = {-76.697866314f, -85.442844673f};
    const lat_long_lanes c4 = {41.472832054f, 59.220168970f};
    uint32_t quarter = (uint32_t)(int32_t)(4 * turns + 0.5f), s, c, swapped;
    real r = turns - 0.25f * (real)(int32_t)quarter, r2 = r * r;
    lat_long_lanes p = c0 + r2 * (c1 + r2 * (c2 + r2 * (c3 + r2 * c4)));

    s = float_bits(p[0] * r);
    c = float_bits(p[1]);
    swapped = (s ^ c) & (0 - (quarter & 1));
    *sine = float_from_bits(s ^ swapped ^ (quarter & 2) << 30);
    *cosine = float_from_bits(c ^ swapped ^ ((quarter + 1) & 2) << 30);
}

/* Angles of (x, |y|) over pi, 0..1, of both pairs at once. Reduced to the quarter of the first octant around 0 or 1:
 * atan(a / b) = pi / 4 + atan((a - b) / (a + b)). */
static inline void lat_long_angles(const real x[2], const real y[2], real angle[2])
{
    const lat_long_bits sign = {INT32_MIN, INT32_MIN, INT32_MIN, INT32_MIN};
    const lat_long_lanes quarter = {0.25f, 0.25f, 0.25f, 0.25f}, half = quarter + quarter, one = half + half;
    lat_long_lanes xs = {x[0], x[1], 1, 1}, ys = {y[0], y[1], 0, 0}, low, high, q, q2, p;
    lat_long_bits ax = (lat_long_bits)xs & ~sign, ay = (lat_long_bits)ys & ~sign, steep, left, outer, changed;

    steep = (lat_long_lanes)ay > (lat_long_lanes)ax;
    changed = (ax ^ ay) & steep;
    low = (lat_long_lanes)(ay ^ changed);
    high = (lat_long_lanes)(ax ^ changed);
    outer = low > 0.41421356f * high;
    q = (low - (lat_long_lanes)((lat_long_bits)high & outer)) / (high + (lat_long_lanes)((lat_long_bits)low & outer));
    q2 = q * q;
    p = 0.31830988599f + q2 * (-0.10610321119f + q2 * (0.06365619159f + q2 * (-0.04532580148f +
        q2 * (0.03364452106f + q2 * -0.01918157962f))));
    p = q * p + (lat_long_lanes)((lat_long_bits)quarter & outer);
    p = (lat_long_lanes)((lat_long_bits)p ^ (sign & steep)) + (lat_long_lanes)((lat_long_bits)half & steep);
    left = xs < 0;
    p = (lat_long_lanes)((lat_long_bits)p ^ (sign & left)) + (lat_long_lanes)((lat_long_bits)one & left);
    angle[0] = p[0];
    angle[1] = p[1];
}

#endif

/* Of a direction in the map's axes, of any length but 0. */
static inline void lat_long_of(struct vec3 d, struct lat_long *out)
{
    real radius2 = d.x * d.x + d.z * d.z, angle[2];
    /* Straight up and down have no longitude: that of +x. */
    const real x[2] = {radius2 > 0 || !SAFEGUARD(ATAN2_ORIGIN) ? d.x : 1, real_abs(d.y)};
    const real y[2] = {d.z, real_sqrt(radius2)};

    lat_long_angles(x, y, angle);
    out->u = 0.5f + real_copysign(0.5f * angle[0], d.z);
    out->u = out->u < 1 ? out->u : out->u - 1;
    /* Not acos(y), which cannot resolve angles below 3e-4 from a pole. */
    out->distance = SAFEGUARD(MAP_POLE) ? angle[1] : real_acos(real_min(x[1], 1)) * REAL_INV_PI;
    out->south = d.y < 0;
}
