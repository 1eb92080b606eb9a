#include "worker/render/light/density.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"

/* cos(pi v), its distance from 1 or -1 precise at the poles. */
static double edge_cosine(double v)
{
    double half = (double)real_sin((real)(PI_D / 2 * (v < 0.5 ? v : 1 - v)));
    double cosine = 1 - 2 * half * half;

    return v < 0.5 ? cosine : -cosine;
}

status density_init(struct density *d, double u0, double v0, double u_size, double v_size,
                    uint32_t columns, uint32_t rows, struct error *err)
{
    status s;

    memset(d, 0, sizeof *d);
    d->u0 = u0;
    d->v0 = v0;
    d->u_size = u_size;
    d->v_size = v_size;
    s = distribution_init(&d->cells, rows, columns, err);
    if (s != STATUS_OK)
        return s;
    d->row_cosine = mem_calloc((size_t)rows + 1, sizeof *d->row_cosine);
    d->inverse_area = mem_calloc(rows, sizeof *d->inverse_area);
    if (!d->row_cosine || !d->inverse_area) {
        density_release(d);
        return error_no_memory(err, "the environment's importance table");
    }
    for (uint32_t row = 0; row <= rows; row++)
        d->row_cosine[row] = edge_cosine(v0 + v_size * row / rows);
    for (uint32_t row = 0; row < rows; row++)
        d->inverse_area[row] = 1 / density_cell_area(d, row);
    return STATUS_OK;
}

double density_cell_area(const struct density *d, uint32_t row)
{
    return (d->row_cosine[row] - d->row_cosine[row + 1]) * 2 * PI_D * d->u_size /
           d->cells.columns;
}

void density_set_row(struct density *d, uint32_t row, const double *weights)
{
    distribution_set_row(&d->cells, row, weights);
}

int density_finish(struct density *d)
{
    return distribution_finish(&d->cells);
}

void density_release(struct density *d)
{
    distribution_release(&d->cells);
    mem_free(d->row_cosine);
    mem_free(d->inverse_area);
    memset(d, 0, sizeof *d);
}

size_t density_bytes(const struct density *d)
{
    return d->cells.rows == 0 ? 0
                              : distribution_bytes(&d->cells) +
                                    (2 * (size_t)d->cells.rows + 1) * sizeof(double);
}

double density_sample(const struct density *d, real a, real b, double *u, double *cosine)
{
    struct distribution_cell cell;

    distribution_choose(&d->cells, a, b, &cell);
    *u = d->u0 + d->u_size * ((cell.column + cell.column_fraction) / d->cells.columns);
    *cosine = d->row_cosine[cell.row] +
              (d->row_cosine[cell.row + 1] - d->row_cosine[cell.row]) * cell.row_fraction;
    return cell.odds * d->inverse_area[cell.row];
}

double density_at(const struct density *d, real u, real v)
{
    double x = (double)u - d->u0, y = ((double)v - d->v0) / d->v_size;
    uint32_t column, row;

    x = (x - floor(x)) / d->u_size;
    if (d->cells.rows == 0 || x >= 1 || y < 0 || y > 1)
        return 0;
    column = (uint32_t)(x * d->cells.columns);
    row = (uint32_t)(y * d->cells.rows);
    column = column < d->cells.columns ? column : d->cells.columns - 1;
    row = row < d->cells.rows ? row : d->cells.rows - 1;
    return distribution_odds(&d->cells, row, column) * d->inverse_area[row];
}
