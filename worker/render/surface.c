#include "worker/render/surface.h"

#include <string.h>

#include "worker/render/world.h"

/* In units of 2^-24 of the largest coordinate in play. Chosen by the grazing-plane test of
 * tests/numerics/test_offset.c, which passes from 2 upwards. */
#define OFFSET_ULPS 8.0f
/* The cosine to which a shading normal that faces away is bent. */
#define BEND_COSINE 1e-3f

static float abs_max3(struct vec3 a)
{
    return float_max(fabsf(a.x), float_max(fabsf(a.y), fabsf(a.z)));
}

float surface_offset(struct vec3 p, const struct vec3 corner[3],
                     const struct world_instance *instance)
{
    /* Embree subtracts the ray's origin from the corners: its rounding grows with the largest
     * coordinate of the point and with the size of the triangle. */
    float extent = float_max(abs_max3(vec3_sub(corner[1], corner[0])),
                             abs_max3(vec3_sub(corner[2], corner[0])));
    float magnitude = float_max(abs_max3(p), extent);

    return OFFSET_ULPS * 0x1p-24f * magnitude + instance->position_error;
}

/* A triangle's corners in world space, in double; exact for baked instances. */
static void corners_d(const struct world_instance *instance, const struct world_mesh *mesh,
                      const uint32_t vertex[3], double corner[3][3])
{
    for (int k = 0; k < 3; k++) {
        if (instance->world_positions) {
            const float *p = instance->world_positions + 3 * (size_t)vertex[k];
            for (int a = 0; a < 3; a++)
                corner[k][a] = (double)p[a];
        } else {
            const float *p = mesh->positions + 3 * (size_t)vertex[k];
            for (int a = 0; a < 3; a++) {
                const float *row = instance->to_world.m[a];
                corner[k][a] = (double)row[0] * (double)p[0] + (double)row[1] * (double)p[1] +
                               (double)row[2] * (double)p[2] + (double)row[3];
            }
        }
    }
}

void world_triangle(const struct render_scene *scene, const struct world_instance *instance,
                    uint32_t triangle, float time, struct vec3 corner[3])
{
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    double c[3][3];

    (void)time;
    corners_d(instance, mesh, world_vertices(mesh, triangle), c);
    for (int k = 0; k < 3; k++)
        corner[k] = vec3_make((float)c[k][0], (float)c[k][1], (float)c[k][2]);
}

