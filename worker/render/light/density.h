/* density: a distribution of directions, constant in each cell of a grid over a window of a
 * lat-long map.
 *
 * Cells are equal in u and in v. Within a cell, directions are uniform in solid angle, so the poles
 * need no special treatment. Window: u from u0 on for u_size (periodic), v likewise.
 */
#ifndef AZULEJO_RENDER_DENSITY_H
#define AZULEJO_RENDER_DENSITY_H

#include "common/math/real.h"
#include "worker/render/light/distribution.h"

struct density {
    double u0, v0, u_size, v_size;
    struct distribution cells;
    double *row_cosine;   /* [rows + 1] of theta at the rows' edges, decreasing */
    double *inverse_area; /* [rows] 1 / solid angle of a cell */
};

/* An empty grid over the window. Then call density_set_row for each row, with the integral of the
 * importance over each cell, and density_finish, which returns 0 if all of it is 0. */
status density_init(struct density *d, double u0, double v0, double u_size, double v_size,
                    uint32_t columns, uint32_t rows, struct error *err) MUST_CHECK;
void density_set_row(struct density *d, uint32_t row, const double *weights);
int density_finish(struct density *d);
void density_release(struct density *d);
size_t density_bytes(const struct density *d);

/* Solid angle of a cell of that row. */
double density_cell_area(const struct density *d, uint32_t row);

/* A direction: u, not wrapped, and cos(theta). a, b in [0, 1). Its density in solid angle. */
double density_sample(const struct density *d, real a, real b, double *u, double *cosine);
double density_at(const struct density *d, real u, real v);

#endif
