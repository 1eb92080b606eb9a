/* curve_table: an increasing function of a positive float as a table, for curves that are wanted
 * for every channel of every pixel. Each octave is cut into 128 pieces; a piece is the parabola
 * through the curve's values at its ends and its middle, which for powers and logarithms is
 * within 3e-8 of the value. The float's own bits say which piece. What comes out never decreases
 * from one piece to the next, and has the same bits on every machine.
 */
#ifndef AZULEJO_MATH_CURVE_TABLE_H
#define AZULEJO_MATH_CURVE_TABLE_H

#include "common/math/elementary.h"

enum { CURVE_PIECES = 128 }; /* an octave */

struct curve_table {
    float (*pieces)[4]; /* value, slope, bend; the value where the next piece begins */
    uint32_t start;     /* the upper half of the bits of the first piece's beginning */
    float low, high;    /* the argument's range */
};

/* Make a table of curve(x, user), which must not decrease, over `octaves` octaves from 2^first on
 * (first >= -126), in storage of the caller: float pieces[octaves * CURVE_PIECES][4]. */
void curve_table_build(struct curve_table *table, float (*pieces)[4], int first, int octaves,
                       double (*curve)(double x, const void *user), const void *user);

/* The curve at x; x below the table's range is taken for its lower end, above it for its upper
 * end, NaN for the lower one. */
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

#endif
