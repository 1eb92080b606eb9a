/* Textures at a point of a triangle, and what is asked of a material without shading it: alpha and emission. */
#include <math.h>

#include "worker/render/bsdf/bsdf.h"
#include "worker/render/base/profile_scope.h"
#include "worker/render/surface/surface_parts.h"

/* The image's coordinates there; the footprint from the triangle's scale to the image's. */
static void surface_slot_coordinates(const struct render_slot *slot, const struct render_mesh *mesh,
                                     const uint32_t vertex[3], real b1, real b2, real *u_out, real *v_out,
                                     real *footprint)
{
    const float32 *uv = mesh->uv[slot->uv_set];
    real u = 0, v = 0, area = 0;

    if (uv) {
        const float32 *a = uv + 2 * (size_t)vertex[0], *b = uv + 2 * (size_t)vertex[1], *c = uv + 2 * (size_t)vertex[2];
        real b0 = 1 - b1 - b2;
        u = b0 * a[0] + b1 * b[0] + b2 * c[0];
        v = b0 * a[1] + b1 * b[1] + b2 * c[1];
        if (*footprint > 0)
            area = 0.5f * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
    }
    if (slot->transformed) {
        real u0 = u;
        u = slot->m[0][0] * u0 + slot->m[0][1] * v + slot->m[0][2];
        v = slot->m[1][0] * u0 + slot->m[1][1] * v + slot->m[1][2];
        area *= slot->m[0][0] * slot->m[1][1] - slot->m[0][1] * slot->m[1][0];
    }
    *u_out = u;
    *v_out = v;
    *footprint *= real_sqrt(real_abs(area));
}

struct texel slot_lookup(const struct render_slot *slot, const struct render_mesh *mesh, const uint32_t vertex[3],
                         real b1, real b2, real footprint, int srgb)
{
    real u, v;

    PROFILE_EFFECT(TEXTURE);
    surface_slot_coordinates(slot, mesh, vertex, b1, b2, &u, &v, &footprint);
    return texture_lookup(slot->image, &slot->texture, u, v, footprint, srgb);
}

void slot_place(const struct render_slot *slot, const struct render_mesh *mesh, const uint32_t vertex[3], real b1,
                real b2, real footprint, struct texture_place *place)
{
    real u, v;

    PROFILE_EFFECT(TEXTURE);
    surface_slot_coordinates(slot, mesh, vertex, b1, b2, &u, &v, &footprint);
    texture_place(place, slot->image, &slot->texture, u, v, footprint, slot->color);
}

real material_alpha(const struct render_material *material, const struct render_mesh *mesh, const uint32_t vertex[3],
                    real b1, real b2)
{
    real alpha = material->m.base_color[3];

    if (slot_is_read(&material->base_color))
        alpha *= slot_lookup(&material->base_color, mesh, vertex, b1, b2, 0, 1).a;
    if (mesh->colors) {
        const float32 *c = mesh->colors + 3;
        const real first = c[4 * (size_t)vertex[0]];
        /* Equal ones give exactly that value: it may be the cutoff. */
        alpha *= first + b1 * (c[4 * (size_t)vertex[1]] - first) + b2 * (c[4 * (size_t)vertex[2]] - first);
    }
    return alpha;
}

/* What a clearcoat lets out of the emission below it. */
static real emission_scale(const struct render_material *material, const struct render_mesh *mesh,
                           const uint32_t vertex[3], real b1, real b2, real cosine, real outside)
{
    real n = real_max(material->m.clearcoat_ior, 1) / real_max(outside, 1), f0 = (n - 1) / (n + 1), m = 1 - cosine;
    real coat = material->m.clearcoat;

    PROFILE_EFFECT(CLEARCOAT);
    if (slot_is_read(&material->clearcoat))
        coat *= slot_lookup(&material->clearcoat, mesh, vertex, b1, b2, 0, 0).r;
    f0 *= f0;
    return 1 - coat * (f0 + (bsdf_f90_of(f0) - f0) * (m * m * m * m * m));
}

struct vec3 material_emission(const struct render_material *material, const struct render_mesh *mesh,
                              const uint32_t vertex[3], real b1, real b2)
{
    struct vec3 emission = vec3_make(material->m.emission[0], material->m.emission[1], material->m.emission[2]);

    if (slot_is_read(&material->emission)) {
        struct texel texel = slot_lookup(&material->emission, mesh, vertex, b1, b2, 0, 1);
        emission = vec3_mul(emission, vec3_make(texel.r, texel.g, texel.b));
    }
    return emission;
}

struct vec3 material_emitted(const struct render_material *material, const struct render_mesh *mesh,
                             const uint32_t vertex[3], real b1, real b2, real cosine, real outside)
{
    struct vec3 radiance = material_emission(material, mesh, vertex, b1, b2);

    if (calls_for(EFFECTS_ALL, EFFECT_CLEARCOAT) && material->m.clearcoat > 0)
        radiance = vec3_scale(radiance, emission_scale(material, mesh, vertex, b1, b2, cosine, outside));
    return radiance;
}
