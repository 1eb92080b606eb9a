#include "common/scene/simplify.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "common/base/memory.h"
#include "common/image/color.h"
#include "common/image/image.h"

enum { RED, GREEN, BLUE, ALPHA, CHANNELS };

/* What is known of an image. Grey is replicated and a missing alpha is 1, as in the renderer. */
struct survey {
    int done;
    int floats;
    float code_max;              /* 255, 65535; 0 for floats */
    float low[CHANNELS], high[CHANNELS]; /* codes, or values of floats */
};

struct simplifier {
    struct scene *scene;
    struct scene_blob_reader reader;
    struct scene_simplify_report *report;
    struct survey *images;       /* [image_count] */
    uint8_t *material_reached;   /* [material_count] */
    uint8_t *alpha_colors;       /* [material_count] on a mesh with vertex alpha below 1 */
    uint8_t *mesh_alpha;         /* [mesh_count] 0: not looked at, 1: all 1, 2: below */
    struct error *err;
};

/* ---- the slots ---------------------------------------------------------------------------- */

#define AT(field) offsetof(struct scene_material, field)
#define RGB(field) {{AT(field[0]), RED}, {AT(field[1]), GREEN}, {AT(field[2]), BLUE}}

/* Slots that multiply factors: which channel which factor. */
static const struct rule {
    size_t slot;
    int srgb;
    float most;                  /* that the factor may be */
    int parts;
    struct {
        size_t factor;
        int channel;
    } part[CHANNELS];
} rules[] = {
    {AT(base_color_texture), 1, 1, 4,
     {{AT(base_color[0]), RED}, {AT(base_color[1]), GREEN}, {AT(base_color[2]), BLUE},
      {AT(base_color[3]), ALPHA}}},
    {AT(metallic_roughness_texture), 0, 1, 2, {{AT(roughness), GREEN}, {AT(metallic), BLUE}}},
    {AT(emission_texture), 1, 1e30f, 3, RGB(emission)},
    {AT(specular_texture), 0, 1, 1, {{AT(specular), ALPHA}}},
    {AT(specular_color_texture), 1, 1e30f, 3, RGB(specular_color)},
    {AT(transmission_texture), 0, 1, 1, {{AT(transmission), RED}}},
    {AT(clearcoat_texture), 0, 1, 1, {{AT(clearcoat), RED}}},
    {AT(clearcoat_roughness_texture), 0, 1, 1, {{AT(clearcoat_roughness), GREEN}}},
    {AT(sheen_color_texture), 1, 1, 3, RGB(sheen_color)},
    {AT(sheen_roughness_texture), 0, 1, 1, {{AT(sheen_roughness), ALPHA}}},
    {AT(iridescence_texture), 0, 1, 1, {{AT(iridescence), RED}}},
    {AT(diffuse_transmission_texture), 0, 1, 1, {{AT(diffuse_transmission), ALPHA}}},
    {AT(diffuse_transmission_color_texture), 1, 1, 3, RGB(diffuse_transmission_color)},
    {AT(mix_texture), 0, 1, 1, {{AT(mix_amount), RED}}},
};
enum { RULE_COUNT = sizeof rules / sizeof *rules };

/* The others. */
static const size_t special_slots[] = {AT(normal_texture), AT(clearcoat_normal_texture),
                                       AT(anisotropy_texture), AT(iridescence_thickness_texture)};
enum { SLOT_COUNT = RULE_COUNT + sizeof special_slots / sizeof *special_slots };

static struct scene_texture_slot *slot_at(struct scene_material *m, size_t offset)
{
    return (struct scene_texture_slot *)(void *)((char *)m + offset);
}

static struct scene_texture_slot *slot_number(struct scene_material *m, int i)
{
    return slot_at(m, i < RULE_COUNT ? rules[i].slot : special_slots[i - RULE_COUNT]);
}

static float *factor_at(struct scene_material *m, size_t offset)
{
    return (float *)(void *)((char *)m + offset);
}

