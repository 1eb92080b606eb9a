#include <math.h>
#include <string.h>

#include "client/import/gltf.h"
#include "client/import/uri.h"
#include "common/base/file.h"
#include "common/base/memory.h"
#include "common/image/image.h"
#include "common/math/elementary.h"

#define TRY(call)                  \
    do {                           \
        status result_ = (call);   \
        if (result_ != STATUS_OK)  \
            return result_;        \
    } while (0)

/* ---- images ------------------------------------------------------------------------------- */

/* Is it a kind of picture that is known but not read? For a message that helps. */
static const char *foreign_format(const uint8_t *data, size_t size)
{
    if (size >= 12 && memcmp(data, "RIFF", 4) == 0 && memcmp(data + 8, "WEBP", 4) == 0)
        return "a WebP";
    if (size >= 12 && memcmp(data, "\xabKTX 20\xbb\r\n\x1a\n", 12) == 0)
        return "a KTX2";
    if (size >= 2 && memcmp(data, "BM", 2) == 0)
        return "a BMP";
    if (size >= 4 && memcmp(data, "DDS ", 4) == 0)
        return "a DDS";
    if (size >= 4 && memcmp(data, "GIF8", 4) == 0)
        return "a GIF";
    return "an unknown";
}

static status read_image(struct gltf *g, size_t index, int64_t *row)
{
    const struct gltf_place at = gltf_at("images", index, "");
    const char *uri = NULL, *name = NULL, *file;
    struct buffer bytes = BUFFER_INIT;
    int64_t view = -1;
    json_t *image;
    uint32_t added = 0;
    status result;

    TRY(gltf_row(g, g->images, &at, &image));
    TRY(gltf_text(g, image, &at, "uri", &uri));
    TRY(gltf_text(g, image, &at, "name", &name));
    TRY(gltf_index(g, image, &at, "bufferView", g->views, &view));
    file = uri && !uri_is_data(uri) ? uri : NULL;
    if (uri) {
        result = gltf_read_uri(g, uri, &at, &bytes);
    } else if (view >= 0) {
        const uint8_t *data = NULL;
        size_t size = 0, stride;
        result = gltf_view(g, (size_t)view, &data, &size, &stride);
        if (result == STATUS_OK)
            buffer_append(&bytes, data, size);
        if (!buffer_ok(&bytes))
            result = error_no_memory(g->err, "an image");
    } else {
        result = gltf_fail(g, STATUS_ERR_INPUT, &at, "has neither a uri nor a bufferView");
    }
    if (result == STATUS_OK && image_format_of(bytes.data, bytes.size) == IMAGE_UNKNOWN)
        result = gltf_fail(g, STATUS_ERR_INPUT, &at,
                           "%.80s is %s file: PNG and JPEG textures are read (convert the "
                           "textures, for example with gltf-transform)",
                           file ? file : name ? name : "it",
                           foreign_format(bytes.data, bytes.size));
    if (result == STATUS_OK) {
        result = builder_add_image(g->b, name ? name : file ? file_basename(file) : "", bytes.data,
                                   bytes.size, &added);
        bytes = (struct buffer)BUFFER_INIT; /* taken over */
        *row = added;
    }
    buffer_release(&bytes);
    return result;
}

/* ---- textures ----------------------------------------------------------------------------- */

static enum scene_wrap wrap_of(struct gltf *g, uint64_t mode, const struct gltf_place *at)
{
    switch (mode) {
    case 10497: return WRAP_REPEAT;
    case 33071: return WRAP_CLAMP;
    case 33648: return WRAP_MIRROR;
    default:
        builder_warn(g->b, "wrap mode", "samplers[%zu]: wrap mode %llu is unknown: repeated",
                     at->row, (unsigned long long)mode);
        return WRAP_REPEAT;
    }
}

