/* glTF: the material extensions. A factor of 0 switches its effect off whatever its textures
 * contain: they are then not read. */
#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "common/image/image.h"

/* Clamp a value to its range, with a warning. */
static float clamp(struct gltf *g, const struct gltf_place *at, const char *key, double value, double low, double high)
{
    double clamped = value < low ? low : value > high ? high : value;

    if (clamped != value)
        builder_warn(g->b, "out of range", "%s[%zu]%s: %s is %g, taken as %g", at->table, at->row, at->part, key, value,
                     clamped);
    return (float)clamped;
}

/* glTF has no priorities, so they come in an extra. Extras may contain anything: a value that is
 * not a number is ignored. */
static void read_priority(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    const struct gltf_place inner = gltf_within(at, ".extras");
    json_t *value = json_object_get(json_object_get(in, "extras"), "dielectric_priority");

    if (json_is_number(value))
        m->priority = (int)clamp(g, &inner, "dielectric_priority", json_number_value(value), -SCENE_PRIORITY_MAX,
                                 SCENE_PRIORITY_MAX);
}

status gltf_factor(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, double high, float *out)
{
    double value = (double)*out;

    TRY(gltf_number(g, in, at, key, &value));
    *out = clamp(g, at, key, value, 0, high);
    return STATUS_OK;
}

status gltf_color(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key, size_t count, double high,
                  float *out)
{
    double values[4];

    for (size_t i = 0; i < count; i++)
        values[i] = (double)out[i];
    TRY(gltf_numbers(g, in, at, key, count, values));
    for (size_t i = 0; i < count; i++)
        out[i] = clamp(g, at, key, values[i], 0, high);
    return STATUS_OK;
}

static int is_black(const float color[3]) { return color[0] == 0 && color[1] == 0 && color[2] == 0; }

status gltf_normal_slot(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
                        struct scene_texture_slot *slot, float *scale)
{
    const struct gltf_place inner = gltf_within(at, ".%s", key);
    json_t *info = NULL;
    double value = 1;

    TRY(gltf_slot(g, in, at, key, slot, &info));
    if (info)
        TRY(gltf_number(g, info, &inner, "scale", &value));
    *scale = (float)(value < -1e6 ? -1e6 : value > 1e6 ? 1e6 : value);
    return STATUS_OK;
}

static status read_specular(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
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
    TRY(gltf_factor(g, specular, &at_specular, "specularFactor", 1, &m->specular));
    TRY(gltf_slot(g, specular, &at_specular, "specularTexture", &m->specular_texture, NULL));
    TRY(gltf_color(g, specular, &at_specular, "specularColorFactor", 3, 1e15, m->specular_color));
    return gltf_slot(g, specular, &at_specular, "specularColorTexture", &m->specular_color_texture, NULL);
}

static status read_transmission(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    json_t *transmission = gltf_extension(in, "KHR_materials_transmission");
    json_t *volume = gltf_extension(in, "KHR_materials_volume");
    const struct gltf_place at_t = gltf_within(at, ".KHR_materials_transmission");
    const struct gltf_place at_v = gltf_within(at, ".KHR_materials_volume");
    double thickness = 0, distance = INFINITY;

    if (transmission) {
        TRY(gltf_factor(g, transmission, &at_t, "transmissionFactor", 1, &m->transmission));
        if (m->transmission > 0)
            TRY(gltf_slot(g, transmission, &at_t, "transmissionTexture", &m->transmission_texture, NULL));
    }
    if (!volume)
        return STATUS_OK;
    /* The factor multiplies the thickness texture, so it alone decides: 0 is a thin wall. A
     * ray tracer measures the thickness itself and has no use for the texture. */
    TRY(gltf_number(g, volume, &at_v, "thicknessFactor", &thickness));
    TRY(gltf_number(g, volume, &at_v, "attenuationDistance", &distance));
    TRY(gltf_color(g, volume, &at_v, "attenuationColor", 3, 1, m->attenuation_color));
    m->refractive = thickness > 0;
    m->attenuation_distance = (float)distance;
    if (!(m->attenuation_distance > 0)) {
        builder_warn(g->b, "attenuation distance", "%s[%zu]%s: attenuationDistance must be above 0: taken as infinite",
                     at->table, at->row, at_v.part);
        m->attenuation_distance = INFINITY;
    }
    read_priority(g, in, at, m);
    return STATUS_OK;
}

