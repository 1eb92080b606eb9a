/* sampler: random numbers as a pure function of (seed, frame, pixel, sample, dimension).
 *
 * Owen-scrambled Sobol' (0,2)-sequences, padded: every pair of dimensions is its own two-dimensional sequence with its
 * own index shuffle and scrambles (Burley 2020, JCGT 9(4); the hash is Vegdahl's). Sample i of a group is point i of
 * the group's own, independently scrambled sequence: one long sequence has less error than the mean of several short
 * ones. The path asks for dimensions by name, so one decision's numbers never depend on how many numbers another
 * decision used.
 *
 * Invariant: the bits are pinned (tests/unit/render/test_sampler.c). Changing them changes every picture that the farm
 * renders.
 */
#pragma once

#include <stdint.h>

#include "common/base/safeguard.h"
#include "common/math/real.h"

struct sample2 {
    real u, v; /* each in [0, 1) */
};

struct sampler {
    uint64_t seed;               /* hash of job seed, frame, pixel and group */
    uint32_t index;              /* the point's number in the group's sequence */
    uint32_t index_reversed;     /* its bits, most significant first: what the shuffle hashes */
    uint32_t lane;               /* its place in */
    struct sampler_batch *batch; /* NULL: it makes its numbers alone */
};

enum { SAMPLER_LANES = 8, SAMPLER_BATCH_PAIRS = 32 };

/* Consecutive samples of one seed. Their numbers differ only by the index, so a pair's are made for all of them when
 * the first one asks, by vector instructions: the same bits. */
struct sampler_batch {
    uint64_t seed;
    uint32_t index_reversed[SAMPLER_LANES];
    uint32_t made; /* a bit for each pair */
    float32 u[SAMPLER_BATCH_PAIRS][SAMPLER_LANES], v[SAMPLER_BATCH_PAIRS][SAMPLER_LANES];
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

void sampler_start(struct sampler *s, uint64_t job_seed, uint32_t frame, uint32_t pixel_x, uint32_t pixel_y,
                   uint32_t group, uint32_t sample);

/* Start `count` samples from `first` on, at most SAMPLER_LANES, of the seed that samplers[0] was started with. They share
 * `batch`, which must outlive them; one thread's. NULL: each makes its numbers alone, with the same bits. */
int sampler_batch_pays(void); /* on this processor */
void sampler_start_batch(struct sampler *samplers, uint32_t first, uint32_t count, struct sampler_batch *batch);

/* Make the sample independent of all others: from now on its pairs are points of sequences that no
 * other sample shares. Each such pair is one point with its own scrambles, hence uniform. */
void sampler_isolate(struct sampler *s);

/* The two numbers of dimension pair `pair`. */
static inline struct sample2 sampler_get(const struct sampler *s, uint32_t pair);

/* One hashed number in [0,1) that is not part of the sequence: for decisions that may
 * happen any number of times (stochastic alpha). `key` tells them apart. */
real sampler_hash(const struct sampler *s, uint32_t key_a, uint32_t key_b);

/* The same number in two steps: what the sample and key_a settle, once for any number of key_b. */
uint32_t sampler_hash_first(const struct sampler *s, uint32_t key_a);
static inline real sampler_hash_second(uint32_t first, uint32_t key_b);

/* ---- the parts, for the tests ---- */
/* Nested uniform (Owen) scramble of a 32-bit fraction, most significant digit first. */
uint32_t owen_scramble(uint32_t x, uint32_t seed);
/* Point `index` of the first two Sobol' dimensions, unscrambled, as 32-bit fractions. */
void sobol_2d(uint32_t index, uint32_t out[2]);
/* Shuffled and scrambled point of the padded pair with this seed. */
struct sample2 sobol_owen_2d(uint32_t index, uint64_t seed);
static inline uint32_t hash_u32(uint32_t x);
uint32_t hash_combine(uint32_t seed, uint32_t value);

/* ---- what runs about twenty times per path, inline ---- */

/* Wellons' "lowbias32": a bijection whose every output bit depends on every input bit. */
static inline uint32_t hash_u32(uint32_t x)
{
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

/* Stafford's mix 13 of the 64-bit finaliser (as in SplitMix64): a bijection. */
static inline uint64_t hash_u64(uint64_t x)
{
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
    return x ^ (x >> 31);
}

static inline uint32_t bits_reverse_32(uint32_t x)
{
    x = __builtin_bswap32(x);
    x = (x >> 4 & 0x0f0f0f0fu) | (x & 0x0f0f0f0fu) << 4;
    x = (x >> 2 & 0x33333333u) + 4 * (x & 0x33333333u);
    return (x >> 1 & 0x55555555u) + 2 * (x & 0x55555555u);
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

/* A 32-bit fraction as a float in [0, 1), rounded down. Rounding up would reach 1, and would move
 * one point in 2^15 across the edge of a 1/1024 cell, which must hold exactly one point of the net.
 * In a word longer than a float's 24 bits, the top bit of `x >> 24` is at the first bit to be
 * dropped; with that bit cleared, rounding to nearest rounds down. */
static inline float32 unit_float(uint32_t x)
{
    return (float32)(SAFEGUARD(UNIT_BELOW_1) ? x & ~(x >> 24) : x) * 0x1p-32f;
}

static inline real sampler_hash_second(uint32_t first, uint32_t key_b) { return unit_float(hash_u32(first ^ key_b)); }

/* Make the pair's numbers, of all samples of the batch, or of one sample alone. */
void sampler_batch_make(struct sampler_batch *batch, uint32_t pair);
struct sample2 sampler_get_alone(const struct sampler *s, uint32_t pair);

static inline struct sample2 sampler_get(const struct sampler *s, uint32_t pair)
{
    struct sampler_batch *batch = s->batch;

    if (!batch || pair >= SAMPLER_BATCH_PAIRS)
        return sampler_get_alone(s, pair);
    if (!(batch->made >> pair & 1))
        sampler_batch_make(batch, pair);
    return (struct sample2){batch->u[pair][s->lane], batch->v[pair][s->lane]};
}
