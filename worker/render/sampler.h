/* sampler: random numbers as a pure function of (seed, frame, pixel, sample, dimension).
 *
 * Owen-scrambled Sobol' (0,2)-sequences, padded: every pair of dimensions is its own
 * two-dimensional sequence with its own index shuffle and scrambles (Burley 2020, JCGT
 * 9(4); the hash is Vegdahl's). Sample i belongs to replicate i mod 2 and is point i / 2
 * of that replicate's own, independently scrambled sequence (refs: Owen 2501.00150).
 * The path asks for dimensions by name, so that one decision's numbers never depend on
 * how many another took.
 */
#ifndef AZULEJO_RENDER_SAMPLER_H
#define AZULEJO_RENDER_SAMPLER_H

#include <stdint.h>

struct sample2 {
    float u, v; /* each in [0, 1) */
};

struct sampler {
    uint32_t seed;   /* hash of job seed, frame, pixel and replicate */
    uint32_t index;  /* the point's number in the replicate's sequence */
};

/* Dimension pairs: what a pair of numbers is for. A path vertex of depth d uses
 * DIMENSION_VERTEX + d * DIMENSIONS_PER_VERTEX + one of the vertex's. */
enum dimension {
    DIMENSION_PIXEL = 0,     /* position in the pixel (filter) */
    DIMENSION_LENS = 1,
    DIMENSION_TIME = 2,
    DIMENSION_VERTEX = 8,
    VERTEX_LIGHT_POINT = 0,  /* where on the light */
    VERTEX_LIGHT_CHOICE = 1, /* u: which light, v: spare */
    VERTEX_BSDF = 2,         /* direction */
    VERTEX_LOBE = 3,         /* u: which lobe, v: Russian roulette */
    DIMENSIONS_PER_VERTEX = 4,
};

void sampler_start(struct sampler *s, uint64_t job_seed, uint32_t frame, uint32_t pixel_x,
                   uint32_t pixel_y, uint32_t sample);

/* The two numbers of dimension pair `pair`. */
struct sample2 sampler_get(const struct sampler *s, uint32_t pair);

/* One hashed number in [0,1) that is not part of the sequence: for decisions that may
 * happen any number of times (stochastic alpha). `key` tells them apart. */
float sampler_hash(const struct sampler *s, uint32_t key_a, uint32_t key_b);

/* ---- the parts, for the tests ---- */
/* Nested uniform (Owen) scramble of a 32-bit fraction, most significant digit first. */
uint32_t owen_scramble(uint32_t x, uint32_t seed);
/* Point `index` of the first two Sobol' dimensions, unscrambled, as 32-bit fractions. */
void sobol_2d(uint32_t index, uint32_t out[2]);
/* Shuffled and scrambled point of the padded pair with this seed. */
struct sample2 sobol_owen_2d(uint32_t index, uint32_t seed);
uint32_t hash_u32(uint32_t x);
uint32_t hash_combine(uint32_t seed, uint32_t value);

#endif
