/* wide: functions compiled for AVX2, too, and chosen when they are called. The bits are the same: lanes compute what
 * scalars would, contraction is off and FMA is not asked for. Private to common/denoise. */
#pragma once

#define INLINE inline __attribute__((always_inline))

/* Whether AVX2 is used where it is there: 1 at first. For tests that both give the same bits. */
extern int wide_allowed;

/* The public function `name` from the static INLINE function `body`, which all loops are in. */
#ifdef __x86_64__
#define WIDE_VERSIONS(name, body, parameters, arguments)                     \
    __attribute__((target("avx2"))) static void body##_wide parameters       \
    {                                                                        \
        body arguments;                                                      \
    }                                                                        \
    void name parameters                                                     \
    {                                                                        \
        if (wide_allowed && __builtin_cpu_supports("avx2"))                  \
            body##_wide arguments;                                           \
        else                                                                 \
            body arguments;                                                  \
    }
#else
#define WIDE_VERSIONS(name, body, parameters, arguments) \
    void name parameters                                 \
    {                                                    \
        body arguments;                                  \
    }
#endif
