#include "common/math/curve_table.h"

void curve_table_build(struct curve_table *table, float (*pieces)[4], int first, int octaves,
                       double (*curve)(double x, const void *user), const void *user)
{
    double at_start = curve(ldexp(1.0, first), user);

    for (int i = 0; i < octaves * CURVE_PIECES; i++) {
        double width = ldexp(1.0 / CURVE_PIECES, first + i / CURVE_PIECES);
        double start = ldexp(1.0, first + i / CURVE_PIECES) + width * (i % CURVE_PIECES);
        double at_middle = curve(start + 0.5 * width, user), at_end = curve(start + width, user);

        pieces[i][0] = (float)at_start;
        pieces[i][1] = (float)(4.0 * at_middle - 3.0 * at_start - at_end);
        pieces[i][2] = (float)(2.0 * (at_start + at_end) - 4.0 * at_middle);
        pieces[i][3] = (float)at_end;
        at_start = at_end;
    }
    table->pieces = pieces;
    table->start = (uint32_t)(127 + first) << 7;
    table->low = (float)ldexp(1.0, first);
    table->high = float_from_bits(float_bits((float)ldexp(1.0, first + octaves)) - 1);
}
