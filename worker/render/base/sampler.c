#include "worker/render/base/sampler.h"

#include "common/film/tiles.h"

uint32_t hash_u32(uint32_t x)
{
    /* Wellons' "lowbias32": a bijection whose every output bit depends on every input bit. */
    x = (x ^ (x >> 16)) * 0x7feb352du;
    x = (x ^ (x >> 15)) * 0x846ca68bu;
    return x ^ (x >> 16);
}

uint32_t hash_combine(uint32_t seed, uint32_t value)
{
    return hash_u32(hash_u32(seed + 0x9e3779b9u) ^ value);
}

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

void sampler_start(struct sampler *s, uint64_t job_seed, uint32_t frame, uint32_t pixel_x,
                   uint32_t pixel_y, uint32_t group, uint32_t sample)
{
    uint32_t replicate = group * GROUP_REPLICATES + sample % GROUP_REPLICATES;
    uint64_t seed = hash_u64(job_seed ^ 0x6a09e667f3bcc909ull);

    /* Every step is a bijection, so two pixels of one frame and replicate never share a seed; other
     * pairs do so only with the odds of a random 64-bit function. */
    seed = hash_u64(seed + ((uint64_t)frame << 32 | replicate));
    s->seed = hash_u64(seed + ((uint64_t)pixel_y << 32 | pixel_x));
    s->index = sample / GROUP_REPLICATES;
    s->index_reversed = bits_reverse_32(s->index);
}

void sampler_isolate(struct sampler *s)
{
    s->seed = hash_u64(hash_u64(s->seed ^ 0xbb67ae8584caa73bull) + s->index);
    s->index = s->index_reversed = 0;
}

real sampler_hash(const struct sampler *s, uint32_t key_a, uint32_t key_b)
{
    uint32_t h = hash_combine((uint32_t)(s->seed >> 32), s->index);

    h = hash_combine(h ^ (uint32_t)s->seed, key_a);
    return unit_float(hash_combine(h, key_b));
}
