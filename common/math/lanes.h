/* lanes: four floats at a time, for loops over the channels of pixels that a compiler does not turn into vector
 * instructions. Without branches, since noise would mispredict them. The same bits on every machine.
 */
#pragma once

#include <stdint.h>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

typedef float lanes __attribute__((vector_size(16)));
typedef int32_t lane_masks __attribute__((vector_size(16)));

static inline lanes lanes_of(float value) { return (lanes){value, value, value, value}; }

/* Of each lane `yes` where the mask is set (a comparison's result), else `no`. */
static inline lanes lanes_choose(lane_masks mask, lanes yes, lanes no)
{
    return (lanes)(((lane_masks)yes & mask) | ((lane_masks)no & ~mask));
}

/* a > b ? a : b of each lane: b where one is NaN. */
static inline lanes lanes_larger(lanes a, lanes b)
{
#ifdef __SSE2__
    return (lanes)_mm_max_ps((__m128)a, (__m128)b);
#else
    return lanes_choose(a > b, a, b);
#endif
}

/* a < b ? a : b of each lane: b where one is NaN. */
static inline lanes lanes_smaller(lanes a, lanes b)
{
#ifdef __SSE2__
    return (lanes)_mm_min_ps((__m128)a, (__m128)b);
#else
    return lanes_choose(a < b, a, b);
#endif
}

/* Each lane times `by`, in double, rounded once. */
static inline lanes lanes_times(lanes a, double by)
{
#ifdef __SSE2__
    const __m128d twice = {by, by};
    const __m128 high = _mm_movehl_ps((__m128)a, (__m128)a);

    return (lanes)_mm_movelh_ps(_mm_cvtpd_ps(_mm_mul_pd(_mm_cvtps_pd((__m128)a), twice)),
                                _mm_cvtpd_ps(_mm_mul_pd(_mm_cvtps_pd(high), twice)));
#else
    for (int i = 0; i < 4; i++)
        a[i] = (float)((double)a[i] * by);
    return a;
#endif
}
