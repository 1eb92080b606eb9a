/* The shading frame at a hit, and the material's values there: factors times textures. */
#include <string.h>

#include "common/base/safeguard.h"
#include "common/math/elementary.h"
#include "common/scene/material.h"
#include "worker/render/base/fault.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/surface/surface_parts.h"
#include "worker/render/surface/render_motion.h"

/* The cosine to which a shading normal that faces away is bent. */
#define BEND_COSINE REAL(1e-3)

/* ---- the normal ----------------------------------------------------------------------------- */

static struct vec3 surface_interpolate(const float32 *values, size_t stride, const uint32_t vertex[3], real b1, real b2)
{
    const float32 *a = values + stride * vertex[0], *b = values + stride * vertex[1], *c = values + stride * vertex[2];
    real b0 = 1 - b1 - b2;

    return vec3_make(b0 * a[0] + b1 * b[0] + b2 * c[0], b0 * a[1] + b1 * b[1] + b2 * c[1],
                     b0 * a[2] + b1 * b[2] + b2 * c[2]);
}

/* Mixed between the steps of a mesh that moves. Apart, for most do not. */
static __attribute__((noinline)) struct vec3 surface_moving(const struct surface *s, const float32 *const *motion,
                                                            size_t stride)
{
    struct vec3 from, to;
    real f;
    uint32_t segment = motion_segment(s->time, s->instance->motion_steps, &f);

    from = surface_interpolate(motion[segment], stride, s->vertex, s->b1, s->b2);
    to = surface_interpolate(motion[segment + 1], stride, s->vertex, s->b1, s->b2);
    return vec3_mad(vec3_scale(from, 1 - f), to, f);
}

/* The same of vectors that deform with the mesh. */
static inline struct vec3 surface_deformed(const struct surface *s, const float32 *opening,
                                           const float32 *const *motion, size_t stride)
{
    if (calls_for(EFFECTS_ALL, EFFECT_DEFORMATION) && motion)
        return surface_moving(s, motion, stride);
    return surface_interpolate(opening, stride, s->vertex, s->b1, s->b2);
}

/* A texture's texel at the hit; most of a material's textures are read at one place. */
static struct texel surface_texel(const struct surface *s, const struct render_slot *slot)
{
    if (slot->shares_place) {
        PROFILE_EFFECT(TEXTURE);
        return texture_read(slot->image, &slot->texture, &s->place, slot->color);
    }
    return slot_lookup(slot, s->mesh, s->vertex, s->b1, s->b2, s->footprint, slot->color);
}

static const float32 *surface_tangents(const struct surface *s) { return instance_tangents(s->instance, s->mesh); }

/* The tangent at the hit, world, unit and perpendicular to `n`; black where there is none. */
static struct vec3 surface_tangent(const struct surface *s, struct vec3 n)
{
    struct vec3 t = surface_deformed(s, surface_tangents(s), s->instance->motion_tangents, 4);

    if (!s->instance->skinned) {
        struct transform to_world = instance_to_world_at(s->instance, s->time);
        t = transform_vector(&to_world, t);
    }
    return vec3_normalize(vec3_mad(t, n, -vec3_dot(n, t)));
}

static real surface_handedness(const struct surface *s)
{
    real w = surface_tangents(s)[4 * (size_t)s->vertex[0] + 3] < 0 ? -1.0f : 1.0f;

    return s->instance->flipped ? -w : w;
}

/* Only meshes with tangents say which way a normal map lies. */
static int surface_takes_normal_maps(const struct render_scene *scene, const struct surface *s)
{
    return calls_for(scene->effects, EFFECT_NORMAL_MAP) && s->mesh->tangents;
}

/* A normal map's normal, world, on the front side; `n` where there is no tangent. */
static struct vec3 surface_mapped_normal(const struct surface *s, const struct render_slot *slot, real scale,
                                         struct vec3 n)
{
    struct vec3 t = surface_tangent(s, n), b, front_ng = s->front ? s->ng : vec3_neg(s->ng);
    struct texel texel;
    real cosine;

