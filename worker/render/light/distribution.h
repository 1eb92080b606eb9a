/* distribution: which cell of a grid, with probability proportional to the cell's weight.
 *
 * Row by the second number (marginal), then column by the first (conditional on the row);
 * both choices are monotone, so that stratified numbers stay stratified. Memory is four
 * bytes a cell and a sixteenth more: a column's start is a 32-bit fraction of its row, 256
 * times finer than the numbers that are compared with it; row starts are doubles.
 * Invariant: a cell or a row of weight 0 has no width and is never chosen.
 */
#ifndef AZULEJO_RENDER_DISTRIBUTION_H
#define AZULEJO_RENDER_DISTRIBUTION_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/status.h"

enum { DISTRIBUTION_BLOCK = 16 }; /* columns whose starts fill one cache line */

struct distribution {
    uint32_t rows, columns;
    double *row_start;      /* [rows + 1], 0 to 1; sums of row weights until finished */
    uint32_t *column_start; /* [rows][columns]; a row's end, 2^32, is not stored */
    uint32_t *block_start;  /* [rows][blocks] every 16th column_start, to search first: a binary
                               search in a long row costs a cache miss a step */
    uint32_t blocks;
    double total;           /* sum of all weights */
};

struct distribution_cell {
    uint32_t row, column;
    double row_fraction, column_fraction; /* where in the cell, each 0..1 */
};

status distribution_init(struct distribution *d, uint32_t rows, uint32_t columns,
                         struct error *err) MUST_CHECK;
void distribution_release(struct distribution *d);
size_t distribution_bytes(const struct distribution *d);

/* Rows in order 0, 1, ... each once. weights[columns]: finite, >= 0, their sum finite.
 * `scale` multiplies the row (its height). */
void distribution_set_row(struct distribution *d, uint32_t row, const double *weights,
                          double scale);

/* After the last row. 0 when every weight was 0: then nothing may be chosen. */
int distribution_finish(struct distribution *d);

/* Choose in two steps, so that the caller can fetch what it holds of the block's columns
 * while the second waits for memory. u, v in [0, 1).
 * First the row, and the block: `column` is its first, column_fraction is not set. */
void distribution_choose_block(const struct distribution *d, float u, float v,
                               struct distribution_cell *out);
/* Then the column in the block, with the same u. */
void distribution_choose_column(const struct distribution *d, float u,
                                struct distribution_cell *out);

#endif
