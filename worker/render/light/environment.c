/* The map is cut into cells between texel centres: column i from centre i to centre i + 1
 * (periodic), strip k from row k - 1 to row k, strips 0 and H from a row to its pole and half
 * as high. In a cell, radiance is bilinear between four nodes. Going straight over the pole
 * from row 0 at u one meets row 0 at u + 1/2, so the radiance at the pole, seen from column u,
 * is the mean of the two.
 */
#include "worker/render/light/environment.h"

#include <float.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "common/scene/scene.h"
#include "worker/render/light/density.h"

/* The finest grid on which the importance is looked at has two cells a texel each way, since a
 * single bright texel fills no cell evenly; it has more where the map is smaller than this, and
 * one where the map is larger than PARTS_COLUMNS_MAX. */
enum { GRID_COLUMNS_MIN = 256, GRID_ROWS_MIN = 128, PARTS_COLUMNS_MAX = 2048 };
/* A map whose importance is less than this share of its light counts as constant. */
#define COMPENSATED_MIN 0.01
/* A coarser grid is good enough if it raises the second moment of the light's estimate by no
 * more than this. */
#define GRID_LOSS_MAX 1.02
/* Windows: this many at most, around the brightest cells, within this angle of them, each with
 * at least this share of all importance; and the number of cells a side. */
enum { WINDOWS_MAX = 8, WINDOW_CELLS_MAX = 256 };
#define WINDOW_RADIUS_DEG 1.5
#define WINDOW_SHARE_MIN 0.02

/* Where nothing else finds the light that importance sampling leaves out (cells that are too dark for
 * the tables' resolution), this share of the samples is uniform. */
#define UNIFORM_SHARE_ALONE 0.0625f

enum mode { MODE_NONE, MODE_UNIFORM, MODE_IMPORTANCE };

struct environment {
    uint32_t width, height;   /* 0: constant */
    struct image map;         /* the factor is multiplied in */
    struct vec3 constant;
    float to_map[3][3];       /* from the world, the job's rotation included */
    enum mode mode;
    int black;
    double mean_luminance;
    struct density parts[WINDOWS_MAX + 1]; /* the grid, then the windows; MODE_IMPORTANCE only */
    float part_start[WINDOWS_MAX + 2];     /* where each one's share of the choices begins */
    uint32_t part_count;
    float uniform_share;      /* of the choices, over the whole sphere; MODE_IMPORTANCE only */
};

static double luminance(struct vec3 c)
{
    /* In double: the weights of the largest floats must not overflow when summed. */
    return 0.212656 * (double)c.x + 0.715158 * (double)c.y + 0.072186 * (double)c.z;
}

/* sin(pi v) for 0 <= v <= 1, precise at both ends. */
static double sine_pi(double v)
{
    return (double)det_sin((float)(PI_D * (v < 0.5 ? v : 1.0 - v)));
}

/* ---- nodes and cells ---------------------------------------------------------------------- */

static inline struct vec3 texel(const struct environment *env, uint32_t column, uint32_t row)
{
    const float *p = env->map.pixels + 3 * ((size_t)row * env->width + column);

    return (struct vec3){p[0], p[1], p[2]};
}

/* A texel's channels side by side, for arithmetic on all of them at once. */
typedef float lanes __attribute__((vector_size(16)));

static inline lanes texel_lanes(const struct environment *env, uint32_t column, uint32_t row)
{
    const float *p = env->map.pixels + 3 * ((size_t)row * env->width + column);

    return (lanes){p[0], p[1], p[2], 0};
}

static inline lanes lanes_lerp(lanes a, lanes b, float t)
{
    return a * (1.0f - t) + b * t;
}

/* The texel of the same row half-way round; between two columns where the width is odd. */
static struct vec3 opposite(const struct environment *env, uint32_t column, uint32_t row)
{
    uint32_t width = env->width, a = (column + width / 2) % width;