static int is_black(const float color[3])
{
    return color[0] == 0 && color[1] == 0 && color[2] == 0;
}

/* ---- looking at images -------------------------------------------------------------------- */

static void survey_value(struct survey *s, int channel, float value)
{
    s->low[channel] = fminf(s->low[channel], value);
    s->high[channel] = fmaxf(s->high[channel], value);
}

static void survey_copy(struct survey *s, int from, int to)
{
    s->low[to] = s->low[from];
    s->high[to] = s->high[from];
}

/* One and two channels are grey; the last of two or four is alpha. */
static void survey_spread(struct survey *s, uint32_t channels)
{
    if (channels == 2)
        survey_copy(s, GREEN, ALPHA);
    if (channels % 2 == 1)
        s->low[ALPHA] = s->high[ALPHA] = s->floats ? 1 : s->code_max;
    if (channels < 3) {
        survey_copy(s, RED, GREEN);
        survey_copy(s, RED, BLUE);
    }
}

static status survey_integers(struct survey *s, const uint8_t *data, size_t size_bytes,
                              const char *name, struct error *err)
{
    struct image8 image;
    status st = image_decode_8(&image, data, size_bytes, name, err);
    size_t count;

    if (st != STATUS_OK)
        return st;
    count = (size_t)image.width * image.height;
    s->code_max = image.bits == 8 ? 255 : 65535;
    for (uint32_t c = 0; c < image.channels; c++) {
        const uint16_t *words = (const uint16_t *)(const void *)image.pixels;
        unsigned low = 65535, high = 0;

        for (size_t i = 0; i < count; i++) {
            unsigned code = image.bits == 8 ? image.pixels[i * image.channels + c]
                                            : words[i * image.channels + c];
            low = code < low ? code : low;
            high = code > high ? code : high;
        }
        s->low[c] = (float)low;
        s->high[c] = (float)high;
    }
    survey_spread(s, image.channels);
    image8_release(&image);
    return STATUS_OK;
}

static status survey_floats(struct survey *s, const uint8_t *data, size_t size_bytes,
                            const char *name, struct error *err)
{
    struct image image;
    status st = image_decode_float(&image, data, size_bytes, name, NULL, err);
    size_t count;

    if (st != STATUS_OK)
        return st;
    count = (size_t)image.width * image.height;
    s->floats = 1;
    for (int c = 0; c < (int)image.channels; c++) {
        s->low[c] = s->high[c] = image.pixels[c];
        for (size_t i = 1; i < count; i++)
            survey_value(s, c, image.pixels[i * image.channels + (size_t)c]);
    }
    survey_spread(s, image.channels);
    image_release(&image);
    return STATUS_OK;
}

/* Decode the image of a slot's texture, the first time that it is asked about. */
static status survey_slot(struct simplifier *w, const struct scene_texture_slot *slot,
                          const struct survey **out)
{
    uint32_t index = w->scene->textures[slot->texture].image;
    const struct scene_image *image = &w->scene->images[index];
    struct survey *s = &w->images[index];
    enum image_format format;
    const uint8_t *data;
    size_t size_bytes;
    status st;

    *out = s;
    if (s->done)
        return STATUS_OK;
    st = w->reader.get(w->reader.user, &image->blob.digest, &data, &size_bytes, w->err);
    if (st != STATUS_OK)
        return st;
    format = image_format_of(data, size_bytes);
    if (format == IMAGE_HDR || format == IMAGE_EXR)
        st = survey_floats(s, data, size_bytes, image->name, w->err);
    else
        st = survey_integers(s, data, size_bytes, image->name, w->err);
    s->done = st == STATUS_OK;
    return st;
}

static int is_constant(const struct survey *s, int channel)
{
    return s->low[channel] == s->high[channel];
}

/* What a lookup in a constant channel gives, to the bit (worker/render/texture.c). */
static float constant_value(const struct survey *s, int channel, int srgb)
{
    float code = s->low[channel];

    if (s->floats)
        return code;
    if (!srgb || channel == ALPHA)
        return code / s->code_max;
    return srgb_decode(code / s->code_max);
}

