/* blocks: are two pictures that ought to be the same apart by more than noise?
 *
 * Both have side x side pixels, doubles [side][side][3], and were made with the same seed, so most of their samples are the same. In
 * each block of 8x8 pixels, and in the picture, Student's t of the pixels' differences tells whether their mean is 0. A difference
 * of less than 1e-5 of the block's light is none. */
#pragma once

enum { BLOCKS_SIDE = 8 };

struct blocks_worst {
    double p_value; /* two-sided, the least; 1: no difference */
    double share;   /* the difference's, of the block's light */
    int x, y;       /* in pixels, of the block's corner; 0, 0 may be the whole picture */
};

/* Comparisons that blocks_compare makes. */
unsigned blocks_comparisons(int side);
/* `side`: a multiple of BLOCKS_SIDE. */
struct blocks_worst blocks_compare(const double *picture, const double *reference, int side);
/* The normal quantile of a two-sided p-value, for people. */
double blocks_z(double p_value);
