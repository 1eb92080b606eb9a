/* triangle_light_weigh: power and bounds of an emissive triangle, found before the rendering. */
#include <string.h>

#include "common/math/elementary.h"
#include "worker/render/light/light.h"
#include "worker/render/surface/surface.h"
#include "worker/render/render_scene.h"

/* An emissive texture is averaged over a triangle on a pattern about as fine as the texels of an image of
 * TEXELS_A_SIDE; what the pattern misses counts as at least this much of the material's factor, so that no lit spot is
 * ever without odds. Triangles that the texture leaves dark throughout are none of the lights (face_light.c). */
enum { TEXELS_A_SIDE = 1024, PATTERN_MIN = 4, PATTERN_MAX = 48 };
#define UNSEEN_EMISSION 1e-4

static uint32_t pattern_side(const struct render_slot *slot, const struct render_mesh *mesh, const uint32_t vertex[3])
{
    const float32 *uv = mesh->uv[slot->uv_set];
    real longest = 0, side;

    for (int k = 0; uv && k < 3; k++)
        for (int axis = 0; axis < 2; axis++) {
            const float32 *a = uv + 2 * (size_t)vertex[k], *b = uv + 2 * (size_t)vertex[(k + 1) % 3];
            real du = b[0] - a[0], dv = b[1] - a[1];

            longest = real_max(longest, real_abs(slot->m[axis][0] * du + slot->m[axis][1] * dv));
        }
    side = longest * TEXELS_A_SIDE;
    return side >= PATTERN_MAX ? PATTERN_MAX : side > PATTERN_MIN ? (uint32_t)side : PATTERN_MIN;
}

/* Mean emitted luminance of a triangle that is not dark. */
static double triangle_luminance(const struct render_material *material, const struct render_mesh *mesh,
                                 const uint32_t vertex[3])
{
    double whole = (double)vec3_luminance(
               vec3_make(material->m.emission[0], material->m.emission[1], material->m.emission[2])),
           sum = 0;
    uint32_t side, n = 0;

    if (!material->emission.image)
        return whole;
    side = pattern_side(&material->emission, mesh, vertex);
    for (uint32_t i = 0; i < side; i++)
        for (uint32_t j = 0; j < side - i; j++, n++) {
            real b1 = ((real)i + 1.0f / 3) / (real)side;
            real b2 = ((real)j + 1.0f / 3) / (real)side;

            sum += (double)vec3_luminance(material_emission(material, mesh, vertex, b1, b2));
        }
    sum /= n;
    return sum > UNSEEN_EMISSION * whole ? sum : UNSEEN_EMISSION * whole;
}

/* Twice the area as a vector, of the triangle with its first edge from one moment and its second from another. */
static struct vec3 crossed(const struct vec3 a[3], const struct vec3 b[3])
{
    return vec3_cross(vec3_sub(a[1], a[0]), vec3_sub(b[2], b[0]));
}

/* The normals of a triangle whose corners move along straight lines are combinations, with positive
 * weights, of those at both ends and of the mean of the mixed ones (Bernstein's form). So a cone of
 * less than a right angle around all of those holds every normal in between. */
static void cone_add_normal(struct light_bounds *b, struct vec3 doubled)
{
    struct vec3 normal = vec3_normalize(doubled);
    real cosine;

    if (vec3_is_black(normal))
        return;
    if (vec3_is_black(b->axis)) {
        b->axis = normal;
        return;
    }
    cosine = vec3_dot(b->axis, normal);
    b->spread_rad = real_max(b->spread_rad, cosine >= 1 - REAL(1e-6) ? 0 : real_acos(cosine) + REAL(1e-3));
}

/* Where a triangle is and which way it faces while the shutter is open; its largest area. */
static real triangle_bounds(const struct render_scene *scene, const struct render_instance *instance, uint32_t triangle,
                            struct light_bounds *b)
{
    uint32_t steps = instance->motion_steps > 1 ? instance->motion_steps : 1;
    real sign = instance->flipped ? -1.0f : 1.0f, doubled_area = 0;
    struct vec3 before[3] = {{0, 0, 0}};

    b->min = vec3_splat(INFINITY);
    b->max = vec3_splat(-INFINITY);
    for (uint32_t k = 0; k < steps; k++) {
        real time = steps > 1 ? (real)k / (real)(steps - 1) : 0;
        struct vec3 corner[3], doubled;

        triangle_of_instance(scene, instance, triangle, time, corner);
        for (int c = 0; c < 3; c++)
            light_bounds_add(b, corner[c]);
        doubled = crossed(corner, corner);
        cone_add_normal(b, vec3_scale(doubled, sign));
        if (k > 0)
            cone_add_normal(b, vec3_scale(vec3_add(crossed(before, corner), crossed(corner, before)), sign));
        doubled_area = real_max(doubled_area, triangle_double_area(doubled));
        memcpy(before, corner, sizeof before);
    }
    if (b->spread_rad >= REAL_PI / 2)
        b->spread_rad = REAL_PI;
    return 0.5f * doubled_area;
}

void triangle_light_weigh(const struct render_scene *scene, const void *light_, struct light_weight *out)
{
    const struct hit *light = light_;
    const struct render_instance *instance = &scene->instances[light->instance];
    const struct render_mesh *mesh = &scene->meshes[instance->mesh];
    const struct render_material *material = &scene->materials[instance->material];
    struct light_bounds *b = &out->bounds;

    b->area = triangle_bounds(scene, instance, light->triangle, b);
    b->emission_rad = REAL_PI / 2;
    b->reach = INFINITY;
    b->lamp = light->instance;
    b->two_sided = material->m.double_sided;
    out->intensity = (double)b->area * triangle_luminance(material, mesh, triangle_vertices(mesh, light->triangle));
    if (!(out->intensity > 0 && isfinite(out->intensity)))
        out->intensity = 0;
    out->power = out->intensity * PI_D * (b->two_sided ? 2 : 1);
}