/* +z to the precision of 8 bits, whose codes have no 0: 127 and 128 are either side of it. */
static int is_flat(const struct survey *s)
{
    const float max = s->floats ? 1 : s->code_max;

    for (int c = RED; c <= GREEN; c++)
        if (s->low[c] / max < 127.0f / 255.0f || s->high[c] / max > 128.0f / 255.0f)
            return 0;
    return s->low[BLUE] / max >= 254.0f / 255.0f && s->high[BLUE] / max <= 1.0f;
}

/* ---- slots that cannot act ----------------------------------------------------------------- */

static void drop(struct simplifier *w, struct scene_texture_slot *slot)
{
    if (slot->texture < 0)
        return;
    slot->texture = -1;
    w->report->unseen++;
}

static void drop_dielectric(struct simplifier *w, struct scene_material *m)
{
    drop(w, &m->specular_texture);
    drop(w, &m->specular_color_texture);
    drop(w, &m->transmission_texture);
    drop(w, &m->diffuse_transmission_texture);
    drop(w, &m->diffuse_transmission_color_texture);
}

/* What neither metals by their index nor surfaces without light of their own have. */
static void drop_layers(struct simplifier *w, struct scene_material *m)
{
    drop_dielectric(w, m);
    drop(w, &m->sheen_color_texture);
    drop(w, &m->sheen_roughness_texture);
    drop(w, &m->iridescence_texture);
    drop(w, &m->iridescence_thickness_texture);
}

static void drop_clearcoat(struct simplifier *w, struct scene_material *m)
{
    drop(w, &m->clearcoat_texture);
    drop(w, &m->clearcoat_roughness_texture);
    drop(w, &m->clearcoat_normal_texture);
}

/* A factor of 0 is 0 whatever its texture, and so are the weights that it scales. */
static void drop_weightless(struct simplifier *w, struct scene_material *m)
{
    if (is_black(m->base_color) && (m->alpha_mode == ALPHA_OPAQUE || m->base_color[3] == 0))
        drop(w, &m->base_color_texture);
    if (m->roughness == 0 && m->metallic == 0)
        drop(w, &m->metallic_roughness_texture);
    if (m->normal_scale == 0)
        drop(w, &m->normal_texture);
    if (is_black(m->emission))
        drop(w, &m->emission_texture);
    if (m->specular == 0) {
        drop(w, &m->specular_texture);
        drop(w, &m->specular_color_texture);
    }
    if (is_black(m->specular_color))
        drop(w, &m->specular_color_texture);
    if (m->transmission == 0)
        drop(w, &m->transmission_texture);
    if (m->anisotropy == 0)
        drop(w, &m->anisotropy_texture);
    if (m->clearcoat == 0)
        drop_clearcoat(w, m);
    if (m->clearcoat_roughness == 0)
        drop(w, &m->clearcoat_roughness_texture);
    if (m->clearcoat_normal_scale == 0)
        drop(w, &m->clearcoat_normal_texture);
    if (is_black(m->sheen_color)) {
        drop(w, &m->sheen_color_texture);
        drop(w, &m->sheen_roughness_texture);
    }
    if (m->sheen_roughness == 0)
        drop(w, &m->sheen_roughness_texture);
    if (m->iridescence == 0) {
        drop(w, &m->iridescence_texture);
        drop(w, &m->iridescence_thickness_texture);
    }
    if (m->iridescence_thickness_min_nm == m->iridescence_thickness_max_nm)
        drop(w, &m->iridescence_thickness_texture);
    if (m->diffuse_transmission == 0) {
        drop(w, &m->diffuse_transmission_texture);
        drop(w, &m->diffuse_transmission_color_texture);
    }
    if (is_black(m->diffuse_transmission_color))
        drop(w, &m->diffuse_transmission_color_texture);
    if (m->mix_amount == 0)
        drop(w, &m->mix_texture);
}

