#include "worker/render/light/environment/distribution.h"

#include <string.h>

#include "common/base/memory.h"

#define ROW_STEPS 0x1p24

status distribution_init(struct distribution *d, uint32_t rows, uint32_t columns, struct error *err)
{
    size_t starts, guides;

    memset(d, 0, sizeof *d);
    if (rows == 0 || columns == 0 || rows > DISTRIBUTION_SIDE_MAX || columns > DISTRIBUTION_SIDE_MAX)
        return error_set(err, STATUS_ERR_INTERNAL, "a distribution of %u x %u cells", columns, rows);
    d->rows = rows;
    d->columns = columns;
    d->row_guides = 1;
    while (d->row_guides < rows) /* a power of two: its product with a number in [0, 1) is exact */
        d->row_guides *= 2;
    d->column_guides = (columns + DISTRIBUTION_GUIDED - 1) / DISTRIBUTION_GUIDED;
    starts = (size_t)rows * (columns + 1);
    guides = (size_t)rows * d->column_guides;
    d->row_start = mem_calloc((size_t)rows + 1, sizeof *d->row_start);
    d->row_guide = mem_calloc(d->row_guides, sizeof *d->row_guide);
    d->column_start = mem_calloc(starts, sizeof *d->column_start);
    d->column_guide = mem_calloc(guides, sizeof *d->column_guide);
    d->row_weight = mem_calloc(rows, sizeof *d->row_weight);
    if (!d->row_start || !d->row_guide || !d->column_start || !d->column_guide || !d->row_weight) {
        distribution_release(d);
        return error_no_memory(err, "the environment's importance table");
    }
    return STATUS_OK;
}

void distribution_release(struct distribution *d)
{
    mem_free(d->row_start);
    mem_free(d->row_guide);
    mem_free(d->column_start);
    mem_free(d->column_guide);
    mem_free(d->row_weight);
    memset(d, 0, sizeof *d);
}

size_t distribution_bytes(const struct distribution *d)
{
    return ((size_t)d->rows + 1) * sizeof *d->row_start + d->row_guides * sizeof *d->row_guide +
           (size_t)d->rows * ((d->columns + 1) * sizeof *d->column_start + d->column_guides * sizeof *d->column_guide);
}

void distribution_set_row(struct distribution *d, uint32_t row, const double *weights)
{
    uint16_t *start = d->column_start + (size_t)row * (d->columns + 1);
    uint16_t *guide = d->column_guide + (size_t)row * d->column_guides;
    double sum = 0, before = 0;

    for (uint32_t i = 0; i < d->columns; i++)
        sum += weights[i];
    d->row_weight[row] = sum;
    if (!(sum > 0))
        return;
    for (uint32_t i = 0; i < d->columns; i++) {
        double position = before / sum * DISTRIBUTION_WHOLE;

        start[i] = position < DISTRIBUTION_WHOLE ? (uint16_t)position : DISTRIBUTION_WHOLE;
        before += weights[i];
    }
    start[d->columns] = DISTRIBUTION_WHOLE;
    for (uint32_t g = 0, i = 0; g < d->column_guides; g++) {
        while (i + 1 < d->columns && (uint64_t)start[i + 1] * d->column_guides <= (uint64_t)g * DISTRIBUTION_WHOLE)
            i++;
        guide[g] = (uint16_t)i;
    }
}

int distribution_finish(struct distribution *d)
{
    double before = 0;

    for (uint32_t row = 0; row < d->rows; row++)
        d->total += d->row_weight[row];
    if (!(d->total > 0))
        return 0;
    for (uint32_t row = 0; row < d->rows; row++) {
        d->row_start[row] = (real)(floor(before / d->total * ROW_STEPS) / ROW_STEPS);
        before += d->row_weight[row]; /* the same sum as the total: rows without weight at the end start at 1 */
    }
    d->row_start[d->rows] = 1;
    for (uint32_t g = 0, row = 0; g < d->row_guides; g++) {
        while (row + 1 < d->rows && (double)d->row_start[row + 1] * d->row_guides <= g)
            row++;
        d->row_guide[g] = (uint16_t)row;
    }
    mem_free(d->row_weight);
    d->row_weight = NULL;
    return 1;
}
