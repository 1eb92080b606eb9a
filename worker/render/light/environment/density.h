/* density: a distribution of directions, constant in each cell of a grid over a window of a lat-long map.
 *
 * Cells are equal in u and in v. Within a cell, directions are uniform in solid angle, so the poles need no special
 * treatment. Window: u from u0 on for u_size (periodic), v likewise.
 */
#pragma once

#include "common/math/real.h"
#include "worker/render/light/environment/distribution.h"

/* 1 - cos of the angle to the nearer pole, which float holds precisely however near the pole is. */
struct density_row {
    real versine, height; /* at the row's northern edge, and from there to its southern */
    real scale;           /* density of a cell of width 1 of DISTRIBUTION_WHOLE */
    int south;            /* the versine is that of the angle to the nadir */
};

struct density {
    real u0, v0, u_size, v_size;
    real cell_u, columns_of_u, rows_of_v; /* width of a cell; cells in 1 of u and of v */
    struct distribution cells;
    struct density_row *rows; /* [cells.rows] */
};

/* A direction that was chosen. */
struct density_choice {
    real u; /* not wrapped */
    real versine;
    int south;
    real pdf; /* solid angle, times the share that density_finish got */
};

/* An empty grid over the window. Then call density_set_row for each row, with the integral of the
 * importance over each cell, and density_finish. */
status density_init(struct density *d, double u0, double v0, double u_size, double v_size, uint32_t columns,
                    uint32_t rows, struct error *err) MUST_CHECK;
void density_set_row(struct density *d, uint32_t row, const double *weights);
/* 0 if all of it is 0. Otherwise density_share must follow: the odds of choosing from this density. */
int density_finish(struct density *d);
void density_share(struct density *d, double share);
void density_release(struct density *d);
size_t density_bytes(const struct density *d);

/* Solid angle of a cell of that row. */
double density_cell_area(const struct density *d, uint32_t row);

/* a, b in [0, 1). */
static inline void density_choose(const struct density *d, real a, real b, struct density_choice *out)
{
    struct distribution_cell cell;
    const struct density_row *row;

    distribution_choose(&d->cells, a, b, &cell);
    row = &d->rows[cell.row];
    out->u = d->u0 + d->cell_u * ((real)(int32_t)cell.column + cell.column_fraction);
    out->versine = row->versine + row->height * cell.row_fraction;
    out->south = row->south;
    out->pdf = row->scale * (real)(int32_t)cell.width;
}

/* Position in the window, from 0 on; not below u_size outside of it. */
static inline real density_offset(const struct density *d, real u)
{
    real x = u - d->u0;

    return x < 0 ? x + 1 : x;
}

/* Density of density_choose times the share; 0 outside of the window. 0 <= u < 1, 0 <= v <= 1. */
static inline real density_at(const struct density *d, real u, real v)
{
    real x = density_offset(d, u), y = v - d->v0;
    uint32_t column, row;

    if (x >= d->u_size || y < 0 || y > d->v_size)
        return 0;
    column = (uint32_t)(int32_t)(x * d->columns_of_u);
    row = (uint32_t)(int32_t)(y * d->rows_of_v);
    column = column < d->cells.columns ? column : d->cells.columns - 1;
    row = row < d->cells.rows ? row : d->cells.rows - 1;
    return d->rows[row].scale * (real)(int32_t)distribution_width(&d->cells, row, column);
}
