/* elementary: sine, logarithm and their kin with the same bits on every machine.
 *
 * glibc picks FMA variants by CPU, so its results differ between machines; these use only IEEE additions,
 * multiplications and divisions in double and round once to float, with contraction off. The measured error is below
 * 0.502 ulp of float over the stated range, of det_tan below 2 ulp (tests/numerics/test_elementary.c measures it).
 */
#pragma once

#include <math.h>
#include <stdint.h>
#include <string.h>

#define PI_D 3.14159265358979323846
#define PI_F 3.14159265358979323846f
#define INV_PI_F 0.31830988618379067154f
#define INV_2PI_F 0.15915494309189533577f

/* The largest float below 1: where a random number in [0,1) is clamped to. */
#define ONE_MINUS_EPSILON 0x1.fffffep-1f

/* sin and cos of x radians together, |x| <= 1e5. */
void det_sincos(float x, float *sine, float *cosine);
float det_sin(float x);
float det_cos(float x);
float det_tan(float x);

/* Angle of (x, y), -pi..pi; det_atan2(0, 0) is 0. */
float det_atan2(float y, float x);

/* Arc cosine, input clamped to -1..1; 0..pi. */
float det_acos(float x);
float det_asin(float x);

/* e^x; 0 below -104, infinity above 88.73. */
float det_exp(float x);

/* Natural logarithm; -infinity at 0, NaN below. */
float det_log(float x);

/* x^y for x >= 0; 0^0 is 1. */
float det_pow(float x, float y);

/* The same in double, errors below 4 ulp of double, of det_pow_d below 4 (1 + |y log x|)
 * ulp: for tables and statistics. */
double det_exp_d(double x);
double det_log_d(double x);
double det_pow_d(double x, double y);

/* Sine in double, |x| <= 1e5, absolute error below 2e-16 up to |x| = pi; angle of (x, y) in
 * double, error below 4 ulp of double. */
double det_sin_d(double x);
double det_atan2_d(double y, double x);

/* A 64-bit hash over results of all of the above: two machines whose values agree compute
 * the same arithmetic. Exchanged in the handshake. */
uint64_t elementary_fingerprint(void);
/* Of a worker whose renderer computes in `precision`, "float" or "double" (real.h): of two workers whose
 * values agree but whose precisions differ, the tiles do not match. */
uint64_t elementary_fingerprint_of(const char *precision);

static inline uint32_t float_bits(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}
static inline float float_from_bits(uint32_t bits)
{
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}
