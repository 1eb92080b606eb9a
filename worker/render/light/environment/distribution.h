/* distribution: choose a cell of a grid with probability proportional to its weight.
 *
 * The second number chooses the row (marginal), then the first chooses the column (conditional on
 * the row). Both choices are monotone, so stratified numbers stay stratified; an alias table would lose that.
 * A guide table tells where in the cumulative weights to begin, so a choice takes a step or two.
 * A row's start is a multiple of 2^-24, a column's a 16-bit fraction of its row: two bytes per cell, so the table of a
 * large map stays in a core's cache. The reported odds are exactly those of the rounded starts; a cell of less than
 * DISTRIBUTION_WHOLE of its row may have odds 0.
 * Invariant: a cell or a row of weight 0 has no width and is never chosen.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/math/real.h"
#include "common/base/status.h"

enum {
    DISTRIBUTION_SIDE_MAX = 65536, /* rows or columns */
    DISTRIBUTION_WHOLE = 65535,    /* the end of a row */
    DISTRIBUTION_GUIDED = 4,       /* columns of the grid to one of their guide */
};

struct distribution {
    uint32_t rows, columns;
    uint32_t row_guides, column_guides;
    real *row_start;        /* [rows + 1], 0 to 1 */
    uint16_t *row_guide;    /* [row_guides] the last row that starts at or before its share of 0..1 */
    uint16_t *column_start; /* [rows][columns + 1] */
    uint16_t *column_guide; /* [rows][column_guides] likewise, of columns */
    double *row_weight;     /* [rows] sums, until finished */
    double total;           /* sum of all weights */
};

struct distribution_cell {
    uint32_t row, column;
    uint32_t width;                     /* share of the row, of DISTRIBUTION_WHOLE */
    real row_fraction, column_fraction; /* position in the cell, each 0..1 */
};

/* ERR_INTERNAL beyond DISTRIBUTION_SIDE_MAX; ERR_NO_MEMORY. */
status distribution_init(struct distribution *d, uint32_t rows, uint32_t columns, struct error *err) MUST_CHECK;
void distribution_release(struct distribution *d);
size_t distribution_bytes(const struct distribution *d);

/* Each row once. weights[columns]: finite, >= 0, with a finite sum. */
void distribution_set_row(struct distribution *d, uint32_t row, const double *weights);

/* After the last row. 0 if every weight was 0: then there is nothing to choose. */
int distribution_finish(struct distribution *d);

/* The cell's share of its row, of DISTRIBUTION_WHOLE. */
static inline uint32_t distribution_width(const struct distribution *d, uint32_t row, uint32_t column)
{
    const uint16_t *start = d->column_start + (size_t)row * (d->columns + 1) + column;

    return (uint32_t)start[1] - start[0];
}

static inline real distribution_row_odds(const struct distribution *d, uint32_t row)
{
    return d->row_start[row + 1] - d->row_start[row];
}

/* u, v in [0, 1). */
static inline void distribution_choose(const struct distribution *d, real u, real v, struct distribution_cell *out)
{
    real position = u * DISTRIBUTION_WHOLE;
    uint32_t target = (uint32_t)(int32_t)position, row = d->row_guide[(int32_t)(v * (real)(int32_t)d->row_guides)];
    uint32_t column;
    const uint16_t *start;

    while (d->row_start[row + 1] <= v)
        row++;
    start = d->column_start + (size_t)row * (d->columns + 1);
    column = d->column_guide[(size_t)row * d->column_guides + (size_t)target * d->column_guides / DISTRIBUTION_WHOLE];
    while (start[column + 1] <= target)
        column++;
    out->row = row;
    out->row_fraction = (v - d->row_start[row]) / distribution_row_odds(d, row);
    out->column = column;
    out->width = (uint32_t)start[column + 1] - start[column];
    out->column_fraction = (position - (real)start[column]) / (real)(int32_t)out->width;
}