static void drop_unseen(struct simplifier *w, struct scene_material *m)
{
    switch (m->kind) {
    case MATERIAL_INTERFACE:
        for (int i = 0; i < SLOT_COUNT; i++)
            drop(w, slot_number(m, i));
        return;
    case MATERIAL_CONDUCTOR:
        drop_layers(w, m);
        if (m->roughness == 0)
            drop(w, &m->metallic_roughness_texture);
        break;
    case MATERIAL_SURFACE:
        if (m->metallic == 1 && m->metallic_roughness_texture.texture < 0)
            drop_dielectric(w, m);
        break;
    default:
        break;
    }
    if (m->kind != MATERIAL_MIX)
        drop(w, &m->mix_texture);
    if (m->unlit && m->kind == MATERIAL_SURFACE) {
        drop_layers(w, m);
        drop_clearcoat(w, m);
        drop(w, &m->metallic_roughness_texture);
        drop(w, &m->anisotropy_texture);
    }
    drop_weightless(w, m);
}

/* ---- constants into factors ---------------------------------------------------------------- */

static int is_srgb(const struct scene_texture *texture, int srgb)
{
    return texture->encoding == ENCODING_BY_SLOT ? srgb : texture->encoding == ENCODING_SRGB;
}

/* Outside of the image it would be black. */
static int has_border(const struct scene_texture *texture)
{
    return texture->wrap_u == WRAP_BLACK || texture->wrap_v == WRAP_BLACK;
}

/* Does the renderer read this factor at all? */
static int part_acts(const struct scene_material *m, size_t factor)
{
    if (factor == AT(base_color[3]))
        return m->alpha_mode != ALPHA_OPAQUE;
    if (factor == AT(metallic))
        return m->kind != MATERIAL_CONDUCTOR;
    return 1;
}

static status fold_rule(struct simplifier *w, struct scene_material *m, const struct rule *rule)
{
    struct scene_texture_slot *slot = slot_at(m, rule->slot);
    const struct scene_texture *texture;
    float product[CHANNELS];
    const struct survey *s;
    status st;

    if (slot->texture < 0)
        return STATUS_OK;
    texture = &w->scene->textures[slot->texture];
    st = survey_slot(w, slot, &s);
    if (st != STATUS_OK || has_border(texture))
        return st;
    for (int i = 0; i < rule->parts; i++) {
        float factor = *factor_at(m, rule->part[i].factor);
        int channel = rule->part[i].channel;

        product[i] = factor;
        if (factor == 0 || !part_acts(m, rule->part[i].factor))
            continue;
        if (!is_constant(s, channel))
            return STATUS_OK;
        product[i] = factor * constant_value(s, channel, is_srgb(texture, rule->srgb));
        if (!(product[i] <= rule->most))
            return STATUS_OK;
    }
    for (int i = 0; i < rule->parts; i++)
        *factor_at(m, rule->part[i].factor) = product[i];
    slot->texture = -1;
    w->report->folded++;
    return STATUS_OK;
}

static status fold_normal(struct simplifier *w, struct scene_texture_slot *slot)
{
    const struct scene_texture *texture;
    const struct survey *s;
    status st;

    if (slot->texture < 0)
        return STATUS_OK;
    texture = &w->scene->textures[slot->texture];
    st = survey_slot(w, slot, &s);
    if (st != STATUS_OK || has_border(texture) || is_srgb(texture, 0) || !is_flat(s))
        return st;
    slot->texture = -1;
    w->report->flat_normals++;
    return STATUS_OK;
}

