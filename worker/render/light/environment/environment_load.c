/* environment_load: creates an environment from a map or a constant. */
#include <float.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/scene/scene.h"
#include "worker/render/light/environment/environment_map.h"

/* Where nothing else finds the light that importance sampling leaves out (cells too dark for the
 * tables' resolution), this share of the samples is uniform. */
#define UNIFORM_SHARE_ALONE 0.0625f

/* sin(pi v) for 0 <= v <= 1, accurate at both ends. */
static double sine_pi(double v) { return (double)real_sin((real)(PI_D * (v < 0.5 ? v : 1.0 - v))); }

/* Integral over v of a row's bilinear weight times sin(pi v), times pi / 2: the row's share of the
 * mean over the sphere. Rows 0 and H - 1 also own the strip to the pole: averaged over u, the
 * radiance there is the row's. Gauss-Legendre, five points per interval of at most 1/H. */
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
            double x = 0.5 + (i < 0 ? -0.5 : 0.5) * node[i < 0 ? -i : i]; /* from the centre, 0..1 */

            sum +=
                weight[i < 0 ? -i : i] * 0.5 * length * (to_pole ? 1.0 : 1.0 - x) * sine_pi(centre + side * length * x);
        }
    }
    return sum * PI_D / 2;
}

static real uniform_share(enum env_sampling sampling)
{
    return sampling == ENV_SAMPLING_IMPORTANCE_ONLY && SAFEGUARD(MAP_DARK_CELLS) ? UNIFORM_SHARE_ALONE : 0;
}

/* A texel times the factor. A value that is no valid radiance, or brighter than lights may be, becomes the nearest
 * valid one: an estimate, its square and sums of these stay finite, so no sample is lost. */
static real texel_scaled(real value, real factor)
{
    real scaled = value > 0 ? value * factor : 0.0f;

    if (!SAFEGUARD(MAP_RADIANCE))
        return value * factor;
    if (!(scaled <= SCENE_RADIANCE_MAX)) /* also the product of infinity and 0 */
        scaled = factor > 0 ? SCENE_RADIANCE_MAX : 0.0f;
    return scaled;
}

/* Returns the largest value. */
static real scale_pixels(struct image *map, struct vec3 factor)
{
    const real strength[3] = {factor.x, factor.y, factor.z};
    size_t count = (size_t)map->width * map->height * 3;
    real largest = 0;

    for (size_t i = 0; i < count; i++) {
        real value = map->pixels[i], scaled = texel_scaled(value, strength[i % 3]);

        if (scaled != value)
            map->pixels[i] = (float32)scaled;
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

/* Is it a rotation or a mirroring? A tenth of a percent allows for rounding in files. */
static int is_orthonormal(const float32 m[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            real dot = m[i][0] * m[j][0] + m[i][1] * m[j][1] + m[i][2] * m[j][2];

            if (!(real_abs(dot - (i == j)) <= REAL(1e-3)))
                return 0;
        }
    return 1;
}

/* Undo the job's rotation about +Y, then the map's own, if any. */
static void set_rotation(struct environment *env, const float32 own[3][3], real rotate_deg)
{
    double turns = (double)rotate_deg / 360.0;
    real sine, cosine;

    turns -= floor(turns);
    real_sincos((real)(2 * PI_D * turns), &sine, &cosine);
    if (turns == 0.25 || turns == 0.75)
        cosine = 0;
    if (turns == 0.5)
        sine = 0;
    for (int i = 0; i < 3; i++) {
        real x = own ? own[i][0] : (real)(i == 0), y = own ? own[i][1] : (real)(i == 1),
             z = own ? own[i][2] : (real)(i == 2);

        env->to_map[i][0] = x * cosine + z * sine;
        env->to_map[i][1] = y;
        env->to_map[i][2] = z * cosine - x * sine;
    }
}

/* Is a texel too dark for bilinear weights to tell it from black? */
static int has_black(const struct image *map)
{
    size_t count = (size_t)map->width * map->height;

    for (size_t i = 0; i < count; i++) {
        const float32 *p = map->pixels + 3 * i;

        if (!(p[0] >= FLT_MIN || p[1] >= FLT_MIN || p[2] >= FLT_MIN))
            return 1;
    }
    return 0;
}

static enum mode mode_of(enum env_sampling sampling)
{
    switch (sampling) {
    case ENV_SAMPLING_LEARNED:
    case ENV_SAMPLING_IMPORTANCE:
    case ENV_SAMPLING_IMPORTANCE_ONLY: return MODE_IMPORTANCE;
    case ENV_SAMPLING_UNIFORM:
    case ENV_SAMPLING_UNIFORM_ONLY: return MODE_UNIFORM;
    case ENV_SAMPLING_BSDF:
    case ENV_SAMPLING_COUNT: break;
    }
    return MODE_NONE;
}

status environment_new(struct environment **out, struct image *map, const float32 own[3][3], real rotate_deg,
                       struct vec3 factor, enum env_sampling sampling, struct error *err)
{
    struct environment *env = mem_calloc(1, sizeof *env);
    status st = STATUS_OK;

    *out = NULL;
    if (!env) {
        image_release(map);
        return error_no_memory(err, "the environment");
    }
    env->map = *map;
    memset(map, 0, sizeof *map);
    if (env->map.channels != 3 || env->map.width == 0 || env->map.height == 0) {
        st =
            error_set(err, STATUS_ERR_INPUT, "the environment map is %u x %u with %u channels; it must have 3 channels",
                      env->map.width, env->map.height, env->map.channels);
        goto done;
    }
    if (!isfinite(rotate_deg) || !vec3_is_finite(factor) || vec3_min(factor) < 0) {
        st = error_set(err, STATUS_ERR_INPUT,
                       "environment rotation %g degrees, strength (%g, %g, %g): all must be finite "
                       "and the strength at least 0",
                       (double)rotate_deg, (double)factor.x, (double)factor.y, (double)factor.z);
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
    env->largest = scale_pixels(&env->map, factor);
    env->black = env->largest == 0;
    if (env->black)
        goto done;
    env->has_black = has_black(&env->map);
    env->mode = mode_of(sampling);
    env->uniform_share = uniform_share(sampling);
    measure_mean(env);
    if (env->mode == MODE_IMPORTANCE)
        st = environment_importance_build(env, err);
done:
    if (st != STATUS_OK) {
        environment_free(env);
        return st;
    }
    *out = env;
    return STATUS_OK;
}

status environment_new_constant(struct environment **out, struct vec3 radiance, enum env_sampling sampling,
                                struct error *err)
{
    struct environment *env;

    *out = NULL;
    if (!vec3_is_finite(radiance) || vec3_min(radiance) < 0)
        return error_set(err, STATUS_ERR_INPUT,
                         "the environment's radiance (%g, %g, %g) must be finite and not negative", (double)radiance.x,
                         (double)radiance.y, (double)radiance.z);
    env = mem_calloc(1, sizeof *env);
    NEED(env, err, "the environment");
    set_rotation(env, NULL, 0);
    env->constant = (struct vec3){real_min(radiance.x, SCENE_RADIANCE_MAX),
                                  real_min(radiance.y, SCENE_RADIANCE_MAX),
                                  real_min(radiance.z, SCENE_RADIANCE_MAX)};
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