    if (width % 2 == 0)
        return texel(env, a, row);
    return vec3_lerp(texel(env, a, row), texel(env, (a + 1) % width, row), 0.5f);
}

/* Which cell and where in it: what a direction is turned into. */
struct place {
    uint32_t column;  /* cell column, 0..width-1 */
    uint32_t strip;   /* counted from the nearer pole; 0 is the pole's */
    int south;        /* the nearer pole is the nadir */
    float x, y;       /* 0..1 from column to column, and from the near edge to the far one */
};

/* Rare: the edge of a pole's strip on the pole's side. */
static __attribute__((noinline)) lanes pole_edge(const struct environment *env, uint32_t column,
                                                 uint32_t next, uint32_t row, float x)
{
    struct vec3 near[2] = {vec3_lerp(texel(env, column, row), opposite(env, column, row), 0.5f),
                           vec3_lerp(texel(env, next, row), opposite(env, next, row), 0.5f)};
    struct vec3 edge = vec3_lerp(near[0], near[1], x);

    return (lanes){edge.x, edge.y, edge.z, 0};
}

/* A cell is seen from the nearer pole: its near edge is on the pole's side. */
static inline struct vec3 cell_radiance(const struct environment *env, const struct place *at)
{
    uint32_t last = env->height - 1, next = at->column + 1 < env->width ? at->column + 1 : 0;
    uint32_t far_step = at->strip < last ? at->strip : last;
    uint32_t far_row = at->south ? last - far_step : far_step;
    lanes far = lanes_lerp(texel_lanes(env, at->column, far_row), texel_lanes(env, next, far_row),
                           at->x);
    lanes near, mean;

    if (at->strip > 0) {
        uint32_t near_row = at->south ? far_row + 1 : far_row - 1;

        near = lanes_lerp(texel_lanes(env, at->column, near_row),
                          texel_lanes(env, next, near_row), at->x);
    } else {
        near = pole_edge(env, at->column, next, far_row, at->x);
    }
    mean = lanes_lerp(near, far, at->y);
    return (struct vec3){mean[0], mean[1], mean[2]};
}

/* What a direction means in the map. */
struct angles {
    float u;        /* 0..1 */
    float distance; /* from the nearer pole over pi, 0..1/2 */
    int south;      /* the nearer pole is the nadir */
};

static inline void place_of(const struct environment *env, const struct angles *angles,
                            struct place *at)
{
    float x = angles->u * (float)env->width - 0.5f, rows = angles->distance * (float)env->height;
    int32_t column = x < 0 ? -1 : (int32_t)x;

    at->x = x - (float)column;
    at->column = column < 0 ? env->width - 1 : (uint32_t)column;
    at->south = angles->south;
    if (rows < 0.5f) {
        at->strip = 0;
        at->y = 2.0f * rows;
        return;
    }
    rows -= 0.5f;
    at->strip = (uint32_t)rows + 1;
    at->y = rows - (float)(at->strip - 1);
    if (env->height == 1) { /* the equator is the far edge of both pole strips */
        at->strip = 0;
        at->y = 1.0f;
    }
}

/* ---- directions --------------------------------------------------------------------------- */

static inline struct vec3 to_map(const struct environment *env, struct vec3 d)
{
    const float(*m)[3] = env->to_map;

    return (struct vec3){m[0][0] * d.x + m[0][1] * d.y + m[0][2] * d.z,
                         m[1][0] * d.x + m[1][1] * d.y + m[1][2] * d.z,
                         m[2][0] * d.x + m[2][1] * d.y + m[2][2] * d.z};
}

static inline struct vec3 from_map(const struct environment *env, struct vec3 d)
{
    const float(*m)[3] = env->to_map;

    return (struct vec3){m[0][0] * d.x + m[1][0] * d.y + m[2][0] * d.z,
                         m[0][1] * d.x + m[1][1] * d.y + m[2][1] * d.z,
                         m[0][2] * d.x + m[1][2] * d.y + m[2][2] * d.z};
}

