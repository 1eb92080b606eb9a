#include "client/import/gltf/gltf.h"

#include <string.h>
#include <strings.h>

#include "client/terminal/must.h"
#include "common/base/bytes.h"
#include "common/system/file.h"
#include "common/base/memory.h"

enum {
    GLB_MAGIC = 0x46546c67,       /* "glTF" */
    GLB_CHUNK_JSON = 0x4e4f534a,  /* "JSON" */
    GLB_CHUNK_BIN = 0x004e4942,   /* "BIN" */
    GLB_HEADER_BYTES = 12,
    GLB_CHUNK_HEADER_BYTES = 8,
    JSON_BYTES_MAX = 1 << 29,
};

/* ---- extensions --------------------------------------------------------------------------- */

enum support {
    SUPPORT_FULL,       /* done */
    SUPPORT_WITHOUT,    /* a warning names what is missing, where it is used */
    SUPPORT_NOTHING,    /* says nothing about the picture */
    SUPPORT_FALLBACK, /* only if the file offers another form as well */
};

static const struct {
    const char *name;
    enum support support;
} extensions[] = { /* and those of gltf_reads_material_extension */
    {"KHR_materials_ior", SUPPORT_FULL},
    {"KHR_materials_specular", SUPPORT_FULL},
    {"KHR_materials_transmission", SUPPORT_FULL},
    {"KHR_materials_volume", SUPPORT_FULL},
    {"KHR_materials_unlit", SUPPORT_FULL},
    {"KHR_materials_emissive_strength", SUPPORT_FULL},
    {"KHR_texture_transform", SUPPORT_FULL},
    {"KHR_lights_punctual", SUPPORT_FULL},
    {"KHR_mesh_quantization", SUPPORT_FULL},
    {"KHR_node_visibility", SUPPORT_FULL},
    {"EXT_mesh_gpu_instancing", SUPPORT_FULL},
    {"KHR_materials_subsurface", SUPPORT_WITHOUT},
    {"KHR_materials_variants", SUPPORT_FULL},
    {"KHR_animation_pointer", SUPPORT_FULL},
    {"KHR_materials_pbrSpecularGlossiness", SUPPORT_FULL},
    {"EXT_lights_image_based", SUPPORT_WITHOUT},
    {"KHR_texture_basisu", SUPPORT_FALLBACK},
    {"EXT_texture_webp", SUPPORT_FULL},
    {"EXT_lights_ies", SUPPORT_FULL},
    {"KHR_draco_mesh_compression", SUPPORT_FULL},
    {"EXT_meshopt_compression", SUPPORT_FULL},
    {"KHR_meshopt_compression", SUPPORT_FULL},
    {"KHR_xmp", SUPPORT_NOTHING},
    {"KHR_xmp_json_ld", SUPPORT_NOTHING},
    {"KHR_node_selectability", SUPPORT_NOTHING},
    {"KHR_node_hoverability", SUPPORT_NOTHING},
    {"FB_ngon_encoding", SUPPORT_NOTHING},
    {"AGI_articulations", SUPPORT_NOTHING},
    {"AGI_stk_metadata", SUPPORT_NOTHING},
    {"EXT_feature_metadata", SUPPORT_NOTHING},
    {"EXT_instance_features", SUPPORT_NOTHING},
    {"EXT_mesh_features", SUPPORT_NOTHING},
    {"EXT_mesh_manifold", SUPPORT_NOTHING},
    {"EXT_structural_metadata", SUPPORT_NOTHING},
    {"GODOT_single_root", SUPPORT_NOTHING},
    {"KHR_audio", SUPPORT_NOTHING},
    {"KHR_audio_emitter", SUPPORT_NOTHING},
    {"KHR_implicit_shapes", SUPPORT_NOTHING},
    {"KHR_interactivity", SUPPORT_NOTHING},
    {"KHR_physics_rigid_bodies", SUPPORT_NOTHING},
    {"MSFT_lod", SUPPORT_NOTHING},
    {"MSFT_screencoverage", SUPPORT_NOTHING},
    {"OMI_collider", SUPPORT_NOTHING},
    {"OMI_physics_body", SUPPORT_NOTHING},
    {"OMI_physics_shape", SUPPORT_NOTHING},
};

