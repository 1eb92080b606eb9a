#include "worker/render/world_material.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/math/elementary.h"
#include "worker/render/image_share.h"

/* ---- texture slots ------------------------------------------------------------------------ */

static int is_black(const float color[3])
{
    return color[0] == 0 && color[1] == 0 && color[2] == 0;
}

enum slot_flags {
    SLOT_UNLIT = 1, /* read by unlit materials too */
    SLOT_SHADED = 2, /* read by surface_shade: makes the material MATERIAL_TEXTURED */
    SLOT_COLOR = 4, /* holds colours: sRGB unless the texture says otherwise */
    SLOT_WIDE = 8 /* looked up by footprint */
};
#define SLOT_DATA_READ (SLOT_SHADED | SLOT_WIDE)
#define SLOT_COLOR_READ (SLOT_DATA_READ | SLOT_COLOR)

/* X(world_material's field, scene_material's field, flags, when its factor is not 0). */
#define SLOT_MAP(X)                                                                              \
    X(base_color, base_color_texture, SLOT_UNLIT | SLOT_COLOR_READ,                              \
      !is_black(m->base_color) || m->alpha_mode != ALPHA_OPAQUE)                                 \
    X(metallic_roughness, metallic_roughness_texture, SLOT_DATA_READ,                            \
      m->metallic > 0 || m->roughness > 0)                                                       \
    X(normal, normal_texture, SLOT_WIDE, m->normal_scale != 0)                                   \
    X(emission, emission_texture, SLOT_COLOR, !is_black(m->emission))                            \
    X(specular, specular_texture, SLOT_DATA_READ, m->specular > 0)                               \
    X(specular_color, specular_color_texture, SLOT_COLOR_READ,                                   \
      m->specular > 0 && !is_black(m->specular_color))                                           \
    X(transmission, transmission_texture, SLOT_DATA_READ, m->transmission > 0)                   \
    X(anisotropy, anisotropy_texture, SLOT_DATA_READ, m->anisotropy > 0)                         \
    X(clearcoat, clearcoat_texture, SLOT_DATA_READ, m->clearcoat > 0)                            \
    X(clearcoat_roughness, clearcoat_roughness_texture, SLOT_DATA_READ,                          \
      m->clearcoat > 0 && m->clearcoat_roughness > 0)                                            \
    X(clearcoat_normal, clearcoat_normal_texture, SLOT_DATA_READ,                                \
      m->clearcoat > 0 && m->clearcoat_normal_scale != 0)                                        \
    X(sheen_color, sheen_color_texture, SLOT_COLOR_READ, !is_black(m->sheen_color))              \
    X(sheen_roughness, sheen_roughness_texture, SLOT_DATA_READ,                                  \
      !is_black(m->sheen_color) && m->sheen_roughness > 0)                                       \
    X(iridescence, iridescence_texture, SLOT_DATA_READ, m->iridescence > 0)                      \
    X(iridescence_thickness, iridescence_thickness_texture, SLOT_DATA_READ,                      \
      m->iridescence > 0 &&                                                                      \
          m->iridescence_thickness_min_nm != m->iridescence_thickness_max_nm)                    \
    X(diffuse_transmission, diffuse_transmission_texture, SLOT_DATA_READ,                        \
      m->diffuse_transmission > 0)                                                               \
    X(diffuse_transmission_color, diffuse_transmission_color_texture, SLOT_COLOR_READ,           \
      m->diffuse_transmission > 0 && !is_black(m->diffuse_transmission_color))                   \
    X(mix, mix_texture, 0, m->mix_amount > 0)

struct slot {
    size_t ready, described; /* offsets in struct world_material, struct scene_material */
    int flags;
};
static const struct slot slots[] = {
#define SLOT_ROW(field, texture, flags, condition) \
    {offsetof(struct world_material, field), offsetof(struct scene_material, texture), flags},
    SLOT_MAP(SLOT_ROW)
#undef SLOT_ROW
};
enum { SLOTS = sizeof slots / sizeof *slots, SLOT_MIX = SLOTS - 1 };

