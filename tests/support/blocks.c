#include "tests/support/blocks.h"

#include <math.h>
#include <stddef.h>

#include "tests/support/statistics.h"

#define ROUNDING 1e-5

static void compare(const double *a, const double *b, int width, int x, int y, int side, int channel, struct blocks_worst *worst)
{
    struct running_stats apart = {0};
    double sum = 0, error, p;

    for (int i = 0; i < side * side; i++) {
        size_t at = ((size_t)(y + i / side) * (size_t)width + (size_t)(x + i % side)) * 3 + (size_t)channel;
        running_stats_add(&apart, a[at] - b[at]);
        sum += fabs(b[at]);
    }
    error = running_stats_error(&apart);
    if (fabs(apart.mean) * side * side <= ROUNDING * sum)
        return;
    p = error > 0 ? 2 * student_cdf(-fabs(apart.mean) / error, side * side - 1) : 0;
    if (p < worst->p_value)
        *worst = (struct blocks_worst){p, apart.mean * side * side / sum, x, y};
}

unsigned blocks_comparisons(int side) { return 3u * (unsigned)(side / BLOCKS_SIDE * (side / BLOCKS_SIDE) + 1); }

struct blocks_worst blocks_compare(const double *picture, const double *reference, int side)
{
    struct blocks_worst worst = {.p_value = 1};
    const int across = side / BLOCKS_SIDE;

    for (int c = 0; c < 3; c++) {
        compare(picture, reference, side, 0, 0, side, c, &worst);
        for (int k = 0; k < across * across; k++)
            compare(picture, reference, side, k % across * BLOCKS_SIDE, k / across * BLOCKS_SIDE, BLOCKS_SIDE, c, &worst);
    }
    return worst;
}

double blocks_z(double p_value) { return p_value <= 1e-300 ? 37 : p_value >= 1 ? 0 : -normal_quantile(p_value / 2); }