/* The row of an extension, or -1. */
static int extension_find(const char *name)
{
    for (size_t i = 0; i < sizeof extensions / sizeof *extensions; i++)
        if (strcmp(extensions[i].name, name) == 0)
            return (int)i;
    return -1;
}

static status refuse_extension(struct gltf *g, const char *name, int known)
{
    char clean[GLTF_KEY_MAX];

    snprintf(clean, sizeof clean, "%s", name);
    if (known >= 0)
        return error_set(g->err, STATUS_ERR_UNSUPPORTED,
                         "the file requires %s, which is not supported: convert its textures to "
                         "PNG, JPEG or WebP first, for example with \"gltf-transform "
                         "ktxdecompress in.glb out.glb\"",
                         clean);
    return error_set(g->err, STATUS_ERR_UNSUPPORTED,
                     "the file requires the extension \"%s\", which is not supported: export it "
                     "again without that",
                     clean);
}

int gltf_knows_extension(struct gltf *g, const char *name)
{
    char kind[128];

    if (extension_find(name) >= 0 || gltf_reads_material_extension(name))
        return 1;
    snprintf(kind, sizeof kind, "extension %.80s", name);
    builder_warn_at(g->b, g->name, 0, kind, "the extension \"%.80s\" is not known: ignored", name);
    return 0;
}

static status check_extensions(struct gltf *g)
{
    const struct gltf_place at = gltf_at("", 0, "");
    json_t *required = NULL, *used = NULL;

    TRY(gltf_array(g, g->root, &at, "extensionsRequired", &required));
    TRY(gltf_array(g, g->root, &at, "extensionsUsed", &used));
    for (size_t i = 0; i < json_array_size(required); i++) {
        const char *name = json_string_value(json_array_get(required, i));
        int known = name ? extension_find(name) : -1;
        if (!name)
            return error_set(g->err, STATUS_ERR_INPUT, "extensionsRequired[%zu] must be a string", i);
        if (gltf_reads_material_extension(name))
            continue;
        if (known < 0 || extensions[known].support == SUPPORT_FALLBACK)
            return refuse_extension(g, name, known);
    }
    for (size_t i = 0; i < json_array_size(used); i++) {
        const char *name = json_string_value(json_array_get(used, i));
        if (name)
            (void)gltf_knows_extension(g, name);
    }
    if (gltf_extension(g->root, "EXT_lights_image_based"))
        builder_warn(g->b, "image based light",
                     "the file has image based lights (EXT_lights_image_based), which are not "
                     "read: give an environment map instead");
    return STATUS_OK;
}

/* ---- KHR_materials_variants ---------------------------------------------------------------- */

int gltf_choice(const char *wanted, const char *const *names, size_t count)
{
    uint64_t number = 0;
    const char *at = wanted;

    for (size_t i = 0; i < count; i++)
        if (strcmp(names[i], wanted) == 0)
            return (int)i;
    for (; *at >= '0' && *at <= '9' && number < count; at++)
        number = number * 10 + (uint64_t)(*at - '0');
    return *wanted && !*at && number < count ? (int)number : -1;
}

