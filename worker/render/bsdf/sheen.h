/* sheen: cloth's Charlie distribution with its shadowing (Conty Estevez and Kulla 2017,
 * "Production Friendly Microfacet Sheen BRDF", as in KHR_materials_sheen).
 *
 * Below alpha 0.1 the model itself sends out more than comes in at grazing angles (its
 * directional albedo, albedo.h, is above 1); there it is scaled down by the larger of the two
 * directions' albedos, which keeps it reciprocal.
 */
#ifndef AZULEJO_RENDER_SHEEN_H
#define AZULEJO_RENDER_SHEEN_H

#include "common/math/elementary.h"
#include "common/math/vec.h"
#include "worker/render/bsdf/albedo.h"

/* Nearer to the horizon the fit does not shadow as it should, and 1 / mu runs away. */
#define SHEEN_MU_MIN 1e-4f

/* The shadowing's fit at this alpha: a / (1 + b x^c) + d x + e. */
static inline void sheen_fit(float alpha, float fit[5])
{
    static const float ends[5][2] = {{21.5473f, 25.3245f}, {3.82987f, 3.32435f},
                                     {0.19823f, 0.16801f}, {-1.97760f, -1.27393f},
                                     {-4.32054f, -4.85967f}};
    float t = (1.0f - alpha) * (1.0f - alpha);

    for (int i = 0; i < 5; i++)
        fit[i] = ends[i][0] + (ends[i][1] - ends[i][0]) * t;
}

static inline float sheen_curve(const float fit[5], float x)
{
    return fit[0] / (1.0f + fit[1] * det_pow(x, fit[2])) + fit[3] * x + fit[4];
}

/* Lambda(mu); half = sheen_curve(fit, 0.5), about which the fit is mirrored. */
static inline float sheen_lambda(const float fit[5], float half, float mu)
{
    return det_exp(mu < 0.5f ? sheen_curve(fit, mu) : 2.0f * half - sheen_curve(fit, 1.0f - mu));
}

/* D of a half vector whose squared sine with the normal is sin2. */
static inline float sheen_density(float alpha, float sin2)
{
    float inverse = 1.0f / alpha;
    return (2.0f + inverse) * INV_2PI_F * det_pow(sin2 < 1.0f ? sin2 : 1.0f, 0.5f * inverse);
}

#endif
