/* distribution: choose a cell of a grid with probability proportional to its weight.
 *
 * The second number chooses the row (marginal), then the first chooses the column (conditional on
 * the row). Both choices are monotone, so stratified numbers stay stratified. A column's start is a
 * 16-bit fraction of its row: two bytes per cell, so the table of a large map stays in a core's
 * cache. The reported odds are exactly those of the rounded starts; a cell of less than 2^-16 of
 * its row may have odds 0.
 * Invariant: a cell or a row of weight 0 has no width and is never chosen.
 */
#ifndef AZULEJO_RENDER_DISTRIBUTION_H
#define AZULEJO_RENDER_DISTRIBUTION_H

#include <stddef.h>
#include <stdint.h>

#include "common/math/real.h"
#include "common/base/status.h"

enum { DISTRIBUTION_BLOCK = 32 }; /* columns whose starts fill one cache line */

struct distribution {
    uint32_t rows, columns;
    double *row_start;      /* [rows + 1], 0 to 1; sums of row weights until finished */
    uint16_t *column_start; /* [rows][columns]; a row's end, 2^16, is not stored */
    uint16_t *block_start;  /* [rows][blocks] every 32nd column_start, searched first: a binary
                               search in a long row costs a cache miss per step */
    uint32_t *used;         /* [rows] columns up to the last that has weight */
    uint32_t blocks;
    double total;           /* sum of all weights */
};

struct distribution_cell {
    uint32_t row, column;
    double row_fraction, column_fraction; /* position in the cell, each 0..1 */
    double odds;
};

status distribution_init(struct distribution *d, uint32_t rows, uint32_t columns,
                         struct error *err) MUST_CHECK;
void distribution_release(struct distribution *d);
size_t distribution_bytes(const struct distribution *d);

/* Rows in order 0, 1, ... each once. weights[columns]: finite, >= 0, with a finite sum. */
void distribution_set_row(struct distribution *d, uint32_t row, const double *weights);

/* After the last row. 0 if every weight was 0: then there is nothing to choose. */
int distribution_finish(struct distribution *d);

/* u, v in [0, 1). */
void distribution_choose(const struct distribution *d, real u, real v,
                         struct distribution_cell *out);

/* The odds with which distribution_choose chooses the cell. */
double distribution_odds(const struct distribution *d, uint32_t row, uint32_t column);

#endif
