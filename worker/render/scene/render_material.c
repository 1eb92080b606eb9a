#include "worker/render/scene/render_material.h"

#include <math.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/system/parallel.h"
#include "common/math/elementary.h"
#include "common/scene/material.h"
#include "common/scene/effects_material.h"
#include "worker/render/bsdf/bsdf.h"
#include "worker/render/scene/image_share.h"

static struct scene_material reduced(const struct scene_material *material, const struct render_settings *settings)
{
    struct scene_material m = *material;

    scene_material_reduce(&m, settings->without);
    return m;
}

/* ---- what is used ------------------------------------------------------------------------- */

static void use_material(struct render_used *used, const struct scene *scene, const struct render_settings *settings,
                         uint32_t index)
{
    struct scene_material m = reduced(&scene->materials[index], settings);

    for (int i = 0; i < MATERIAL_TEXTURES; i++) {
        const struct scene_texture *texture;

        if (!material_has_texture(&m, i))
            continue;
        texture = &scene->textures[m.textures[i].texture];
        used->images[texture->image] |= RENDER_IMAGE_USED;
        if (material_textures[i].filtered && !texture->nearest && settings->texture_filter == TEXTURE_FILTER_CONE)
            used->images[texture->image] |= (uint8_t)texture_use_of(texture, material_textures[i].color);
    }
    if (m.medium >= 0)
        used->media[m.medium] = 1;
    if (m.medium_outside >= 0)
        used->media[m.medium_outside] = 1;
    if (m.kind == MATERIAL_MIX)
        used->materials[m.mix_material[0]] = used->materials[m.mix_material[1]] = 1;
}

static void use_lights(struct render_used *used, const struct scene *scene, const struct render_settings *settings)
{
    if (settings->without & (EFFECT_PUNCTUAL_LIGHT | EFFECT_LIGHT_IMAGE))
        return;
    for (uint32_t i = 0; i < scene->light_count; i++) {
        const struct scene_light *light = &scene->lights[i];
        int has_image = (scene_light_parts(light->kind) & LIGHT_HAS_FRAME) != 0;
        if (has_image && light->image >= 0 && !scene_color_is(light->intensity, 0))
            used->images[light->image] |= RENDER_IMAGE_USED;
    }
}

status used_init(struct render_used *used, const struct scene *scene, const struct render_settings *settings,
                 struct error *err)
{
    memset(used, 0, sizeof *used);
    used->materials = mem_calloc(scene->material_count, 1);
    used->images = mem_calloc(scene->image_count, 1);
    used->media = mem_calloc(scene->medium_count, 1);
    if (!used->materials || !used->images || !used->media) {
        used_release(used);
        return error_no_memory(err, "the tables of what is used");
    }
    for (uint32_t i = 0; i < scene->instance_count; i++)
        used->materials[scene->instances[i].material] = 1;
    /* A mix refers to lower rows only; this loop visits them later. */
    for (uint32_t i = scene->material_count; i-- > 0;)
        if (used->materials[i])
            use_material(used, scene, settings, i);
    use_lights(used, scene, settings);
    if (scene->fog >= 0 && !(settings->without & (EFFECT_FOG | EFFECT_MEDIUM)))
        used->media[scene->fog] = 1;
    return STATUS_OK;
}

void used_release(struct render_used *used)
{
    mem_free(used->materials);
    mem_free(used->images);
    mem_free(used->media);
    memset(used, 0, sizeof *used);
}

/* ---- images ------------------------------------------------------------------------------- */

struct image_load {
    struct render_scene *w;
    const struct scene *scene;
    const struct render_used *used;
    struct image_file {
        const uint8_t *data; /* NULL: not used */
        size_t size_bytes;
        struct error fault;
    } * files; /* [image_count] */
};

