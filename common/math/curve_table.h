/* curve_table: a table of an increasing function of a positive float, for curves that are evaluated for every channel
 * of every pixel. Each octave is divided into 128 pieces. A piece is the parabola through the curve's values at its
 * ends and its middle, which for powers and logarithms is within 3e-8 of the value. The float's own bits select the
 * piece. The result never decreases from one piece to the next, and has the same bits on every machine.
 */
#pragma once

#include "common/math/elementary.h"

enum { CURVE_PIECES = 128 }; /* an octave */

struct curve_table {
    float (*pieces)[4]; /* value, slope, bend; the value where the next piece begins */
    uint32_t start;     /* the upper half of the bits of the first piece's start */
    float low, high;    /* the argument's range */
};

/* Make a table of curve(x, user), which must not decrease, over `octaves` octaves from 2^first on
 * (first >= -126), in storage of the caller: float pieces[octaves * CURVE_PIECES][4]. */
void curve_table_build(struct curve_table *table, float (*pieces)[4], int first, int octaves,
                       double (*curve)(double x, const void *user), const void *user);

/* The curve at x. x below the table's range gives the value of its lower end, x above it that of
 * its upper end, NaN that of the lower end. */
static inline float curve_table_at(const struct curve_table *table, float x)
{
    const float *piece;
    uint32_t bits;
    float t, value;

    x = x > table->low ? x : table->low;
    x = x < table->high ? x : table->high;
    bits = float_bits(x);
    piece = table->pieces[(bits >> 16) - table->start];
    t = (float)(bits & 0xffff) * 0x1p-16f;
    value = piece[0] + t * (piece[1] + t * piece[2]);
    value = value > piece[0] ? value : piece[0];
    return value < piece[3] ? value : piece[3];
}
