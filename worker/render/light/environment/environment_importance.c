/* environment_importance: how samples are distributed over a map: a grid, and windows around suns
 * and lamps (environment.h). */
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/light/environment/environment_map.h"

/* The finest grid on which the importance is computed has two cells per texel in each direction,
 * since a single bright texel fills no cell evenly. It has more if the map is smaller than this,
 * and one if the map is larger than PARTS_COLUMNS_MAX. */
enum { GRID_COLUMNS_MIN = 256, GRID_ROWS_MIN = 128, PARTS_COLUMNS_MAX = 2048 };
/* A map whose importance is less than this share of its light counts as constant. */
#define COMPENSATED_MIN 0.01
/* A coarser grid is good enough if it raises the second moment of the light's estimate by at most this. */
#define GRID_LOSS_MAX 1.02
/* A window is around a cell and within this angle of it, holds at least this share of all
 * importance, and has this many cells a side. */
enum { WINDOW_CELLS_MAX = 256 };
#define WINDOW_RADIUS_DEG 1.5
#define WINDOW_SHARE_MIN 0.02

/* ---- the finest grid ----------------------------------------------------------------------- */

/* Importance on the finest grid, relative to the brightest texel. */
struct importance {
    const struct environment *env;
    uint32_t columns, rows; /* of the grid */
    double scale, offset;   /* importance = max(0, luminance * scale - offset) */
    real *values;           /* [rows][columns] means over the cells */
    double total;           /* integral over the sphere */
};

static double cosine_pi(double v)
{
    double half = (double)real_sin((real)(PI_D / 2 * (v < 0.5 ? v : 1 - v)));

    return v < 0.5 ? 1 - 2 * half * half : 2 * half * half - 1;
}

/* Solid angle of a cell in a row of a grid. */
static double grid_area(uint32_t row, uint32_t columns, uint32_t rows)
{
    return 2 * PI_D / columns * (cosine_pi((double)row / rows) - cosine_pi((double)(row + 1) / rows));
}

/* Luminances of a row of texels; rows -1 and height are across the poles. */
static void texel_row(const struct importance *m, int64_t row, double *out)
{
    const struct environment *env = m->env;

    for (uint32_t x = 0; x < env->width; x++)
        out[x] = m->scale * luminance(row < 0              ? opposite(env, x, 0)
                                      : row >= env->height ? opposite(env, x, env->height - 1)
                                                           : texel(env, x, (uint32_t)row));
}

/* Weights of a texel's neighbours and of itself in the mean over part `i` of `parts` of it. Exact
 * for one part or an even number: a bilinear map is linear on each half of a texel. */
static void part_weights(uint32_t i, uint32_t parts, double w[3])
{
    double t = (i + 0.5) / parts - 0.5;

    w[0] = parts == 1 ? 0.125 : t < 0 ? -t : 0;
    w[2] = parts == 1 ? 0.125 : t < 0 ? 0 : t;
    w[1] = 1 - w[0] - w[2];
}

/* Fill in values and total; `rows3`: three rows of texels' luminances. */
static void importance_measure(struct importance *m, double *rows3)
{
    uint32_t width = m->env->width, height = m->env->height;
    uint32_t parts_x = m->columns / width, parts_y = m->rows / height;
    double *row[3] = {rows3, rows3 + width, rows3 + 2 * (size_t)width};

    m->total = 0;
    texel_row(m, -1, row[1]);
    texel_row(m, 0, row[2]);
    for (uint32_t y = 0; y < height; y++) {
        double *oldest = row[0];

        row[0] = row[1];
        row[1] = row[2];
        row[2] = oldest;
        texel_row(m, (int64_t)y + 1, row[2]);
        for (uint32_t j = 0; j < parts_y; j++) {
            uint32_t grid_row = y * parts_y + j;
            real *out = m->values + (size_t)grid_row * m->columns;
            double wy[3], sum = 0;

            part_weights(j, parts_y, wy);
            for (uint32_t x = 0; x < width; x++) {
                uint32_t around[3] = {x > 0 ? x - 1 : width - 1, x, x + 1 < width ? x + 1 : 0};
                double column[3];

                for (int k = 0; k < 3; k++)
                    column[k] = wy[0] * row[0][around[k]] + wy[1] * row[1][around[k]] + wy[2] * row[2][around[k]];
                for (uint32_t i = 0; i < parts_x; i++) {
                    double wx[3], value;

                    part_weights(i, parts_x, wx);
                    value = wx[0] * column[0] + wx[1] * column[1] + wx[2] * column[2] - m->offset;
                    *out = value > 0 ? (real)value : 0;
                    sum += (double)*out++;
                }
            }
            m->total += sum * grid_area(grid_row, m->columns, m->rows);
        }
    }
}

