/* vec: three floats, the type of points, directions and linear RGB. All functions pure. */
#ifndef AZULEJO_MATH_VEC_H
#define AZULEJO_MATH_VEC_H

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
    float x, y, z;
};

static inline struct vec3 vec3_make(float x, float y, float z) { return (struct vec3){x, y, z}; }
static inline struct vec3 vec3_splat(float s) { return (struct vec3){s, s, s}; }
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
static inline struct vec3 vec3_scale(struct vec3 a, float s)
{
    return (struct vec3){a.x * s, a.y * s, a.z * s};
}
/* a + b * s */
static inline struct vec3 vec3_mad(struct vec3 a, struct vec3 b, float s)
{
    return (struct vec3){a.x + b.x * s, a.y + b.y * s, a.z + b.z * s};
}
static inline struct vec3 vec3_neg(struct vec3 a) { return (struct vec3){-a.x, -a.y, -a.z}; }
static inline float vec3_dot(struct vec3 a, struct vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline float vec3_length_squared(struct vec3 a) { return vec3_dot(a, a); }
static inline float vec3_length(struct vec3 a) { return sqrtf(vec3_dot(a, a)); }

/* The largest power of two that is not above m > 0, and is a normal float. */
static inline float float_power_below(float m)
{
    uint32_t bits;

    memcpy(&bits, &m, sizeof bits);
    bits &= 0x7f800000u;
    memcpy(&m, &bits, sizeof m);
    return bits ? m : 0x1p-126f;
}

/* Unit vector along a; (0,0,0) when its length is zero or not finite. Scaled first, so
 * that very short and very long vectors neither underflow nor overflow. */
static inline struct vec3 vec3_normalize(struct vec3 a)
{
    float l2 = vec3_dot(a, a);

    if (!(l2 > 1e-30f && l2 < 1e30f) && SAFEGUARD(LENGTH_RANGE)) {
        float m = float_max(fabsf(a.x), float_max(fabsf(a.y), fabsf(a.z)));
        if (!(m > 0.0f && m < INFINITY))
            return (struct vec3){0, 0, 0};
        /* A power of two: no bit depends on the vector's length. */
        m = float_power_below(m);
        a.x /= m;
        a.y /= m;
        a.z /= m;
        l2 = vec3_dot(a, a);
    }
    return vec3_scale(a, 1.0f / sqrtf(l2));
}
static inline struct vec3 vec3_lerp(struct vec3 a, struct vec3 b, float t)
{
    return vec3_add(vec3_scale(a, 1.0f - t), vec3_scale(b, t));
}
static inline float vec3_max(struct vec3 a) { return float_max(a.x, float_max(a.y, a.z)); }
static inline float vec3_min(struct vec3 a) { return float_min(a.x, float_min(a.y, a.z)); }
static inline float vec3_average(struct vec3 a) { return (a.x + a.y + a.z) * (1.0f / 3.0f); }
static inline int vec3_is_black(struct vec3 a) { return a.x == 0 && a.y == 0 && a.z == 0; }
static inline int vec3_is_finite(struct vec3 a)
{
    return isfinite(a.x) && isfinite(a.y) && isfinite(a.z);
}
/* Luminance of linear Rec. 709 RGB. */
static inline float vec3_luminance(struct vec3 c)
{
    return 0.212656f * c.x + 0.715158f * c.y + 0.072186f * c.z;
}

/* An orthonormal basis around a normal. */
struct basis {
    struct vec3 s, t, n;
};

/* Duff et al. 2017 (JCGT 6(1)), "Building an Orthonormal Basis, Revisited": exact for all
 * unit n, n.z = -1 included. */
static inline struct basis basis_from_normal(struct vec3 n)
{
    float sign = SAFEGUARD(BASIS_AT_POLE) ? copysignf(1.0f, n.z) : 1.0f;
    float a = -1.0f / (sign + n.z);
    float b = n.x * n.y * a;
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

#endif
