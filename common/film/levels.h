/* levels: how much the two halves of a group's sequence differ on a tile, at a level.
 *
 * Level k is the moment at which a group has 2^(k+1) samples of each pixel. Half A are those of level k - 1, half B
 * those since then. A film computes its statistics at that moment and keeps them: they are a function of the group's
 * samples up to that level and of nothing else. Level 0 has no halves.
 *
 * Halves of a scrambled sequence are negatively correlated. With V_k the variance of the mean at level k, and A and B
 * exchangeable, the mean of (A - B)^2 / 4 is V_(k-1) - V_k. With independent samples that is V_k. A sequence whose
 * variance falls to a share r a doubling has V_k = r / (1 - r) times it. The ratio of two levels' statistics is the r
 * of the doubling before, and r grows towards 1/2 as the sequence's advantage wears off, so level_correction() takes
 * the mean of that ratio and 1/2. What it is worth is measured: docs/ALLOCATION.md.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

enum {
    LEVEL_BINS = 24,
    LEVEL_SPREADS = 48,
    LEVEL_SPREAD_ONE = 16, /* what a pixel counts in `spreads` */
};

struct film_level {
    uint64_t rays;             /* of the group on the tile, up to this level */
    uint64_t subject;          /* of the group's samples on the tile, up to this level: subject_samples (unit.h) */
    double radiance;           /* sum over pixels of R + G + B of the group's mean */
    double linear;             /* sum over pixels and RGB of (A - B)^2 / 4, in linear radiance */
    float display;             /* sum over pixels of e^2 in codes, e = the largest channel's |a - b| / 2 */
    int16_t has_codes;         /* everything in codes is known; never at level 0 */
    int16_t skipped;           /* not measured (film_measure_from): the rest is 0 */
    uint16_t bins[LEVEL_BINS]; /* pixels by level_bin(e) */
    /* As a picture of this group alone reports it (common/accuracy/figures.h): codes of its mean
     * with half of A - B added and subtracted, minus those of the mean. */
    float channels;                  /* sum over pixels and channels of the squares' mean */
    uint16_t spreads[LEVEL_SPREADS]; /* pixels by the standard deviation that they share with their
                          * neighbours on the tile; each is divided between the two nearest of
                          * level_spread(i). Smaller ones than the first are left out */
};

/* The bin of an error in codes, of 255: bin i holds 2^(i/2 - 5) up to the next half octave; smaller errors
 * are in bin 0, larger ones in the last. */
uint32_t level_bin(float codes);

/* 2^(i/4 - 5) codes. */
float level_spread(uint32_t i);

/* What a display shows of linear pixels: codes[count][3] of rgb[count][3], 0..255 and not rounded.
 * A function of each pixel alone. `codes` NULL: not known. */
struct film_codes {
    void (*codes)(void *user, const float *rgb, uint32_t count, float *codes);
    void *user;
};

/* sRGB at 0 EV: for a picture without an operator. */
void film_codes_plain(void *user, const float *rgb, uint32_t count, float *codes);

/* From the sums of `samples` samples, [height][width][3], and of the second half of them; NULL: there
 * are no halves, and no errors. Sets all fields except rays and subject; without codes or halves it leaves those
 * in codes 0. width, height <= TILE_SIZE. */
void film_level_measure(struct film_level *out, const double *sums, const float *second, uint32_t width,
                        uint32_t height, uint32_t samples, const struct film_codes *codes);

/* The variance of a group's mean over what a level says, from the same sum of squares at this level and
 * at the one before (0: not known): 1 for independent samples, at least a third. */
double level_correction(double now, double before);