/* The strength alone, where the direction is exactly the tangent's, or does not matter. */
static status fold_anisotropy(struct simplifier *w, struct scene_material *m)
{
    struct scene_texture_slot *slot = &m->anisotropy_texture;
    const struct scene_texture *texture;
    float x, y, strength;
    const struct survey *s;
    status st;
    int srgb;

    if (slot->texture < 0)
        return STATUS_OK;
    texture = &w->scene->textures[slot->texture];
    srgb = is_srgb(texture, 0);
    st = survey_slot(w, slot, &s);
    if (st != STATUS_OK || has_border(texture) || !is_constant(s, BLUE))
        return st;
    strength = m->anisotropy * constant_value(s, BLUE, srgb);
    if (strength != 0) {
        if (!is_constant(s, RED) || !is_constant(s, GREEN) || !(strength <= 1))
            return STATUS_OK;
        x = constant_value(s, RED, srgb) * 2 - 1;
        y = constant_value(s, GREEN, srgb) * 2 - 1;
        if (x != 1 || y != 0)
            return STATUS_OK;
    }
    m->anisotropy = strength;
    slot->texture = -1;
    w->report->folded++;
    return STATUS_OK;
}

static status fold_thickness(struct simplifier *w, struct scene_material *m)
{
    struct scene_texture_slot *slot = &m->iridescence_thickness_texture;
    const struct scene_texture *texture;
    const struct survey *s;
    float thickness;
    status st;

    if (slot->texture < 0)
        return STATUS_OK;
    texture = &w->scene->textures[slot->texture];
    st = survey_slot(w, slot, &s);
    if (st != STATUS_OK || has_border(texture) || !is_constant(s, GREEN))
        return st;
    thickness = m->iridescence_thickness_min_nm +
                (m->iridescence_thickness_max_nm - m->iridescence_thickness_min_nm) *
                    constant_value(s, GREEN, is_srgb(texture, 0));
    if (!(thickness >= 0 && thickness <= 1e9f))
        return STATUS_OK;
    m->iridescence_thickness_min_nm = m->iridescence_thickness_max_nm = thickness;
    slot->texture = -1;
    w->report->folded++;
    return STATUS_OK;
}

static status fold_material(struct simplifier *w, struct scene_material *m)
{
    status st = STATUS_OK;

    for (int i = 0; i < RULE_COUNT && st == STATUS_OK; i++)
        st = fold_rule(w, m, &rules[i]);
    if (st == STATUS_OK)
        st = fold_normal(w, &m->normal_texture);
    if (st == STATUS_OK)
        st = fold_normal(w, &m->clearcoat_normal_texture);
    if (st == STATUS_OK)
        st = fold_anisotropy(w, m);
    if (st == STATUS_OK)
        st = fold_thickness(w, m);
    return st;
}

/* ---- alpha --------------------------------------------------------------------------------- */

/* Is any vertex's alpha other than 1? */
static status survey_mesh_alpha(struct simplifier *w, uint32_t index, int *below)
{
    const struct scene_mesh *mesh = &w->scene->meshes[index];
    struct scene_mesh_layout layout;
    const uint8_t *data;
    size_t size_bytes;
    status st;

    *below = w->mesh_alpha[index] == 2;
    if (w->mesh_alpha[index] || !(mesh->arrays & MESH_COLORS))
        return STATUS_OK;
    st = w->reader.get(w->reader.user, &mesh->blob.digest, &data, &size_bytes, w->err);
    if (st != STATUS_OK)
        return st;
    scene_mesh_layout(mesh, &layout);
    if (size_bytes != layout.total_bytes)
        return error_set(w->err, STATUS_ERR_INPUT, "mesh %s: its blob has %zu bytes instead of %zu",
                         mesh->name, size_bytes, layout.total_bytes);
    for (uint32_t i = 0; i < mesh->vertex_count && !*below; i++) {
        float alpha;

        memcpy(&alpha, data + layout.colors + 16 * (size_t)i + 12, sizeof alpha);
        *below = alpha != 1.0f;
    }
    w->mesh_alpha[index] = *below ? 2 : 1;
    return STATUS_OK;
}

