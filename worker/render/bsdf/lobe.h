/* lobe: what all lobes of a BSDF share. Private to worker/render/bsdf. */
#pragma once

#include "common/base/safeguard.h"
#include "common/math/vec.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/base/gate.h"

/* Code that few surfaces need is not inlined: otherwise every surface would save registers for it.
 * Code that is worth inlining in each of its few call sites is. */
#define LOBE_RARE static __attribute__((noinline, unused))
#define LOBE_OFTEN static inline __attribute__((always_inline))

enum lobe_side { LOBE_SIDE_ABOVE, LOBE_SIDE_BELOW };

/* What the layers leave of what lies below them, between wo and wi (layering.h). */
struct cover {
    real lobe;                                      /* of lobes in general */
    real diffuse;                                   /* of Lambert's, whose mean over wi lambert_scale() takes care of */
#define LAYER_COVER(name, prefix, ...) real prefix; /* of this layer: what those above leave */
    BSDF_LAYER_MAP(LAYER_COVER)
#undef LAYER_COVER
};
#define LAYER_UNCOVERED(name, prefix, ...) .prefix = 1,
#define COVER_NONE ((struct cover){.lobe = 1, .diffuse = 1, BSDF_LAYER_MAP(LAYER_UNCOVERED)})

/* The result of sampling a lobe. */
enum lobe_result {
    LOBE_NOTHING, /* no sample */
    LOBE_SMOOTH,  /* out->wi, flags and eta_scale are set; value and density are to be evaluated */
    LOBE_DELTA,   /* ... and out->weight */
};

static const struct vec3 LOBE_BLACK = {0, 0, 0};

static inline int lobe_is_present(const struct bsdf *b, enum bsdf_lobe lobe) { return (int)(b->lobes >> lobe & 1); }

/* Do layers lie on wo's side, and on the other? They are on the outside of a refractive object and
 * on both sides of a thin wall. */
static inline int is_covered_near(const struct bsdf *b) { return !(b->material.refractive && b->material.inside); }
static inline int is_covered_far(const struct bsdf *b) { return !b->material.refractive || b->material.inside; }

/* x clamped to low..high; NaN becomes low. */
static inline real clamp_to(real x, real low, real high) { return real_min(real_max(x, low), high); }
static inline struct vec3 clamp_color(struct vec3 c, real high)
{
    return (struct vec3){clamp_to(c.x, 0, high), clamp_to(c.y, 0, high), clamp_to(c.z, 0, high)};
}

/* GGX divides by alpha^2. A narrower one is a mirror. */
static inline int alpha_is_smooth(real alpha) { return alpha < (SAFEGUARD(SMOOTH_MIRROR) ? BSDF_ALPHA_MIN : 0.0f); }

/* Index of the object's surroundings; and an index relative to it. */
static inline real index_outside(const struct bsdf_params *params)
{
    return calls_for(EFFECTS_ALL, EFFECT_NESTED_DIELECTRIC) && params->ior_outside > 1.0f
               ? real_min(params->ior_outside, BSDF_IOR_MAX) : 1.0f;
}
static inline real relative_index(real n, const struct bsdf_params *params)
{
    real outside = index_outside(params);
    return outside > 1.0f ? n / outside : n;
}

/* A layer of reflectance r whose light is reflected back with probability k: the geometric series. */
static inline real interreflected(real r, real k) { return r * (1.0f - k) / (1.0f - k * r); }
