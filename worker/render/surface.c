#include "worker/render/surface.h"

#include <string.h>

#include "common/math/elementary.h"
#include "worker/render/charge.h"
#include "worker/render/exact.h"
#include "worker/render/has.h"
#include "worker/render/world.h"
#include "worker/render/world_motion.h"

/* The cosine to which a shading normal that faces away is bent. */
#define BEND_COSINE 1e-3f

/* Any of the effects that surface_layers sees to. */
#define HAS_LAYERS                                                                           \
    (HAS(ANISOTROPY) || HAS(CONDUCTOR) || HAS(CLEARCOAT) || HAS(SHEEN) || HAS(IRIDESCENCE) || \
     HAS(DIFFUSE_TRANSMISSION))

void world_triangle(const struct render_scene *scene, const struct world_instance *instance,
                    uint32_t triangle, float time, struct vec3 corner[3])
{
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    double c[3][3];

    world_corners(scene, instance, world_vertices(mesh, triangle), time, c);
    for (int k = 0; k < 3; k++)
        corner[k] = vec3_make((float)c[k][0], (float)c[k][1], (float)c[k][2]);
}

/* A lower bound of the distance to the nearest edge: the smallest weight's share of the least
 * height. */
static float surface_inset(double u, double v, double double_area, const double e1[3],
                           const double e2[3])
{
    double a = exact_dot(e1, e1), b = exact_dot(e2, e2), ab = exact_dot(e1, e2);
    double c = a + b - 2 * ab, w = 1 - u - v, least, longest;

    least = u < v ? u : v;
    least = w < least ? w : least;
    longest = a > b ? a : b;
    longest = c > longest ? c : longest;
    return longest > 0 ? (float)(least * double_area / sqrt(longest)) : 0;
}

void surface_from_hit(const struct render_scene *scene, const struct ray *ray,
                      const struct hit *hit, struct surface *s)
{
    double c[3][3], e1[3], e2[3], n[3], to_origin[3], pvec[3], qvec[3], p[3], d[3], o[3];
    double determinant, u, v, length, sign;

    exact_vec(ray->direction, d);
    exact_origin(ray, o);
    s->number = hit->instance;
    s->instance = &scene->instances[hit->instance];
    s->footprint = 0;
    s->other_count = 0;
    s->time = ray->time;
    s->material = &scene->materials[s->instance->material];
    s->mesh = &scene->meshes[s->instance->mesh];
    s->triangle = hit->triangle;
    s->vertex = world_vertices(s->mesh, hit->triangle);
    world_corners(scene, s->instance, s->vertex, ray->time, c);
    exact_sub(c[1], c[0], e1);
    exact_sub(c[2], c[0], e2);
    exact_sub(o, c[0], to_origin);
    exact_cross(e1, e2, n);
    length = sqrt(exact_dot(n, n));

    /* Moeller-Trumbore in double; the clamp only ever undoes rounding at an edge. */
    exact_cross(d, e2, pvec);
    exact_cross(to_origin, e1, qvec);
    determinant = exact_dot(e1, pvec);
    if (determinant != 0 && isfinite(1 / determinant)) {
        u = exact_dot(to_origin, pvec) / determinant;
        v = exact_dot(d, qvec) / determinant;
        u = u < 0 ? 0 : u > 1 ? 1 : u;
        v = v < 0 ? 0 : v > 1 - u ? 1 - u : v;
    } else {
        u = v = 1.0 / 3;
    }
    for (int a = 0; a < 3; a++)
        p[a] = c[0][a] + u * e1[a] + v * e2[a];
    s->b1 = (float)u;
    s->b2 = (float)v;
    s->t = (float)((p[0] - o[0]) * d[0] + (p[1] - o[1]) * d[1] + (p[2] - o[2]) * d[2]);
    s->p = exact_round(p, s->rest);
    s->area = (float)(0.5 * length);
    s->contacts = world_near_boundary(scene, s->p);
    s->inset = surface_inset(u, v, length, e1, e2);

    sign = s->instance->flipped ? -1 : 1;
    s->front = exact_dot(n, d) * sign < 0;
    sign = s->front ? sign : -sign;
    if (length > 0)
        s->ng = vec3_make((float)(n[0] / length * sign), (float)(n[1] / length * sign),
                          (float)(n[2] / length * sign));
    else
        s->ng = vec3_neg(ray->direction);
}

