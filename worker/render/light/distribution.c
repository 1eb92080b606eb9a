#include "worker/render/light/distribution.h"

#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"

#define WHOLE 65536.0 /* the end of a row */

status distribution_init(struct distribution *d, uint32_t rows, uint32_t columns,
                         struct error *err)
{
    uint32_t blocks = (columns + DISTRIBUTION_BLOCK - 1) / DISTRIBUTION_BLOCK;
    size_t cells;

    memset(d, 0, sizeof *d);
    if (rows == 0 || columns == 0 || !mem_size_mul(rows, columns, &cells))
        return error_set(err, STATUS_ERR_INTERNAL, "a distribution of %u x %u cells", columns,
                         rows);
    d->row_start = mem_calloc((size_t)rows + 1, sizeof *d->row_start);
    d->column_start = mem_calloc(cells, sizeof *d->column_start);
    d->block_start = mem_calloc((size_t)rows * blocks, sizeof *d->block_start);
    d->used = mem_calloc(rows, sizeof *d->used);
    if (!d->row_start || !d->column_start || !d->block_start || !d->used) {
        distribution_release(d);
        return error_no_memory(err, "the environment's importance table");
    }
    d->rows = rows;
    d->columns = columns;
    d->blocks = blocks;
    return STATUS_OK;
}

void distribution_release(struct distribution *d)
{
    mem_free(d->row_start);
    mem_free(d->column_start);
    mem_free(d->block_start);
    mem_free(d->used);
    memset(d, 0, sizeof *d);
}

size_t distribution_bytes(const struct distribution *d)
{
    return ((size_t)d->rows + 1) * sizeof *d->row_start + d->rows * sizeof *d->used +
           (size_t)d->rows * d->columns * sizeof *d->column_start +
           (size_t)d->rows * d->blocks * sizeof *d->block_start;
}

/* A cell's start within its row. The last cell keeps a width, even one below the rounding: 65536 would
 * be stored as 0, the start of the whole row. */
static uint16_t cell_start(double position)
{
    if (!SAFEGUARD(MAP_ROW_END))
        return (uint16_t)(uint32_t)position;
    return position < WHOLE - 1 ? (uint16_t)position : UINT16_MAX;
}

void distribution_set_row(struct distribution *d, uint32_t row, const double *weights)
{
    uint16_t *start = d->column_start + (size_t)row * d->columns;
    double sum = 0, before = 0;

    for (uint32_t i = 0; i < d->columns; i++) {
        sum += weights[i];
        if (weights[i] > 0)
            d->used[row] = i + 1;
    }
    d->row_start[row + 1] = d->row_start[row] + sum;
    if (!(sum > 0))
        d->used[row] = 0;
    for (uint32_t i = 0; i < d->used[row]; i++) {
        start[i] = cell_start(before / sum * WHOLE);
        if (i % DISTRIBUTION_BLOCK == 0)
            d->block_start[(size_t)row * d->blocks + i / DISTRIBUTION_BLOCK] = start[i];
        before += weights[i];
    }
}

int distribution_finish(struct distribution *d)
{
    d->total = d->row_start[d->rows];
    if (!(d->total > 0))
        return 0;
    /* x / x is exactly 1, so rows without weight at the end start at 1. */
    for (uint32_t row = 0; row <= d->rows; row++)
        d->row_start[row] /= d->total;
    return 1;
}

/* The last of `count` ascending starts that is at or below the target; the first start always is.
 * Always the same number of steps, without a branch that could be mispredicted. */
static inline uint32_t last_at_or_below(const uint16_t *start, uint32_t count, uint32_t target)
{
    uint32_t low = 0;

    while (count > 1) {
        uint32_t half = count / 2;

        low += start[low + half] <= target ? half : 0;
        count -= half;
    }
    return low;
}

void distribution_choose(const struct distribution *d, real u, real v,
                         struct distribution_cell *out)
{
    const uint16_t *start;
    uint32_t row = 0, used, block, left, at;
    double position = (double)u * WHOLE, before, end, row_odds;

    for (uint32_t count = d->rows; count > 1;) {
        uint32_t half = count / 2;

        row += d->row_start[row + half] <= (double)v ? half : 0;
        count -= half;
    }
    row_odds = d->row_start[row + 1] - d->row_start[row];
    out->row = row;
    out->row_fraction = ((double)v - d->row_start[row]) / row_odds;

    used = d->used[row];
    block = DISTRIBUTION_BLOCK *
            last_at_or_below(d->block_start + (size_t)row * d->blocks,
                             (used + DISTRIBUTION_BLOCK - 1) / DISTRIBUTION_BLOCK,
                             (uint32_t)position);
    start = d->column_start + (size_t)row * d->columns + block;
    left = used - block;
    at = last_at_or_below(start, left < DISTRIBUTION_BLOCK ? left : DISTRIBUTION_BLOCK,
                          (uint32_t)position);
    before = (double)start[at];
    end = at + 1 < left ? (double)start[at + 1] : WHOLE;
    out->column = block + at;
    out->column_fraction = (position - before) / (end - before);
    out->odds = row_odds * ((end - before) * (1 / WHOLE));
}

double distribution_odds(const struct distribution *d, uint32_t row, uint32_t column)
{
    const uint16_t *start = d->column_start + (size_t)row * d->columns + column;
    uint32_t used = d->used[row];
    double end;

    if (column >= used)
        return 0;
    end = column + 1 < used ? (double)start[1] : WHOLE;
    return (d->row_start[row + 1] - d->row_start[row]) * ((end - (double)start[0]) * (1 / WHOLE));
}
