/* Finds what no instance reaches and removes it from the scene's tables. */
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/simplify/simplify_parts.h"

void simplify_mixes(struct simplifier *w)
{
    for (uint32_t i = 0; i < w->scene->material_count; i++) {
        struct scene_material *m = &w->scene->materials[i];
        int only = m->mix_amount == 0 ? 0 : 1;

        if (m->kind != MATERIAL_MIX || m->mix_material[0] == m->mix_material[1] ||
            (m->mix_amount != 0 && (m->mix_amount != 1 || m->mix_texture.texture >= 0)))
            continue;
        m->mix_material[!only] = m->mix_material[only];
        w->report->mixes++;
    }
}

void simplify_reach(struct simplifier *w)
{
    const struct scene *scene = w->scene;

    memset(w->material_reached, 0, scene->material_count);
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        w->material_reached[scene->instances[i].material] = 1;
        if (scene->instances[i].body >= 0)
            w->material_reached[scene->instances[i].body] = 1;
    }
    /* A mix's parts come before it in the table. */
    for (uint32_t i = scene->material_count; i-- > 0;)
        if (w->material_reached[i] && scene->materials[i].kind == MATERIAL_MIX)
            for (int k = 0; k < 2; k++)
                w->material_reached[scene->materials[i].mix_material[k]] = 1;
}

/* From flags to new numbers, in the old order; returns how many there are. */
static uint32_t renumber(const uint8_t *reached, uint32_t count, uint32_t *number)
{
    uint32_t next = 0;

    for (uint32_t i = 0; i < count; i++) {
        number[i] = next;
        next += reached[i] != 0;
    }
    return next;
}

static void remove_materials(struct scene *scene, const uint8_t *reached, uint32_t *number)
{
    uint32_t kept = renumber(reached, scene->material_count, number);

    for (uint32_t i = 0; i < scene->material_count; i++) {
        struct scene_material *m = &scene->materials[number[i]];

        if (!reached[i])
            continue;
        *m = scene->materials[i];
        /* The fields of other kinds have no meaning, but must stay in range. */
        for (int k = 0; k < 2; k++)
            m->mix_material[k] = m->kind == MATERIAL_MIX ? number[m->mix_material[k]] : 0;
    }
    for (uint32_t i = 0; i < scene->instance_count; i++) {
        struct scene_instance *instance = &scene->instances[i];

        instance->material = number[instance->material];
        if (instance->body >= 0)
            instance->body = (int32_t)number[instance->body];
    }
    scene->material_count = kept;
}

/* `reached` and `number`: the materials'. Those of TRACK_MATERIAL and of textures come first, and stay in order. */
static void remove_tracks(struct scene *scene, const uint8_t *reached, const uint32_t *number)
{
    uint32_t kept = 0;

    for (uint32_t i = 0; i < scene->track_count; i++) {
        struct scene_track track = scene->tracks[i];

        if (track.target <= TRACK_UV_OFFSET && !reached[track.row])
            continue;
        if (track.target <= TRACK_UV_OFFSET)
            track.row = number[track.row];
        scene->tracks[kept++] = track;
    }
    scene->track_count = kept;
}

static void remove_textures(struct scene *scene, uint8_t *reached, uint32_t *number)
{
    uint32_t kept;

    memset(reached, 0, scene->texture_count);
    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int k = 0; k < MATERIAL_TEXTURES; k++) {
            int32_t texture = scene->materials[i].textures[k].texture;

            if (texture >= 0)
                reached[texture] = 1;
        }
    kept = renumber(reached, scene->texture_count, number);
    for (uint32_t i = 0; i < scene->texture_count; i++)
        if (reached[i])
            scene->textures[number[i]] = scene->textures[i];
    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int k = 0; k < MATERIAL_TEXTURES; k++) {
            struct scene_texture_slot *slot = &scene->materials[i].textures[k];

            if (slot->texture >= 0)
                slot->texture = (int32_t)number[slot->texture];
        }
    scene->texture_count = kept;
}

static void remove_images(struct scene *scene, uint8_t *reached, uint32_t *number, uint64_t *bytes)
{
    uint32_t kept;

    memset(reached, 0, scene->image_count);
    for (uint32_t i = 0; i < scene->texture_count; i++)
        reached[scene->textures[i].image] = 1;
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->lights[i].image >= 0)
            reached[scene->lights[i].image] = 1;
    kept = renumber(reached, scene->image_count, number);
    for (uint32_t i = 0; i < scene->image_count; i++) {
        if (reached[i])
            scene->images[number[i]] = scene->images[i];
        else
            *bytes += scene->images[i].blob.size_bytes;
    }
    for (uint32_t i = 0; i < scene->texture_count; i++)
        scene->textures[i].image = number[scene->textures[i].image];
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->lights[i].image >= 0)
            scene->lights[i].image = (int32_t)number[scene->lights[i].image];
    scene->image_count = kept;
}

status simplify_remove_unreached(struct simplifier *w)
{
    struct scene *scene = w->scene;
    const uint32_t materials = scene->material_count, textures = scene->texture_count, images = scene->image_count;
    size_t most = materials > textures ? materials : textures;
    uint8_t *reached;
    uint32_t *number;
    status st = STATUS_OK;

    most = most > images ? most : images;
    reached = mem_alloc_array(most, sizeof *reached);
    number = mem_alloc_array(most, sizeof *number);
    if (reached && number) {
        simplify_reach(w);
        remove_materials(scene, w->material_reached, number);
        remove_tracks(scene, w->material_reached, number);
        remove_textures(scene, reached, number);
        remove_images(scene, reached, number, &w->report->image_bytes);
        w->report->materials = materials - scene->material_count;
        w->report->textures = textures - scene->texture_count;
        w->report->images = images - scene->image_count;
    } else {
        st = error_no_memory(w->err, "the scene's tables");
    }
    mem_free(number);
    mem_free(reached);
    return st;
}