static status read_sampler(struct gltf *g, size_t index, struct scene_texture *out)
{
    const struct gltf_place at = gltf_at("samplers", index, "");
    uint64_t wrap_s = 10497, wrap_t = 10497, magnify = 9729;
    json_t *sampler;

    TRY(gltf_row(g, g->samplers, &at, &sampler));
    TRY(gltf_size(g, sampler, &at, "wrapS", &wrap_s));
    TRY(gltf_size(g, sampler, &at, "wrapT", &wrap_t));
    TRY(gltf_size(g, sampler, &at, "magFilter", &magnify));
    out->wrap_u = wrap_of(g, wrap_s, &at);
    out->wrap_v = wrap_of(g, wrap_t, &at);
    out->nearest = magnify == 9728;
    return STATUS_OK;
}

/* *row stays BUILDER_NO_ROW for a texture in a form that is not read. */
static status read_texture(struct gltf *g, size_t index, int64_t *row)
{
    const struct gltf_place at = gltf_at("textures", index, "");
    struct scene_texture out = {.wrap_u = WRAP_REPEAT, .wrap_v = WRAP_REPEAT};
    int64_t source = -1, sampler = -1;
    json_t *texture;
    uint32_t added;

    TRY(gltf_row(g, g->textures, &at, &texture));
    TRY(gltf_index(g, texture, &at, "source", g->images, &source));
    TRY(gltf_index(g, texture, &at, "sampler", g->samplers, &sampler));
    if (gltf_extension(texture, "KHR_texture_basisu"))
        builder_warn(g->b, "basisu",
                     "textures[%zu] is in KTX2 form (KHR_texture_basisu), which is not read: %s",
                     index, source >= 0 ? "its PNG or JPEG form is used" : "left out");
    if (gltf_extension(texture, "EXT_texture_webp"))
        builder_warn(g->b, "webp",
                     "textures[%zu] is in WebP form (EXT_texture_webp), which is not read: %s",
                     index, source >= 0 ? "its PNG or JPEG form is used" : "left out");
    if (source < 0) {
        if (!json_object_get(texture, "extensions"))
            builder_warn(g->b, "texture without source", "textures[%zu] has no image: left out",
                         index);
        return STATUS_OK;
    }
    if (sampler >= 0)
        TRY(read_sampler(g, (size_t)sampler, &out));
    if (g->image_rows[source] == GLTF_ROW_UNREAD)
        TRY(read_image(g, (size_t)source, &g->image_rows[source]));
    out.image = (uint32_t)g->image_rows[source];
    TRY(builder_add_texture(g->b, &out, &added));
    *row = added;
    return STATUS_OK;
}

/* KHR_texture_transform: uv' = T R S uv; the angle turns counter-clockwise as seen on the
 * image, whose v runs downwards. */
static status read_transform(struct gltf *g, json_t *info, const struct gltf_place *at,
                             struct scene_texture_slot *slot, uint64_t *uv_set)
{
    const struct gltf_place inner = gltf_within(at, ".KHR_texture_transform");
    json_t *extension = gltf_extension(info, "KHR_texture_transform");
    double offset[2] = {0, 0}, scale[2] = {1, 1}, rotation = 0;
    float s, c;

    if (!extension)
        return STATUS_OK;
    TRY(gltf_numbers(g, extension, &inner, "offset", 2, offset));
    TRY(gltf_numbers(g, extension, &inner, "scale", 2, scale));
    TRY(gltf_number(g, extension, &inner, "rotation", &rotation));
    TRY(gltf_size(g, extension, &inner, "texCoord", uv_set));
    if (fabs(rotation) > 1e5)
        return gltf_fail(g, STATUS_ERR_INPUT, &inner, "rotation is too large");
    det_sincos((float)rotation, &s, &c);
    slot->uv_transform[0][0] = (float)((double)c * scale[0]);
    slot->uv_transform[0][1] = (float)((double)s * scale[1]);
    slot->uv_transform[0][2] = (float)offset[0];
    slot->uv_transform[1][0] = (float)((double)-s * scale[0]);
    slot->uv_transform[1][1] = (float)((double)c * scale[1]);
    slot->uv_transform[1][2] = (float)offset[1];
    for (int i = 0; i < 6; i++)
        if (!(fabsf((&slot->uv_transform[0][0])[i]) <= 1e6f))
            return gltf_fail(g, STATUS_ERR_INPUT, &inner, "offset and scale must be below 1e6");
    return STATUS_OK;
}

