#include "common/math/elementary.h"

#include "common/base/safeguard.h"

/* Taylor and Pade-free polynomials on short ranges, evaluated by Horner in double. The
 * reductions are exact enough that the final rounding to float dominates the error. */

static double bits_to_double(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static uint64_t double_to_bits(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* sin on |r| <= pi/4: odd Taylor polynomial up to r^17, error below 1e-16. */
static double sin_reduced(double r)
{
    double r2 = r * r;
    double p = 1.0 / 355687428096000.0;

    p = p * r2 - 1.0 / 1307674368000.0;
    p = p * r2 + 1.0 / 6227020800.0;
    p = p * r2 - 1.0 / 39916800.0;
    p = p * r2 + 1.0 / 362880.0;
    p = p * r2 - 1.0 / 5040.0;
    p = p * r2 + 1.0 / 120.0;
    p = p * r2 - 1.0 / 6.0;
    return r + r * r2 * p;
}

/* cos on |r| <= pi/4: even Taylor polynomial up to r^16. */
static double cos_reduced(double r)
{
    double r2 = r * r;
    double p = 1.0 / 20922789888000.0;

    p = p * r2 - 1.0 / 87178291200.0;
    p = p * r2 + 1.0 / 479001600.0;
    p = p * r2 - 1.0 / 3628800.0;
    p = p * r2 + 1.0 / 40320.0;
    p = p * r2 - 1.0 / 720.0;
    p = p * r2 + 1.0 / 24.0;
    p = p * r2 - 1.0 / 2.0;
    return 1.0 + r2 * p;
}

/* x less n quarter turns. */
static double less_quarters(double x, double n)
{
    /* pi/2 in two parts, the high one with 33 significant bits so that n * high is exact. */
    const double half_pi_high = 0x1.921fb544p+0, half_pi_low = 0x1.0b4611a626331p-34;

    return SAFEGUARD(SINE_REDUCTION) ? (x - n * half_pi_high) - n * half_pi_low : x - n * (PI_D / 2);
}

static void sincos_d(double x, double *sine, double *cosine)
{
    double scaled = x * (2.0 / PI_D);
    double n = (double)(int64_t)(scaled + copysign(0.5, scaled));
    double r = less_quarters(x, n);
    uint64_t s = double_to_bits(sin_reduced(r)), c = double_to_bits(cos_reduced(r));
    uint64_t quarter = (uint64_t)(int64_t)n;
    uint64_t swapped = (s ^ c) & (0 - (quarter & 1));

    /* s, c; c, -s; -s, -c; -c, s: without a branch, which every other angle would mispredict. */
    *sine = bits_to_double(s ^ swapped ^ (quarter & 2) << 62);
    *cosine = bits_to_double(c ^ swapped ^ ((quarter + 1) & 2) << 62);
}

void det_sincos(float x, float *sine, float *cosine)
{
    double s, c;

    sincos_d(x, &s, &c);
    *sine = (float)s;
    *cosine = (float)c;
}

double det_sin_d(double x)
{
    double s, c;

    sincos_d(x, &s, &c);
    return s;
}

float det_sin(float x)
{
    float s, c;
    det_sincos(x, &s, &c);
    return s;
}

float det_cos(float x)
{
    float s, c;
    det_sincos(x, &s, &c);
    return c;
}

float det_tan(float x)
{
    float s, c;
    det_sincos(x, &s, &c);
    return s / c;
}

/* atan on 0 <= q <= 1: reduce around the nearest of 0, 1/4, 1/2, 3/4, 1, then the odd
 * Taylor series on |t| <= 1/8 up to t^17. */
static double atan_unit(double q)
{
    static const double centre_atan[5] = {0.0, 0.24497866312686415417, 0.46364760900080611621,
                                          0.64350110879328438680, 0.78539816339744830962};
    int k = (int)(q * 4.0 + 0.5);
    double centre = 0.25 * k;
    double t = (q - centre) / (1.0 + q * centre);
    double t2 = t * t;
    double p = 1.0 / 17.0;

    p = -1.0 / 15.0 + t2 * p;
    p = 1.0 / 13.0 + t2 * p;
    p = -1.0 / 11.0 + t2 * p;
    p = 1.0 / 9.0 + t2 * p;
    p = -1.0 / 7.0 + t2 * p;
    p = 1.0 / 5.0 + t2 * p;
    p = -1.0 / 3.0 + t2 * p;
    return centre_atan[k] + (t + t * t2 * p);
}

double det_atan2_d(double y, double x)
{
    /* Relative to the nearer axis, and how the angle is counted from there; without branches, since
     * directions are unpredictable. */
    static const double start[2] = {0, PI_D / 2}, half[2] = {0, PI_D}, way[2] = {1, -1};
    double ax = fabs(x), ay = fabs(y);
    int steep = ay > ax, left = x < 0;
    double high = ay > ax ? ay : ax, low = ay < ax ? ay : ax;
    double angle;

    if (high == 0 && SAFEGUARD(ATAN2_ORIGIN))
        return 0;
    angle = start[steep] + way[steep] * atan_unit(low / high);
    angle = half[left] + way[left] * angle;
    return way[y < 0] * angle;
}

float det_atan2(float y, float x) { return (float)det_atan2_d(y, x); }

/* A unit vector's cosine rounds to more than 1. */
static double within_one(float x) { return !SAFEGUARD(COSINE_RANGE) ? x : x < -1.0f ? -1.0 : x > 1.0f ? 1.0 : x; }

float det_acos(float x)
{
    double c = within_one(x);

    return (float)det_atan2_d(sqrt((1.0 - c) * (1.0 + c)), c);
}

float det_asin(float x)
{
    double s = within_one(x);

    return (float)det_atan2_d(s, sqrt((1.0 - s) * (1.0 + s)));
}

/* p * 2^k for p from 0.7 to 1.5. */
static double scale_by_power(double p, int64_t k)
{
    if (k > 1023) { /* 2^1024 does not exist: scale in two steps */
        p *= 2.0;
        k--;
    }
    if (k < -1022 && SAFEGUARD(EXP_SUBNORMAL)) {
        p *= 0x1p-60;
        k += 60;
    }
    return p * bits_to_double((uint64_t)(k + 1023) << 52);
}

double det_exp_d(double x)
{
    const double ln2_high = 0x1.62e42fefp-1, ln2_low = 0x1.473de6af278edp-34;
    double n, r, p;

    if (!(x >= -745.2 && x <= 709.78) && SAFEGUARD(EXP_RANGE))
        return x != x ? x : x > 0 ? INFINITY : 0;
    n = (double)(int64_t)(x * 1.44269504088896340736 + (x >= 0 ? 0.5 : -0.5));
    r = (x - n * ln2_high) - n * ln2_low;
    p = 1.0 / 87178291200.0;
    p = p * r + 1.0 / 6227020800.0;
    p = p * r + 1.0 / 479001600.0;
    p = p * r + 1.0 / 39916800.0;
    p = p * r + 1.0 / 3628800.0;
    p = p * r + 1.0 / 362880.0;
    p = p * r + 1.0 / 40320.0;
    p = p * r + 1.0 / 5040.0;
    p = p * r + 1.0 / 720.0;
    p = p * r + 1.0 / 120.0;
    p = p * r + 1.0 / 24.0;
    p = p * r + 1.0 / 6.0;
    p = p * r + 0.5;
    p = p * r + 1.0;
    p = p * r + 1.0;
    return scale_by_power(p, (int64_t)n);
}

double det_log_d(double x)
{
    const double ln2_high = 0x1.62e42fefp-1, ln2_low = 0x1.473de6af278edp-34;
    uint64_t bits;
    int exponent = 0;
    double m, s, s2, p;

    if (x != x || x < 0)
        return NAN;
    if (x == 0)
        return -INFINITY;
    if (x > 1.7976931348623157e308)
        return INFINITY;
    if (x < 2.2250738585072014e-308) {
        x *= 0x1p60;
        exponent -= 60;
    }
    bits = double_to_bits(x);
    exponent += (int)(bits >> 52) - 1023;
    m = bits_to_double((bits & 0xfffffffffffffull) | 0x3ff0000000000000ull);
    if (m > 1.41421356237309504880) {
        m *= 0.5;
        exponent++;
    }
    /* log m = 2 artanh((m-1)/(m+1)), |s| <= 0.1716, series up to s^21. */
    s = (m - 1.0) / (m + 1.0);
    s2 = s * s;
    p = 1.0 / 21.0;
    p = p * s2 + 1.0 / 19.0;
    p = p * s2 + 1.0 / 17.0;
    p = p * s2 + 1.0 / 15.0;
    p = p * s2 + 1.0 / 13.0;
    p = p * s2 + 1.0 / 11.0;
    p = p * s2 + 1.0 / 9.0;
    p = p * s2 + 1.0 / 7.0;
    p = p * s2 + 1.0 / 5.0;
    p = p * s2 + 1.0 / 3.0;
    return exponent * ln2_high + (2.0 * s + (2.0 * s * s2 * p + exponent * ln2_low));
}

double det_pow_d(double x, double y)
{
    if (y == 0 || x == 1)
        return 1;
    return det_exp_d(y * det_log_d(x)); /* of x = 0: of minus or plus infinity */
}

float det_exp(float x) { return (float)det_exp_d(x); }

float det_log(float x) { return (float)det_log_d(x); }

float det_pow(float x, float y) { return (float)det_pow_d(x, y); }

uint64_t elementary_fingerprint(void)
{
    uint64_t hash = 14695981039346656037ull;

    for (int i = 1; i <= 2000; i++) {
        float x = (float)i * 0.01370f;
        float results[7] = {det_sin(x),         det_cos(-3 * x), det_atan2(x, 7 - x),
                            det_acos(x / 28.0f), det_exp(x - 9),  det_log(x),
                            det_pow(x, 1.0f / 2.4f)};
        for (int j = 0; j < 7; j++) {
            hash ^= float_bits(results[j]);
            hash *= 1099511628211ull;
        }
        hash ^= float_bits(sqrtf(x) / (x + 3.0f) * x + 1.0f);
        hash *= 1099511628211ull;
    }
    return hash;
}

uint64_t elementary_fingerprint_of(const char *precision)
{
    uint64_t hash = elementary_fingerprint();

    if (strcmp(precision, "float") != 0) /* releases without a choice computed in float */
        for (; *precision; precision++)
            hash = (hash ^ (uint8_t)*precision) * 1099511628211ull;
    return hash;
}