/* Which materials lie on a mesh whose vertices are less than opaque; a mix's parts with it. */
static status survey_colors(struct simplifier *w)
{
    const struct scene *scene = w->scene;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_instance *instance = &scene->instances[i];
        int below = 0;
        const struct scene_material *m = &scene->materials[instance->material];
        status st;

        if (m->kind != MATERIAL_MIX && m->alpha_mode == ALPHA_OPAQUE)
            continue;
        st = survey_mesh_alpha(w, instance->mesh, &below);
        if (st != STATUS_OK)
            return st;
        if (below)
            w->alpha_colors[instance->material] = 1;
    }
    for (uint32_t i = scene->material_count; i-- > 0;)
        if (w->alpha_colors[i] && scene->materials[i].kind == MATERIAL_MIX)
            for (int k = 0; k < 2; k++)
                w->alpha_colors[scene->materials[i].mix_material[k]] = 1;
    return STATUS_OK;
}

static status make_opaque(struct simplifier *w, uint32_t index)
{
    struct scene_material *m = &w->scene->materials[index];
    struct scene_texture_slot *slot = &m->base_color_texture;
    int always = m->alpha_mode == ALPHA_MASK && m->alpha_cutoff <= 0;
    int one = m->base_color[3] == 1 && !w->alpha_colors[index];

    if (m->alpha_mode == ALPHA_OPAQUE)
        return STATUS_OK;
    if (slot->texture >= 0 && !always) {
        const struct survey *s;
        status st = survey_slot(w, slot, &s);

        if (st != STATUS_OK)
            return st;
        one = one && !has_border(&w->scene->textures[slot->texture]) && is_constant(s, ALPHA) &&
              constant_value(s, ALPHA, 0) == 1;
    } else if (m->alpha_mode == ALPHA_MASK && !w->alpha_colors[index]) {
        always = always || m->base_color[3] >= m->alpha_cutoff;
    }
    if (!always && !(one && (m->alpha_mode == ALPHA_BLEND || m->alpha_cutoff <= 1)))
        return STATUS_OK;
    m->alpha_mode = ALPHA_OPAQUE;
    w->report->made_opaque++;
    return STATUS_OK;
}

/* ---- the environment ----------------------------------------------------------------------- */

static status simplify_environment(struct simplifier *w)
{
    struct scene_environment *e = &w->scene->environment;
    struct image_repairs repairs = {0};
    struct image map;
    const uint8_t *data;
    size_t size_bytes, count;
    int same = 1;
    status st;

    if (!e->present || e->constant)
        return STATUS_OK;
    st = w->reader.get(w->reader.user, &e->image.blob.digest, &data, &size_bytes, w->err);
    if (st == STATUS_OK)
        st = image_decode_hdr(&map, data, size_bytes, e->image.name, &repairs, w->err);
    if (st != STATUS_OK)
        return st;
    count = (size_t)map.width * map.height;
    for (size_t i = 1; i < count && same; i++)
        same = memcmp(map.pixels, map.pixels + 3 * i, 3 * sizeof(float)) == 0;
    for (int c = 0; c < 3 && same; c++)
        same = e->radiance[c] * map.pixels[c] <= 1e30f;
    if (same) {
        e->constant = 1;
        for (int c = 0; c < 3; c++)
            e->radiance[c] *= map.pixels[c];
        w->report->uniform_environment = 1;
        w->report->image_bytes += e->image.blob.size_bytes;
    }
    image_release(&map);
    return STATUS_OK;
}

/* ---- what nothing reaches ------------------------------------------------------------------ */

/* A mix of which one part is never there, or always, needs the other no more. */
static void simplify_mixes(struct simplifier *w)
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

static void reach_materials(struct simplifier *w)
{
    const struct scene *scene = w->scene;

    memset(w->material_reached, 0, scene->material_count);
    for (uint32_t i = 0; i < scene->instance_count; i++)
        w->material_reached[scene->instances[i].material] = 1;
    /* A mix's parts come before it. */
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
        /* Those of other kinds mean nothing, but must stay in range. */
        for (int k = 0; k < 2; k++)
            m->mix_material[k] = m->kind == MATERIAL_MIX ? number[m->mix_material[k]] : 0;
    }
    for (uint32_t i = 0; i < scene->instance_count; i++)
        scene->instances[i].material = number[scene->instances[i].material];
    scene->material_count = kept;
}

