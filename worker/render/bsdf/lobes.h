/* lobes: the pieces that preparing, evaluating and sampling a BSDF share. Private to
 * worker/render/bsdf. */
#ifndef AZULEJO_RENDER_LOBES_H
#define AZULEJO_RENDER_LOBES_H

#include "common/math/vec.h"
#include "worker/render/bsdf/albedo.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/bsdf/fresnel.h"

/* x clamped to low..high; NaN becomes low. */
static inline float clamp_to(float x, float low, float high)
{
    return x > low ? (x < high ? x : high) : low;
}
static inline struct vec3 clamp_color(struct vec3 c, float high)
{
    return (struct vec3){clamp_to(c.x, 0, high), clamp_to(c.y, 0, high), clamp_to(c.z, 0, high)};
}

/* Schlick reflectance of the reflect lobe, all weights included. */
static inline struct vec3 schlick_color(const struct bsdf *b, float weight)
{
    return (struct vec3){b->f0.x + (b->f90 - b->f0.x) * weight,
                         b->f0.y + (b->f90 - b->f0.y) * weight,
                         b->f0.z + (b->f90 - b->f0.z) * weight};
}

/* Reflectance of the refractive interface (without its weight). */
static inline struct vec3 interface_color(const struct bsdf *b, float cos_i)
{
    float weight;
    struct vec3 f;

    if (b->exact) {
        float r = fresnel_exact(cos_i, b->eta);
        if (r >= 1.0f)
            return (struct vec3){1, 1, 1};
        weight = (r - b->normal_f0) * b->inverse_rest_f0;
    } else {
        weight = schlick_weight(cos_i);
    }
    /* The exact term dips below its value at normal incidence for an ior above 3.7. */
    f.x = clamp_to(b->f0_dielectric.x + (b->f90_dielectric - b->f0_dielectric.x) * weight, 0, 1);
    f.y = clamp_to(b->f0_dielectric.y + (b->f90_dielectric - b->f0_dielectric.y) * weight, 0, 1);
    f.z = clamp_to(b->f0_dielectric.z + (b->f90_dielectric - b->f0_dielectric.z) * weight, 0, 1);
    return f;
}

/* How likely the interface lobe reflects or transmits at a microfacet that reflects `f`. 0
 * only where that way carries nothing. Apart, for 1 - F has few digits at grazing angles. */
struct interface_choice {
    float reflect, transmit;
};

static inline struct interface_choice interface_choose(const struct bsdf *b, struct vec3 f)
{
    float reflected = vec3_average(f);
    float transmitted = (1.0f - vec3_max(f)) * vec3_average(b->p.base_color);
    float scale = reflected + transmitted;

    if (!(scale > 0.0f))
        return (struct interface_choice){1, 0};
    scale = 1.0f / scale;
    return (struct interface_choice){reflected * scale, transmitted * scale};
}

/* Share of light that the reflection leaves for the base where Schlick's mean weight is
 * `blend`; and along a direction. */
static inline float layer_rest_of(const struct bsdf *b, float blend)
{
    float rest = 1.0f - (b->layer_f0 + (b->layer_f90 - b->layer_f0) * blend);
    return rest > 0.0f ? rest : 0.0f;
}
static inline float layer_rest(const struct bsdf *b, float mu)
{
    float blend;

    if (b->layer_f90 == 0.0f)
        return 1.0f;
    blend = b->smooth ? schlick_weight(mu) : albedo_blend_at(&b->row, mu);
    return layer_rest_of(b, blend);
}

#endif