static void load_images(void *user, size_t begin, size_t end)
{
    const struct image_load *load = user;

    for (size_t i = begin; i < end; i++) {
        const struct scene_image *image = &load->scene->images[i];
        struct image_file *file = &load->files[i];

        if (file->data)
            file->fault.code =
                image_share_get(&load->w->image_shares[i], &image->blob.digest, image_uses(load->used, (uint32_t)i),
                                file->data, file->size_bytes, image->name, &file->fault);
    }
}

/* By as many threads as may be used; the first fault in the scene's order is reported. */
static status load_all_images(struct image_load *load, struct blob_source blobs, struct error *err)
{
    struct render_scene *w = load->w;

    for (uint32_t i = 0; i < w->image_count; i++) {
        struct image_file *file = &load->files[i];
        status s;

        if (!load->used->images[i])
            continue;
        s = blobs.get(blobs.user, &load->scene->images[i].blob.digest, &file->data, &file->size_bytes, err);
        if (s != STATUS_OK)
            return s;
    }
    parallel_for(w->build_threads, w->image_count, 1, load_images, load);
    for (uint32_t i = 0; i < w->image_count; i++) {
        if (load->files[i].fault.code != STATUS_OK) {
            *err = load->files[i].fault;
            return err->code;
        }
        if (w->image_shares[i]) {
            w->images[i] = image_share_image(w->image_shares[i]);
            w->info.texture_bytes += texture_image_bytes(w->images[i]);
        }
    }
    return STATUS_OK;
}

status images_load(struct render_scene *w, const struct scene *scene, const struct render_used *used,
                   struct blob_source blobs, struct error *err)
{
    struct image_load load = {w, scene, used, mem_calloc(scene->image_count, sizeof *load.files)};
    status s;

    w->images = mem_calloc(scene->image_count, sizeof *w->images);
    w->image_shares = mem_calloc(scene->image_count, sizeof *w->image_shares);
    if (load.files && w->images && w->image_shares) {
        w->image_count = scene->image_count;
        s = load_all_images(&load, blobs, err);
    } else {
        s = error_no_memory(err, "the textures");
    }
    mem_free(load.files);
    return s;
}

/* ---- materials ---------------------------------------------------------------------------- */

static void slot_init(struct render_slot *out, const struct render_scene *w, const struct scene *scene,
                      const struct scene_texture_slot *slot, int color)
{
    out->texture = scene->textures[slot->texture];
    if (w->settings.texture_filter == TEXTURE_FILTER_NEAREST)
        out->texture.nearest = 1;
    out->image = w->images[out->texture.image];
    out->uv_set = slot->uv_set;
    out->color = color;
    out->transformed = 0;
    for (int axis = 0; axis < 2; axis++)
        for (int k = 0; k < 3; k++) {
            out->m[axis][k] = slot->uv_transform[axis][k];
            out->transformed |= out->m[axis][k] != (axis == k ? 1.0f : 0.0f);
        }
}

static real absorption(real color, real distance)
{
    if (!(distance < INFINITY) || color >= 1)
        return 0;
    /* A black attenuation colour absorbs everything; a finite value avoids 0 * inf. */
    return -real_log(real_fmax(color, REAL(1e-30))) / real_fmax(distance, REAL(1e-30));
}

/* Does it have any of the layers that surface_shade.c and the BSDF treat separately? */
static int is_layered(const struct scene_material *m)
{
#define FACTOR_OF_MATERIAL(name) m->name
#define FACTOR_IS_SET(effect, value) || value > 0
    return m->anisotropy > 0 || !scene_color_is(m->sheen_color, 0) || m->base_interreflection > 0 || m->thin_slab ||
           m->kind == MATERIAL_CONDUCTOR BSDF_FACTOR_MAP(FACTOR_IS_SET, FACTOR_OF_MATERIAL);
#undef FACTOR_IS_SET
#undef FACTOR_OF_MATERIAL
}