static status read_clearcoat(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    TRY(gltf_factor(g, in, at, "clearcoatFactor", 1, &m->clearcoat));
    if (m->clearcoat == 0)
        return STATUS_OK;
    TRY(gltf_slot(g, in, at, "clearcoatTexture", &m->clearcoat_texture, NULL));
    TRY(gltf_factor(g, in, at, "clearcoatRoughnessFactor", 1, &m->clearcoat_roughness));
    if (m->clearcoat_roughness > 0)
        TRY(gltf_slot(g, in, at, "clearcoatRoughnessTexture", &m->clearcoat_roughness_texture, NULL));
    return gltf_normal_slot(g, in, at, "clearcoatNormalTexture", &m->clearcoat_normal_texture,
                            &m->clearcoat_normal_scale);
}

static status read_sheen(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    TRY(gltf_color(g, in, at, "sheenColorFactor", 3, 1, m->sheen_color));
    if (is_black(m->sheen_color))
        return STATUS_OK;
    TRY(gltf_slot(g, in, at, "sheenColorTexture", &m->sheen_color_texture, NULL));
    TRY(gltf_factor(g, in, at, "sheenRoughnessFactor", 1, &m->sheen_roughness));
    if (m->sheen_roughness == 0)
        return STATUS_OK;
    return gltf_slot(g, in, at, "sheenRoughnessTexture", &m->sheen_roughness_texture, NULL);
}

static status read_iridescence(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    double index = 1.3;

    TRY(gltf_factor(g, in, at, "iridescenceFactor", 1, &m->iridescence));
    if (m->iridescence == 0)
        return STATUS_OK;
    TRY(gltf_slot(g, in, at, "iridescenceTexture", &m->iridescence_texture, NULL));
    TRY(gltf_number(g, in, at, "iridescenceIor", &index));
    m->iridescence_ior = clamp(g, at, "iridescenceIor", index, 1, 1e6);
    /* The minimum may exceed the maximum. */
    TRY(gltf_factor(g, in, at, "iridescenceThicknessMinimum", 1e6, &m->iridescence_thickness_min_nm));
    TRY(gltf_factor(g, in, at, "iridescenceThicknessMaximum", 1e6, &m->iridescence_thickness_max_nm));
    return gltf_slot(g, in, at, "iridescenceThicknessTexture", &m->iridescence_thickness_texture, NULL);
}

static status read_anisotropy(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    double rotation = 0;

    TRY(gltf_factor(g, in, at, "anisotropyStrength", 1, &m->anisotropy));
    if (m->anisotropy == 0)
        return STATUS_OK;
    TRY(gltf_number(g, in, at, "anisotropyRotation", &rotation));
    if (fabs(rotation) > 1e4)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "anisotropyRotation is too large");
    m->anisotropy_rotation_rad = (float)rotation;
    return gltf_slot(g, in, at, "anisotropyTexture", &m->anisotropy_texture, NULL);
}

static status read_dispersion(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    return gltf_factor(g, in, at, "dispersion", 1e6, &m->dispersion);
}

static status read_diffuse_transmission(struct gltf *g, json_t *in, const struct gltf_place *at,
                                        struct scene_material *m)
{
    TRY(gltf_factor(g, in, at, "diffuseTransmissionFactor", 1, &m->diffuse_transmission));
    if (m->diffuse_transmission == 0)
        return STATUS_OK;
    TRY(gltf_slot(g, in, at, "diffuseTransmissionTexture", &m->diffuse_transmission_texture, NULL));
    TRY(gltf_color(g, in, at, "diffuseTransmissionColorFactor", 3, 1, m->diffuse_transmission_color));
    return gltf_slot(g, in, at, "diffuseTransmissionColorTexture", &m->diffuse_transmission_color_texture, NULL);
}

static status read_diffuse_roughness(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m)
{
    TRY(gltf_factor(g, in, at, "diffuseRoughnessFactor", 1, &m->diffuse_roughness));
    if (m->diffuse_roughness == 0)
        return STATUS_OK;
    return gltf_slot(g, in, at, "diffuseRoughnessTexture", &m->diffuse_roughness_texture, NULL);
}

/* The supported extensions: they are listed only here. */
static const struct {
    const char *name;
    status (*read)(struct gltf *g, json_t *in, const struct gltf_place *at, struct scene_material *m);
} readers[] = {
    {"KHR_materials_clearcoat", read_clearcoat},
    {"KHR_materials_sheen", read_sheen},
    {"KHR_materials_iridescence", read_iridescence},
    {"KHR_materials_anisotropy", read_anisotropy},
    {"KHR_materials_dispersion", read_dispersion},
    {"KHR_materials_diffuse_transmission", read_diffuse_transmission},
    {"KHR_materials_diffuse_roughness", read_diffuse_roughness},
};
enum { READERS = sizeof readers / sizeof *readers };

int gltf_reads_material_extension(const char *name)
{
    for (size_t i = 0; i < READERS; i++)
        if (strcmp(readers[i].name, name) == 0)
            return 1;
    return 0;
}

