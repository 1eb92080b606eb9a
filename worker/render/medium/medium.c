/* medium: homogeneous media in closed form, what paths call, and the phase function. */
#include "worker/render/medium/medium.h"

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/medium/medium_data.h"
#include "worker/render/medium/null_collisions.h"

/* ---- homogeneous -------------------------------------------------------------------------- */

/* exp(-extinction * metres). Extinction 0 loses nothing, at any distance. */
static real medium_beer(real extinction, real metres)
{
    return extinction > 0.0f || !SAFEGUARD(MEDIUM_CLEAR) ? real_exp(-extinction * metres) : 1.0f;
}

/* The same of the three channels, which mostly are equal. */
static inline struct vec3 medium_beer_of(const struct render_medium *medium, real metres)
{
    const real first = medium_beer(medium->extinction[0], metres);

    if (!medium->chromatic)
        return (struct vec3){first, first, first};
    return (struct vec3){first, medium_beer(medium->extinction[1], metres), medium_beer(medium->extinction[2], metres)};
}

/* Integral of exp(-extinction t) from 0 to `metres`. An infinite segment without extinction would
 * emit infinitely; it counts as 0. */
static real medium_beer_integral(real extinction, real metres)
{
    double depth = (double)extinction * (double)metres;

    if (!SAFEGUARD(MEDIUM_THIN))
        return (1.0f - real_exp(-extinction * metres)) / extinction;
    if (!(metres < INFINITY))
        return extinction > 0.0f ? 1.0f / extinction : 0.0f;
    if (depth < 1e-5)
        return (real)((double)metres * (1.0 - 0.5 * depth));
    return (real)((1.0 - det_exp_d(-depth)) / (double)extinction);
}

static struct vec3 medium_homogeneous_emission(const struct render_medium *medium, real metres)
{
    real sum[3];

    for (int c = 0; c < 3; c++)
        sum[c] = medium->emission[c] > 0.0f
                     ? real_min(medium->emission[c] * medium_beer_integral(medium->extinction[c], metres),
                                MEDIUM_RADIANCE_MAX)
                     : 0.0f;
    return medium_vec(sum);
}

/* The free path of a uniformly chosen channel. The balance heuristic divides by the mean of the
 * three channels' densities, so no weight exceeds 3. The densities are relative to the chosen
 * channel's, whose optical depth is below 17, so none overflows or underflows. */
static void medium_sample_homogeneous(const struct render_medium *medium, real t_max, real u, struct medium_event *out)
{
    int chosen = medium->chromatic ? medium_channel(&u) : 0;
    real extinction = medium->extinction[chosen];
    real distance = extinction > 0.0f ? medium_depth_of(u) / extinction : INFINITY;
    real part[3], weight[3], mean = 0.0f;

    out->scattered = distance < t_max;
    out->distance = out->scattered ? distance : t_max;
    for (int c = 0; c < 3; c++) {
        real difference = medium->extinction[c] - extinction;

        part[c] = difference != 0.0f ? real_exp(-difference * out->distance) : 1.0f;
        mean += out->scattered ? part[c] * medium->extinction[c] : part[c];
    }
    mean *= 1.0f / REAL(3.0);
    for (int c = 0; c < 3; c++)
        weight[c] = (out->scattered ? part[c] * medium->scattering[c] : part[c]) / mean;
    out->weight = medium_vec(weight);
}

/* ---- what paths call ----------------------------------------------------------------------- */

void medium_sample(const struct render_medium *medium, const struct ray *ray, real first, struct medium_random *random,
                   struct medium_event *out)
{
    real t_max = ray->t_max > 0.0f ? ray->t_max : 0.0f;

    out->emitted = (struct vec3){0, 0, 0};
    if (medium->size[0]) {
        real emitted[3] = {0, 0, 0};

        PROFILE_EFFECT(MEDIUM_GRID);
        if (medium->scatters) {
            null_collisions_sample(medium, ray, first, random, out);
            return;
        }
        out->scattered = 0;
        out->distance = t_max;
        out->weight = null_collisions_transmittance(medium, ray, first, random, medium->emits ? emitted : NULL);
        out->emitted = medium_vec(emitted);
        return;
    }
    if (medium->emits)
        out->emitted = medium_homogeneous_emission(medium, t_max);
    if (medium->scatters) {
        medium_sample_homogeneous(medium, t_max, first, out);
        return;
    }
    out->scattered = 0;
    out->distance = t_max;
    out->weight = medium_beer_of(medium, t_max);
}

struct vec3 medium_transmittance(const struct render_medium *medium, const struct ray *ray,
                                 struct medium_random *random)
{
    real t_max = ray->t_max > 0.0f ? ray->t_max : 0.0f;

    if (medium->size[0]) {
        PROFILE_EFFECT(MEDIUM_GRID);
        return null_collisions_transmittance(medium, ray, sampler_hash(random->sampler, random->key, random->drawn++),
                                             random, NULL);
    }
    return medium_beer_of(medium, t_max);
}

/* 1 + g^2 - 2 g cos, as a sum of two terms >= 0, so that it does not cancel where it is smallest. */
static real medium_phase_base(real strength, real near_one, real along)
{
    if (!SAFEGUARD(MEDIUM_PHASE))
        return 1.0f + strength * strength - 2.0f * strength * along;
    return near_one * near_one + 2.0f * strength * (1.0f - along);
}

/* Henyey & Greenstein 1941. */
real medium_phase(const struct render_medium *medium, real cosine)
{
    real strength = real_abs(medium->g);
    real along = medium->g < 0.0f ? -cosine : cosine;
    real near_one = 1.0f - strength, d;

    along = along < -1.0f ? -1.0f : real_min(along, 1.0f);
    d = medium_phase_base(strength, near_one, along);
    return near_one * (1.0f + strength) / (d * real_sqrt(d)) * (0.25f * REAL_INV_PI);
}

/* The inverse of the cumulative distribution with 1 / g factored out: at g = 0 it is 2 u - 1
 * without a special case. In double: near |g| = 1 its terms cancel. */
static double medium_phase_cosine(double g, double u)
{
    double x = 2.0 * u - 1.0, rest = (1.0 - x) * (1.0 + x), d = 1.0 + g * x;
    double cosine = (x * (1.0 + g * g) + 0.5 * g * (3.0 + x * x) - 0.5 * g * g * g * rest) / (d * d);

    return cosine < -1.0 ? -1.0 : cosine > 1.0 ? 1.0 : cosine;
}

struct vec3 medium_phase_sample(const struct render_medium *medium, struct vec3 direction, real u, real v)
{
    double cosine = medium_phase_cosine((double)medium->g, (double)u);
    real sine = (real)sqrt((1.0 - cosine) * (1.0 + cosine)), s, c;
    struct basis frame = basis_from_normal(direction);

    real_sincos(2.0f * REAL_PI * v, &s, &c);
    return vec3_normalize(basis_to_world(&frame, (struct vec3){sine * c, sine * s, (real)cosine}));
}