/* List them for the report, and find the wanted one. */
static status read_variants(struct gltf *g, const char *wanted)
{
    const struct gltf_place root = gltf_at("", 0, "");
    json_t *extension = gltf_extension(g->root, "KHR_materials_variants"), *list = NULL;
    struct import_result *out = g->b->out;
    size_t count;

    g->variant = -1;
    if (extension)
        TRY(gltf_array(g, extension, &root, "variants", &list));
    count = json_array_size(list);
    if (count > SCENE_MATERIALS_MAX)
        return error_set(g->err, STATUS_ERR_LIMIT, "the file has %zu material variants: at most %d "
                         "are taken", count, SCENE_MATERIALS_MAX);
    out->variants = must(ARENA_ARRAY(&out->scene.arena, const char *, count));
    for (size_t i = 0; i < count; i++)
        out->variants[i] = builder_name(g->b, json_string_value(json_object_get(json_array_get(list, i), "name")));
    out->variant_count = count;
    if (!wanted)
        return STATUS_OK;
    g->variant = gltf_choice(wanted, out->variants, count);
    if (g->variant < 0)
        return error_set(g->err, STATUS_ERR_INPUT,
                         "there is no material variant \"%.80s\": the file has %zu (azulejo import "
                         "lists them)",
                         wanted, count);
    out->variant_taken = g->variant;
    return STATUS_OK;
}

/* ---- the frame ---------------------------------------------------------------------------- */

static status check_asset(struct gltf *g)
{
    const struct gltf_place at = gltf_at("", 0, "");
    const char *version = "", *least = "";
    json_t *asset = json_object_get(g->root, "asset");

    if (!json_is_object(g->root) || !json_is_object(asset))
        return error_set(g->err, STATUS_ERR_INPUT, "is not glTF 2.0: it has no \"asset\" with a version");
    TRY(gltf_text(g, asset, &at, "version", &version));
    TRY(gltf_text(g, asset, &at, "minVersion", &least));
    if (strncmp(version, "2.", 2) != 0)
        return error_set(g->err, STATUS_ERR_UNSUPPORTED, "has glTF version \"%.16s\": version 2.0 is read", version);
    if (*least && strcmp(least, "2.0") != 0)
        return error_set(g->err, STATUS_ERR_UNSUPPORTED, "requires glTF version \"%.16s\": version 2.0 is read", least);
    return STATUS_OK;
}

static status open_tables(struct gltf *g)
{
    const struct gltf_place at = gltf_at("", 0, "");
    json_t *punctual = gltf_extension(g->root, "KHR_lights_punctual");
    json_t *ies = gltf_extension(g->root, "EXT_lights_ies");

    TRY(gltf_array(g, g->root, &at, "accessors", &g->accessors));
    TRY(gltf_array(g, g->root, &at, "buffers", &g->buffers));
    TRY(gltf_array(g, g->root, &at, "bufferViews", &g->views));
    TRY(gltf_array(g, g->root, &at, "images", &g->images));
    TRY(gltf_array(g, g->root, &at, "samplers", &g->samplers));
    TRY(gltf_array(g, g->root, &at, "textures", &g->textures));
    TRY(gltf_array(g, g->root, &at, "materials", &g->materials));
    TRY(gltf_array(g, g->root, &at, "meshes", &g->meshes));
    TRY(gltf_array(g, g->root, &at, "nodes", &g->nodes));
    TRY(gltf_array(g, g->root, &at, "scenes", &g->scenes));
    TRY(gltf_array(g, g->root, &at, "cameras", &g->cameras));
    TRY(gltf_array(g, g->root, &at, "animations", &g->animations));
    TRY(gltf_array(g, g->root, &at, "skins", &g->skins));
    if (punctual)
        TRY(gltf_array(g, punctual, &at, "lights", &g->lights));
    if (ies)
        TRY(gltf_array(g, ies, &at, "lights", &g->profile_table));
    g->profiles = must(mem_alloc_array(json_array_size(g->profile_table), sizeof *g->profiles));
    for (size_t i = 0; i < json_array_size(g->profile_table); i++)
        g->profiles[i].image = GLTF_ROW_UNREAD;
    g->buffer_data = must(mem_calloc(json_array_size(g->buffers), sizeof *g->buffer_data));
    g->view_data = must(mem_calloc(json_array_size(g->views), sizeof *g->view_data));
    g->accessor_data = must(mem_calloc(json_array_size(g->accessors), sizeof *g->accessor_data));
    g->mesh_data = must(mem_calloc(json_array_size(g->meshes), sizeof *g->mesh_data));
    g->image_rows = must(mem_alloc_array(json_array_size(g->images), sizeof *g->image_rows));
    g->texture_rows = must(mem_alloc_array(json_array_size(g->textures), sizeof *g->texture_rows));
    g->skin_rows = must(mem_alloc_array(json_array_size(g->skins), sizeof *g->skin_rows));
    g->material_rows = must(mem_alloc_array(json_array_size(g->materials) + 1, sizeof *g->material_rows));
    for (size_t i = 0; i < json_array_size(g->images); i++)
        g->image_rows[i] = GLTF_ROW_UNREAD;
    for (size_t i = 0; i < json_array_size(g->textures); i++)
        g->texture_rows[i] = GLTF_ROW_UNREAD;
    for (size_t i = 0; i < json_array_size(g->skins); i++)
        g->skin_rows[i] = GLTF_ROW_UNREAD;
    for (size_t i = 0; i <= json_array_size(g->materials); i++)
        g->material_rows[i] = GLTF_ROW_UNREAD;
    gltf_open_nodes(g);
    return STATUS_OK;
}

