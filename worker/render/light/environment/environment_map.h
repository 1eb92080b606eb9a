/* environment_map: an environment's parts, and the map's texels, cells and directions. Private to environment*.c.
 *
 * The map is divided into cells between texel centres: column i from centre i to centre i + 1 (periodic), strip k from
 * row k - 1 to row k; strips 0 and H, from a row to its pole, are half as high. Within a cell, radiance is bilinear
 * between four nodes. A straight line over the pole from row 0 at u continues in row 0 at u + 1/2, so the radiance at
 * the pole, seen from column u, is the mean of the two.
 */
#pragma once

#include "common/image/image.h"
#include "worker/render/light/environment/density.h"
#include "worker/render/light/environment/environment.h"
#include "worker/render/base/lat_long.h"

/* Limit of windows of finer importance, around the brightest cells. */
enum { WINDOWS_MAX = 8 };

enum mode { MODE_NONE, MODE_UNIFORM, MODE_IMPORTANCE };

struct environment {
    uint32_t width, height; /* 0: constant */
    struct image map;       /* already multiplied by the factor */
    struct vec3 constant;
    real to_map[3][3]; /* from world space, including the job's rotation */
    enum mode mode;
    int black;
    int has_black; /* texels that are black, or all but black */
    real largest;  /* of the map's values */
    double mean_luminance;
    struct density parts[WINDOWS_MAX + 1]; /* the grid, then the windows; MODE_IMPORTANCE only */
    real part_start[WINDOWS_MAX + 2];      /* where each part's share of the choices begins */
    uint32_t part_count;
    real uniform_share; /* of the choices: uniform over the sphere; MODE_IMPORTANCE only */
};

static inline double luminance(struct vec3 c)
{
    /* In double: the weights of the largest floats must not overflow when summed. */
    return 0.212656 * (double)c.x + 0.715158 * (double)c.y + 0.072186 * (double)c.z;
}

static inline struct vec3 texel(const struct environment *env, uint32_t column, uint32_t row)
{
    const float32 *p = env->map.pixels + 3 * ((size_t)row * env->width + column);

    return (struct vec3){p[0], p[1], p[2]};
}

/* The texel of the same row half-way round; between two columns if the width is odd. */
static inline struct vec3 opposite(const struct environment *env, uint32_t column, uint32_t row)
{
    uint32_t width = env->width, a = (column + width / 2) % width;

    if (width % 2 == 0)
        return texel(env, a, row);
    return vec3_lerp(texel(env, a, row), texel(env, (a + 1) % width, row), 0.5f);
}

static inline struct vec3 environment_to_map(const struct environment *env, struct vec3 d)
{
    const real(*m)[3] = env->to_map;

    return (struct vec3){m[0][0] * d.x + m[0][1] * d.y + m[0][2] * d.z, m[1][0] * d.x + m[1][1] * d.y + m[1][2] * d.z,
                         m[2][0] * d.x + m[2][1] * d.y + m[2][2] * d.z};
}

static inline struct vec3 environment_from_map(const struct environment *env, struct vec3 d)
{
    const real(*m)[3] = env->to_map;

    return (struct vec3){m[0][0] * d.x + m[1][0] * d.y + m[2][0] * d.z, m[0][1] * d.x + m[1][1] * d.y + m[2][1] * d.z,
                         m[0][2] * d.x + m[1][2] * d.y + m[2][2] * d.z};
}

/* The direction, in the map's axes, that was chosen from a density. A window may cross the map's seam: u is wrapped. */
static inline struct vec3 environment_chosen(struct density_choice *choice)
{
    const real radius = real_sqrt(choice->versine * (2 - choice->versine));
    real sine, cosine;

    choice->u = choice->u >= 1 ? choice->u - 1 : choice->u;
    lat_long_sincos(choice->u, &sine, &cosine);
    return vec3_make(-radius * cosine, real_flip(1 - choice->versine, choice->south), -radius * sine);
}

/* The parts from this one on are windows. */
static inline uint32_t environment_first_window(const struct environment *env)
{
    return env->part_count > 0 && env->parts[0].u_size == 1;
}

/* The part's share of the choices. */
static inline real environment_part_share(const struct environment *env, uint32_t part)
{
    return env->part_start[part + 1] - env->part_start[part];
}

/* environment.c: the radiance at a place of a map that is not black. */
struct vec3 environment_read(const struct environment *env, const struct lat_long *at);

/* environment_importance.c: fill in the parts. ERR_NO_MEMORY. */
status environment_importance_build(struct environment *env, struct error *err) MUST_CHECK;

/* environment_importance.c: a density by luminance of each of rows x columns equal cells of the map, without what the
 * windows hold; cells.total 0: it is black, and has none. cells[rows * columns] zeroed. ERR_NO_MEMORY. */
status environment_cells_build(const struct environment *env, uint32_t columns, uint32_t rows, struct density *cells,
                               struct error *err) MUST_CHECK;
