#include "worker/render/light/environment/environment.h"

#include <float.h>

#include "common/base/safeguard.h"
#include "worker/render/light/environment/environment_map.h"

#define UNIFORM_PDF (0.25f * REAL_INV_PI)

/* ---- cells -------------------------------------------------------------------------------- */

/* A texel's channels side by side, for arithmetic on all of them at once. */
typedef real lanes __attribute__((vector_size(4 * sizeof(real))));

static inline lanes texel_lanes(const struct environment *env, uint32_t column, uint32_t row)
{
    const float32 *p = env->map.pixels + 3 * ((size_t)row * env->width + column);

    return (lanes){p[0], p[1], p[2], 0};
}

static inline lanes lanes_lerp(lanes a, lanes b, real t) { return a * (1.0f - t) + b * t; }

/* A cell and the position in it: what a direction is converted to. */
struct place {
    uint32_t column; /* cell column, 0..width-1 */
    uint32_t strip;  /* counted from the nearer pole; 0 is the pole's own strip */
    int south;       /* the nearer pole is the nadir */
    real x, y;       /* 0..1 from column to column, and from the near edge to the far one */
};

/* Rare: the edge of a pole's strip on the pole's side. */
static __attribute__((noinline)) lanes pole_edge(const struct environment *env, uint32_t column, uint32_t next,
                                                 uint32_t row, real x)
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
    lanes far = lanes_lerp(texel_lanes(env, at->column, far_row), texel_lanes(env, next, far_row), at->x);
    lanes near, mean;

    if (at->strip > 0) {
        uint32_t near_row = at->south ? far_row + 1 : far_row - 1;

        near = lanes_lerp(texel_lanes(env, at->column, near_row), texel_lanes(env, next, near_row), at->x);
    } else {
        near = pole_edge(env, at->column, next, far_row, at->x);
    }
    mean = lanes_lerp(near, far, at->y);
    return (struct vec3){mean[0], mean[1], mean[2]};
}

static inline void place_of(const struct environment *env, const struct lat_long *map, struct place *at)
{
    real x = map->u * (real)env->width - 0.5f, rows = map->distance * (real)env->height;
    int32_t column = x < 0 ? -1 : (int32_t)x;

    at->x = x - (real)column;
    at->column = column < 0 ? env->width - 1 : (uint32_t)column;
    at->south = map->south;
    if (rows < 0.5f) {
        at->strip = 0;
        at->y = 2.0f * rows;
        return;
    }
    rows -= 0.5f;
    at->strip = (uint32_t)(int32_t)rows + 1;
    at->y = rows - (real)(int32_t)(at->strip - 1);
    if (env->height == 1) { /* the equator is the far edge of both pole strips */
        at->strip = 0;
        at->y = 1.0f;
    }
}

/* ---- directions --------------------------------------------------------------------------- */

struct vec3 environment_read(const struct environment *env, const struct lat_long *at)
{
    struct place place;

    place_of(env, at, &place);
    return cell_radiance(env, &place);
}

int environment_has_black(const struct environment *env) { return env->black || env->has_black; }

/* Of all parts, or of all but one. */
static real importance_pdf(const struct environment *env, const struct lat_long *at, uint32_t without)
{
    real v = at->south ? 1 - at->distance : at->distance, pdf = 0;

    for (uint32_t i = 0; i < env->part_count; i++)
        pdf += i != without ? density_at(&env->parts[i], at->u, v) : 0;
    return pdf;
}

/* 0: its length is 0 or not finite. */
static inline int is_direction(struct vec3 d)
{
    real length2 = vec3_length_squared(d);

    return length2 > 0 && length2 < INFINITY;
}

struct vec3 environment_radiance_pdf(const struct environment *env, struct vec3 direction, real *pdf)
{
    const real uniform = env->mode == MODE_IMPORTANCE ? env->uniform_share : env->mode == MODE_UNIFORM;
    struct lat_long at;

    *pdf = 0;
    if (!is_direction(direction))
        return vec3_splat(0);
    *pdf = uniform * UNIFORM_PDF;
    if (env->width == 0 || env->black)
        return env->constant;
    lat_long_of(environment_to_map(env, direction), &at);
    if (env->mode == MODE_IMPORTANCE)
        *pdf += (1 - uniform) * importance_pdf(env, &at, UINT32_MAX);
    return environment_read(env, &at);
}

struct vec3 environment_radiance(const struct environment *env, struct vec3 direction)
{
    struct lat_long at;

    if (!is_direction(direction))
        return vec3_splat(0);
    if (env->width == 0 || env->black)
        return env->constant;
    lat_long_of(environment_to_map(env, direction), &at);
    return environment_read(env, &at);
}

real environment_pdf(const struct environment *env, struct vec3 direction)
{
    struct lat_long at;

    if (env->mode == MODE_NONE || !is_direction(direction))
        return 0;
    if (env->mode == MODE_UNIFORM)
        return UNIFORM_PDF;
    lat_long_of(environment_to_map(env, direction), &at);
    return env->uniform_share * UNIFORM_PDF + (1 - env->uniform_share) * importance_pdf(env, &at, UINT32_MAX);
}

/* ---- sampling ----------------------------------------------------------------------------- */

/* Can parts other than the one that was chosen from contain the direction? */
static inline int overlaps(const struct environment *env, uint32_t part, real u)
{
    for (uint32_t i = 0; i < env->part_count; i++)
        if (i != part && density_offset(&env->parts[i], u) < env->parts[i].u_size)
            return 1;
    return 0;
}