static void remove_textures(struct scene *scene, uint8_t *reached, uint32_t *number)
{
    uint32_t kept;

    memset(reached, 0, scene->texture_count);
    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int k = 0; k < SLOT_COUNT; k++) {
            int32_t texture = slot_number(&scene->materials[i], k)->texture;

            if (texture >= 0)
                reached[texture] = 1;
        }
    kept = renumber(reached, scene->texture_count, number);
    for (uint32_t i = 0; i < scene->texture_count; i++)
        if (reached[i])
            scene->textures[number[i]] = scene->textures[i];
    for (uint32_t i = 0; i < scene->material_count; i++)
        for (int k = 0; k < SLOT_COUNT; k++) {
            struct scene_texture_slot *slot = slot_number(&scene->materials[i], k);

            if (slot->texture >= 0)
                slot->texture = (int32_t)number[slot->texture];
        }
    scene->texture_count = kept;
}

static void remove_images(struct scene *scene, uint8_t *reached, uint32_t *number,
                          uint64_t *bytes)
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

static status remove_unreached(struct simplifier *w)
{
    struct scene *scene = w->scene;
    const uint32_t materials = scene->material_count, textures = scene->texture_count,
                   images = scene->image_count;
    size_t most = materials > textures ? materials : textures;
    uint8_t *reached;
    uint32_t *number;
    status st = STATUS_OK;

    most = most > images ? most : images;
    reached = mem_alloc_array(most, sizeof *reached);
    number = mem_alloc_array(most, sizeof *number);
    if (reached && number) {
        reach_materials(w);
        remove_materials(scene, w->material_reached, number);
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

/* ---- the whole ----------------------------------------------------------------------------- */

static status simplify_materials(struct simplifier *w)
{
    status st;

    simplify_mixes(w);
    reach_materials(w);
    for (uint32_t i = 0; i < w->scene->material_count; i++) {
        struct scene_material *m = &w->scene->materials[i];

        if (!w->material_reached[i])
            continue;
        drop_unseen(w, m);
        st = fold_material(w, m);
        if (st != STATUS_OK)
            return st;
        drop_unseen(w, m);
    }
    simplify_mixes(w);
    reach_materials(w);
    st = survey_colors(w);
    for (uint32_t i = 0; i < w->scene->material_count && st == STATUS_OK; i++)
        if (w->material_reached[i]) {
            st = make_opaque(w, i);
            /* Without alpha there may be less to keep. */
            if (st == STATUS_OK)
                st = fold_rule(w, &w->scene->materials[i], &rules[0]);
            if (st == STATUS_OK)
                drop_unseen(w, &w->scene->materials[i]);
        }
    return st;
}

status scene_simplify(struct scene *scene, struct scene_blob_reader reader,
                      struct scene_simplify_report *report, struct error *err)
{
    struct simplifier w = {.scene = scene, .reader = reader, .report = report, .err = err};
    status st;

    memset(report, 0, sizeof *report);
    w.images = mem_calloc(scene->image_count, sizeof *w.images);
    w.material_reached = mem_calloc(scene->material_count, 1);
    w.alpha_colors = mem_calloc(scene->material_count, 1);
    w.mesh_alpha = mem_calloc(scene->mesh_count, 1);
    if (!w.images || !w.material_reached || !w.alpha_colors || !w.mesh_alpha)
        st = error_no_memory(err, "what is known of the scene");
    else
        st = simplify_materials(&w);
    if (st == STATUS_OK)
        st = simplify_environment(&w);
    if (st == STATUS_OK)
        st = remove_unreached(&w);
    mem_free(w.mesh_alpha);
    mem_free(w.alpha_colors);
    mem_free(w.material_reached);
    mem_free(w.images);
    return st;
}
