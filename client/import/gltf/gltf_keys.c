/* The keys that a glTF file may have: one line names what is not read, so that nothing goes in silence. docs/FORMATS.md has its table from here. */
#include <string.h>

#include "client/import/gltf/gltf.h"

/* The objects of a file, by their own names, and of extensions, by the extensions'. A key alone is read or, as a name, shows nowhere;
 * "key>object" has an object, "key*>object" an array of them; "key#" are all that begin so. */
static const struct {
    const char *object, *keys;
} objects[] = {
    {"file", "asset>asset scene scenes*>scene nodes*>node meshes*>mesh skins*>skin materials*>material textures*>texture "
             "samplers*>sampler images*>image cameras*>camera animations*>animation accessors*>accessor bufferViews*>view "
             "buffers*>buffer extensionsUsed extensionsRequired"},
    {"asset", "version minVersion generator copyright"},
    {"scene", "name nodes"},
    {"node", "name children mesh skin camera matrix translation rotation scale weights"},
    {"mesh", "name primitives*>primitive weights"},
    {"primitive", "attributes>attributes indices material mode targets*>target"},
    {"attributes", "POSITION NORMAL TANGENT TEXCOORD_# COLOR_0 JOINTS_0 JOINTS_1 WEIGHTS_0 WEIGHTS_1 _#"},
    {"target", "POSITION NORMAL _#"},
    {"skin", "name joints inverseBindMatrices skeleton"},
    {"material", "name pbrMetallicRoughness>pbrMetallicRoughness normalTexture>textureInfo occlusionTexture>textureInfo "
                 "emissiveTexture>textureInfo emissiveFactor alphaMode alphaCutoff doubleSided"},
    {"pbrMetallicRoughness", "baseColorFactor baseColorTexture>textureInfo metallicFactor roughnessFactor "
                             "metallicRoughnessTexture>textureInfo"},
    {"textureInfo", "index texCoord scale strength"},
    {"texture", "name source sampler"},
    {"sampler", "name magFilter minFilter wrapS wrapT"},
    {"image", "name uri mimeType bufferView"},
    {"camera", "name type perspective>perspective orthographic>orthographic"},
    {"perspective", "aspectRatio yfov znear zfar"},
    {"orthographic", "xmag ymag znear zfar"},
    {"animation", "name channels*>channel samplers*>keyframes"},
    {"channel", "sampler target>animated"},
    {"animated", "node path"},
    {"keyframes", "input output interpolation"},
    {"accessor", "name bufferView byteOffset componentType normalized count type min max sparse>sparse"},
    {"sparse", "count indices>sparsePart values>sparsePart"},
    {"sparsePart", "bufferView byteOffset componentType"},
    {"view", "name buffer byteOffset byteLength byteStride target"},
    {"buffer", "name uri byteLength"},
    {"KHR_lights_punctual", "light lights*>light"},
    {"light", "name type color intensity range spot>spot"},
    {"spot", "innerConeAngle outerConeAngle"},
    {"KHR_materials_anisotropy", "anisotropyStrength anisotropyRotation anisotropyTexture>textureInfo"},
    {"KHR_materials_clearcoat", "clearcoatFactor clearcoatTexture>textureInfo clearcoatRoughnessFactor "
                                "clearcoatRoughnessTexture>textureInfo clearcoatNormalTexture>textureInfo"},
    {"KHR_materials_diffuse_roughness", "diffuseRoughnessFactor diffuseRoughnessTexture>textureInfo"},
    {"KHR_materials_diffuse_transmission", "diffuseTransmissionFactor diffuseTransmissionTexture>textureInfo "
                                           "diffuseTransmissionColorFactor diffuseTransmissionColorTexture>textureInfo"},
    {"KHR_materials_dispersion", "dispersion"},
    {"KHR_materials_emissive_strength", "emissiveStrength"},
    {"KHR_materials_ior", "ior"},
    {"KHR_materials_iridescence", "iridescenceFactor iridescenceTexture>textureInfo iridescenceIor iridescenceThicknessMinimum "
                                  "iridescenceThicknessMaximum iridescenceThicknessTexture>textureInfo"},
    {"KHR_materials_pbrSpecularGlossiness", "diffuseFactor diffuseTexture>textureInfo specularFactor glossinessFactor "
                                            "specularGlossinessTexture>textureInfo"},
    {"KHR_materials_sheen", "sheenColorFactor sheenColorTexture>textureInfo sheenRoughnessFactor sheenRoughnessTexture>textureInfo"},
    {"KHR_materials_specular", "specularFactor specularTexture>textureInfo specularColorFactor specularColorTexture>textureInfo"},
    {"KHR_materials_transmission", "transmissionFactor transmissionTexture>textureInfo"},
    {"KHR_materials_unlit", ""},
    {"KHR_materials_variants", "variants*>variant mappings*>mapping"},
    {"variant", "name"},
    {"mapping", "name material variants"},
    {"KHR_materials_volume", "thicknessFactor thicknessTexture>textureInfo attenuationDistance attenuationColor"},
    {"KHR_node_visibility", "visible"},
    {"KHR_texture_transform", "offset rotation scale texCoord"},
    {"EXT_mesh_gpu_instancing", "attributes>instances"},
    {"instances", "TRANSLATION ROTATION SCALE _#"},
    {"EXT_texture_webp", "source"},
    {"EXT_lights_ies", "light multiplier color lights*>profile"},
    {"profile", "name uri bufferView mimeType"},
};

