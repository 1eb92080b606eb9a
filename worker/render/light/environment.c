#include "worker/render/light/environment.h"

#include <float.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/light/environment_map.h"

/* ---- cells -------------------------------------------------------------------------------- */

/* A texel's channels side by side, for arithmetic on all of them at once. */
typedef real lanes __attribute__((vector_size(4 * sizeof(real))));

static inline lanes texel_lanes(const struct environment *env, uint32_t column, uint32_t row)
{
    const float32 *p = env->map.pixels + 3 * ((size_t)row * env->width + column);

    return (lanes){p[0], p[1], p[2], 0};
}

static inline lanes lanes_lerp(lanes a, lanes b, real t)
{
    return a * (1.0f - t) + b * t;
}

/* A cell and the position in it: what a direction is converted to. */
struct place {
    uint32_t column;  /* cell column, 0..width-1 */
    uint32_t strip;   /* counted from the nearer pole; 0 is the pole's own strip */
    int south;        /* the nearer pole is the nadir */
    real x, y;       /* 0..1 from column to column, and from the near edge to the far one */
};

/* Rare: the edge of a pole's strip on the pole's side. */
static __attribute__((noinline)) lanes pole_edge(const struct environment *env, uint32_t column,
                                                 uint32_t next, uint32_t row, real x)
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

static inline void place_of(const struct environment *env, const struct angles *angles,
                            struct place *at)
{
    real x = angles->u * (real)env->width - 0.5f, rows = angles->distance * (real)env->height;
    int32_t column = x < 0 ? -1 : (int32_t)x;

    at->x = x - (real)column;
    at->column = column < 0 ? env->width - 1 : (uint32_t)column;
    at->south = angles->south;
    if (rows < 0.5f) {
        at->strip = 0;
        at->y = 2.0f * rows;
        return;
    }
    rows -= 0.5f;
    at->strip = (uint32_t)rows + 1;
    at->y = rows - (real)(at->strip - 1);
    if (env->height == 1) { /* the equator is the far edge of both pole strips */
        at->strip = 0;
        at->y = 1.0f;
    }
}

/* ---- directions --------------------------------------------------------------------------- */

static inline struct vec3 to_map(const struct environment *env, struct vec3 d)
{
    const real(*m)[3] = env->to_map;

    return (struct vec3){m[0][0] * d.x + m[0][1] * d.y + m[0][2] * d.z,
                         m[1][0] * d.x + m[1][1] * d.y + m[1][2] * d.z,
                         m[2][0] * d.x + m[2][1] * d.y + m[2][2] * d.z};
}

static inline struct vec3 from_map(const struct environment *env, struct vec3 d)
{
    const real(*m)[3] = env->to_map;

    return (struct vec3){m[0][0] * d.x + m[1][0] * d.y + m[2][0] * d.z,
                         m[0][1] * d.x + m[1][1] * d.y + m[2][1] * d.z,
                         m[0][2] * d.x + m[1][2] * d.y + m[2][2] * d.z};
}

/* The angle to the nearer pole over pi. Not acos(y), which cannot resolve angles below 3e-4 from a
 * pole. */
static inline real pole_distance(real radius2, real y, real length2)
{
    if (!SAFEGUARD(MAP_POLE))
        return real_acos(real_min(real_abs(y) / real_sqrt(length2), 1)) * REAL_INV_PI;
    return real_atan2(real_sqrt(radius2), real_abs(y)) * REAL_INV_PI;
}

/* 0 if the direction is invalid. */
static inline int angles_of(const struct environment *env, struct vec3 d, struct angles *out)
{
    real radius2, length2, u;

    d = to_map(env, d);
    radius2 = d.x * d.x + d.z * d.z;
    length2 = radius2 + d.y * d.y;
    if (!(length2 > 0 && length2 < INFINITY))
        return 0;
    out->distance = pole_distance(radius2, d.y, length2);
    out->south = d.y < 0;
    u = 0.5f + real_atan2(d.z, d.x) * REAL_INV_2PI;
    out->u = u >= 1.0f ? u - 1.0f : u;
    return 1;
}

static struct vec3 radiance_at(const struct environment *env, const struct angles *angles)
{
    struct place at;

    place_of(env, angles, &at);
    return cell_radiance(env, &at);
}

struct vec3 environment_map_radiance(const struct environment *env, const struct angles *angles)
{
    return radiance_at(env, angles);
}