/* Bit i: slot i has a texture that counts. `m` is already reduced. */
static uint32_t slots_read(const struct scene_material *m)
{
    const int counts[SLOTS] = {
#define SLOT_CONDITION(field, texture, flags, condition) (condition),
        SLOT_MAP(SLOT_CONDITION)
#undef SLOT_CONDITION
    };
    uint32_t mask = 0;

    for (int i = 0; i < SLOTS; i++) {
        const struct scene_texture_slot *slot =
            (const void *)((const char *)m + slots[i].described);
        int role = m->kind == MATERIAL_MIX         ? i == SLOT_MIX || slots[i].flags & SLOT_UNLIT
                   : i == SLOT_MIX                 ? 0
                   : m->kind == MATERIAL_INTERFACE ? 0
                   : m->unlit                      ? slots[i].flags & SLOT_UNLIT
                                                   : 1;
        if (role && counts[i] && slot->texture >= 0)
            mask |= 1u << i;
    }
    return mask;
}

static struct scene_material reduced(const struct scene_material *material,
                                     const struct render_settings *settings)
{
    struct scene_material m = *material;

    scene_material_reduce(&m, settings->without);
    return m;
}

/* ---- what is used ------------------------------------------------------------------------- */

static void use_material(struct world_used *used, const struct scene *scene,
                         const struct render_settings *settings, uint32_t index)
{
    struct scene_material m = reduced(&scene->materials[index], settings);
    uint32_t mask = slots_read(&m);

    for (int i = 0; i < SLOTS; i++) {
        const struct scene_texture_slot *slot =
            (const void *)((const char *)&m + slots[i].described);
        if (mask >> i & 1) {
            const struct scene_texture *texture = &scene->textures[slot->texture];
            used->images[texture->image] |= WORLD_IMAGE_USED;
            if ((slots[i].flags & SLOT_WIDE) && !texture->nearest &&
                settings->texture_filter == TEXTURE_FILTER_CONE)
                used->images[texture->image] |=
                    (uint8_t)texture_use_of(texture, slots[i].flags & SLOT_COLOR);
        }
    }
    if (m.medium >= 0)
        used->media[m.medium] = 1;
    if (m.medium_outside >= 0)
        used->media[m.medium_outside] = 1;
    if (m.kind == MATERIAL_MIX)
        used->materials[m.mix_material[0]] = used->materials[m.mix_material[1]] = 1;
}

static void use_lights(struct world_used *used, const struct scene *scene,
                       const struct render_settings *settings)
{
    if (settings->without & (EFFECT_PUNCTUAL_LIGHT | EFFECT_LIGHT_IMAGE))
        return;
    for (uint32_t i = 0; i < scene->light_count; i++) {
        const struct scene_light *light = &scene->lights[i];
        int has_image = (scene_light_parts(light->kind) & LIGHT_HAS_FRAME) != 0;
        if (has_image && light->image >= 0 && !is_black(light->intensity))
            used->images[light->image] |= WORLD_IMAGE_USED;
    }
}

status world_used_init(struct world_used *used, const struct scene *scene,
                       const struct render_settings *settings, struct error *err)
{
    memset(used, 0, sizeof *used);
    used->materials = mem_calloc(scene->material_count, 1);
    used->images = mem_calloc(scene->image_count, 1);
    used->media = mem_calloc(scene->medium_count, 1);
    if (!used->materials || !used->images || !used->media) {
        world_used_release(used);
        return error_no_memory(err, "the tables of what is used");
    }
    for (uint32_t i = 0; i < scene->instance_count; i++)
        used->materials[scene->instances[i].material] = 1;
    /* A mix refers to lower rows only: they come later in this loop. */
    for (uint32_t i = scene->material_count; i-- > 0;)
        if (used->materials[i])
            use_material(used, scene, settings, i);
    use_lights(used, scene, settings);
    if (scene->fog >= 0 && !(settings->without & (EFFECT_FOG | EFFECT_MEDIUM)))
        used->media[scene->fog] = 1;
    return STATUS_OK;
}

void world_used_release(struct world_used *used)
{
    mem_free(used->materials);
    mem_free(used->images);
    mem_free(used->media);
    memset(used, 0, sizeof *used);
}

/* ---- images ------------------------------------------------------------------------------- */