/* A textureInfo; `info_out` (may be NULL) gets the JSON object for what else stands in it. */
static status read_slot(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                        struct scene_texture_slot *slot, json_t **info_out)
{
    const struct gltf_place inner = gltf_within(at, ".%s", key);
    json_t *info = NULL;
    int64_t index = -1;
    uint64_t uv_set = 0;

    TRY(gltf_object(g, in, at, key, &info));
    if (info_out)
        *info_out = info;
    if (!info)
        return STATUS_OK;
    TRY(gltf_index(g, info, &inner, "index", g->textures, &index));
    if (index < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &inner, "names no texture");
    TRY(gltf_size(g, info, &inner, "texCoord", &uv_set));
    TRY(read_transform(g, info, &inner, slot, &uv_set));
    if (uv_set > 1) {
        builder_warn(g->b, "texture coordinate set",
                     "materials[%zu]%s uses texture coordinate set %llu: only 0 and 1 are read, "
                     "the texture is left out",
                     inner.row, inner.part, (unsigned long long)uv_set);
        return STATUS_OK;
    }
    if (g->texture_rows[index] == GLTF_ROW_UNREAD) {
        g->texture_rows[index] = BUILDER_NO_ROW;
        TRY(read_texture(g, (size_t)index, &g->texture_rows[index]));
    }
    slot->texture = (int32_t)g->texture_rows[index];
    slot->uv_set = (uint32_t)uv_set;
    return STATUS_OK;
}

/* ---- materials ---------------------------------------------------------------------------- */

/* Bring a value into its range, and say so. */
static float clamp(struct gltf *g, const struct gltf_place *at, const char *key, double value,
                   double low, double high)
{
    double clamped = value < low ? low : value > high ? high : value;

    if (clamped != value)
        builder_warn(g->b, "out of range", "%s[%zu]%s: %s is %g, taken as %g", at->table, at->row,
                     at->part, key, value, clamped);
    return (float)clamped;
}

static status read_factor(struct gltf *g, json_t *in, const struct gltf_place *at,
                          const char *key, double high, float *out)
{
    double value = (double)*out;

    TRY(gltf_number(g, in, at, key, &value));
    *out = clamp(g, at, key, value, 0, high);
    return STATUS_OK;
}

static status read_color(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                         size_t count, double high, float *out)
{
    double values[4];

    for (size_t i = 0; i < count; i++)
        values[i] = (double)out[i];
    TRY(gltf_numbers(g, in, at, key, count, values));
    for (size_t i = 0; i < count; i++)
        out[i] = clamp(g, at, key, values[i], 0, high);
    return STATUS_OK;
}

static status read_pbr(struct gltf *g, json_t *in, const struct gltf_place *at,
                       struct scene_material *m)
{
    const struct gltf_place inner = gltf_within(at, ".pbrMetallicRoughness");
    json_t *pbr = NULL;

    TRY(gltf_object(g, in, at, "pbrMetallicRoughness", &pbr));
    if (!pbr)
        return STATUS_OK;
    TRY(read_color(g, pbr, &inner, "baseColorFactor", 4, 1, m->base_color));
    TRY(read_slot(g, pbr, &inner, "baseColorTexture", &m->base_color_texture, NULL));
    if (m->unlit)
        return STATUS_OK;
    TRY(read_factor(g, pbr, &inner, "metallicFactor", 1, &m->metallic));
    TRY(read_factor(g, pbr, &inner, "roughnessFactor", 1, &m->roughness));
    return read_slot(g, pbr, &inner, "metallicRoughnessTexture", &m->metallic_roughness_texture,
                     NULL);
}