status gltf_material_extensions(struct gltf *g, json_t *material, const struct gltf_place *at, struct scene_material *m)
{
    if (!gltf_extension(material, "KHR_materials_pbrSpecularGlossiness"))
        TRY(read_specular(g, material, at, m));
    TRY(read_transmission(g, material, at, m));
    for (size_t i = 0; i < READERS; i++) {
        const struct gltf_place inner = gltf_within(at, ".%s", readers[i].name);
        json_t *in = gltf_extension(material, readers[i].name);
        if (in)
            TRY(readers[i].read(g, in, &inner, m));
    }
    if (gltf_extension(material, "KHR_materials_subsurface"))
        builder_warn(g->b, "subsurface",
                     "materials[%zu] \"%.80s\" uses KHR_materials_subsurface, a draft: rendered "
                     "without the subsurface scattering",
                     at->row, m->name);
    return STATUS_OK;
}

/* ---- KHR_materials_pbrSpecularGlossiness ---------------------------------------------------- */

/* A grey picture of 1 - glossiness * alpha of `from`. */
static status roughness_image(struct gltf *g, const struct scene_image *from, float glossiness, uint32_t *row)
{
    const struct import_blob *blob = builder_blob(g->b, &from->blob);
    struct buffer png = BUFFER_INIT;
    struct image8 in = {0}, out = {0};
    status result = STATUS_ERR_INTERNAL;

    if (blob)
        result = builder_damage(g->b, image_decode_8(&in, blob->data, blob->size_bytes, from->name, g->err));
    if (result == STATUS_OK)
        result = image8_init(&out, in.width, in.height, 1, 8, g->err);
    for (size_t i = 0; result == STATUS_OK && i < (size_t)in.width * in.height; i++) {
        size_t at = i * in.channels + in.channels - 1;
        float alpha = 1;
        if (in.channels % 2 == 0)
            alpha = in.bits == 16 ? (float)((const uint16_t *)(const void *)in.pixels)[at] / 65535
                                  : (float)in.pixels[at] / 255;
        out.pixels[i] = (uint8_t)((1 - glossiness * alpha) * 255 + 0.5f);
    }
    if (result == STATUS_OK)
        result = png_encode_8(&png, &out, 1, g->err);
    if (result == STATUS_OK) {
        result = builder_add_image(g->b, from->name, png.data, png.size, row);
        png = (struct buffer)BUFFER_INIT; /* taken over */
    }
    buffer_release(&png);
    image8_release(&out);
    image8_release(&in);
    return result;
}

/* The old model's specular colour is F0 itself. Here F0 is that of the index, 0.04, times specular_color, which may
 * exceed 1: the same F0 and roughness. Two things differ: the old model darkens the diffuse part by 1 - max(F0), this
 * one by 1 - the Fresnel reflection; and the texture's glossiness becomes 8-bit roughness. */
status gltf_specular_glossiness(struct gltf *g, json_t *extension, const struct gltf_place *at,
                                struct scene_material *m)
{
    const struct gltf_place inner = gltf_within(at, ".KHR_materials_pbrSpecularGlossiness");
    struct scene_texture_slot both;
    float glossiness = 1, specular[3] = {1, 1, 1};
    struct scene_texture texture;
    uint32_t added;

    builder_warn(g->b, "specular-glossiness",
                 "materials[%zu] \"%.80s\" uses KHR_materials_pbrSpecularGlossiness, which is "
                 "archived: converted, its diffuse part may look slightly brighter",
                 at->row, m->name);
    TRY(gltf_color(g, extension, &inner, "diffuseFactor", 4, 1, m->base_color));
    TRY(gltf_slot(g, extension, &inner, "diffuseTexture", &m->base_color_texture, NULL));
    TRY(gltf_color(g, extension, &inner, "specularFactor", 3, 1, specular));
    TRY(gltf_factor(g, extension, &inner, "glossinessFactor", 1, &glossiness));
    m->metallic = 0;
    m->roughness = 1 - glossiness;
    m->ior = 1.5f;
    for (int i = 0; i < 3; i++)
        m->specular_color[i] = specular[i] * 25;
    both = m->specular_color_texture;
    TRY(gltf_slot(g, extension, &inner, "specularGlossinessTexture", &both, NULL));
    if (both.texture < 0)
        return STATUS_OK;
    m->specular_color_texture = m->metallic_roughness_texture = both;
    m->roughness = 1;
    texture = g->b->textures[both.texture];
    TRY(roughness_image(g, &g->b->images[texture.image], glossiness, &texture.image));
    TRY(builder_add_texture(g->b, &texture, &added));
    m->metallic_roughness_texture.texture = (int32_t)added;
    return STATUS_OK;
}
