#include "worker/render/base/sampler.h"

#include "common/film/tiles.h"

/* Reverse the bits of both halves, and swap the halves. (Shift and addition are one instruction.) */
static inline uint64_t bits_reverse_64(uint64_t x)
{
    x = __builtin_bswap64(x);
    x = (x >> 4 & 0x0f0f0f0f0f0f0f0full) | (x & 0x0f0f0f0f0f0f0f0full) << 4;
    x = (x >> 2 & 0x3333333333333333ull) + 4 * (x & 0x3333333333333333ull);
    return (x >> 1 & 0x5555555555555555ull) + 2 * (x & 0x5555555555555555ull);
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

/* What scrambles the points of a pair. */
struct scrambles {
    uint32_t shuffle, u, v;
};

static inline struct scrambles scrambles_of(uint64_t seed)
{
    uint64_t both = hash_u64(seed + 0x9e3779b97f4a7c15ull);

    return (struct scrambles){(uint32_t)(hash_u64(seed ^ 0xd1b54a32d192ed03ull) >> 32), (uint32_t)both,
                              (uint32_t)(both >> 32)};
}

static inline uint64_t pair_seed(uint64_t seed, uint32_t pair)
{
    return seed + (SAFEGUARD(INDEPENDENT_PAIRS) ? pair * 0xda942042e4dd58b5ull : 0);
}

/* The index shuffle is owen_scramble(index): reverse, hash, reverse. Dimension 0 (van der Corput)
 * is the reversed index, so its scramble hashes the shuffled index directly; dimension 1's scramble
 * likewise hashes its digits. One 64-bit reversal then serves both. */
static inline struct sample2 sobol_owen_2d_reversed(uint32_t index_reversed, uint64_t seed)
{
    const struct scrambles by = scrambles_of(seed);
    uint32_t index = bits_reverse_32(owen_hash_reversed(index_reversed, by.shuffle));
    uint32_t x = owen_hash_reversed(index, by.u);
    uint32_t y = owen_hash_reversed(sobol_pascal_reversed(index), by.v);
    uint64_t both = bits_reverse_64((uint64_t)x << 32 | y);

    return (struct sample2){unit_float((uint32_t)both), unit_float((uint32_t)(both >> 32))};
}

struct sample2 sampler_get_alone(const struct sampler *s, uint32_t pair)
{
    return sobol_owen_2d_reversed(s->index_reversed, pair_seed(s->seed, pair));
}

/* What a seed makes of it before the value joins. */
static uint32_t hash_seeded(uint32_t seed) { return hash_u32(seed + 0x9e3779b9u); }

uint32_t hash_combine(uint32_t seed, uint32_t value) { return hash_u32(hash_seeded(seed) ^ value); }

uint32_t owen_scramble(uint32_t x, uint32_t seed)
{
    return bits_reverse_32(owen_hash_reversed(bits_reverse_32(x), seed));
}

void sobol_2d(uint32_t index, uint32_t out[2])
{
    out[0] = bits_reverse_32(index);
    out[1] = bits_reverse_32(sobol_pascal_reversed(index));
}

struct sample2 sobol_owen_2d(uint32_t index, uint64_t seed)
{
    return sobol_owen_2d_reversed(bits_reverse_32(index), seed);
}

void sampler_start(struct sampler *s, uint64_t job_seed, uint32_t frame, uint32_t pixel_x, uint32_t pixel_y,
                   uint32_t group, uint32_t sample)
{
    uint64_t seed = hash_u64(job_seed ^ 0x6a09e667f3bcc909ull);

    /* Every step is a bijection, so two pixels of one frame and group never share a seed; other
     * pairs do so only with the odds of a random 64-bit function. */
    seed = hash_u64(seed + ((uint64_t)frame << 32 | group));
    s->seed = hash_u64(seed + ((uint64_t)pixel_y << 32 | pixel_x));
    s->batch = NULL;
    s->lane = 0;
    s->index = sample;
    s->index_reversed = bits_reverse_32(sample);
}

void sampler_isolate(struct sampler *s)
{
    s->seed = hash_u64(hash_u64(s->seed ^ 0xbb67ae8584caa73bull) + s->index);
    s->index = s->index_reversed = 0;
    s->batch = NULL;
}

/* ---- several samples at a time --------------------------------------------------------------- */

/* A loop that compilers turn into vector instructions. */
static inline __attribute__((always_inline)) void make(struct sampler_batch *batch, uint32_t pair)
{
    const struct scrambles by = scrambles_of(pair_seed(batch->seed, pair));
    const uint32_t *index_reversed = batch->index_reversed;
    float32 *u = batch->u[pair], *v = batch->v[pair];

    for (uint32_t lane = 0; lane < SAMPLER_LANES; lane++) {
        uint32_t index = bits_reverse_32(owen_hash_reversed(index_reversed[lane], by.shuffle));
        u[lane] = unit_float(bits_reverse_32(owen_hash_reversed(index, by.u)));
        v[lane] = unit_float(bits_reverse_32(owen_hash_reversed(sobol_pascal_reversed(index), by.v)));
    }
    batch->made |= UINT32_C(1) << pair;
}

#ifdef __x86_64__
static __attribute__((target("avx2"))) void make_avx2(struct sampler_batch *batch, uint32_t pair) { make(batch, pair); }
#endif

/* SSE2 cannot multiply words, so without AVX2 a batch would be no faster than its samples alone. */
int sampler_batch_pays(void)
{
#ifdef __x86_64__
    return __builtin_cpu_supports("avx2") != 0;
#else
    return 1;
#endif
}

void sampler_batch_make(struct sampler_batch *batch, uint32_t pair)
{
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2")) {
        make_avx2(batch, pair);
        return;
    }
#endif
    make(batch, pair);
}

void sampler_start_batch(struct sampler *samplers, uint32_t first, uint32_t count, struct sampler_batch *batch)
{
    const uint64_t seed = samplers[0].seed;

    for (uint32_t k = 0; k < count; k++)
        samplers[k] = (struct sampler){seed, first + k, bits_reverse_32(first + k), k, batch};
    if (!batch)
        return;
    batch->seed = seed;
    batch->made = 0;
    for (uint32_t k = 0; k < SAMPLER_LANES; k++)
        batch->index_reversed[k] = k < count ? samplers[k].index_reversed : bits_reverse_32(first + k);
}

uint32_t sampler_hash_first(const struct sampler *s, uint32_t key_a)
{
    uint32_t h = hash_combine((uint32_t)(s->seed >> 32), s->index);

    return hash_seeded(hash_combine(h ^ (uint32_t)s->seed, key_a));
}

real sampler_hash(const struct sampler *s, uint32_t key_a, uint32_t key_b)
{
    return sampler_hash_second(sampler_hash_first(s, key_a), key_b);
}