static void close_tables(struct gltf *g)
{
    for (size_t i = 0; g->buffer_data && i < json_array_size(g->buffers); i++)
        buffer_release(&g->buffer_data[i].owned);
    for (size_t i = 0; g->view_data && i < json_array_size(g->views); i++)
        buffer_release(&g->view_data[i]);
    for (size_t i = 0; g->accessor_data && i < json_array_size(g->accessors); i++)
        mem_free(g->accessor_data[i]);
    for (size_t i = 0; g->mesh_data && i < json_array_size(g->meshes); i++)
        gltf_mesh_free(g->mesh_data[i]);
    for (size_t i = 0; i < g->channel_count; i++) {
        gltf_keys_release(&g->channels[i].channel);
    }
    mem_free(g->channels);
    gltf_tracks_free(g);
    mem_free(g->node_data);
    mem_free(g->skin_rows);
    mem_free(g->profiles);
    mem_free(g->buffer_data);
    mem_free(g->view_data);
    mem_free(g->accessor_data);
    mem_free(g->mesh_data);
    mem_free(g->image_rows);
    mem_free(g->texture_rows);
    mem_free(g->material_rows);
    json_decref(g->root);
}

/* Find the JSON and the binary chunk of a GLB. */
static status open_glb(struct gltf *g, const uint8_t *data, size_t size, const uint8_t **json, size_t *json_bytes)
{
    size_t at = GLB_HEADER_BYTES, total;

    if (size < GLB_HEADER_BYTES + GLB_CHUNK_HEADER_BYTES)
        return error_set(g->err, STATUS_ERR_INPUT, "the GLB file is cut short");
    if (bytes_get32(data + 4) != 2)
        return error_set(g->err, STATUS_ERR_UNSUPPORTED, "is a GLB file of version %u: version 2 is read",
                         bytes_get32(data + 4));
    total = bytes_get32(data + 8);
    if (total > size)
        return error_set(g->err, STATUS_ERR_INPUT, "the GLB file is cut short: it has %zu of %zu bytes", size, total);
    for (int chunk = 0; total - at >= GLB_CHUNK_HEADER_BYTES && at <= total; chunk++) {
        size_t length = bytes_get32(data + at);
        uint32_t type = bytes_get32(data + at + 4);
        at += GLB_CHUNK_HEADER_BYTES;
        if (length > total - at)
            return error_set(g->err, STATUS_ERR_INPUT, "chunk %d of the GLB file is cut short: it has %zu of %zu bytes",
                             chunk, total - at, length);
        if (chunk == 0 && type != GLB_CHUNK_JSON)
            return error_set(g->err, STATUS_ERR_INPUT, "the GLB file does not start with JSON");
        if (chunk == 0) {
            *json = data + at;
            for (*json_bytes = length; *json_bytes && (*json)[*json_bytes - 1] == 0;)
                --*json_bytes; /* padded with NUL in place of spaces */
        } else if (chunk == 1 && type == GLB_CHUNK_BIN) {
            g->bin = data + at;
            g->bin_bytes = length;
        }
        at += length;
    }
    if (!*json)
        return error_set(g->err, STATUS_ERR_INPUT, "the GLB file holds no JSON");
    return STATUS_OK;
}