static void cross_d(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double dot_d(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void surface_from_hit(const struct render_scene *scene, const struct ray *ray,
                      const struct hit *hit, struct surface *s)
{
    double c[3][3], e1[3], e2[3], n[3], to_origin[3], pvec[3], qvec[3], p[3];
    double d[3] = {(double)ray->direction.x, (double)ray->direction.y, (double)ray->direction.z};
    double o[3] = {(double)ray->origin.x, (double)ray->origin.y, (double)ray->origin.z};
    double determinant, u, v, length, sign;
    struct vec3 corner[3];

    s->instance = &scene->instances[hit->instance];
    s->footprint = 0;
    s->time = ray->time;
    s->material = &scene->materials[s->instance->material];
    s->mesh = &scene->meshes[s->instance->mesh];
    s->triangle = hit->triangle;
    s->vertex = world_vertices(s->mesh, hit->triangle);
    corners_d(s->instance, s->mesh, s->vertex, c);
    for (int a = 0; a < 3; a++) {
        e1[a] = c[1][a] - c[0][a];
        e2[a] = c[2][a] - c[0][a];
        to_origin[a] = o[a] - c[0][a];
    }
    cross_d(e1, e2, n);
    length = sqrt(dot_d(n, n));

    /* Moeller-Trumbore in double; the clamp only ever undoes rounding at an edge. */
    cross_d(d, e2, pvec);
    cross_d(to_origin, e1, qvec);
    determinant = dot_d(e1, pvec);
    if (determinant != 0 && isfinite(1 / determinant)) {
        u = dot_d(to_origin, pvec) / determinant;
        v = dot_d(d, qvec) / determinant;
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
    s->p = vec3_make((float)p[0], (float)p[1], (float)p[2]);
    s->area = (float)(0.5 * length);

    sign = s->instance->flipped ? -1 : 1;
    s->front = dot_d(n, d) * sign < 0;
    sign = s->front ? sign : -sign;
    if (length > 0)
        s->ng = vec3_make((float)(n[0] / length * sign), (float)(n[1] / length * sign),
                          (float)(n[2] / length * sign));
    else
        s->ng = vec3_neg(ray->direction);
    for (int k = 0; k < 3; k++)
        corner[k] = vec3_make((float)c[k][0], (float)c[k][1], (float)c[k][2]);
    s->offset = surface_offset(s->p, corner, s->instance);
}

static struct vec3 interpolate(const float *values, size_t stride, const uint32_t vertex[3],
                               float b1, float b2)
{
    const float *a = values + stride * vertex[0], *b = values + stride * vertex[1],
                *c = values + stride * vertex[2];
    float b0 = 1 - b1 - b2;

    return vec3_make(b0 * a[0] + b1 * b[0] + b2 * c[0], b0 * a[1] + b1 * b[1] + b2 * c[1],
                     b0 * a[2] + b1 * b[2] + b2 * c[2]);
}

/* The normal map's normal, world, on the front side; `n` where there is no tangent. */
static struct vec3 mapped_normal(const struct surface *s, struct vec3 n)
{
    const struct world_mesh *mesh = s->mesh;
    struct vec3 t = interpolate(mesh->tangents, 4, s->vertex, s->b1, s->b2), b;
    struct texel texel = world_slot_lookup(&s->material->normal, mesh, s->vertex, s->b1, s->b2, s->footprint, 0);
    float scale = s->material->m.normal_scale;
    float handedness = mesh->tangents[4 * (size_t)s->vertex[0] + 3] < 0 ? -1.0f : 1.0f;

    t = transform_vector(&s->instance->to_world, t);
    t = vec3_normalize(vec3_mad(t, n, -vec3_dot(n, t)));
    if (vec3_is_black(t))
        return n;
    if (s->instance->flipped)
        handedness = -handedness;
    b = vec3_scale(vec3_cross(n, t), handedness);
    b = vec3_normalize(vec3_add(vec3_add(vec3_scale(t, (texel.r * 2 - 1) * scale),
                                         vec3_scale(b, (texel.g * 2 - 1) * scale)),
                                vec3_scale(n, texel.b * 2 - 1)));
    return vec3_is_black(b) ? n : b;
}

static struct vec3 shading_normal(const struct surface *s, struct vec3 wo)
{
    struct vec3 front_ng = s->front ? s->ng : vec3_neg(s->ng), n = front_ng, mirror;
    float cosine;

    if (s->mesh->normals) {
        n = interpolate(s->mesh->normals, 3, s->vertex, s->b1, s->b2);
        n = vec3_normalize(transform_normal(&s->instance->to_object, n));
        if (vec3_is_black(n))
            n = front_ng;
        else if (vec3_dot(n, front_ng) < 0)
            n = vec3_neg(n); /* normals that disagree with the winding */
    }
    if (s->material->flags & MATERIAL_NORMAL_MAP && s->mesh->tangents) {
        n = mapped_normal(s, n);
        if (vec3_dot(n, front_ng) < 0)
            n = vec3_mad(n, front_ng, BEND_COSINE - vec3_dot(n, front_ng));
    } else if (!s->mesh->normals) {
        return s->ng;
    }
    if (!s->front)
        n = vec3_neg(n);
    n = vec3_normalize(n);

    /* Bend a normal that faces away from wo, then one whose mirror direction would dive
     * under the geometric surface (the black rims of coarse smooth meshes). */
    cosine = vec3_dot(n, wo);
    if (cosine < BEND_COSINE) {
        n = vec3_normalize(vec3_mad(n, wo, BEND_COSINE - cosine));
        cosine = vec3_dot(n, wo);
    }
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

static void textured_params(const struct surface *s, struct bsdf_params *params)
{
    const struct world_material *material = s->material;
    struct texel texel;

    if (material->base_color.image) {
        texel = world_slot_lookup(&material->base_color, s->mesh, s->vertex, s->b1, s->b2, s->footprint, 1);
        params->base_color = vec3_mul(params->base_color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (material->metallic_roughness.image) {
        float roughness;
        texel = world_slot_lookup(&material->metallic_roughness, s->mesh, s->vertex, s->b1, s->b2, s->footprint, 0);
        roughness = material->m.roughness * texel.g;
        params->alpha = roughness * roughness;
        params->metallic *= texel.b;
    }
    if (material->specular.image)
        params->specular *=
            world_slot_lookup(&material->specular, s->mesh, s->vertex, s->b1, s->b2, s->footprint, 0).a;
    if (material->specular_color.image) {
        texel = world_slot_lookup(&material->specular_color, s->mesh, s->vertex, s->b1, s->b2, s->footprint, 1);
        params->specular_color =
            vec3_mul(params->specular_color, vec3_make(texel.r, texel.g, texel.b));
    }
    if (material->transmission.image)
        params->transmission *=
            world_slot_lookup(&material->transmission, s->mesh, s->vertex, s->b1, s->b2, s->footprint, 0).r;
}

void surface_shade(struct surface *s, struct vec3 wo, struct bsdf_params *params)
{
    const struct scene_material *m = &s->material->m;

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
    if (s->material->flags & MATERIAL_TEXTURED)
        textured_params(s, params);
    if (s->mesh->colors)
        params->base_color = vec3_mul(params->base_color,
                                      interpolate(s->mesh->colors, 4, s->vertex, s->b1, s->b2));
    s->frame = frame_from_normal(shading_normal(s, wo));
}

struct vec3 surface_ray_origin(const struct surface *s, struct vec3 direction)
{
    return vec3_mad(s->p, s->ng, vec3_dot(direction, s->ng) < 0 ? -s->offset : s->offset);
}

/* ---- lookups that need the triangle ------------------------------------------------------- */
struct texel world_slot_lookup(const struct world_slot *slot, const struct world_mesh *mesh,
                               const uint32_t vertex[3], float b1, float b2, float footprint,
                               int srgb)
{
    const float *uv = mesh->uv[slot->uv_set];
    float u = 0, v = 0;

    if (uv) {
        const float *a = uv + 2 * (size_t)vertex[0], *b = uv + 2 * (size_t)vertex[1],
                    *c = uv + 2 * (size_t)vertex[2];
        float b0 = 1 - b1 - b2;
        u = b0 * a[0] + b1 * b[0] + b2 * c[0];
        v = b0 * a[1] + b1 * b[1] + b2 * c[1];
    }
    if (slot->transformed) {
        float u0 = u;
        u = slot->m[0][0] * u0 + slot->m[0][1] * v + slot->m[0][2];
        v = slot->m[1][0] * u0 + slot->m[1][1] * v + slot->m[1][2];
    }
    return texture_lookup(slot->image, &slot->texture, u, v, footprint, srgb);
}

float world_alpha(const struct world_material *material, const struct world_mesh *mesh,
                  const uint32_t vertex[3], float b1, float b2)
{
    float alpha = material->m.base_color[3];

    if (material->base_color.image)
        alpha *= world_slot_lookup(&material->base_color, mesh, vertex, b1, b2, 0, 1).a;
    if (mesh->colors) {
        const float *c = mesh->colors;
        alpha *= (1 - b1 - b2) * c[4 * (size_t)vertex[0] + 3] + b1 * c[4 * (size_t)vertex[1] + 3] +
                 b2 * c[4 * (size_t)vertex[2] + 3];
    }
    return alpha;
}

struct vec3 world_emission(const struct world_material *material, const struct world_mesh *mesh,
                           const uint32_t vertex[3], float b1, float b2)
{
    struct vec3 emission =
        vec3_make(material->m.emission[0], material->m.emission[1], material->m.emission[2]);

    if (material->emission.image) {
        struct texel texel = world_slot_lookup(&material->emission, mesh, vertex, b1, b2, 0, 1);
        emission = vec3_mul(emission, vec3_make(texel.r, texel.g, texel.b));
    }
    return emission;
}