/* ---- windows ------------------------------------------------------------------------------- */

/* A window around a cell of the grid. */
struct window {
    uint32_t column, row, columns, rows; /* column: may cross the seam */
};

static double window_total(const struct importance *m, const struct window *w)
{
    double total = 0;

    for (uint32_t y = w->row; y < w->row + w->rows; y++) {
        double sum = 0;

        for (uint32_t x = 0; x < w->columns; x++)
            sum += (double)m->values[(size_t)y * m->columns + (w->column + x) % m->columns];
        total += sum * grid_area(y, m->columns, m->rows);
    }
    return total;
}

/* The brightest cell's window. 0: everything is dark, or the cell is too near to a pole. */
static int window_find(const struct importance *m, struct window *out)
{
    size_t best = 0, count = (size_t)m->columns * m->rows;
    uint32_t column, row, reach_x, reach_y;
    double sine;

    for (size_t i = 1; i < count; i++)
        if (m->values[i] > m->values[best])
            best = i;
    if (!(m->values[best] > 0))
        return 0;
    column = (uint32_t)(best % m->columns);
    row = (uint32_t)(best / m->columns);
    sine = sqrt(1 - cosine_pi((row + 0.5) / m->rows) * cosine_pi((row + 0.5) / m->rows));
    reach_y = (uint32_t)(WINDOW_RADIUS_DEG / 180 * m->rows) + 2;
    if (!(WINDOW_RADIUS_DEG / 360 / sine < 0.1))
        return 0;
    reach_x = (uint32_t)(WINDOW_RADIUS_DEG / 360 / sine * m->columns) + 2;
    out->row = row > reach_y ? row - reach_y : 0;
    out->rows = (row + reach_y < m->rows ? row + reach_y + 1 : m->rows) - out->row;
    out->columns = 2 * reach_x + 1;
    out->column = (column + m->columns - reach_x) % m->columns;
    return out->columns <= WINDOW_CELLS_MAX && out->rows <= WINDOW_CELLS_MAX;
}

/* Importance at a point of the map. */
static double importance_at(const struct importance *m, double u, double v)
{
    struct lat_long at = {.u = (real)(u - floor(u)), .distance = (real)(v < 0.5 ? v : 1 - v), .south = v >= 0.5};
    double value;

    at.u = at.u < 1 ? at.u : 0;
    value = luminance(environment_read(m->env, &at)) * m->scale - m->offset;
    return value > 0 ? value : 0;
}