/* 0 if it is no direction. */
static inline int angles_of(const struct environment *env, struct vec3 d, struct angles *out)
{
    float radius2, length2, u;

    d = to_map(env, d);
    radius2 = d.x * d.x + d.z * d.z;
    length2 = radius2 + d.y * d.y;
    if (!(length2 > 0 && length2 < INFINITY))
        return 0;
    /* Not acos(y), which knows nothing of angles below 3e-4 from a pole. */
    out->distance = det_atan2(sqrtf(radius2), fabsf(d.y)) * INV_PI_F;
    out->south = d.y < 0;
    u = 0.5f + det_atan2(d.z, d.x) * INV_2PI_F;
    out->u = u >= 1.0f ? u - 1.0f : u;
    return 1;
}

static struct vec3 radiance_at(const struct environment *env, const struct angles *angles)
{
    struct place at;

    place_of(env, angles, &at);
    return cell_radiance(env, &at);
}

static float importance_pdf(const struct environment *env, const struct angles *angles)
{
    float v = angles->south ? 1 - angles->distance : angles->distance;
    double pdf = 0;

    for (uint32_t i = 0; i < env->part_count; i++)
        pdf += (double)(env->part_start[i + 1] - env->part_start[i]) *
               density_at(&env->parts[i], angles->u, v);
    if (env->uniform_share > 0)
        pdf += ((double)(0.25f * INV_PI_F) - pdf) * (double)env->uniform_share;
    return pdf < (double)FLT_MAX ? (float)pdf : FLT_MAX;
}

struct vec3 environment_radiance_pdf(const struct environment *env, struct vec3 direction,
                                     float *pdf)
{
    struct angles angles;

    *pdf = 0;
    if (!angles_of(env, direction, &angles))
        return vec3_splat(0);
    if (env->mode == MODE_UNIFORM)
        *pdf = 0.25f * INV_PI_F;
    else if (env->mode == MODE_IMPORTANCE)
        *pdf = importance_pdf(env, &angles);
    return env->width == 0 || env->black ? env->constant : radiance_at(env, &angles);
}

struct vec3 environment_radiance(const struct environment *env, struct vec3 direction)
{
    struct angles angles;

    if (!angles_of(env, direction, &angles))
        return vec3_splat(0);
    return env->width == 0 || env->black ? env->constant : radiance_at(env, &angles);
}

float environment_pdf(const struct environment *env, struct vec3 direction)
{
    float pdf;

    (void)environment_radiance_pdf(env, direction, &pdf);
    return pdf;
}

/* ---- sampling ----------------------------------------------------------------------------- */

static int sample_map(const struct environment *env, float u, float v, struct vec3 *direction,
                      struct vec3 *radiance, float *pdf)
{
    struct angles angles;
    uint32_t part = 0;
    double map_u, cosine, versine, density, sine;
    float share, sin_phi, cos_phi;

    while (part + 1 < env->part_count && u >= env->part_start[part + 1])
        part++;
    share = env->part_start[part + 1] - env->part_start[part];
    u = float_min((u - env->part_start[part]) / share, ONE_MINUS_EPSILON);
    density = density_sample(&env->parts[part], u, v, &map_u, &cosine);
    map_u -= floor(map_u);
    versine = 1 - fabs(cosine);
    sine = sqrt(versine * (2 - versine));
    det_sincos((float)(2 * PI_D * (map_u - 0.5)), &sin_phi, &cos_phi);
    angles.u = (float)map_u < 1 ? (float)map_u : 0;
    angles.south = cosine < 0;
    angles.distance = 2 * INV_PI_F * det_asin((float)sqrt(0.5 * versine));
    *direction = vec3_normalize(from_map(
        env, (struct vec3){(float)sine * cos_phi, (float)cosine, (float)sine * sin_phi}));
    *radiance = radiance_at(env, &angles);
    if (env->part_count == 1)
        *pdf = density < (double)FLT_MAX ? (float)density : FLT_MAX;
    else
        *pdf = importance_pdf(env, &angles);
    return *pdf > 0;
}