    PROFILE_EFFECT(NORMAL_MAP);
    if (vec3_is_black(t))
        return n;
    texel = surface_texel(s, slot);
    b = vec3_scale(vec3_cross(n, t), surface_handedness(s));
    b = vec3_normalize(
        vec3_add(vec3_add(vec3_scale(t, (texel.r * 2 - 1) * scale), vec3_scale(b, (texel.g * 2 - 1) * scale)),
                 vec3_scale(n, texel.b * 2 - 1)));
    if (vec3_is_black(b))
        return n;
    cosine = vec3_dot(b, front_ng);
    return cosine < 0 ? vec3_mad(b, front_ng, BEND_COSINE - cosine) : b;
}

/* A stretched face's normal is not the stretched normal. */
static inline struct vec3 surface_normal_to_world(const struct surface *s, struct vec3 n)
{
    if (SAFEGUARD(NORMAL_OF_STRETCHED)) {
        struct transform to_object = instance_to_object_at(s->instance, s->time);
        return transform_normal(&to_object, n);
    } else {
        struct transform to_world = instance_to_world_at(s->instance, s->time);
        return transform_vector(&to_world, n);
    }
}

static inline struct vec3 vertex_normal(const struct surface *s)
{
    struct vec3 front_ng = s->front ? s->ng : vec3_neg(s->ng), n;
    const float32 *normals = instance_normals(s->instance, s->mesh);

    if (!normals || s->instance->shape)
        return front_ng;
    n = surface_deformed(s, normals, s->instance->motion_normals, 3);
    if (!s->instance->skinned) {
        n = surface_normal_to_world(s, n);
    }
    n = vec3_normalize(n);
    if (vec3_is_black(n) && SAFEGUARD(NORMAL_ZERO))
        return front_ng;
    return vec3_dot(n, front_ng) < 0 ? vec3_neg(n) : n; /* normals that disagree with the winding */
}

struct vec3 surface_vertex_normal(const struct surface *s) { return vertex_normal(s); }

/* To the ray's side, and bent: first a normal that faces away from wo, then, where something reflects, one whose mirror
 * direction would dive under the geometric surface (the black rims of coarse smooth meshes). */
static struct vec3 surface_bent_normal(const struct surface *s, struct vec3 n, struct vec3 wo, int reflects)
{
    struct vec3 mirror;
    real cosine;

    n = vec3_normalize(s->front ? n : vec3_neg(n));
    cosine = vec3_dot(n, wo);
    if (cosine < BEND_COSINE) {
        n = vec3_normalize(vec3_mad(n, wo, BEND_COSINE - cosine));
        cosine = vec3_dot(n, wo);
    }
    if (!reflects || !SAFEGUARD(MIRROR_ABOVE))
        return n;
    mirror = vec3_sub(vec3_scale(n, 2 * cosine), wo);
    cosine = vec3_dot(mirror, s->ng);
    if (cosine < BEND_COSINE) {
        struct vec3 lifted = vec3_normalize(vec3_mad(mirror, s->ng, BEND_COSINE - cosine));
        struct vec3 bent = vec3_normalize(vec3_add(lifted, wo));
        if (vec3_dot(bent, wo) > 0)
            n = bent;
    }
    return n;
}

/* ---- the material's values ------------------------------------------------------------------ */

static struct vec3 rgb(const float32 color[3]) { return vec3_make(color[0], color[1], color[2]); }

static real square(real x) { return x * x; }

/* Factor times one channel of the texture; 0 where the factor is. */
static real surface_scalar(const struct surface *s, real factor, const struct render_slot *slot,
                           int channel /* enum material_channel */)
{
    struct texel texel;

    if (factor == 0 || !slot_is_read(slot))
        return factor;
    texel = surface_texel(s, slot);
    return factor * (channel == CHANNEL_RED     ? texel.r
                     : channel == CHANNEL_GREEN ? texel.g
                     : channel == CHANNEL_BLUE  ? texel.b
                                                : texel.a);
}

