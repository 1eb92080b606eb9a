#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/light/triangle_light.h"
#include "worker/render/surface/surface.h"
#include "worker/render/texture/texture_dark.h"
#include "worker/render/world.h"

/* An emissive texture is averaged over a triangle on a pattern about as fine as the texels of
 * an image of TEXELS_A_SIDE; what the pattern misses counts as at least this much of the
 * material's factor, so that no lit spot is ever without odds. Triangles that the texture leaves
 * dark throughout are none of the lights. */
enum { TEXELS_A_SIDE = 1024, PATTERN_MIN = 4, PATTERN_MAX = 48 };
#define UNSEEN_EMISSION 1e-4

static uint32_t pattern_side(const struct world_slot *slot, const struct world_mesh *mesh,
                             const uint32_t vertex[3])
{
    const float *uv = mesh->uv[slot->uv_set];
    float longest = 0, side;

    for (int k = 0; uv && k < 3; k++)
        for (int axis = 0; axis < 2; axis++) {
            const float *a = uv + 2 * (size_t)vertex[k], *b = uv + 2 * (size_t)vertex[(k + 1) % 3];
            float du = b[0] - a[0], dv = b[1] - a[1];

            longest = float_max(longest,
                                fabsf(slot->m[axis][0] * du + slot->m[axis][1] * dv));
        }
    side = longest * TEXELS_A_SIDE;
    return side >= PATTERN_MAX ? PATTERN_MAX : side > PATTERN_MIN ? (uint32_t)side : PATTERN_MIN;
}

/* Is the slot's image black all over the triangle? */
static int slot_is_dark(const struct texture_dark *dark, const struct world_slot *slot,
                        const struct world_mesh *mesh, const uint32_t vertex[3])
{
    const float *uv = mesh->uv[slot->uv_set];
    double range[2][2];

    for (int axis = 0; axis < 2; axis++) {
        const float *m = slot->m[axis];
        double largest = 0, low = INFINITY, high = -INFINITY;

        for (int k = 0; k < 3; k++) {
            double u = uv ? (double)uv[2 * (size_t)vertex[k]] : 0;
            double v = uv ? (double)uv[2 * (size_t)vertex[k] + 1] : 0;
            double at = (double)m[0] * u + (double)m[1] * v + (double)m[2];

            low = fmin(low, at);
            high = fmax(high, at);
            largest = fmax(largest, fabs((double)m[0] * u) + fabs((double)m[1] * v) +
                                        fabs((double)m[2]));
        }
        /* Points in between are interpolated and transformed in float. */
        range[axis][0] = low - 0x1p-20 * largest;
        range[axis][1] = high + 0x1p-20 * largest;
    }
    return texture_dark_in(dark, &slot->texture, range[0], range[1]);
}

/* Mean emitted luminance of a triangle that is not dark. */
static double triangle_luminance(const struct world_material *material,
                                 const struct world_mesh *mesh, const uint32_t vertex[3])
{
    double whole = (double)vec3_luminance(vec3_make(
               material->m.emission[0], material->m.emission[1], material->m.emission[2])),
           sum = 0;
    uint32_t side, n = 0;

    if (!material->emission.image)
        return whole;
    side = pattern_side(&material->emission, mesh, vertex);
    for (uint32_t i = 0; i < side; i++)
        for (uint32_t j = 0; j < side - i; j++, n++) {
            float b1 = ((float)i + 1.0f / 3) / (float)side;
            float b2 = ((float)j + 1.0f / 3) / (float)side;

            sum += (double)vec3_luminance(world_emission(material, mesh, vertex, b1, b2));
        }
    sum /= n;
    return sum > UNSEEN_EMISSION * whole ? sum : UNSEEN_EMISSION * whole;
}

/* Twice the area as a vector, of the triangle with its first edge from one moment and its
 * second from another. */
static struct vec3 crossed(const struct vec3 a[3], const struct vec3 b[3])
{
    return vec3_cross(vec3_sub(a[1], a[0]), vec3_sub(b[2], b[0]));
}

/* Normals of a triangle whose corners move along straight lines are combinations, with positive
 * weights, of those at both ends and of the mean of the mixed ones (Bernstein's form): a
 * cone of less than a right angle around all those holds every normal in between. */
static void cone_add_normal(struct light_bounds *b, struct vec3 doubled)
{
    struct vec3 normal = vec3_normalize(doubled);
    float cosine;

    if (vec3_is_black(normal))
        return;
    if (vec3_is_black(b->axis)) {
        b->axis = normal;
        return;
    }
    cosine = vec3_dot(b->axis, normal);
    b->spread_rad = float_max(b->spread_rad, cosine >= 1 - 1e-6f ? 0 : det_acos(cosine) + 1e-3f);
}