static status parse_json(struct gltf *g, const uint8_t *json, size_t size)
{
    json_error_t error;

    if (size >= 3 && memcmp(json, "\xef\xbb\xbf", 3) == 0) {
        json += 3; /* a byte-order mark is not allowed, but harmless */
        size -= 3;
    }
    if (size > JSON_BYTES_MAX)
        return error_set(g->err, STATUS_ERR_LIMIT, "the JSON has %zu bytes: at most %d are taken", size,
                         JSON_BYTES_MAX);
    /* jansson limits the nesting depth itself. */
    g->root = json_loadb((const char *)json, size, 0, &error);
    if (g->root)
        return STATUS_OK;
    /* When memory runs out, jansson does not always set the code, but then its text is empty. */
    if (json_error_code(&error) == json_error_out_of_memory || !*error.text)
        must_(0);
    return error_set(g->err, STATUS_ERR_INPUT, "line %d, column %d: is not JSON: %s", error.line, error.column,
                     error.text);
}

static int is_glb(const uint8_t *data, size_t size) { return size >= 4 && bytes_get32(data) == GLB_MAGIC; }

static int gltf_recognise(const void *data, size_t size_bytes, const char *name)
{
    const uint8_t *bytes = data;
    size_t at = size_bytes >= 3 && memcmp(bytes, "\xef\xbb\xbf", 3) == 0 ? 3 : 0;

    if (is_glb(bytes, size_bytes) || strcasecmp(file_extension(name), "gltf") == 0 ||
        strcasecmp(file_extension(name), "glb") == 0)
        return 1;
    while (at < size_bytes && bytes[at] && strchr(" \t\r\n", bytes[at]))
        at++;
    return at < size_bytes && bytes[at] == '{';
}

static status gltf_import(const void *data, size_t size_bytes, const char *name, const char *folder,
                          const struct import_options *options, struct builder *b)
{
    struct gltf g = {.b = b, .err = b->err, .name = name, .folder = folder};
    const uint8_t *json = data;
    size_t json_bytes = size_bytes;
    const char *title = "";
    status result = STATUS_OK;

    if (is_glb(data, size_bytes)) {
        json = NULL;
        result = open_glb(&g, data, size_bytes, &json, &json_bytes);
    } else if (strcasecmp(file_extension(name), "glb") == 0 && size_bytes > 0 && json[0] != '{') {
        result = error_set(b->err, STATUS_ERR_INPUT, "is not a GLB file: it does not start with "
                                                     "\"glTF\"");
    }
    THEN(result, parse_json(&g, json, json_bytes));
    THEN(result, check_asset(&g));
    THEN(result, check_extensions(&g));
    if (result == STATUS_OK)
        gltf_check_keys(&g);
    THEN(result, open_tables(&g));
    if (result == STATUS_OK)
        gltf_light_units(&g, options->light_units);
    THEN(result, read_variants(&g, options->variant));
    THEN(result, gltf_animations(&g, options->animation));
    THEN(result, gltf_walk(&g, options->scene_index, &title));
    THEN(result, gltf_add_channels(&g));
    THEN(result, gltf_add_tracks(&g));
    THEN(result, builder_finish(b, *title ? title : file_basename(name), options));
    close_tables(&g);
    return result;
}

const struct import_format format_gltf = {
    .name = "glTF 2.0 (.gltf, .glb)",
    .recognise = gltf_recognise,
    .import = gltf_import,
};