status world_images_load(struct render_scene *w, const struct scene *scene,
                         const struct world_used *used, struct blob_source blobs,
                         struct error *err)
{
    w->images = mem_calloc(scene->image_count, sizeof *w->images);
    w->image_shares = mem_calloc(scene->image_count, sizeof *w->image_shares);
    if (!w->images || !w->image_shares)
        return error_no_memory(err, "the textures");
    w->image_count = scene->image_count;
    for (uint32_t i = 0; i < scene->image_count; i++) {
        const uint8_t *data;
        size_t size_bytes;
        status s;
        if (!used->images[i])
            continue;
        s = blobs.get(blobs.user, &scene->images[i].blob.digest, &data, &size_bytes, err);
        if (s == STATUS_OK)
            s = image_share_get(&w->image_shares[i], &scene->images[i].blob.digest,
                                world_image_uses(used, i), data, size_bytes,
                                scene->images[i].name, err);
        if (s != STATUS_OK)
            return s;
        w->images[i] = image_share_image(w->image_shares[i]);
        w->info.texture_bytes += texture_image_bytes(w->images[i]);
    }
    return STATUS_OK;
}

/* ---- materials ---------------------------------------------------------------------------- */

static void slot_init(struct world_slot *out, const struct render_scene *w,
                      const struct scene *scene, const struct scene_texture_slot *slot)
{
    static const float identity[2][3] = {{1, 0, 0}, {0, 1, 0}};

    out->texture = scene->textures[slot->texture];
    if (w->settings.texture_filter == TEXTURE_FILTER_NEAREST)
        out->texture.nearest = 1;
    out->image = w->images[out->texture.image];
    out->uv_set = slot->uv_set;
    memcpy(out->m, slot->uv_transform, sizeof out->m);
    out->transformed = memcmp(out->m, identity, sizeof identity) != 0;
}

static float absorption(float color, float distance)
{
    if (!(distance < INFINITY) || color >= 1)
        return 0;
    /* A black attenuation colour lets nothing through; a finite stand-in avoids 0 * inf. */
    return -det_log(fmaxf(color, 1e-30f)) / fmaxf(distance, 1e-30f);
}

/* Is the material ever seen through? A metal that no texture makes less than one is not. */
static int transmits(const struct world_material *material)
{
    const struct scene_material *m = &material->m;

    return m->kind == MATERIAL_SURFACE && !m->unlit && m->transmission > 0 &&
           (m->metallic < 1 || material->metallic_roughness.image);
}

static unsigned flags_of(const struct world_material *material, enum scene_volume_rule rule)
{
    const struct scene_material *m = &material->m;
    int lit = !m->unlit && m->kind != MATERIAL_INTERFACE, coat_mapped;
    unsigned flags = 0;

    for (int i = 0; i < SLOTS; i++) {
        const struct world_slot *slot = (const void *)((const char *)material + slots[i].ready);
        if (slot->image && (slots[i].flags & SLOT_SHADED))
            flags |= MATERIAL_TEXTURED;
    }
    if (lit && (m->emission[0] > 0 || m->emission[1] > 0 || m->emission[2] > 0))
        flags |= MATERIAL_EMISSIVE;
    if (material->normal.image)
        flags |= MATERIAL_NORMAL_MAP;
    if (m->kind == MATERIAL_INTERFACE || (m->refractive && transmits(material)))
        flags |= MATERIAL_BOUNDS;
    if (m->kind == MATERIAL_INTERFACE || transmits(material) || (lit && m->diffuse_transmission > 0))
        flags |= MATERIAL_TWO_WAY;
    if (rule == VOLUMES_BOUNDARIES && (flags & MATERIAL_TWO_WAY) && m->medium != m->medium_outside)
        flags |= MATERIAL_BOUNDS;
    /* What bounds a volume is left through its back faces, whatever doubleSided says. */
    if (!m->double_sided && !(flags & MATERIAL_BOUNDS))
        flags |= MATERIAL_CULLED;
    coat_mapped = m->clearcoat > 0 && material->clearcoat_normal.image;
    if (lit && (m->anisotropy > 0 || m->clearcoat > 0 || !is_black(m->sheen_color) ||
                m->iridescence > 0 || m->diffuse_transmission > 0 || m->base_interreflection > 0 ||
                m->thin_slab || m->kind == MATERIAL_CONDUCTOR))
        flags |= MATERIAL_LAYERED;
    if (lit && (m->anisotropy > 0 || coat_mapped))
        flags |= MATERIAL_NEEDS_FRAME;
    return flags;
}