static real importance_pdf(const struct environment *env, const struct angles *angles)
{
    real v = angles->south ? 1 - angles->distance : angles->distance;
    double pdf = 0;

    for (uint32_t i = 0; i < env->part_count; i++)
        pdf += (double)(env->part_start[i + 1] - env->part_start[i]) *
               density_at(&env->parts[i], angles->u, v);
    if (env->uniform_share > 0)
        pdf += ((double)(0.25f * REAL_INV_PI) - pdf) * (double)env->uniform_share;
    return pdf < (double)FLT_MAX ? (real)pdf : FLT_MAX;
}

struct vec3 environment_radiance_pdf(const struct environment *env, struct vec3 direction,
                                     real *pdf)
{
    struct angles angles;

    *pdf = 0;
    if (!angles_of(env, direction, &angles))
        return vec3_splat(0);
    if (env->mode == MODE_UNIFORM)
        *pdf = 0.25f * REAL_INV_PI;
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

real environment_pdf(const struct environment *env, struct vec3 direction)
{
    real pdf;

    (void)environment_radiance_pdf(env, direction, &pdf);
    return pdf;
}

/* ---- sampling ----------------------------------------------------------------------------- */

/* A window may cross the map's seam. */
static inline double seam_crossed(double u) { return SAFEGUARD(MAP_SEAM) ? u - floor(u) : u; }

static int sample_map(const struct environment *env, real u, real v, struct vec3 *direction,
                      struct vec3 *radiance, real *pdf)
{
    struct angles angles;
    uint32_t part = 0;
    double map_u, cosine, versine, density, sine;
    real share, sin_phi, cos_phi;

    while (part + 1 < env->part_count && u >= env->part_start[part + 1])
        part++;
    share = env->part_start[part + 1] - env->part_start[part];
    u = real_min((u - env->part_start[part]) / share, REAL_BELOW_ONE);
    density = density_sample(&env->parts[part], u, v, &map_u, &cosine);
    map_u = seam_crossed(map_u);
    versine = 1 - fabs(cosine);
    sine = sqrt(versine * (2 - versine));
    real_sincos((real)(2 * PI_D * (map_u - 0.5)), &sin_phi, &cos_phi);
    angles.u = (real)map_u < 1 ? (real)map_u : 0;
    angles.south = cosine < 0;
    angles.distance = 2 * REAL_INV_PI * real_asin((real)sqrt(0.5 * versine));
    *direction = vec3_normalize(from_map(
        env, (struct vec3){(real)sine * cos_phi, (real)cosine, (real)sine * sin_phi}));
    *radiance = radiance_at(env, &angles);
    if (env->part_count == 1)
        *pdf = density < (double)FLT_MAX ? (real)density : FLT_MAX;
    else
        *pdf = importance_pdf(env, &angles);
    return *pdf > 0;
}

static struct vec3 sphere_direction(real u, real v)
{
    real y = 1.0f - 2.0f * v, radius = 2.0f * real_sqrt(v * (1.0f - v)), sine, cosine;

    real_sincos(u * (2.0f * REAL_PI), &sine, &cosine);
    return vec3_make(radius * cosine, y, radius * sine);
}

/* A share of the choices is uniform, the others follow the map. */
static __attribute__((noinline)) int sample_mixed(const struct environment *env, real u, real v,
                                                  struct vec3 *direction, struct vec3 *radiance,
                                                  real *pdf)
{
    real share = env->uniform_share;

    if (u < share)
        *direction = sphere_direction(real_min(u / share, REAL_BELOW_ONE), v);
    else if (!sample_map(env, real_min((u - share) / (1 - share), REAL_BELOW_ONE), v, direction,
                         radiance, pdf))
        return 0;
    *radiance = environment_radiance_pdf(env, *direction, pdf);
    return *pdf > 0;
}

int environment_sample(const struct environment *env, real u, real v, struct vec3 *direction,
                       struct vec3 *radiance, real *pdf)
{
    u = real_min(real_max(u, 0.0f), REAL_BELOW_ONE);
    v = real_min(real_max(v, 0.0f), REAL_BELOW_ONE);
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
    *pdf = 0.25f * REAL_INV_PI;
    return 1;
}

/* ---- properties ----------------------------------------------------------------------- */

int environment_is_black(const struct environment *env)
{
    return env->black;
}

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