/* Remove the window from the grid and make it a separate density. */
static status window_cut(struct importance *m, const struct window *w, struct density *out, struct error *err)
{
    uint32_t columns = w->columns, rows = w->rows;
    double weights[WINDOW_CELLS_MAX];

    columns = 4 * columns < WINDOW_CELLS_MAX ? 4 * columns : WINDOW_CELLS_MAX;
    rows = 4 * rows < WINDOW_CELLS_MAX ? 4 * rows : WINDOW_CELLS_MAX;
    TRY(density_init(out, (double)w->column / m->columns, (double)w->row / m->rows, (double)w->columns / m->columns, (double)w->rows / m->rows, columns, rows, err));
    for (uint32_t y = 0; y < rows; y++) {
        for (uint32_t x = 0; x < columns; x++) {
            weights[x] = 0;
            for (int k = 0; k < 4; k++) /* midpoints of a cell's quarters */
                weights[x] += importance_at(m, (double)out->u0 + (double)out->u_size * (x + (k % 2 + 0.5) / 2) / columns,
                                            (double)out->v0 + (double)out->v_size * (y + (k / 2 + 0.5) / 2) / rows);
            weights[x] *= density_cell_area(out, y) / 4;
        }
        density_set_row(out, y, weights);
    }
    for (uint32_t y = w->row; y < w->row + w->rows; y++)
        for (uint32_t x = 0; x < w->columns; x++)
            m->values[(size_t)y * m->columns + (w->column + x) % m->columns] = 0;
    return STATUS_OK;
}

/* ---- the stored grid ------------------------------------------------------------------------ */

/* Sums over the grid's cells that fall into one row of a coarser one: of importance, of its square, of solid angle. */
struct coarse {
    uint32_t columns, rows;
    double *sum, *square, *area; /* [columns] each */
};

static void coarse_row(const struct importance *m, const struct coarse *c, uint32_t row)
{
    uint32_t begin = (uint32_t)((uint64_t)row * m->rows / c->rows);
    uint32_t end = (uint32_t)((uint64_t)(row + 1) * m->rows / c->rows);

    for (uint32_t i = 0; i < c->columns; i++)
        c->sum[i] = c->square[i] = c->area[i] = 0;
    for (uint32_t y = begin; y < end; y++) {
        double area = grid_area(y, m->columns, m->rows);

        for (uint32_t x = 0; x < m->columns; x++) {
            uint32_t at = (uint32_t)((uint64_t)x * c->columns / m->columns);
            double value = (double)m->values[(size_t)y * m->columns + x];

            c->sum[at] += value * area;
            c->square[at] += value * value * area;
            c->area[at] += area;
        }
    }
}

/* Second moment of the light's estimate with the coarser grid over that with the finest. */
static double coarse_loss(const struct importance *m, const struct coarse *c)
{
    double moment = 0, total = 0;

    for (uint32_t row = 0; row < c->rows; row++) {
        coarse_row(m, c, row);
        for (uint32_t i = 0; i < c->columns; i++) {
            total += c->sum[i];
            if (c->sum[i] > 0)
                moment += c->square[i] * c->area[i] / c->sum[i];
        }
    }
    return total > 0 ? moment / total : 1;
}

/* The coarsest grid that is good enough. */
static status grid_build(const struct importance *m, struct density *out, struct error *err)
{
    struct coarse c = {0};
    double *sums = mem_alloc_array(m->columns, 3 * sizeof *sums);
    status s;

    NEED(sums, err, "the environment's importance table");
    c.sum = sums;
    c.square = sums + m->columns;
    c.area = sums + 2 * (size_t)m->columns;
    for (c.columns = GRID_COLUMNS_MIN;; c.columns *= 2) {
        c.rows = c.columns / 2;
        c.rows = c.rows < m->rows ? c.rows : m->rows;
        if (c.columns >= m->columns || c.columns >= DISTRIBUTION_SIDE_MAX) {
            c.columns = m->columns < DISTRIBUTION_SIDE_MAX ? m->columns : DISTRIBUTION_SIDE_MAX;
            c.rows = m->rows < DISTRIBUTION_SIDE_MAX ? m->rows : DISTRIBUTION_SIDE_MAX;
            break;
        }
        if (coarse_loss(m, &c) <= GRID_LOSS_MAX)
            break;
    }
    s = density_init(out, 0, 0, 1, 1, c.columns, c.rows, err);
    for (uint32_t row = 0; s == STATUS_OK && row < c.rows; row++) {
        coarse_row(m, &c, row);
        /* Cells hold unequal numbers of texels if the map's size is no multiple. */
        for (uint32_t i = 0; i < c.columns; i++)
            c.sum[i] *= c.area[i] > 0 ? density_cell_area(out, row) / c.area[i] : 0;
        density_set_row(out, row, c.sum);
    }
    mem_free(sums);
    return s;
}

