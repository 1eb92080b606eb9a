#include "worker/render/light/distribution.h"

#include <string.h>

#include "common/base/memory.h"

#define WHOLE 4294967296.0 /* 2^32: the end of a row */

status distribution_init(struct distribution *d, uint32_t rows, uint32_t columns,
                         struct error *err)
{
    size_t cells;

    memset(d, 0, sizeof *d);
    if (rows == 0 || columns == 0 || !mem_size_mul(rows, columns, &cells))
        return error_set(err, STATUS_ERR_INTERNAL, "a distribution of %u x %u cells", columns, rows);
    d->row_start = mem_calloc((size_t)rows + 1, sizeof *d->row_start);
    d->column_start = mem_calloc(cells, sizeof *d->column_start);
    if (!d->row_start || !d->column_start) {
        distribution_release(d);
        return error_no_memory(err, "the environment's importance table");
    }
    d->rows = rows;
    d->columns = columns;
    return STATUS_OK;
}

void distribution_release(struct distribution *d)
{
    mem_free(d->row_start);
    mem_free(d->column_start);
    memset(d, 0, sizeof *d);
}

size_t distribution_bytes(const struct distribution *d)
{
    return ((size_t)d->rows + 1) * sizeof *d->row_start +
           (size_t)d->rows * d->columns * sizeof *d->column_start;
}

void distribution_set_row(struct distribution *d, uint32_t row, const double *weights, double scale)
{
    uint32_t *start = d->column_start + (size_t)row * d->columns;
    double sum = 0, before = 0;

    for (uint32_t i = 0; i < d->columns; i++)
        sum += weights[i];
    d->row_start[row + 1] = d->row_start[row] + sum * scale;
    if (!(sum > 0))
        return;
    for (uint32_t i = 0; i < d->columns; i++) {
        double position = before / sum * WHOLE;

        /* Cells without weight at a row's end start at its end, which does not fit the word:
         * but no u below 1 reaches the last 256 positions. */
        start[i] = position < WHOLE - 1 ? (uint32_t)position : UINT32_MAX;
        before += weights[i];
    }
}

int distribution_finish(struct distribution *d)
{
    d->total = d->row_start[d->rows];
    if (!(d->total > 0))
        return 0;
    /* x / x is exactly 1, so that rows without weight at the end start at 1. */
    for (uint32_t row = 0; row <= d->rows; row++)
        d->row_start[row] /= d->total;
    return 1;
}

void distribution_choose(const struct distribution *d, float u, float v,
                         struct distribution_cell *out)
{
    uint32_t target = (uint32_t)((double)u * WHOLE), low, length;
    const uint32_t *start;
    double width, end;

    /* The last row that starts at or below v, in a fixed number of steps. */
    low = 0;
    for (length = d->rows; length > 1;) {
        uint32_t half = length / 2;

        low += d->row_start[low + half] <= (double)v ? half : 0;
        length -= half;
    }
    out->row = low;
    width = d->row_start[low + 1] - d->row_start[low];
    out->row_fraction = ((double)v - d->row_start[low]) / width;

    start = d->column_start + (size_t)out->row * d->columns;
    low = 0;
    for (length = d->columns; length > 1;) {
        uint32_t half = length / 2;

        low += start[low + half] <= target ? half : 0;
        length -= half;
    }
    out->column = low;
    end = low + 1 < d->columns ? (double)start[low + 1] : WHOLE;
    out->column_fraction = ((double)target - (double)start[low]) / (end - (double)start[low]);
}