static struct vec3 sphere_direction(float u, float v)
{
    float y = 1.0f - 2.0f * v, radius = 2.0f * sqrtf(v * (1.0f - v)), sine, cosine;

    det_sincos(u * (2.0f * PI_F), &sine, &cosine);
    return vec3_make(radius * cosine, y, radius * sine);
}

/* Uniform for a share of the choices, else by the map. */
static __attribute__((noinline)) int sample_mixed(const struct environment *env, float u, float v,
                                                  struct vec3 *direction, struct vec3 *radiance,
                                                  float *pdf)
{
    float share = env->uniform_share;

    if (u < share)
        *direction = sphere_direction(float_min(u / share, ONE_MINUS_EPSILON), v);
    else if (!sample_map(env, float_min((u - share) / (1 - share), ONE_MINUS_EPSILON), v, direction,
                         radiance, pdf))
        return 0;
    *radiance = environment_radiance_pdf(env, *direction, pdf);
    return *pdf > 0;
}

int environment_sample(const struct environment *env, float u, float v, struct vec3 *direction,
                       struct vec3 *radiance, float *pdf)
{
    u = float_min(float_max(u, 0.0f), ONE_MINUS_EPSILON);
    v = float_min(float_max(v, 0.0f), ONE_MINUS_EPSILON);
    if (env->mode == MODE_IMPORTANCE)
        return env->uniform_share > 0 ? sample_mixed(env, u, v, direction, radiance, pdf)
                                      : sample_map(env, u, v, direction, radiance, pdf);
    *direction = vec3_make(0, 1, 0);
    *radiance = vec3_splat(0);
    *pdf = 0;
    if (env->mode == MODE_NONE)
        return 0;
    *direction = sphere_direction(u, v);
    *radiance = environment_radiance(env, *direction);
    *pdf = 0.25f * INV_PI_F;
    return 1;
}

/* ---- making: the importance --------------------------------------------------------------- */

/* Importance on the finest grid, relative to the brightest texel. */
struct importance {
    const struct environment *env;
    uint32_t columns, rows;  /* of the grid */
    double scale, offset;    /* importance = max(0, luminance * scale - offset) */
    float *values;           /* [rows][columns] means over the cells */
    double total;            /* integral over the sphere */
};

static double cosine_pi(double v)
{
    double half = (double)det_sin((float)(PI_D / 2 * (v < 0.5 ? v : 1 - v)));

    return v < 0.5 ? 1 - 2 * half * half : 2 * half * half - 1;
}

/* Solid angle of a cell in a row of a grid. */
static double grid_area(uint32_t row, uint32_t columns, uint32_t rows)
{
    return 2 * PI_D / columns *
           (cosine_pi((double)row / rows) - cosine_pi((double)(row + 1) / rows));
}

/* Luminances of a row of texels; rows -1 and height lie over the poles. */
static void texel_row(const struct importance *m, int64_t row, double *out)
{
    const struct environment *env = m->env;

    for (uint32_t x = 0; x < env->width; x++)
        out[x] = m->scale * luminance(row < 0 ? opposite(env, x, 0)
                                      : row >= env->height
                                          ? opposite(env, x, env->height - 1)
                                          : texel(env, x, (uint32_t)row));
}