/* All parts, each with its share. */
static status parts_build(struct environment *env, struct importance *m, struct error *err)
{
    double total[WINDOWS_MAX + 1], sum = 0, start = 0;
    struct window window;
    uint32_t count = 1;

    while (count <= WINDOWS_MAX && m->columns > 2 * GRID_COLUMNS_MIN && window_find(m, &window) &&
           window_total(m, &window) > WINDOW_SHARE_MIN * m->total) {
        TRY(window_cut(m, &window, &env->parts[count], err));
        count++;
    }
    TRY(grid_build(m, &env->parts[0], err));
    for (uint32_t i = 0; i < count; i++) {
        (void)density_finish(&env->parts[i]);
        total[i] = env->parts[i].cells.total;
        sum += total[i];
    }
    if (!(sum > 0)) {
        env->mode = MODE_UNIFORM;
        return STATUS_OK;
    }
    /* Drop parts without importance. */
    for (uint32_t i = 0; i < count; i++) {
        if (!(total[i] > 0)) {
            density_release(&env->parts[i]);
            continue;
        }
        if (i != env->part_count) {
            env->parts[env->part_count] = env->parts[i];
            memset(&env->parts[i], 0, sizeof env->parts[i]);
        }
        env->part_start[env->part_count++] = (real)(start / sum);
        start += total[i];
    }
    env->part_start[env->part_count] = 1;
    for (uint32_t i = 0; i < env->part_count; i++)
        density_share(&env->parts[i], (double)env->part_start[i + 1] - (double)env->part_start[i]);
    return STATUS_OK;
}

/* The finest grid, not yet measured; `rows3`: as importance_measure needs it. Release both. */
static status importance_init(struct importance *m, const struct environment *env, double **rows3, struct error *err)
{
    size_t cells;

    *m = (struct importance){.env = env, .columns = env->width, .rows = env->height, .scale = 1 / (double)env->largest};
    for (uint32_t parts = 2; m->columns < GRID_COLUMNS_MIN || (parts == 2 && m->columns <= PARTS_COLUMNS_MAX); parts += 2)
        m->columns = env->width * parts;
    for (uint32_t parts = 2; m->rows < GRID_ROWS_MIN || (parts == 2 && m->rows <= PARTS_COLUMNS_MAX / 2); parts += 2)
        m->rows = env->height * parts;
    *rows3 = mem_alloc_array(env->width, 3 * sizeof **rows3);
    m->values = mem_size_mul(m->columns, m->rows, &cells) ? mem_calloc(cells, sizeof *m->values) : NULL;
    if (*rows3 && m->values)
        return STATUS_OK;
    mem_free(m->values);
    mem_free(*rows3);
    m->values = NULL;
    *rows3 = NULL;
    return error_no_memory(err, "the environment's importance table");
}

status environment_importance_build(struct environment *env, struct error *err)
{
    struct importance m;
    double *rows3;
    status s;

    TRY(importance_init(&m, env, &rows3, err));
    m.offset = env->uniform_share > 0 ? 0 : env->mean_luminance * m.scale;
    importance_measure(&m, rows3);
    if (!(m.total > COMPENSATED_MIN * 4 * PI_D * m.offset)) {
        m.offset = 0;
        importance_measure(&m, rows3);
    }
    s = parts_build(env, &m, err);
    mem_free(m.values);
    mem_free(rows3);
    return s;
}

/* ---- cells by luminance ----------------------------------------------------------------------- */