static struct vec3 surface_interpolate(const float *values, size_t stride,
                                       const uint32_t vertex[3], float b1, float b2)
{
    const float *a = values + stride * vertex[0], *b = values + stride * vertex[1],
                *c = values + stride * vertex[2];
    float b0 = 1 - b1 - b2;

    return vec3_make(b0 * a[0] + b1 * b[0] + b2 * c[0], b0 * a[1] + b1 * b[1] + b2 * c[1],
                     b0 * a[2] + b1 * b[2] + b2 * c[2]);
}

/* The same of vectors that deform with the mesh: mixed between the steps where it moves. */
static struct vec3 surface_deformed(const struct surface *s, const float *opening,
                                    const float *const *motion, size_t stride)
{
    struct vec3 from, to;
    float f;
    uint32_t segment;

    if (!HAS(MOTION_BLUR) || !HAS(DEFORMATION) || !motion)
        return surface_interpolate(opening, stride, s->vertex, s->b1, s->b2);
    CHARGE_SCOPE(MOTION_BLUR);
    segment = motion_segment(s->time, s->instance->motion_steps, &f);
    from = surface_interpolate(motion[segment], stride, s->vertex, s->b1, s->b2);
    to = surface_interpolate(motion[segment + 1], stride, s->vertex, s->b1, s->b2);
    return vec3_mad(vec3_scale(from, 1 - f), to, f);
}

static struct texel surface_texel(const struct surface *s, const struct world_slot *slot, int srgb)
{
    if (slot->shares_place) {
        CHARGE_SCOPE(TEXTURE);
        return texture_read(slot->image, &slot->texture, &s->place, srgb);
    }
    return world_slot_lookup(slot, s->mesh, s->vertex, s->b1, s->b2, s->footprint, srgb);
}

static const float *surface_tangents(const struct surface *s)
{
    return world_tangents(s->instance, s->mesh);
}

/* The tangent at the hit, world, unit and perpendicular to `n`; black where there is none. */
static struct vec3 surface_tangent(const struct surface *s, struct vec3 n)
{
    struct vec3 t = surface_deformed(s, surface_tangents(s), s->instance->motion_tangents, 4);

    if (!s->instance->skinned) {
        struct transform to_world = world_to_world_at(s->instance, s->time);
        t = transform_vector(&to_world, t);
    }
    return vec3_normalize(vec3_mad(t, n, -vec3_dot(n, t)));
}

static float surface_handedness(const struct surface *s)
{
    float w = surface_tangents(s)[4 * (size_t)s->vertex[0] + 3] < 0 ? -1.0f : 1.0f;

    return s->instance->flipped ? -w : w;
}

/* A normal map's normal, world, on the front side; `n` where there is no tangent. */
static struct vec3 surface_mapped_normal(const struct surface *s, const struct world_slot *slot,
                                         float scale, struct vec3 n)
{
    struct vec3 t = surface_tangent(s, n), b, front_ng = s->front ? s->ng : vec3_neg(s->ng);
    struct texel texel;
    float cosine;

    CHARGE_SCOPE(NORMAL_MAP);
    if (vec3_is_black(t))
        return n;
    texel = surface_texel(s, slot, 0);
    b = vec3_scale(vec3_cross(n, t), surface_handedness(s));
    b = vec3_normalize(vec3_add(vec3_add(vec3_scale(t, (texel.r * 2 - 1) * scale),
                                         vec3_scale(b, (texel.g * 2 - 1) * scale)),
                                vec3_scale(n, texel.b * 2 - 1)));
    if (vec3_is_black(b))
        return n;
    cosine = vec3_dot(b, front_ng);
    return cosine < 0 ? vec3_mad(b, front_ng, BEND_COSINE - cosine) : b;
}

/* The vertices' normal on the front side; the triangle's where they have none. */
static struct vec3 surface_vertex_normal(const struct surface *s)
{
    struct vec3 front_ng = s->front ? s->ng : vec3_neg(s->ng), n;
    const float *normals = world_normals(s->instance, s->mesh);