static unsigned flags_of(const struct render_material *material, enum scene_volume_rule rule)
{
    const struct scene_material *m = &material->m;
    int lit = !m->unlit && m->kind != MATERIAL_INTERFACE, through = material_transmits(m);
    unsigned flags = 0;

    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if (material->slots[i].image && material_textures[i].filtered)
            flags |= MATERIAL_TEXTURED;
    if (lit && !scene_color_is(m->emission, 0))
        flags |= MATERIAL_EMISSIVE;
    if (material->normal.image)
        flags |= MATERIAL_NORMAL_MAP;
    if (m->kind == MATERIAL_INTERFACE || (m->refractive && through))
        flags |= MATERIAL_BOUNDS;
    if (m->kind == MATERIAL_INTERFACE || through || (lit && m->diffuse_transmission > 0))
        flags |= MATERIAL_TWO_WAY;
    if (rule == VOLUMES_BOUNDARIES && (flags & MATERIAL_TWO_WAY) && m->medium != m->medium_outside)
        flags |= MATERIAL_BOUNDS;
    /* Rays leave a volume through back faces, whatever doubleSided says. */
    if (!m->double_sided && !(flags & MATERIAL_BOUNDS))
        flags |= MATERIAL_CULLED;
    if (lit && is_layered(m))
        flags |= MATERIAL_LAYERED;
    if (lit && (m->anisotropy > 0 || material->clearcoat_normal.image))
        flags |= MATERIAL_NEEDS_FRAME;
    return flags;
}

/* Textures with the same layout, the usual case, share one place for their lookups. */
static void share_places(struct render_material *material)
{
    for (int i = 0; i < MATERIAL_TEXTURES; i++) {
        struct render_slot *slot = &material->slots[i];
        const struct render_slot *lead;

        if (!slot->image || !material_textures[i].filtered)
            continue;
        if (!material->lead)
            material->lead = slot;
        lead = material->lead;
        slot->shares_place =
            slot->uv_set == lead->uv_set && memcmp(slot->m, lead->m, sizeof slot->m) == 0 &&
            texture_shares_place(slot->image, &slot->texture, slot->color, lead->image, &lead->texture, lead->color);
    }
}

static void material_init(struct render_material *out, const struct render_scene *w, const struct scene *scene,
                          const struct scene_material *material)
{
    out->m = reduced(material, &w->settings);
    out->m.name = NULL;
    for (int i = 0; i < MATERIAL_TEXTURES; i++)
        if (material_has_texture(&out->m, i))
            slot_init(&out->slots[i], w, scene, &out->m.textures[i], material_textures[i].color);
    out->absorption = vec3_make(absorption(out->m.attenuation_color[0], out->m.attenuation_distance),
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
        /* The hit decides which part a ray meets; a face is culled if both parts cull it. */
        unsigned a = w->materials[first].flags, b = w->materials[second].flags;
        uint32_t filling = w->materials[first].filling;
        out->filling = w->materials[filling].flags & MATERIAL_BOUNDS ? filling : w->materials[second].filling;
        out->flags &= MATERIAL_TEXTURED | MATERIAL_EMISSIVE;
        out->flags |= (a & b & MATERIAL_CULLED) | ((a | b) & MATERIAL_TWO_WAY);
    }
}

status materials_load(struct render_scene *w, const struct scene *scene, struct error *err)
{
    w->materials = mem_calloc(scene->material_count, sizeof *w->materials);
    NEED(w->materials, err, "the materials");
    w->material_count = scene->material_count;
    for (uint32_t i = 0; i < scene->material_count; i++)
        material_init(&w->materials[i], w, scene, &scene->materials[i]);
    return STATUS_OK;
}

/* Alpha matters unless it is 1 everywhere. */
static int alpha_matters(const struct render_material *material, const struct render_mesh *mesh)
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

void materials_placed(struct render_scene *w)
{
    for (uint32_t i = 0; i < w->instance_count; i++) {
        struct render_material *material = &w->materials[w->instances[i].material];
        /* It depends on the mesh's colours, and is stored with the material, which meshes share. */
        if (alpha_matters(material, &w->meshes[w->instances[i].mesh]))
            material->flags |= MATERIAL_ALPHA;
    }
}