static status read_emission(struct gltf *g, json_t *in, const struct gltf_place *at,
                            struct scene_material *m)
{
    json_t *extension = gltf_extension(in, "KHR_materials_emissive_strength");
    const struct gltf_place inner = gltf_within(at, ".KHR_materials_emissive_strength");
    float strength = 1;

    TRY(read_color(g, in, at, "emissiveFactor", 3, 1e15, m->emission));
    if (extension)
        TRY(read_factor(g, extension, &inner, "emissiveStrength", 1e15, &strength));
    for (int i = 0; i < 3; i++)
        m->emission[i] *= strength;
    if (m->emission[0] == 0 && m->emission[1] == 0 && m->emission[2] == 0)
        return STATUS_OK; /* black times any texture is black */
    return read_slot(g, in, at, "emissiveTexture", &m->emission_texture, NULL);
}

static status read_specular(struct gltf *g, json_t *in, const struct gltf_place *at,
                            struct scene_material *m)
{
    json_t *ior = gltf_extension(in, "KHR_materials_ior");
    json_t *specular = gltf_extension(in, "KHR_materials_specular");
    const struct gltf_place at_ior = gltf_within(at, ".KHR_materials_ior");
    const struct gltf_place at_specular = gltf_within(at, ".KHR_materials_specular");
    double index = 1.5;

    if (ior)
        TRY(gltf_number(g, ior, &at_ior, "ior", &index));
    m->ior = index == 0 ? 0.0f : clamp(g, &at_ior, "ior", index, 1, 1e6);
    if (!specular)
        return STATUS_OK;
    TRY(read_factor(g, specular, &at_specular, "specularFactor", 1, &m->specular));
    TRY(read_slot(g, specular, &at_specular, "specularTexture", &m->specular_texture, NULL));
    TRY(read_color(g, specular, &at_specular, "specularColorFactor", 3, 1e15, m->specular_color));
    return read_slot(g, specular, &at_specular, "specularColorTexture",
                     &m->specular_color_texture, NULL);
}

static status read_transmission(struct gltf *g, json_t *in, const struct gltf_place *at,
                                struct scene_material *m)
{
    json_t *transmission = gltf_extension(in, "KHR_materials_transmission");
    json_t *volume = gltf_extension(in, "KHR_materials_volume");
    const struct gltf_place at_t = gltf_within(at, ".KHR_materials_transmission");
    const struct gltf_place at_v = gltf_within(at, ".KHR_materials_volume");
    double thickness = 0, distance = INFINITY;

    if (transmission) {
        TRY(read_factor(g, transmission, &at_t, "transmissionFactor", 1, &m->transmission));
        if (m->transmission > 0)
            TRY(read_slot(g, transmission, &at_t, "transmissionTexture", &m->transmission_texture,
                          NULL));
    }
    if (!volume)
        return STATUS_OK;
    /* The factor multiplies the thickness texture, so it alone decides: 0 is a thin wall. A
     * ray tracer measures the thickness itself and has no use for the texture. */
    TRY(gltf_number(g, volume, &at_v, "thicknessFactor", &thickness));
    TRY(gltf_number(g, volume, &at_v, "attenuationDistance", &distance));
    TRY(read_color(g, volume, &at_v, "attenuationColor", 3, 1, m->attenuation_color));
    m->refractive = thickness > 0;
    m->attenuation_distance = (float)distance;
    if (!(m->attenuation_distance > 0)) {
        builder_warn(g->b, "attenuation distance",
                     "%s[%zu]%s: attenuationDistance must be above 0: taken as infinite", at->table,
                     at->row, at_v.part);
        m->attenuation_distance = INFINITY;
    }
    return STATUS_OK;
}

static status read_alpha(struct gltf *g, json_t *in, const struct gltf_place *at,
                         struct scene_material *m)
{
    const char *mode = "OPAQUE";
    double cutoff = 0.5;

