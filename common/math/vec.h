/* vec: three floats, the type of points, directions and linear RGB. All functions pure. */
#pragma once

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "common/base/safeguard.h"

#include "common/math/real.h"

/* One instruction each, where fmaxf and fminf are calls (they must check for NaN first): here `b`
 * is the result if either is NaN. */
static inline float32 float_max(float32 a, float32 b) { return a > b ? a : b; }
static inline float32 float_min(float32 a, float32 b) { return a < b ? a : b; }

struct vec3 {
    real x, y, z;
};

static inline struct vec3 vec3_make(real x, real y, real z) { return (struct vec3){x, y, z}; }
static inline struct vec3 vec3_splat(real s) { return (struct vec3){s, s, s}; }
static inline struct vec3 vec3_add(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.x + b.x, a.y + b.y, a.z + b.z};
}
static inline struct vec3 vec3_sub(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline struct vec3 vec3_mul(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.x * b.x, a.y * b.y, a.z * b.z};
}
static inline struct vec3 vec3_scale(struct vec3 a, real s) { return (struct vec3){a.x * s, a.y * s, a.z * s}; }
/* a + b * s */
static inline struct vec3 vec3_mad(struct vec3 a, struct vec3 b, real s)
{
    return (struct vec3){a.x + b.x * s, a.y + b.y * s, a.z + b.z * s};
}
static inline struct vec3 vec3_neg(struct vec3 a) { return (struct vec3){-a.x, -a.y, -a.z}; }
static inline real vec3_dot(struct vec3 a, struct vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline real vec3_length_squared(struct vec3 a) { return vec3_dot(a, a); }
static inline real vec3_length(struct vec3 a) { return real_sqrt(vec3_dot(a, a)); }

/* Unit vector along a; (0,0,0) when its length is zero or not finite. Scaled first, so
 * that very short and very long vectors neither underflow nor overflow. */
static inline struct vec3 vec3_normalize(struct vec3 a)
{
    real l2 = vec3_dot(a, a);

    if (!(l2 > REAL(1e-30) && l2 < REAL(1e30)) && SAFEGUARD(LENGTH_RANGE)) {
        real m = real_max(real_abs(a.x), real_max(real_abs(a.y), real_abs(a.z)));
        if (!(m > 0.0f && m < INFINITY))
            return (struct vec3){0, 0, 0};
        /* A power of two: no bit depends on the vector's length. */
        m = real_power_below(m);
        a.x /= m;
        a.y /= m;
        a.z /= m;
        l2 = vec3_dot(a, a);
    }
    return vec3_scale(a, 1.0f / real_sqrt(l2));
}
static inline struct vec3 vec3_lerp(struct vec3 a, struct vec3 b, real t)
{
    return vec3_add(vec3_scale(a, 1.0f - t), vec3_scale(b, t));
}
static inline real vec3_max(struct vec3 a) { return real_max(a.x, real_max(a.y, a.z)); }
static inline real vec3_min(struct vec3 a) { return real_min(a.x, real_min(a.y, a.z)); }
static inline real vec3_average(struct vec3 a) { return (a.x + a.y + a.z) * (1.0f / REAL(3.0)); }
static inline int vec3_is_black(struct vec3 a) { return a.x == 0 && a.y == 0 && a.z == 0; }
static inline int vec3_is_finite(struct vec3 a) { return isfinite(a.x) && isfinite(a.y) && isfinite(a.z); }
/* Luminance of linear Rec. 709 RGB. */
static inline real vec3_luminance(struct vec3 c)
{
    return REAL(0.212656) * c.x + REAL(0.715158) * c.y + REAL(0.072186) * c.z;
}

/* An orthonormal basis around a normal. */
struct basis {
    struct vec3 s, t, n;
};

/* Duff et al. 2017 (JCGT 6(1)), "Building an Orthonormal Basis, Revisited": exact for all unit n, n.z = -1 included. */
static inline struct basis basis_from_normal(struct vec3 n)
{
    real sign = SAFEGUARD(BASIS_AT_POLE) ? real_copysign(1.0f, n.z) : 1.0f;
    real a = -1.0f / (sign + n.z);
    real b = n.x * n.y * a;
    struct basis f;

    f.s = (struct vec3){1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x};
    f.t = (struct vec3){b, sign + n.y * n.y * a, -n.y};
    f.n = n;
    return f;
}
static inline struct vec3 basis_to_local(const struct basis *f, struct vec3 v)
{
    return (struct vec3){vec3_dot(v, f->s), vec3_dot(v, f->t), vec3_dot(v, f->n)};
}
static inline struct vec3 basis_to_world(const struct basis *f, struct vec3 v)
{
    return vec3_add(vec3_add(vec3_scale(f->s, v.x), vec3_scale(f->t, v.y)), vec3_scale(f->n, v.z));
}