/* The way from the file to an object. */
struct step {
    const struct step *parent;
    const char *key;
    size_t row;
    int in_array;
};

static void check_object(struct gltf *g, json_t *in, const char *object, const struct step *here);

static const char *keys_of(const char *object, size_t size)
{
    for (size_t i = 0; i < sizeof objects / sizeof *objects; i++)
        if (strlen(objects[i].object) == size && memcmp(objects[i].object, object, size) == 0)
            return objects[i].keys;
    return NULL;
}

/* What stands behind a key in a list: "", ">object" or "*>object"; NULL: the key is not in it. */
static const char *key_find(const char *keys, const char *key)
{
    const size_t size = strlen(key);

    for (const char *at = keys; *at; at += strspn(at, " ")) {
        const size_t length = strcspn(at, " *>#");
        if (at[length] == '#' ? strncmp(at, key, length) == 0 : length == size && memcmp(at, key, size) == 0)
            return at[length] == '#' ? "" : at + length;
        at += strcspn(at, " ");
    }
    return NULL;
}

static void print_place(const struct step *step, char *out, size_t size)
{
    size_t at;

    if (!step)
        return;
    print_place(step->parent, out, size);
    at = strlen(out);
    at += (size_t)snprintf(out + at, size - at, "%s%.60s", at ? "." : "", step->key);
    if (step->in_array && at < size)
        snprintf(out + at, size - at, "[%zu]", step->row);
}

static void warn_of_key(struct gltf *g, const char *object, const char *key, const struct step *here)
{
    char place[200] = "", kind[160];

    print_place(here, place, sizeof place);
    snprintf(kind, sizeof kind, "key %.*s %.80s", (int)strcspn(object, " "), object, key);
    builder_warn_at(g->b, g->name, 0, kind, "%s%s\"%.80s\" is not read", place, *place ? ": " : "", key);
}

static void check_extensions(struct gltf *g, json_t *in, const struct step *here)
{
    const struct step there = {here, "extensions", 0, 0};
    const char *name;
    json_t *extension;

    json_object_foreach(in, name, extension) {
        const struct step inner = {&there, name, 0, 0};
        if (!gltf_knows_extension(g, name))
            continue;
        if (keys_of(name, strlen(name)))
            check_object(g, extension, name, &inner);
    }
}

/* Of the object whose name ends at a space. */
static void check_object(struct gltf *g, json_t *in, const char *object, const struct step *here)
{
    const char *keys = keys_of(object, strcspn(object, " ")), *key;
    json_t *value, *each;
    size_t row;

    json_object_foreach(in, key, value) {
        const char *kind = key_find(keys, key);
        struct step inner = {here, key, 0, 0};
        if (strcmp(key, "extensions") == 0)
            check_extensions(g, value, here);
        else if (!kind && strcmp(key, "extras") != 0)
            warn_of_key(g, object, key, here);
        else if (kind && kind[0] == '>')
            check_object(g, value, kind + 1, &inner);
        else if (kind && kind[0] == '*')
            json_array_foreach(value, row, each) {
                inner.row = row;
                inner.in_array = 1;
                check_object(g, each, kind + 2, &inner);
            }
    }
}

void gltf_check_keys(struct gltf *g) { check_object(g, g->root, "file", NULL); }