    if (!normals)
        return front_ng;
    n = surface_deformed(s, normals, s->instance->motion_normals, 3);
    if (!s->instance->skinned) {
        struct transform to_object = world_to_object_at(s->instance, s->time);
        n = transform_normal(&to_object, n);
    }
    n = vec3_normalize(n);
    if (vec3_is_black(n))
        return front_ng;
    return vec3_dot(n, front_ng) < 0 ? vec3_neg(n) : n; /* normals that disagree with the winding */
}

/* To the ray's side, and bent: first a normal that faces away from wo, then, where something
 * reflects, one whose mirror direction would dive under the geometric surface (the black rims of
 * coarse smooth meshes). */
static struct vec3 surface_bent_normal(const struct surface *s, struct vec3 n, struct vec3 wo,
                                       int reflects)
{
    struct vec3 mirror;
    float cosine;

    n = vec3_normalize(s->front ? n : vec3_neg(n));
    cosine = vec3_dot(n, wo);
    if (cosine < BEND_COSINE) {
        n = vec3_normalize(vec3_mad(n, wo, BEND_COSINE - cosine));
        cosine = vec3_dot(n, wo);
    }
    if (!reflects)
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

static void surface_texture_params(const struct surface *s, struct bsdf_params *params)
{
    const struct world_material *material = s->material;
    struct texel texel;

    if (material->base_color.image) {
        texel = surface_texel(s, &material->base_color, 1);
        params->base_color = vec3_mul(params->base_color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (material->metallic_roughness.image) {
        float roughness;
        texel = surface_texel(s, &material->metallic_roughness, 0);
        roughness = material->m.roughness * texel.g;
        params->alpha = roughness * roughness;
        params->metallic *= texel.b;
    }
    if (material->specular.image)
        params->specular *= surface_texel(s, &material->specular, 0).a;
    if (material->specular_color.image) {
        texel = surface_texel(s, &material->specular_color, 1);
        params->specular_color =
            vec3_mul(params->specular_color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (material->transmission.image)
        params->transmission *= surface_texel(s, &material->transmission, 0).r;
}

/* Factor times texture of the extensions' scalars; 0 where the factor is. */
static float surface_factor(const struct surface *s, float factor, const struct world_slot *slot,
                            int channel)
{
    struct texel texel;

    if (factor == 0 || !HAS(TEXTURE) || !slot->image)
        return factor;
    texel = surface_texel(s, slot, 0);
    return factor * (channel == 0 ? texel.r : channel == 1 ? texel.g : texel.a);
}

static struct vec3 surface_color(const struct surface *s, const float factor[3],
                                 const struct world_slot *slot)
{
    struct vec3 color = {factor[0], factor[1], factor[2]};
    struct texel texel;

    if (!HAS(TEXTURE) || !slot->image || vec3_is_black(color))
        return color;
    texel = surface_texel(s, slot, 1);
    return vec3_mul(color, vec3_make(texel.r, texel.g, texel.b));
}

static float square(float x)
{
    return x * x;
}

/* Strength and direction of the anisotropy: the frame's x is turned along it. */
static void surface_anisotropy(struct surface *s, struct bsdf_params *params)
{
    const struct scene_material *m = &s->material->m;
    struct vec3 t = surface_tangent(s, s->frame.n), b;
    float strength = m->anisotropy, x = 1, y = 0, c, sine;

    if (vec3_is_black(t))
        return;
    if (HAS(TEXTURE) && s->material->anisotropy.image) {
        struct texel texel = surface_texel(s, &s->material->anisotropy, 0);
        x = texel.r * 2 - 1;
        y = texel.g * 2 - 1;
        strength *= texel.b;
    }
    if (m->anisotropy_rotation_rad != 0) {
        float x0 = x;
        det_sincos(m->anisotropy_rotation_rad, &sine, &c);
        x = c * x0 - sine * y;
        y = sine * x0 + c * y;
    }
    b = vec3_scale(vec3_cross(s->frame.n, t),
                   s->front ? surface_handedness(s) : -surface_handedness(s));
    t = vec3_normalize(vec3_add(vec3_scale(t, x), vec3_scale(b, y)));
    if (vec3_is_black(t) || !(strength > 0))
        return;
    s->frame.s = t;
    s->frame.t = vec3_cross(s->frame.n, t);
    params->alpha_stretched = params->alpha + (1 - params->alpha) * strength * strength;
}

static void surface_clearcoat(const struct render_scene *scene, const struct surface *s,
                              struct vec3 wo, struct vec3 vertex_normal,
                              struct bsdf_params *params)
{
    const struct world_material *material = s->material;
    struct vec3 n = vertex_normal;

    params->clearcoat = surface_factor(s, material->m.clearcoat, &material->clearcoat, 0);
    params->clearcoat_alpha = square(surface_factor(s, material->m.clearcoat_roughness,
                                                    &material->clearcoat_roughness, 1));
    params->clearcoat_ior = material->m.clearcoat_ior;
    params->clearcoat_normal = vec3_make(0, 0, 1);
    if (!ACTIVE(scene, NORMAL_MAP) || !s->mesh->tangents)
        return;
    if (material->clearcoat_normal.image && material->m.clearcoat_normal_scale != 0)
        n = surface_mapped_normal(s, &material->clearcoat_normal,
                                  material->m.clearcoat_normal_scale, n);
    else if (!(material->flags & MATERIAL_NORMAL_MAP))
        return;
    params->clearcoat_normal =
        vec3_normalize(frame_to_local(&s->frame, surface_bent_normal(s, n, wo, 1)));
}

/* What few materials have. */
static void surface_layers(const struct render_scene *scene, struct surface *s, struct vec3 wo,
                           struct vec3 vertex_normal, struct bsdf_params *params)
{
    const struct world_material *material = s->material;
    const struct scene_material *m = &material->m;

    if (ACTIVE(scene, ANISOTROPY) && m->anisotropy > 0 && surface_tangents(s)) {
        CHARGE_SCOPE(ANISOTROPY);
        surface_anisotropy(s, params);
    }
    if (ACTIVE(scene, CONDUCTOR) && m->kind == MATERIAL_CONDUCTOR) {
        CHARGE_SCOPE(CONDUCTOR);
        params->conductor = 1;
        params->eta = vec3_make(m->conductor_eta[0], m->conductor_eta[1], m->conductor_eta[2]);
        params->k = vec3_make(m->conductor_k[0], m->conductor_k[1], m->conductor_k[2]);
    }
    if (ACTIVE(scene, CLEARCOAT) && m->clearcoat > 0) {
        CHARGE_SCOPE(CLEARCOAT);
        surface_clearcoat(scene, s, wo, vertex_normal, params);
    }
    if (ACTIVE(scene, SHEEN) && (m->sheen_color[0] > 0 || m->sheen_color[1] > 0 ||
                                 m->sheen_color[2] > 0)) {
        CHARGE_SCOPE(SHEEN);
        params->sheen_color = surface_color(s, m->sheen_color, &material->sheen_color);
        params->sheen_alpha =
            square(surface_factor(s, m->sheen_roughness, &material->sheen_roughness, 3));
    }
    if (ACTIVE(scene, IRIDESCENCE) && m->iridescence > 0) {
        float thickness = 1;
        CHARGE_SCOPE(IRIDESCENCE);
        params->iridescence = surface_factor(s, m->iridescence, &material->iridescence, 0);
        params->iridescence_ior = m->iridescence_ior;
        if (HAS(TEXTURE) && material->iridescence_thickness.image)
            thickness = surface_texel(s, &material->iridescence_thickness, 0).g;
        params->iridescence_thickness_nm =
            m->iridescence_thickness_min_nm +
            (m->iridescence_thickness_max_nm - m->iridescence_thickness_min_nm) * thickness;
    }
    if (ACTIVE(scene, DIFFUSE_TRANSMISSION) && m->diffuse_transmission > 0) {
        CHARGE_SCOPE(DIFFUSE_TRANSMISSION);
        params->diffuse_transmission =
            surface_factor(s, m->diffuse_transmission, &material->diffuse_transmission, 3);
        params->diffuse_transmission_color = surface_color(
            s, m->diffuse_transmission_color, &material->diffuse_transmission_color);
    }
    params->base_interreflection = m->base_interreflection;
    params->thin_slab = m->thin_slab;
}

void surface_resolve_mix(const struct render_scene *scene, struct surface *s, float u)
{
    /* A mix refers to lower materials only, so this ends. */
    while (s->material->m.kind == MATERIAL_MIX) {
        CHARGE_SCOPE(MATERIAL_MIX);
        const struct world_material *mix = s->material;
        float amount = surface_factor(s, mix->m.mix_amount, &mix->mix, 0);
        int second;

        amount = amount > 0 ? (amount < 1 ? amount : 1) : 0;
        second = u < amount;
        /* What is left of the number is as good as a new one. */
        u = second ? u / amount : (u - amount) / (1 - amount);
        u = u > 0 ? (u < ONE_MINUS_EPSILON ? u : ONE_MINUS_EPSILON) : 0;
        s->material = &scene->materials[mix->m.mix_material[second]];
    }
}

void surface_shade(const struct render_scene *scene, struct surface *s, struct vec3 wo,
                   struct bsdf_params *params)
{
    const struct scene_material *m = &s->material->m;
    int mapped = HAS(NORMAL_MAP) && (s->material->flags & MATERIAL_NORMAL_MAP) &&
                 ACTIVE(scene, NORMAL_MAP) && s->mesh->tangents;
    struct vec3 n = s->ng;

    memset(params, 0, sizeof *params);
    params->base_color = vec3_make(m->base_color[0], m->base_color[1], m->base_color[2]);
    params->metallic = m->metallic;
    params->alpha = m->roughness * m->roughness;
    params->ior = m->ior;
    params->specular = m->specular;
    params->specular_color =
        vec3_make(m->specular_color[0], m->specular_color[1], m->specular_color[2]);
    params->transmission = m->transmission;
    params->refractive = m->refractive;
    params->inside = m->refractive && !s->front;
    params->single_scattering = !ACTIVE(scene, MULTIPLE_SCATTERING);
    if ((HAS(TEXTURE) || HAS(NORMAL_MAP)) && s->material->lead)
        world_slot_place(s->material->lead, s->mesh, s->vertex, s->b1, s->b2, s->footprint,
                         s->material->lead_srgb, &s->place);
    if (HAS(TEXTURE) && s->material->flags & MATERIAL_TEXTURED)
        surface_texture_params(s, params);
    if (ACTIVE(scene, VERTEX_COLOR) && s->mesh->colors)
        params->base_color = vec3_mul(params->base_color, surface_vertex_color(s));
    if (s->mesh->normals || mapped) {
        struct vec3 vertex_normal = surface_vertex_normal(s);
        /* A Lambert reflector has no mirror direction: its normal is what the file says. */
        int reflects = params->metallic > 0 || params->specular > 0 || params->transmission > 0 ||
                       s->material->flags & MATERIAL_LAYERED;
        n = surface_bent_normal(s, mapped ? surface_mapped_normal(s, &s->material->normal,
                                                                  m->normal_scale, vertex_normal)
                                          : vertex_normal, wo, reflects);
    }
    s->frame = frame_from_normal(n);
    if (HAS_LAYERS && s->material->flags & MATERIAL_LAYERED)
        surface_layers(scene, s, wo, surface_vertex_normal(s), params);
}

struct vec3 surface_vertex_color(const struct surface *s)
{
    CHARGE_SCOPE(VERTEX_COLOR);
    return surface_interpolate(s->mesh->colors, 4, s->vertex, s->b1, s->b2);
}

void surface_uv(const struct surface *s, float *u, float *v)
{
    const float *uv = s->mesh->uv[0], *a, *b, *c;
    float b0 = 1 - s->b1 - s->b2;

    *u = *v = 0;
    if (!uv)
        return;
    a = uv + 2 * (size_t)s->vertex[0];
    b = uv + 2 * (size_t)s->vertex[1];
    c = uv + 2 * (size_t)s->vertex[2];
    *u = b0 * a[0] + s->b1 * b[0] + s->b2 * c[0];
    *v = b0 * a[1] + s->b1 * b[1] + s->b2 * c[1];
}

void surface_leave(const struct surface *s, struct vec3 direction, struct ray *ray)
{
    ray->origin = s->p;
    ray->direction = direction;
    ray->t_max = INFINITY;
    ray->time = s->time;
    memcpy(ray->rest, s->rest, sizeof ray->rest);
    ray->left_count = 1 + s->other_count;
    ray->left[0] = (struct hit){s->number, s->triangle};
    for (uint32_t i = 0; i < s->other_count; i++)
        ray->left[1 + i] = s->others[i];
    ray->reaches = 0;
    ray->contacts = s->contacts;
    ray->inset = s->inset;
    ray->off = vec3_dot(direction, s->ng) < 0 ? vec3_neg(s->ng) : s->ng;
}

/* ---- lookups that need the triangle ------------------------------------------------------- */
/* The image's coordinates there; the footprint from the triangle's scale to the image's. */
static void surface_slot_coordinates(const struct world_slot *slot, const struct world_mesh *mesh,
                             const uint32_t vertex[3], float b1, float b2, float *u_out,
                             float *v_out, float *footprint)
{
    const float *uv = mesh->uv[slot->uv_set];
    float u = 0, v = 0, area = 0;

    if (uv) {
        const float *a = uv + 2 * (size_t)vertex[0], *b = uv + 2 * (size_t)vertex[1],
                    *c = uv + 2 * (size_t)vertex[2];
        float b0 = 1 - b1 - b2;
        u = b0 * a[0] + b1 * b[0] + b2 * c[0];
        v = b0 * a[1] + b1 * b[1] + b2 * c[1];
        if (*footprint > 0)
            area = 0.5f * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
    }
    if (slot->transformed) {
        float u0 = u;
        u = slot->m[0][0] * u0 + slot->m[0][1] * v + slot->m[0][2];
        v = slot->m[1][0] * u0 + slot->m[1][1] * v + slot->m[1][2];
        area *= slot->m[0][0] * slot->m[1][1] - slot->m[0][1] * slot->m[1][0];
    }
    *u_out = u;
    *v_out = v;
    *footprint *= sqrtf(fabsf(area));
}

struct texel world_slot_lookup(const struct world_slot *slot, const struct world_mesh *mesh,
                               const uint32_t vertex[3], float b1, float b2, float footprint,
                               int srgb)
{
    float u, v;

    CHARGE_SCOPE(TEXTURE);
    surface_slot_coordinates(slot, mesh, vertex, b1, b2, &u, &v, &footprint);
    return texture_lookup(slot->image, &slot->texture, u, v, footprint, srgb);
}

void world_slot_place(const struct world_slot *slot, const struct world_mesh *mesh,
                      const uint32_t vertex[3], float b1, float b2, float footprint, int srgb,
                      struct texture_place *place)
{
    float u, v;

    CHARGE_SCOPE(TEXTURE);
    surface_slot_coordinates(slot, mesh, vertex, b1, b2, &u, &v, &footprint);
    texture_place(place, slot->image, &slot->texture, u, v, footprint, srgb);
}

float world_alpha(const struct world_material *material, const struct world_mesh *mesh,
                  const uint32_t vertex[3], float b1, float b2)
{
    float alpha = material->m.base_color[3];

    if (HAS(TEXTURE) && material->base_color.image)
        alpha *= world_slot_lookup(&material->base_color, mesh, vertex, b1, b2, 0, 1).a;
    if (mesh->colors) {
        const float *c = mesh->colors;
        alpha *= (1 - b1 - b2) * c[4 * (size_t)vertex[0] + 3] + b1 * c[4 * (size_t)vertex[1] + 3] +
                 b2 * c[4 * (size_t)vertex[2] + 3];
    }
    return alpha;
}

float world_emission_scale(const struct world_material *material, const struct world_mesh *mesh,
                           const uint32_t vertex[3], float b1, float b2, float cosine)
{
    float n = float_max(material->m.clearcoat_ior, 1), f0 = (n - 1) / (n + 1), m = 1 - cosine;
    float coat = material->m.clearcoat;

    CHARGE_SCOPE(CLEARCOAT);
    if (HAS(TEXTURE) && material->clearcoat.image)
        coat *= world_slot_lookup(&material->clearcoat, mesh, vertex, b1, b2, 0, 0).r;
    f0 *= f0;
    return 1 - coat * (f0 + (bsdf_f90_of(f0) - f0) * (m * m * m * m * m));
}

struct vec3 world_emission(const struct world_material *material, const struct world_mesh *mesh,
                           const uint32_t vertex[3], float b1, float b2)
{
    struct vec3 emission =
        vec3_make(material->m.emission[0], material->m.emission[1], material->m.emission[2]);

    if (HAS(TEXTURE) && material->emission.image) {
        struct texel texel = world_slot_lookup(&material->emission, mesh, vertex, b1, b2, 0, 1);
        emission = vec3_mul(emission, vec3_make(texel.r, texel.g, texel.b));
    }
    return emission;
}