/* Where a triangle is and which way it faces while the shutter is open; its largest area. */
static float triangle_bounds(const struct render_scene *scene,
                             const struct world_instance *instance, uint32_t triangle,
                             struct light_bounds *b)
{
    uint32_t steps = instance->motion_steps > 1 ? instance->motion_steps : 1;
    float sign = instance->flipped ? -1.0f : 1.0f, doubled_area = 0;
    struct vec3 before[3] = {{0, 0, 0}};

    b->min = vec3_splat(INFINITY);
    b->max = vec3_splat(-INFINITY);
    for (uint32_t k = 0; k < steps; k++) {
        float time = steps > 1 ? (float)k / (float)(steps - 1) : 0;
        struct vec3 corner[3], doubled;

        world_triangle(scene, instance, triangle, time, corner);
        for (int c = 0; c < 3; c++)
            light_bounds_add(b, corner[c]);
        doubled = crossed(corner, corner);
        cone_add_normal(b, vec3_scale(doubled, sign));
        if (k > 0)
            cone_add_normal(b, vec3_scale(vec3_add(crossed(before, corner),
                                                   crossed(corner, before)), sign));
        doubled_area = float_max(doubled_area, triangle_double_area(doubled));
        memcpy(before, corner, sizeof before);
    }
    if (b->spread_rad >= PI_F / 2)
        b->spread_rad = PI_F;
    return 0.5f * doubled_area;
}


static uint32_t lights_of(const struct render_scene *scene, const struct world_instance *instance)
{
    return instance->sphere ? 1 : scene->meshes[instance->mesh].triangle_count;
}

uint64_t triangle_lights_count(struct render_scene *scene)
{
    uint64_t total = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        struct world_instance *instance = &scene->instances[i];
        instance->light_base = -1;
        if (!(scene->materials[instance->material].flags & MATERIAL_EMISSIVE) ||
            scene->materials[instance->material].m.unlit)
            continue;
        instance->light_base = (int32_t)(total < INT32_MAX ? total : INT32_MAX);
        total += lights_of(scene, instance);
    }
    return total;
}

/* Where the material's emissive texture is dark: made for the first instance that needs it, NULL if it
 * has none. `maps`: [image_count]. */
static status dark_map(const struct world_material *material, struct texture_dark **maps,
                       const struct texture_dark **out, struct error *err)
{
    const struct world_slot *slot = &material->emission;
    status s = STATUS_OK;

    *out = NULL;
    if (!slot->image)
        return STATUS_OK;
    if (!maps[slot->texture.image])
        s = texture_dark_new(&maps[slot->texture.image], slot->image, err);
    *out = maps[slot->texture.image];
    return s;
}

/* Those of one instance. */
static status find_in(const struct render_scene *scene, uint32_t number,
                      struct texture_dark **maps, struct triangle_light *lights, uint8_t *dark,
                      struct error *err)
{
    const struct world_instance *instance = &scene->instances[number];
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    const struct world_material *material = &scene->materials[instance->material];
    const struct texture_dark *map;
    status s = dark_map(material, maps, &map, err);

    for (uint32_t t = 0; s == STATUS_OK && t < lights_of(scene, instance); t++) {
        uint32_t at = (uint32_t)instance->light_base + t;

        lights[at] = (struct triangle_light){number, t};
        if (map && slot_is_dark(map, &material->emission, mesh, world_vertices(mesh, t)))
            dark[at / 8] |= (uint8_t)(1 << at % 8);
    }
    return s;
}

status triangle_lights_find(const struct render_scene *scene, struct triangle_light *lights,
                            uint8_t *dark, struct error *err)
{
    struct texture_dark **maps = mem_calloc((size_t)scene->image_count + 1, sizeof *maps);
    status s = maps ? STATUS_OK : error_no_memory(err, "the table of lights");

    for (uint32_t i = 0; s == STATUS_OK && i < scene->instance_count; i++)
        if (scene->instances[i].light_base >= 0)
            s = find_in(scene, i, maps, lights, dark, err);
    for (uint32_t i = 0; maps && i < scene->image_count; i++)
        texture_dark_free(maps[i]);
    mem_free(maps);
    return s;
}

void triangle_light_weigh(const struct render_scene *scene, const void *light_,
                          struct light_weight *out)
{
    const struct triangle_light *light = light_;
    const struct world_instance *instance = &scene->instances[light->instance];
    const struct world_mesh *mesh = &scene->meshes[instance->mesh];
    const struct world_material *material = &scene->materials[instance->material];
    struct light_bounds *b = &out->bounds;

    b->area = triangle_bounds(scene, instance, light->triangle, b);
    b->emission_rad = PI_F / 2;
    b->reach = INFINITY;
    b->lamp = light->instance;
    b->two_sided = material->m.double_sided;
    out->intensity = (double)b->area *
                     triangle_luminance(material, mesh, world_vertices(mesh, light->triangle));
    if (!(out->intensity > 0 && isfinite(out->intensity)))
        out->intensity = 0;
    out->power = out->intensity * PI_D * (b->two_sided ? 2 : 1);
}