/* Weights of a texel's neighbours and of itself in the mean over part `i` of `parts` of it,
 * exact for one part or an even number: a bilinear map is linear on each half of a texel. */
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
            float *out = m->values + (size_t)grid_row * m->columns;
            double wy[3], sum = 0;

            part_weights(j, parts_y, wy);
            for (uint32_t x = 0; x < width; x++) {
                uint32_t around[3] = {x > 0 ? x - 1 : width - 1, x, x + 1 < width ? x + 1 : 0};
                double column[3];

                for (int k = 0; k < 3; k++)
                    column[k] = wy[0] * row[0][around[k]] + wy[1] * row[1][around[k]] +
                                wy[2] * row[2][around[k]];
                for (uint32_t i = 0; i < parts_x; i++) {
                    double wx[3], value;

                    part_weights(i, parts_x, wx);
                    value = wx[0] * column[0] + wx[1] * column[1] + wx[2] * column[2] - m->offset;
                    *out = value > 0 ? (float)value : 0;
                    sum += (double)*out++;
                }
            }
            m->total += sum * grid_area(grid_row, m->columns, m->rows);
        }
    }
}

/* A window around a cell of the grid. */
struct window {
    uint32_t column, row, columns, rows; /* column: may run over the seam */
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

/* The brightest cell's window. 0: all is dark, or it stands too near to a pole. */
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
    struct angles angles = {.u = (float)(u - floor(u)),
                            .distance = (float)(v < 0.5 ? v : 1 - v), .south = v >= 0.5};
    double value;

    angles.u = angles.u < 1 ? angles.u : 0;
    value = luminance(radiance_at(m->env, &angles)) * m->scale - m->offset;
    return value > 0 ? value : 0;
}

/* Take the window out of the grid and make it a density of its own. */
static status window_cut(struct importance *m, const struct window *w, struct density *out,
                         struct error *err)
{
    uint32_t columns = w->columns, rows = w->rows;
    double weights[WINDOW_CELLS_MAX];
    status s;

    columns = 4 * columns < WINDOW_CELLS_MAX ? 4 * columns : WINDOW_CELLS_MAX;
    rows = 4 * rows < WINDOW_CELLS_MAX ? 4 * rows : WINDOW_CELLS_MAX;
    s = density_init(out, (double)w->column / m->columns, (double)w->row / m->rows,
                     (double)w->columns / m->columns, (double)w->rows / m->rows, columns, rows,
                     err);
    if (s != STATUS_OK)
        return s;
    for (uint32_t y = 0; y < rows; y++) {
        for (uint32_t x = 0; x < columns; x++) {
            weights[x] = 0;
            for (int k = 0; k < 4; k++) /* midpoints of a cell's quarters */
                weights[x] += importance_at(
                    m, out->u0 + out->u_size * (x + (k % 2 + 0.5) / 2) / columns,
                    out->v0 + out->v_size * (y + (k / 2 + 0.5) / 2) / rows);
            weights[x] *= density_cell_area(out, y) / 4;
        }
        density_set_row(out, y, weights);
    }
    for (uint32_t y = w->row; y < w->row + w->rows; y++)
        for (uint32_t x = 0; x < w->columns; x++)
            m->values[(size_t)y * m->columns + (w->column + x) % m->columns] = 0;
    return STATUS_OK;
}

/* Sums over the grid's cells that fall into one row of a coarser one: of importance, of its
 * square, of solid angle. */
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

