/* noise: repeatable randomness over the plane and over space, for what a landscape is made of. The
 * same seed and place give the same value. */
#pragma once

#include <stdint.h>

/* Well mixed 32 bits of three whole numbers and a seed. */
uint32_t noise_hash(int x, int y, int z, uint32_t seed);
/* The n-th number of a hash, 0 to below 1. */
double noise_number(uint32_t hash, int n);
/* Gradient noise (Perlin 2002, "Improving Noise", SIGGRAPH), of wavelength 1 to 2 and size 0.5, and `octaves` - 1 more,
 * each of half the size and wavelength of the one before: -1 to 1. */
double noise_sum(double x, double y, double z, int octaves, uint32_t seed);

/* 0 below `from`, 1 above `to`, smooth between. */
double smooth_step(double from, double to, double x);
double mix(double a, double b, double share_of_b);
