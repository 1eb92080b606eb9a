/* sampler: random numbers as a pure function of (seed, frame, pixel, sample, dimension).
 *
 * Owen-scrambled Sobol' (0,2)-sequences, padded: every pair of dimensions is its own
 * two-dimensional sequence with its own index shuffle and scrambles (Burley 2020, JCGT
 * 9(4); the hash is Vegdahl's). Sample i of group g belongs to replicate 2g + i mod 2 and is point
 * i / 2 of that replicate's own, independently scrambled sequence (refs: Owen 2501.00150).
 * The path asks for dimensions by name, so one decision's numbers never depend on how many numbers
 * another decision used.
 *
 * Invariant: the bits are pinned (tests/unit/render/test_sampler.c). Changing them changes every
 * picture that the farm renders.
 */
#ifndef AZULEJO_RENDER_SAMPLER_H
#define AZULEJO_RENDER_SAMPLER_H

#include <stdint.h>

#include "common/base/safeguard.h"
#include "common/math/real.h"

struct sample2 {
    real u, v; /* each in [0, 1) */
};

struct sampler {
    uint64_t seed;           /* hash of job seed, frame, pixel and replicate */
    uint32_t index;          /* the point's number in the replicate's sequence */
    uint32_t index_reversed; /* its bits, most significant first: what the shuffle hashes */
};

/* Dimension pairs: what a pair of numbers is for. A path vertex of depth d uses
 * DIMENSION_VERTEX + d * DIMENSIONS_PER_VERTEX + one of the vertex's. */
enum dimension {
    DIMENSION_PIXEL = 0,     /* position in the pixel (filter) */
    DIMENSION_LENS = 1,
    DIMENSION_TIME = 2,      /* u: time within the shutter, v: the wavelength */
    DIMENSION_VERTEX = 8,
    VERTEX_LIGHT_POINT = 0,  /* which light, and where on it */
    VERTEX_MEDIUM = 1,       /* u: free path, v: which material of a mix */
    VERTEX_BSDF = 2,         /* direction */
    VERTEX_LOBE = 3,         /* u: which lobe, v: Russian roulette */
    DIMENSIONS_PER_VERTEX = 4,
};

void sampler_start(struct sampler *s, uint64_t job_seed, uint32_t frame, uint32_t pixel_x,
                   uint32_t pixel_y, uint32_t group, uint32_t sample);

/* Make the sample independent of all others: from now on its pairs are points of sequences that no
 * other sample shares. Each such pair is one point with its own scrambles, hence uniform. */
void sampler_isolate(struct sampler *s);

/* The two numbers of dimension pair `pair`. */
static inline struct sample2 sampler_get(const struct sampler *s, uint32_t pair);

/* One hashed number in [0,1) that is not part of the sequence: for decisions that may
 * happen any number of times (stochastic alpha). `key` tells them apart. */
real sampler_hash(const struct sampler *s, uint32_t key_a, uint32_t key_b);

/* ---- the parts, for the tests ---- */
/* Nested uniform (Owen) scramble of a 32-bit fraction, most significant digit first. */
uint32_t owen_scramble(uint32_t x, uint32_t seed);
/* Point `index` of the first two Sobol' dimensions, unscrambled, as 32-bit fractions. */
void sobol_2d(uint32_t index, uint32_t out[2]);
/* Shuffled and scrambled point of the padded pair with this seed. */
struct sample2 sobol_owen_2d(uint32_t index, uint64_t seed);
uint32_t hash_u32(uint32_t x);
uint32_t hash_combine(uint32_t seed, uint32_t value);

/* ---- what runs about twenty times per path, inline ---- */

/* Stafford's mix 13 of the 64-bit finaliser (as in SplitMix64): a bijection. */
static inline uint64_t hash_u64(uint64_t x)
{
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
    return x ^ (x >> 31);
}

/* Reverse the bits of both halves, and swap the halves. */
static inline uint64_t bits_reverse_64(uint64_t x)
{
    x = __builtin_bswap64(x);
    x = (x >> 4 & 0x0f0f0f0f0f0f0f0full) | (x & 0x0f0f0f0f0f0f0f0full) << 4;
    x = (x >> 2 & 0x3333333333333333ull) | (x & 0x3333333333333333ull) << 2;
    return (x >> 1 & 0x5555555555555555ull) | (x & 0x5555555555555555ull) << 1;
}

static inline uint32_t bits_reverse_32(uint32_t x)
{
    x = __builtin_bswap32(x);
    x = (x >> 4 & 0x0f0f0f0fu) | (x & 0x0f0f0f0fu) << 4;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    return (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
}

/* Owen's scramble of a word whose digits run from the least significant bit up: a hash of the bits
 * below decides whether a bit is flipped, since every factor that is xored in is even. Vegdahl's
 * improvement of the Laine-Karras hash. */
static inline uint32_t owen_hash_reversed(uint32_t x, uint32_t seed)
{
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

/* Sobol' dimension 1 of point `index`, its digits from the least significant bit up. The
 * generator matrix is Pascal's triangle modulo 2, that is: read the index as a polynomial
 * p over GF(2), the digits are p(x + 1); and (x + 1)^(2^k) = x^(2^k) + 1 makes a butterfly. */
static inline uint32_t sobol_pascal_reversed(uint32_t index)
{
    index ^= index >> 16;
    index ^= index >> 8 & 0x00ff00ffu;
    index ^= index >> 4 & 0x0f0f0f0fu;
    index ^= index >> 2 & 0x33333333u;
    return index ^ (index >> 1 & 0x55555555u);
}

/* A 32-bit fraction as a float in [0, 1), rounded down. Rounding up would reach 1, and would move
 * one point in 2^15 across the edge of a 1/1024 cell, which must hold exactly one point of the net.
 * In a word longer than a float's 24 bits, the top bit of `x >> 24` is at the first bit to be
 * dropped; with that bit cleared, rounding to nearest rounds down. */
static inline float32 unit_float(uint32_t x)
{
    return (float32)(SAFEGUARD(UNIT_BELOW_1) ? x & ~(x >> 24) : x) * 0x1p-32f;
}

/* The index shuffle is owen_scramble(index): reverse, hash, reverse. Dimension 0 (van der Corput)
 * is the reversed index, so its scramble hashes the shuffled index directly; dimension 1's scramble
 * likewise hashes its digits. One 64-bit reversal then serves both. */
static inline struct sample2 sobol_owen_2d_reversed(uint32_t index_reversed, uint64_t seed)
{
    uint64_t scrambles = hash_u64(seed + 0x9e3779b97f4a7c15ull);
    uint32_t shuffle = (uint32_t)(hash_u64(seed ^ 0xd1b54a32d192ed03ull) >> 32);
    uint32_t index = bits_reverse_32(owen_hash_reversed(index_reversed, shuffle));
    uint32_t x = owen_hash_reversed(index, (uint32_t)scrambles);
    uint32_t y = owen_hash_reversed(sobol_pascal_reversed(index), (uint32_t)(scrambles >> 32));
    uint64_t both = bits_reverse_64((uint64_t)x << 32 | y);

    return (struct sample2){unit_float((uint32_t)both), unit_float((uint32_t)(both >> 32))};
}

static inline struct sample2 sampler_get(const struct sampler *s, uint32_t pair)
{
    uint64_t own = SAFEGUARD(INDEPENDENT_PAIRS) ? pair * 0xda942042e4dd58b5ull : 0;

    return sobol_owen_2d_reversed(s->index_reversed, s->seed + own);
}

#endif
