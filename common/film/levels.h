/* levels: how much the two replicates of a group differ on a tile, at a level.
 *
 * Level k is the moment at which a group has 2^(k+1) samples of each pixel, 2^k in each replicate.
 * A film computes its statistics at that moment and keeps them: they are a function of the group's
 * samples up to that level and of nothing else.
 */
#ifndef AZULEJO_FILM_LEVELS_H
#define AZULEJO_FILM_LEVELS_H

#include <stddef.h>
#include <stdint.h>

enum {
    LEVEL_BINS = 24,
    LEVEL_SPREADS = 48,
    LEVEL_SPREAD_ONE = 16, /* what a pixel counts in `spreads` */
};

struct film_level {
    uint64_t rays;       /* of the group on the tile, up to this level */
    double radiance;     /* sum over pixels of R + G + B of the group's mean */
    double linear;       /* sum over pixels and RGB of (A - B)^2 / 4, in linear radiance */
    float display;       /* sum over pixels of e^2 in codes, e = the largest channel's |a - b| / 2 */
    int has_codes;       /* everything in codes is known */
    uint16_t bins[LEVEL_BINS]; /* pixels by level_bin(e) */
    /* As a picture of this group alone reports it (common/accuracy/figures.h): codes of its mean
     * with half of A - B added and subtracted, minus those of the mean. */
    float channels;      /* sum over pixels and channels of the squares' mean */
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

/* From the sums of both replicates, [2][height][width][3], of `samples` samples together. Sets all
 * fields except rays; without codes it leaves those in codes 0. width, height <= TILE_SIZE. */
void film_level_measure(struct film_level *out, const double *sums, uint32_t width, uint32_t height,
                        uint32_t samples, const struct film_codes *codes);

#endif