/* The coarsest grid that serves. */
static status grid_build(const struct importance *m, struct density *out, struct error *err)
{
    struct coarse c = {0};
    double *sums = mem_alloc_array(m->columns, 3 * sizeof *sums);
    status s;

    if (!sums)
        return error_no_memory(err, "the environment's importance table");
    c.sum = sums;
    c.square = sums + m->columns;
    c.area = sums + 2 * (size_t)m->columns;
    for (c.columns = GRID_COLUMNS_MIN;; c.columns *= 2) {
        c.rows = c.columns / 2;
        c.rows = c.rows < m->rows ? c.rows : m->rows;
        if (c.columns >= m->columns || c.columns > UINT32_MAX / 4) {
            c.columns = m->columns;
            c.rows = m->rows;
            break;
        }
        if (coarse_loss(m, &c) <= GRID_LOSS_MAX)
            break;
    }
    s = density_init(out, 0, 0, 1, 1, c.columns, c.rows, err);
    for (uint32_t row = 0; s == STATUS_OK && row < c.rows; row++) {
        coarse_row(m, &c, row);
        /* Cells hold unequal numbers of texels where the map's size is no multiple. */
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
    status s;

    while (count <= WINDOWS_MAX && m->columns > 2 * GRID_COLUMNS_MIN && window_find(m, &window) &&
           window_total(m, &window) > WINDOW_SHARE_MIN * m->total) {
        s = window_cut(m, &window, &env->parts[count], err);
        if (s != STATUS_OK)
            return s;
        count++;
    }
    s = grid_build(m, &env->parts[0], err);
    if (s != STATUS_OK)
        return s;
    for (uint32_t i = 0; i < count; i++) {
        (void)density_finish(&env->parts[i]);
        total[i] = env->parts[i].cells.total;
        sum += total[i];
    }
    if (!(sum > 0)) {
        env->mode = MODE_UNIFORM;
        return STATUS_OK;
    }
    /* Parts without importance are let go. */
    for (uint32_t i = 0; i < count; i++) {
        if (!(total[i] > 0)) {
            density_release(&env->parts[i]);
            continue;
        }
        if (i != env->part_count) {
            env->parts[env->part_count] = env->parts[i];
            memset(&env->parts[i], 0, sizeof env->parts[i]);
        }
        env->part_start[env->part_count++] = (float)(start / sum);
        start += total[i];
    }
    env->part_start[env->part_count] = 1;
    return STATUS_OK;
}

static status importance_build(struct environment *env, float largest, struct error *err)
{
    struct importance m = {.env = env, .columns = env->width, .rows = env->height,
                           .scale = 1 / (double)largest};
    double *rows3 = NULL;
    size_t cells;
    status s;

    for (uint32_t parts = 2; m.columns < GRID_COLUMNS_MIN ||
                             (parts == 2 && m.columns <= PARTS_COLUMNS_MAX); parts += 2)
        m.columns = env->width * parts;
    for (uint32_t parts = 2; m.rows < GRID_ROWS_MIN ||
                             (parts == 2 && m.rows <= PARTS_COLUMNS_MAX / 2); parts += 2)
        m.rows = env->height * parts;
    m.offset = env->uniform_share > 0 ? 0 : env->mean_luminance * m.scale;
    rows3 = mem_alloc_array(env->width, 3 * sizeof *rows3);
    m.values = mem_size_mul(m.columns, m.rows, &cells) ? mem_calloc(cells, sizeof *m.values) : NULL;
    if (!rows3 || !m.values) {
        s = error_no_memory(err, "the environment's importance table");
        goto done;
    }
    importance_measure(&m, rows3);
    if (!(m.total > COMPENSATED_MIN * 4 * PI_D * m.offset)) {
        m.offset = 0;
        importance_measure(&m, rows3);
    }
    s = parts_build(env, &m, err);
done:
    mem_free(m.values);
    mem_free(rows3);
    return s;
}

/* ---- making ------------------------------------------------------------------------------- */

/* Integral over v of a row's bilinear weight times sin(pi v), times pi / 2: the row's share of
 * the mean over the sphere. Rows 0 and H - 1 also own the strip to the pole: averaged over u
 * the radiance there is the row's. Gauss-Legendre, five points an interval of at most 1/H. */
static double row_share(uint32_t row, uint32_t height)
{
    static const double node[3] = {0.0, 0.53846931010568309104, 0.90617984593866399280};
    static const double weight[3] = {0.56888888888888888889, 0.47862867049936646804,
                                     0.23692688505618908751};
    double h = 1.0 / height, centre = (row + 0.5) * h, sum = 0;

    for (int side = -1; side <= 1; side += 2) {
        int to_pole = side < 0 ? row == 0 : row == height - 1;
        double length = to_pole ? 0.5 * h : h;

        for (int i = -2; i <= 2; i++) {
            double x =
                0.5 + (i < 0 ? -0.5 : 0.5) * node[i < 0 ? -i : i]; /* from the centre, 0..1 */

            sum += weight[i < 0 ? -i : i] * 0.5 * length * (to_pole ? 1.0 : 1.0 - x) *
                   sine_pi(centre + side * length * x);
        }
    }
    return sum * PI_D / 2;
}

/* Multiply the factor in. What no radiance can be, or is brighter than lights may be, becomes the
 * nearest that can: an estimate of it, its square and sums of these stay finite, so no sample is
 * lost. Returns the largest value. */
static float scale_pixels(struct image *map, struct vec3 factor)
{
    const float strength[3] = {factor.x, factor.y, factor.z};
    size_t count = (size_t)map->width * map->height * 3;
    float largest = 0;

    for (size_t i = 0; i < count; i++) {
        float f = strength[i % 3], value = map->pixels[i], scaled = value > 0 ? value * f : 0.0f;

        if (!(scaled <= SCENE_RADIANCE_MAX)) /* the product of infinity and 0 too */
            scaled = f > 0 ? SCENE_RADIANCE_MAX : 0.0f;
        if (scaled != value)
            map->pixels[i] = scaled;
        largest = scaled > largest ? scaled : largest;
    }
    return largest;
}

static void measure_mean(struct environment *env)
{
    double mean = 0;

    for (uint32_t row = 0; row < env->height; row++) {
        double sum = 0;

        for (uint32_t column = 0; column < env->width; column++)
            sum += luminance(texel(env, column, row));
        mean += sum / env->width * row_share(row, env->height);
    }
    env->mean_luminance = mean;
}

/* Is it a rotation or a mirroring? A tenth of a percent is left to rounding in files. */
static int is_orthonormal(const float m[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            float dot = m[i][0] * m[j][0] + m[i][1] * m[j][1] + m[i][2] * m[j][2];

            if (!(fabsf(dot - (i == j)) <= 1e-3f))
                return 0;
        }
    return 1;
}

/* The job's rotation about +Y undone, then the map's own, if any. */
static void set_rotation(struct environment *env, const float own[3][3], float rotate_deg)
{
    double turns = (double)rotate_deg / 360.0;
    float sine, cosine;

    turns -= floor(turns);
    det_sincos((float)(2 * PI_D * turns), &sine, &cosine);
    if (turns == 0.25 || turns == 0.75)
        cosine = 0;
    if (turns == 0.5)
        sine = 0;
    for (int i = 0; i < 3; i++) {
        float x = own ? own[i][0] : (float)(i == 0), y = own ? own[i][1] : (float)(i == 1),
              z = own ? own[i][2] : (float)(i == 2);

        env->to_map[i][0] = x * cosine + z * sine;
        env->to_map[i][1] = y;
        env->to_map[i][2] = z * cosine - x * sine;
    }
}

static enum mode mode_of(enum env_sampling sampling)
{
    switch (sampling) {
    case ENV_SAMPLING_IMPORTANCE:
    case ENV_SAMPLING_IMPORTANCE_ONLY:
        return MODE_IMPORTANCE;
    case ENV_SAMPLING_UNIFORM:
    case ENV_SAMPLING_UNIFORM_ONLY:
        return MODE_UNIFORM;
    case ENV_SAMPLING_BSDF:
    case ENV_SAMPLING_COUNT:
        break;
    }
    return MODE_NONE;
}

status environment_new(struct environment **out, struct image *map, const float own[3][3],
                       float rotate_deg, struct vec3 factor, enum env_sampling sampling,
                       struct error *err)
{
    struct environment *env = mem_calloc(1, sizeof *env);
    status st = STATUS_OK;
    float largest;

    *out = NULL;
    if (!env) {
        image_release(map);
        return error_no_memory(err, "the environment");
    }
    env->map = *map;
    memset(map, 0, sizeof *map);
    if (env->map.channels != 3 || env->map.width == 0 || env->map.height == 0) {
        st = error_set(err, STATUS_ERR_INPUT,
                       "the environment map is %u x %u with %u channels; it must have 3 channels",
                       env->map.width, env->map.height, env->map.channels);
        goto done;
    }
    if (!isfinite(rotate_deg) || !vec3_is_finite(factor) || vec3_min(factor) < 0) {
        st = error_set(err, STATUS_ERR_INPUT,
                       "environment rotation %g degrees, strength (%g, %g, %g): all must be finite "
                       "and the strength at least 0", (double)rotate_deg, (double)factor.x,
                       (double)factor.y, (double)factor.z);
        goto done;
    }
    if (own && !is_orthonormal(own)) {
        st = error_set(err, STATUS_ERR_INPUT,
                       "the environment's axes are not at right angles or not of length 1: give "
                       "it a rotation without scale");
        goto done;
    }
    set_rotation(env, own, rotate_deg);
    env->width = env->map.width;
    env->height = env->map.height;
    largest = scale_pixels(&env->map, factor);
    env->black = largest == 0;
    if (env->black)
        goto done;
    env->mode = mode_of(sampling);
    env->uniform_share = sampling == ENV_SAMPLING_IMPORTANCE_ONLY ? UNIFORM_SHARE_ALONE : 0;
    measure_mean(env);
    if (env->mode == MODE_IMPORTANCE)
        st = importance_build(env, largest, err);
done:
    if (st != STATUS_OK) {
        environment_free(env);
        return st;
    }
    *out = env;
    return STATUS_OK;
}

status environment_new_constant(struct environment **out, struct vec3 radiance,
                                enum env_sampling sampling, struct error *err)
{
    struct environment *env;

    *out = NULL;
    if (!vec3_is_finite(radiance) || vec3_min(radiance) < 0)
        return error_set(err, STATUS_ERR_INPUT,
                         "the environment's radiance (%g, %g, %g) must be finite and not negative",
                         (double)radiance.x, (double)radiance.y, (double)radiance.z);
    env = mem_calloc(1, sizeof *env);
    if (!env)
        return error_no_memory(err, "the environment");
    set_rotation(env, NULL, 0);
    env->constant = (struct vec3){float_min(radiance.x, SCENE_RADIANCE_MAX),
                                  float_min(radiance.y, SCENE_RADIANCE_MAX),
                                  float_min(radiance.z, SCENE_RADIANCE_MAX)};
    env->black = vec3_is_black(radiance);
    env->mean_luminance = luminance(radiance);
    env->mode = env->black || sampling == ENV_SAMPLING_BSDF ? MODE_NONE : MODE_UNIFORM;
    *out = env;
    return STATUS_OK;
}

void environment_free(struct environment *env)
{
    if (!env)
        return;
    for (int i = 0; i <= WINDOWS_MAX; i++)
        density_release(&env->parts[i]);
    image_release(&env->map);
    mem_free(env);
}

int environment_is_black(const struct environment *env)
{
    return env->black;
}

size_t environment_bytes(const struct environment *env)
{
    size_t bytes = sizeof *env + (size_t)env->width * env->height * 3 * sizeof(float);

    for (uint32_t i = 0; i < env->part_count; i++)
        bytes += density_bytes(&env->parts[i]);
    return bytes;
}

float environment_mean_luminance(const struct environment *env)
{
    return env->mean_luminance < (double)FLT_MAX ? (float)env->mean_luminance : FLT_MAX;
}

void environment_importance(const struct environment *env, uint32_t *columns, uint32_t *windows)
{
    int has_grid = env->part_count > 0 && env->parts[0].u_size == 1;

    *columns = has_grid ? env->parts[0].cells.columns : 0;
    *windows = env->part_count - (uint32_t)has_grid;
}
