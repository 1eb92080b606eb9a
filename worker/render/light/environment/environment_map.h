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

/* environment.c: the radiance at a place of a map that is not black. */
struct vec3 environment_read(const struct environment *env, const struct lat_long *at);

/* environment_importance.c: fill in the parts. `largest`: the map's largest value.
 * ERR_NO_MEMORY. */
status environment_importance_build(struct environment *env, real largest, struct error *err) MUST_CHECK;