/* Textures of one layout, as most materials' are, are looked up at one place. */
static void share_places(struct world_material *material)
{
    for (int i = 0; i < SLOTS; i++) {
        struct world_slot *slot = (void *)((char *)material + slots[i].ready);
        int srgb = (slots[i].flags & SLOT_COLOR) != 0;

        if (!slot->image || !(slots[i].flags & SLOT_WIDE))
            continue;
        if (!material->lead) {
            material->lead = slot;
            material->lead_srgb = srgb;
        }
        slot->shares_place =
            slot->uv_set == material->lead->uv_set &&
            memcmp(slot->m, material->lead->m, sizeof slot->m) == 0 &&
            texture_shares_place(slot->image, &slot->texture, srgb, material->lead->image,
                                 &material->lead->texture, material->lead_srgb);
    }
}

static void material_init(struct world_material *out, const struct render_scene *w,
                          const struct scene *scene, const struct scene_material *material)
{
    uint32_t mask;

    out->m = reduced(material, &w->settings);
    out->m.name = NULL;
    mask = slots_read(&out->m);
    for (int i = 0; i < SLOTS; i++)
        if (mask >> i & 1)
            slot_init((void *)((char *)out + slots[i].ready), w, scene,
                      (const void *)((const char *)&out->m + slots[i].described));
    out->absorption =
        vec3_make(absorption(out->m.attenuation_color[0], out->m.attenuation_distance),
                  absorption(out->m.attenuation_color[1], out->m.attenuation_distance),
                  absorption(out->m.attenuation_color[2], out->m.attenuation_distance));
    /* Where there is no fog, no surface lets rays out into it. */
    if ((w->settings.without & EFFECT_FOG) && scene->fog >= 0) {
        if (out->m.medium == scene->fog)
            out->m.medium = -1;
        if (out->m.medium_outside == scene->fog)
            out->m.medium_outside = -1;
    }
    out->flags = flags_of(out, scene->volume_rule);
    out->filling = (uint32_t)(out - w->materials);
    share_places(out);
    if (out->m.kind == MATERIAL_MIX) {
        uint32_t first = out->m.mix_material[0], second = out->m.mix_material[1];
        /* Which part a ray meets is decided at the hit; a face is culled where neither shows. */
        unsigned a = w->materials[first].flags, b = w->materials[second].flags;
        uint32_t filling = w->materials[first].filling;
        out->filling = w->materials[filling].flags & MATERIAL_BOUNDS ? filling
                                                                     : w->materials[second].filling;
        out->flags &= MATERIAL_TEXTURED | MATERIAL_EMISSIVE;
        out->flags |= (a & b & MATERIAL_CULLED) | ((a | b) & MATERIAL_TWO_WAY);
    }
}

status world_materials_load(struct render_scene *w, const struct scene *scene, struct error *err)
{
    w->materials = mem_calloc(scene->material_count, sizeof *w->materials);
    if (!w->materials)
        return error_no_memory(err, "the materials");
    w->material_count = scene->material_count;
    for (uint32_t i = 0; i < scene->material_count; i++)
        material_init(&w->materials[i], w, scene, &scene->materials[i]);
    return STATUS_OK;
}

/* Alpha matters unless every way to less than 1 is shut. */
static int alpha_matters(const struct world_material *material, const struct world_mesh *mesh)
{
    if (material->m.alpha_mode == ALPHA_OPAQUE)
        return 0;
    if (material->base_color.image && !texture_image_is_opaque(material->base_color.image))
        return 1;
    if (mesh->colors)
        return 1;
    if (material->m.alpha_mode == ALPHA_MASK)
        return material->m.base_color[3] < material->m.alpha_cutoff;
    return material->m.base_color[3] < 1;
}

void world_materials_placed(struct render_scene *w)
{
    for (uint32_t i = 0; i < w->instance_count; i++) {
        struct world_material *material = &w->materials[w->instances[i].material];
        /* It depends on the mesh's colours: recorded with the material that meshes share. */
        if (alpha_matters(material, &w->meshes[w->instances[i].mesh]))
            material->flags |= MATERIAL_ALPHA;
    }
}