/* A value whose texture has its name. */
#define SURFACE_FACTOR(s, name) \
    surface_scalar(s, (s)->material->m.name, &(s)->material->name, CHANNEL_OF_##name)

static struct vec3 surface_color(const struct surface *s, const float32 factor[3], const struct render_slot *slot)
{
    struct vec3 color = rgb(factor);
    struct texel texel;

    if (!slot_is_read(slot) || vec3_is_black(color))
        return color;
    texel = surface_texel(s, slot);
    return vec3_mul(color, vec3_make(texel.r, texel.g, texel.b));
}

/* The factors alone. */
static void surface_base(const struct scene_material *m, struct bsdf_params *params)
{
    params->base_color = rgb(m->base_color);
    params->metallic = m->metallic;
    params->alpha = square(m->roughness);
    params->ior = m->ior;
    params->specular = m->specular;
    params->specular_color = rgb(m->specular_color);
    params->transmission = m->transmission;
    params->refractive = m->refractive;
}

/* The same times the textures. */
static void surface_base_textures(struct surface *s, struct bsdf_params *params)
{
    const struct render_material *material = s->material;
    const struct scene_material *m = &material->m;

    slot_place(material->lead, s->mesh, s->vertex, s->b1, s->b2, s->footprint, &s->place);
    params->base_color = surface_color(s, m->base_color, &material->base_color);
    if (material->metallic_roughness.image) {
        struct texel texel = surface_texel(s, &material->metallic_roughness);
        params->alpha = square(m->roughness * texel.g);
        params->metallic *= texel.b;
    }
    params->specular = SURFACE_FACTOR(s, specular);
    params->specular_color = surface_color(s, m->specular_color, &material->specular_color);
    params->transmission = SURFACE_FACTOR(s, transmission);
}

/* ---- layers: what few materials have -------------------------------------------------------- */

/* What a layer is read from. */
struct surface_view {
    const struct render_scene *scene;
    struct vec3 wo;            /* unit, world */
    struct vec3 vertex_normal; /* as surface_vertex_normal */
};

/* Strength and direction of the anisotropy: the frame's x is turned along it. */
static void surface_anisotropy(const struct surface_view *view, struct surface *s, struct bsdf_params *params)
{
    const struct scene_material *m = &s->material->m;
    struct vec3 t, b;
    real strength = m->anisotropy, x = 1, y = 0, c, sine;

    (void)view;
    if (!surface_tangents(s))
        return;
    t = surface_tangent(s, s->basis.n);
    if (vec3_is_black(t))
        return;
    if (slot_is_read(&s->material->anisotropy)) {
        struct texel texel = surface_texel(s, &s->material->anisotropy);
        x = texel.r * 2 - 1;
        y = texel.g * 2 - 1;
        strength *= texel.b;
    }
    if (m->anisotropy_rotation_rad != 0) {
        real x0 = x;
        real_sincos(m->anisotropy_rotation_rad, &sine, &c);
        x = c * x0 - sine * y;
        y = sine * x0 + c * y;
    }
    b = vec3_scale(vec3_cross(s->basis.n, t), s->front ? surface_handedness(s) : -surface_handedness(s));
    t = vec3_normalize(vec3_add(vec3_scale(t, x), vec3_scale(b, y)));
    if (vec3_is_black(t) || !(strength > 0))
        return;
    s->basis.s = t;
    s->basis.t = vec3_cross(s->basis.n, t);
    params->alpha_stretched = params->alpha + (1 - params->alpha) * strength * strength;
}

static void surface_conductor(const struct surface_view *view, struct surface *s, struct bsdf_params *params)
{
    (void)view;
    params->conductor = 1;
    params->eta = rgb(s->material->m.conductor_eta);
    params->k = rgb(s->material->m.conductor_k);
}

/* The coat's own normal map bends it; without one it has the vertices' normal, which is the base's
 * unless that is mapped. */
static struct vec3 surface_coat_normal(const struct surface_view *view, const struct surface *s)
{
    const struct render_material *material = s->material;
    struct vec3 n = view->vertex_normal;

    if (!surface_takes_normal_maps(view->scene, s))
        return vec3_make(0, 0, 1);
    if (material->clearcoat_normal.image)
        n = surface_mapped_normal(s, &material->clearcoat_normal, material->m.clearcoat_normal_scale, n);
    else if (!(material->flags & MATERIAL_NORMAL_MAP))
        return vec3_make(0, 0, 1);
    return vec3_normalize(basis_to_local(&s->basis, surface_bent_normal(s, n, view->wo, 1)));
}

static void surface_clearcoat(const struct surface_view *view, struct surface *s, struct bsdf_params *params)
{
    params->clearcoat_alpha = square(SURFACE_FACTOR(s, clearcoat_roughness));
    params->clearcoat_ior = s->material->m.clearcoat_ior;
    params->clearcoat_normal = surface_coat_normal(view, s);
}

static void surface_sheen(const struct surface_view *view, struct surface *s, struct bsdf_params *params)
{
    const struct render_material *material = s->material;

    (void)view;
    params->sheen_color = surface_color(s, material->m.sheen_color, &material->sheen_color);
    params->sheen_alpha = square(SURFACE_FACTOR(s, sheen_roughness));
}

static void surface_iridescence(const struct surface_view *view, struct surface *s, struct bsdf_params *params)
{
    const struct render_material *material = s->material;
    const struct scene_material *m = &material->m;

    (void)view;
    params->iridescence_ior = m->iridescence_ior;
    params->iridescence_thickness_nm =
        m->iridescence_thickness_min_nm +
        (m->iridescence_thickness_max_nm - m->iridescence_thickness_min_nm) *
            surface_scalar(s, 1, &material->iridescence_thickness, CHANNEL_OF_iridescence_thickness_min_nm);
}

static void surface_diffuse_transmission(const struct surface_view *view, struct surface *s, struct bsdf_params *params)
{
    const struct render_material *material = s->material;

    (void)view;
    params->diffuse_transmission_color =
        surface_color(s, material->m.diffuse_transmission_color, &material->diffuse_transmission_color);
}

/* X(effect, function, does the material `m` have it?), in the order in which they are read: the
 * anisotropy turns the frame in which the coat's normal is given. */
#define SURFACE_LAYERS(X)                                                                         \
    X(ANISOTROPY, surface_anisotropy, m->anisotropy > 0)                                          \
    X(CONDUCTOR, surface_conductor, m->kind == MATERIAL_CONDUCTOR)                                \
    X(CLEARCOAT, surface_clearcoat, m->clearcoat > 0)                                             \
    X(SHEEN, surface_sheen, !scene_color_is(m->sheen_color, 0))                                   \
    X(IRIDESCENCE, surface_iridescence, m->iridescence > 0)                                       \
    X(DIFFUSE_TRANSMISSION, surface_diffuse_transmission, m->diffuse_transmission > 0)

#define SURFACE_LAYER_BIT(effect, function, has) | (uint64_t)1 << EFFECT_BIT_##effect
#define SURFACE_FACTOR_NAME(name) name
#define SURFACE_FACTOR_BIT(effect, name) | (uint64_t)1 << EFFECT_BIT_##effect
#define SURFACE_LAYER_EFFECTS \
    (0 SURFACE_LAYERS(SURFACE_LAYER_BIT) BSDF_FACTOR_MAP(SURFACE_FACTOR_BIT, SURFACE_FACTOR_NAME))

/* Apart, or what they keep in registers would be saved for every surface. */
static __attribute__((noinline)) void surface_layers(const struct render_scene *scene, struct surface *s,
                                                     struct vec3 wo, struct bsdf_params *params)
{
    const struct scene_material *m = &s->material->m;
    const struct surface_view view = {scene, wo, vertex_normal(s)};

#define SURFACE_FACTOR_READ(effect, name)       \
    if (calls_for(scene->effects, EFFECT_##effect) && m->name > 0) { \
        PROFILE_EFFECT(effect);                   \
        params->name = SURFACE_FACTOR(s, name); \
    }
    BSDF_FACTOR_MAP(SURFACE_FACTOR_READ, SURFACE_FACTOR_NAME)
#undef SURFACE_FACTOR_READ
#define SURFACE_LAYER_READ(effect, function, has) \
    if (calls_for(scene->effects, EFFECT_##effect) && (has)) {         \
        PROFILE_EFFECT(effect);                     \
        function(&view, s, params);               \
    }
    SURFACE_LAYERS(SURFACE_LAYER_READ)
#undef SURFACE_LAYER_READ
    params->base_interreflection = m->base_interreflection;
    params->thin_slab = m->thin_slab;
}

/* ---- all of it ------------------------------------------------------------------------------ */

void surface_resolve_mix(const struct render_scene *scene, struct surface *s, real u)
{
    /* A mix refers to lower materials only, so this ends. */
    while (s->material->m.kind == MATERIAL_MIX) {
        const struct render_material *mix = s->material;
        real amount = surface_scalar(s, mix->m.mix_amount, &mix->mix, CHANNEL_OF_mix_amount);
        int second;

        amount = amount > 0 ? (amount < 1 ? amount : 1) : 0;
        second = u < amount;
        /* What is left of the number is as good as a new one. */
        u = second ? u / amount : (u - amount) / (1 - amount);
        u = u > 0 ? (u < REAL_BELOW_ONE ? u : REAL_BELOW_ONE) : 0;
        s->material = &scene->materials[mix->m.mix_material[second]];
    }
}

/* The shading normal on the ray's side. */
static struct vec3 surface_normal(const struct render_scene *scene, const struct surface *s, struct vec3 wo,
                                  const struct bsdf_params *params)
{
    const struct render_material *material = s->material;
    int mapped = material->flags & MATERIAL_NORMAL_MAP && surface_takes_normal_maps(scene, s);
    struct vec3 n;
    int reflects;

    if (!s->mesh->normals && !mapped)
        return s->ng;
    /* A Lambert reflector has no mirror direction: its normal is what the file says. */
    reflects =
        params->metallic > 0 || params->specular > 0 || params->transmission > 0 || material->flags & MATERIAL_LAYERED;
    n = vertex_normal(s);
    if (mapped)
        n = surface_mapped_normal(s, &material->normal, material->m.normal_scale, n);
    return surface_bent_normal(s, n, wo, reflects);
}

void surface_shade(const struct render_scene *scene, struct surface *s, struct vec3 wo, struct bsdf_params *params)
{
    PROFILE_STAGE(SURFACE);
    memset(params, 0, sizeof *params);
    surface_base(&s->material->m, params);
    params->inside = params->refractive && !s->front;
    params->single_scattering = !calls_for(scene->effects, EFFECT_MULTIPLE_SCATTERING);
    if (calls_for(EFFECTS_ALL, EFFECT_TEXTURE) && s->material->lead)
        surface_base_textures(s, params);
    if (calls_for(scene->effects, EFFECT_VERTEX_COLOR) && s->mesh->colors)
        params->base_color = vec3_mul(params->base_color, surface_vertex_color(s));
    s->basis = basis_from_normal(surface_normal(scene, s, wo, params));
    if (calls_for(EFFECTS_ALL, SURFACE_LAYER_EFFECTS) && s->material->flags & MATERIAL_LAYERED)
        surface_layers(scene, s, wo, params);
    if (FAULT(NAN_BASIS))
        s->basis.n.x = NAN;
}

struct vec3 surface_vertex_color(const struct surface *s)
{
    PROFILE_EFFECT(VERTEX_COLOR);
    return surface_interpolate(s->mesh->colors, 4, s->vertex, s->b1, s->b2);
}
