/* face_light: finding the faces of emissive instances, and which of them are dark. */
#include "worker/render/light/face_light.h"

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/texture/texture_dark.h"
#include "worker/render/render_scene.h"

/* Is the slot's image black all over the triangle? */
static int slot_is_dark(const struct texture_dark *dark, const struct render_slot *slot, const struct render_mesh *mesh,
                        const uint32_t vertex[3])
{
    const float32 *uv = mesh->uv[slot->uv_set];
    double range[2][2];

    for (int axis = 0; axis < 2; axis++) {
        const real *m = slot->m[axis];
        double largest = 0, low = INFINITY, high = -INFINITY;

        for (int k = 0; k < 3; k++) {
            double u = uv ? (double)uv[2 * (size_t)vertex[k]] : 0;
            double v = uv ? (double)uv[2 * (size_t)vertex[k] + 1] : 0;
            double at = (double)m[0] * u + (double)m[1] * v + (double)m[2];

            low = fmin(low, at);
            high = fmax(high, at);
            largest = fmax(largest, fabs((double)m[0] * u) + fabs((double)m[1] * v) + fabs((double)m[2]));
        }
        /* Points in between are interpolated and transformed in float. */
        range[axis][0] = low - 0x1p-20 * largest;
        range[axis][1] = high + 0x1p-20 * largest;
    }
    return texture_dark_in(dark, &slot->texture, range[0], range[1]);
}

static uint32_t faces_of(const struct render_scene *scene, const struct render_instance *instance)
{
    return instance->shape ? 1 : scene->meshes[instance->mesh].triangle_count;
}

uint64_t face_lights_count(struct render_scene *scene)
{
    uint64_t total = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        struct render_instance *instance = &scene->instances[i];
        instance->light_base = -1;
        if (!(scene->materials[instance->material].flags & MATERIAL_EMISSIVE) ||
            scene->materials[instance->material].m.unlit)
            continue;
        instance->light_base = (int32_t)(total < INT32_MAX ? total : INT32_MAX);
        total += faces_of(scene, instance);
    }
    return total;
}

/* Where the material's emissive texture is dark: made for the first instance that needs it, NULL if it
 * has none. `maps`: [image_count]. */
static status dark_map(const struct render_material *material, struct texture_dark **maps,
                       const struct texture_dark **out, struct error *err)
{
    const struct render_slot *slot = &material->emission;
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
static status find_in(const struct render_scene *scene, uint32_t number, struct texture_dark **maps, struct hit *faces,
                      uint8_t *dark, struct error *err)
{
    const struct render_instance *instance = &scene->instances[number];
    const struct render_mesh *mesh = &scene->meshes[instance->mesh];
    const struct render_material *material = &scene->materials[instance->material];
    const struct texture_dark *map;
    status s = dark_map(material, maps, &map, err);

    for (uint32_t t = 0; s == STATUS_OK && t < faces_of(scene, instance); t++) {
        uint32_t at = (uint32_t)instance->light_base + t;

        faces[at] = (struct hit){number, t};
        if (map && slot_is_dark(map, &material->emission, mesh, triangle_vertices(mesh, t)))
            dark[at / 8] |= (uint8_t)(1 << at % 8);
    }
    return s;
}

status face_lights_find(const struct render_scene *scene, struct hit *faces, uint8_t *dark, struct error *err)
{
    struct texture_dark **maps = mem_calloc((size_t)scene->image_count + 1, sizeof *maps);
    status s = maps ? STATUS_OK : error_no_memory(err, "the table of lights");

    for (uint32_t i = 0; s == STATUS_OK && i < scene->instance_count; i++)
        if (scene->instances[i].light_base >= 0)
            s = find_in(scene, i, maps, faces, dark, err);
    for (uint32_t i = 0; maps && i < scene->image_count; i++)
        texture_dark_free(maps[i]);
    mem_free(maps);
    return s;
}