static int sample_map(const struct environment *env, real u, real v, struct vec3 *direction, real *pdf)
{
    struct density_choice choice;
    struct lat_long at;
    uint32_t part = 0;
    real share;
    struct vec3 d;

    while (part + 1 < env->part_count && u >= env->part_start[part + 1])
        part++;
    share = env->part_start[part + 1] - env->part_start[part];
    u = real_min((u - env->part_start[part]) / share, REAL_BELOW_ONE);
    density_choose(&env->parts[part], u, v, &choice);
    d = environment_chosen(&choice);
    *direction = vec3_normalize(environment_from_map(env, d));
    *pdf = choice.pdf;
    if (env->part_count > 1 && overlaps(env, part, choice.u)) {
        lat_long_of(d, &at);
        *pdf += importance_pdf(env, &at, part);
    }
    return *pdf > 0;
}

static struct vec3 sphere_direction(real u, real v)
{
    real y = 1.0f - 2.0f * v, radius = 2.0f * real_sqrt(v * (1.0f - v)), sine, cosine;

    lat_long_sincos(u, &sine, &cosine);
    return vec3_make(radius * cosine, y, radius * sine);
}

/* A share of the choices is uniform, the others follow the map. */
static __attribute__((noinline)) int sample_mixed(const struct environment *env, real u, real v, struct vec3 *direction,
                                                  real *pdf)
{
    real share = env->uniform_share;

    if (u < share)
        *direction = sphere_direction(real_min(u / share, REAL_BELOW_ONE), v);
    else if (!sample_map(env, real_min((u - share) / (1 - share), REAL_BELOW_ONE), v, direction, pdf))
        return 0;
    *pdf = environment_pdf(env, *direction);
    return *pdf > 0;
}

int environment_aim(const struct environment *env, real u, real v, struct vec3 *direction, real *pdf)
{
    u = real_min(real_max(u, 0.0f), REAL_BELOW_ONE);
    v = real_min(real_max(v, 0.0f), REAL_BELOW_ONE);
    if (env->mode == MODE_IMPORTANCE)
        return env->uniform_share > 0 ? sample_mixed(env, u, v, direction, pdf) : sample_map(env, u, v, direction, pdf);
    *direction = env->mode == MODE_NONE ? vec3_make(0, 1, 0) : sphere_direction(u, v);
    *pdf = env->mode == MODE_NONE ? 0 : UNIFORM_PDF;
    return *pdf > 0;
}

/* ---- windows -------------------------------------------------------------------------------- */

int environment_has_windows(const struct environment *env)
{
    return env->mode == MODE_IMPORTANCE && environment_first_window(env) < env->part_count;
}

static real windows_pdf(const struct environment *env, const struct lat_long *at)
{
    const uint32_t first = environment_first_window(env);
    const real v = at->south ? 1 - at->distance : at->distance;
    real pdf = 0;

    for (uint32_t i = first; i < env->part_count; i++)
        pdf += density_at(&env->parts[i], at->u, v);
    return pdf / (env->part_start[env->part_count] - env->part_start[first]);
}

void environment_aim_at_windows(const struct environment *env, real u, real v, struct vec3 *direction, real *pdf)
{
    uint32_t part = environment_first_window(env);
    struct density_choice choice;
    struct lat_long at;
    struct vec3 d;

    u = env->part_start[part] + u * (env->part_start[env->part_count] - env->part_start[part]);
    while (part + 1 < env->part_count && u >= env->part_start[part + 1])
        part++;
    u = real_min((u - env->part_start[part]) / environment_part_share(env, part), REAL_BELOW_ONE);
    density_choose(&env->parts[part], real_max(u, 0), v, &choice);
    d = environment_chosen(&choice);
    *direction = vec3_normalize(environment_from_map(env, d));
    lat_long_of(d, &at);
    *pdf = windows_pdf(env, &at);
}

real environment_windows_pdf(const struct environment *env, struct vec3 direction)
{
    struct lat_long at;

    lat_long_of(environment_to_map(env, direction), &at);
    return windows_pdf(env, &at);
}

int environment_sample(const struct environment *env, real u, real v, struct vec3 *direction, struct vec3 *radiance,
                       real *pdf)
{
    int found = environment_aim(env, u, v, direction, pdf);

    *radiance = found ? environment_radiance(env, *direction) : vec3_splat(0);
    return found;
}

/* ---- properties ----------------------------------------------------------------------- */

int environment_is_black(const struct environment *env) { return env->black; }

size_t environment_bytes(const struct environment *env)
{
    size_t bytes = sizeof *env + (size_t)env->width * env->height * 3 * sizeof(float32);

    for (uint32_t i = 0; i < env->part_count; i++)
        bytes += density_bytes(&env->parts[i]);
    return bytes;
}

real environment_mean_luminance(const struct environment *env)
{
    return env->mean_luminance < (double)FLT_MAX ? (real)env->mean_luminance : FLT_MAX;
}

void environment_importance(const struct environment *env, uint32_t *columns, uint32_t *windows)
{
    int has_grid = env->part_count > 0 && env->parts[0].u_size == 1;

    *columns = has_grid ? env->parts[0].cells.columns : 0;
    *windows = env->part_count - (uint32_t)has_grid;
}