/* What a window holds is not the grid's. */
static void window_clear(struct importance *m, const struct density *window)
{
    const double columns = m->columns, rows = m->rows;
    const uint32_t column = (uint32_t)((double)window->u0 * columns + 0.5), row = (uint32_t)((double)window->v0 * rows + 0.5);
    const uint32_t across = (uint32_t)((double)window->u_size * columns + 0.5);
    const uint32_t end = row + (uint32_t)((double)window->v_size * rows + 0.5);

    for (uint32_t y = row; y < end && y < m->rows; y++)
        for (uint32_t x = 0; x < across; x++)
            m->values[(size_t)y * m->columns + (column + x) % m->columns] = 0;
}

/* Finer cells a side of each cell. */
enum { CELL_PARTS_MAX = 16 };

/* A cell's part holds a column and a row of the finest grid at least. */
static uint32_t cell_parts(const struct importance *m, uint32_t columns, uint32_t rows)
{
    uint32_t parts = CELL_PARTS_MAX;

    while (parts > 1 && (parts * columns > m->columns || parts * rows > m->rows))
        parts /= 2;
    return parts;
}

static status cells_init(struct density *cells, uint32_t columns, uint32_t rows, uint32_t parts, struct error *err)
{
    for (uint32_t i = 0; i < columns * rows; i++)
        TRY(density_init(&cells[i], (double)(i % columns) / columns, (double)(i / columns) / rows, 1.0 / columns,
                         1.0 / rows, parts, parts, err));
    return STATUS_OK;
}

/* From the measured grid. `shape`: parts x cells. */
static void cells_fill(const struct importance *m, const struct coarse *shape, uint32_t parts, struct density *cells)
{
    const uint32_t columns = shape->columns / parts;

    for (uint32_t y = 0; y < shape->rows; y++) {
        coarse_row(m, shape, y);
        for (uint32_t i = 0; i < columns; i++) {
            struct density *cell = &cells[y / parts * columns + i];
            double *sum = shape->sum + (size_t)i * parts;

            for (uint32_t x = 0; x < parts; x++)
                sum[x] *= density_cell_area(cell, y % parts) / shape->area[(size_t)i * parts + x];
            density_set_row(cell, y % parts, sum);
        }
    }
}

static status cells_of_map(const struct environment *env, uint32_t columns, uint32_t rows, struct density *cells,
                           struct error *err)
{
    struct coarse shape = {0};
    struct importance m;
    double *rows3, *sums = NULL;
    uint32_t parts;
    status s;

    TRY(importance_init(&m, env, &rows3, err));
    parts = cell_parts(&m, columns, rows);
    shape.columns = columns * parts;
    shape.rows = rows * parts;
    s = cells_init(cells, columns, rows, parts, err);
    if (s == STATUS_OK) {
        sums = mem_alloc_array(shape.columns, 3 * sizeof *sums);
        s = sums ? STATUS_OK : error_no_memory(err, "the environment's importance table");
    }
    if (s == STATUS_OK) {
        shape.sum = sums;
        shape.square = sums + shape.columns;
        shape.area = sums + 2 * (size_t)shape.columns;
        importance_measure(&m, rows3);
        for (uint32_t i = environment_first_window(env); i < env->part_count; i++)
            window_clear(&m, &env->parts[i]);
        cells_fill(&m, &shape, parts, cells);
    }
    mem_free(sums);
    mem_free(m.values);
    mem_free(rows3);
    return s;
}

static status cells_of_constant(uint32_t columns, uint32_t rows, struct density *cells, struct error *err)
{
    TRY(cells_init(cells, columns, rows, 1, err));
    for (uint32_t i = 0; i < columns * rows; i++) {
        const double area = density_cell_area(&cells[i], 0);

        density_set_row(&cells[i], 0, &area);
    }
    return STATUS_OK;
}

status environment_cells_build(const struct environment *env, uint32_t columns, uint32_t rows, struct density *cells,
                               struct error *err)
{
    if (env->width == 0)
        TRY(cells_of_constant(columns, rows, cells, err));
    else
        TRY(cells_of_map(env, columns, rows, cells, err));
    for (uint32_t i = 0; i < columns * rows; i++)
        if (density_finish(&cells[i]))
            density_share(&cells[i], 1);
    return STATUS_OK;
}
