#include "worker/render/light/environment/density.h"

#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"

static double versine_pi(double v)
{
    double half = det_sin_d(PI_D / 2 * v);

    return 2 * half * half;
}

status density_init(struct density *d, double u0, double v0, double u_size, double v_size, uint32_t columns,
                    uint32_t rows, struct error *err)
{
    memset(d, 0, sizeof *d);
    d->u0 = (real)u0;
    d->v0 = (real)v0;
    d->u_size = (real)u_size;
    d->v_size = (real)v_size;
    d->cell_u = (real)(u_size / columns);
    d->columns_of_u = (real)(columns / u_size);
    d->rows_of_v = (real)(rows / v_size);
    TRY(distribution_init(&d->cells, rows, columns, err));
    d->rows = mem_calloc(rows, sizeof *d->rows);
    if (!d->rows) {
        density_release(d);
        return error_no_memory(err, "the environment's importance table");
    }
    for (uint32_t i = 0; i < rows; i++) {
        struct density_row *row = &d->rows[i];
        double north = v0 + v_size * i / rows, south = v0 + v_size * (i + 1) / rows;

        row->south = north + south > 1;
        row->versine = (real)versine_pi(row->south ? 1 - north : north);
        row->height = (real)(versine_pi(row->south ? 1 - south : south)) - row->versine;
    }
    return STATUS_OK;
}

double density_cell_area(const struct density *d, uint32_t row)
{
    return fabs((double)d->rows[row].height) * 2 * PI_D * (double)d->cell_u;
}

void density_set_row(struct density *d, uint32_t row, const double *weights)
{
    distribution_set_row(&d->cells, row, weights);
}

int density_finish(struct density *d) { return distribution_finish(&d->cells); }

void density_share(struct density *d, double share)
{
    for (uint32_t row = 0; row < d->cells.rows; row++)
        d->rows[row].scale = (real)(share * (double)distribution_row_odds(&d->cells, row) /
                                    (DISTRIBUTION_WHOLE * density_cell_area(d, row)));
}

void density_release(struct density *d)
{
    distribution_release(&d->cells);
    mem_free(d->rows);
    memset(d, 0, sizeof *d);
}

size_t density_bytes(const struct density *d)
{
    return d->cells.rows == 0 ? 0 : distribution_bytes(&d->cells) + d->cells.rows * sizeof *d->rows;
}