    TRY(gltf_text(g, in, at, "alphaMode", &mode));
    TRY(gltf_number(g, in, at, "alphaCutoff", &cutoff));
    if (strcmp(mode, "MASK") == 0)
        m->alpha_mode = ALPHA_MASK;
    else if (strcmp(mode, "BLEND") == 0)
        m->alpha_mode = ALPHA_BLEND;
    else if (strcmp(mode, "OPAQUE") != 0)
        builder_warn(g->b, "alpha mode", "materials[%zu]: alphaMode \"%.32s\" is unknown: opaque",
                     at->row, mode);
    m->alpha_cutoff = clamp(g, at, "alphaCutoff", cutoff, 0, 1e6);
    return STATUS_OK;
}

/* What the renderer does not do is told, not refused: the rest of the material stands. */
static void warn_of_extensions(struct gltf *g, json_t *in, const struct gltf_place *at)
{
    static const struct {
        const char *extension, *effect;
    } unsupported[] = {
        {"KHR_materials_clearcoat", "the clear coat"},
        {"KHR_materials_sheen", "the sheen"},
        {"KHR_materials_iridescence", "the iridescence"},
        {"KHR_materials_anisotropy", "the anisotropy"},
        {"KHR_materials_dispersion", "the dispersion"},
        {"KHR_materials_diffuse_transmission", "the diffuse transmission"},
        {"KHR_materials_subsurface", "the subsurface scattering"},
        {"KHR_materials_pbrSpecularGlossiness", "the specular-glossiness values"},
    };

    for (size_t i = 0; i < sizeof unsupported / sizeof *unsupported; i++)
        if (gltf_extension(in, unsupported[i].extension)) {
            const char *name = json_string_value(json_object_get(in, "name"));
            builder_warn(g->b, unsupported[i].extension,
                         "materials[%zu] \"%.80s\" uses %s: rendered without %s", at->row,
                         name ? name : "", unsupported[i].extension, unsupported[i].effect);
        }
}

static status read_material(struct gltf *g, size_t index, struct scene_material *m)
{
    const struct gltf_place at = gltf_at("materials", index, "");
    const char *name = "";
    json_t *in, *normal = NULL;
    double scale = 1;

    TRY(gltf_row(g, g->materials, &at, &in));
    TRY(gltf_text(g, in, &at, "name", &name));
    m->name = builder_name(g->b, name);
    m->unlit = gltf_extension(in, "KHR_materials_unlit") != NULL;
    TRY(gltf_flag(g, in, &at, "doubleSided", &m->double_sided));
    TRY(read_alpha(g, in, &at, m));
    TRY(read_pbr(g, in, &at, m));
    warn_of_extensions(g, in, &at);
    if (m->unlit)
        return STATUS_OK; /* nothing below is seen */
    TRY(read_slot(g, in, &at, "normalTexture", &m->normal_texture, &normal));
    if (normal) {
        const struct gltf_place at_normal = gltf_within(&at, ".normalTexture");
        TRY(gltf_number(g, normal, &at_normal, "scale", &scale));
        m->normal_scale = (float)(scale < -1e6 ? -1e6 : scale > 1e6 ? 1e6 : scale);
    }
    TRY(read_emission(g, in, &at, m));
    TRY(read_specular(g, in, &at, m));
    return read_transmission(g, in, &at, m);
}

status gltf_material(struct gltf *g, int64_t index, uint32_t *row)
{
    size_t slot = index < 0 ? json_array_size(g->materials) : (size_t)index;
    struct scene_material material;

    if (g->material_rows[slot] == GLTF_ROW_UNREAD) {
        uint32_t added;
        scene_material_default(&material);
        if (index >= 0)
            TRY(read_material(g, (size_t)index, &material));
        else
            material.name = builder_name(g->b, "default");
        TRY(builder_add_material(g->b, &material, &added));
        g->material_rows[slot] = added;
    }
    *row = (uint32_t)g->material_rows[slot];
    return STATUS_OK;
}
