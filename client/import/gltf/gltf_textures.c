/* glTF: images, textures and the references to them. */
#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "client/import/builder/uri.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/image/image.h"
#include "common/math/elementary.h"

/* ---- images ------------------------------------------------------------------------------- */

/* Is it a known format that is not read? For a helpful message. */
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
    const char *uri = NULL, *name = NULL, *file, *shown;
    struct buffer bytes = BUFFER_INIT;
    char numbered[32];
    json_t *image;
    uint32_t added = 0;
    int can_lack;
    status result;

    TRY(gltf_row(g, g->images, &at, &image));
    TRY(gltf_text(g, image, &at, "uri", &uri));
    TRY(gltf_text(g, image, &at, "name", &name));
    file = uri && !uri_is_data(uri) ? uri : NULL;
    snprintf(numbered, sizeof numbered, "images[%zu]", index); /* reports of damage use the name */
    shown = name ? name : file ? file_basename(file) : numbered;
    result = gltf_read_bytes(g, image, &at, uri, &bytes);
    *row = BUILDER_NO_ROW;
    if (result == STATUS_OK && image_format_of(bytes.data, bytes.size) == IMAGE_UNKNOWN)
        result = gltf_fail(g, STATUS_ERR_UNSUPPORTED, &at,
                           "%.80s is %s file: PNG, JPEG and WebP textures are read (convert the "
                           "textures, for example with gltf-transform)",
                           file ? file : name ? name : "it",
                           foreign_format(bytes.data, bytes.size));
    can_lack = file || result == STATUS_ERR_UNSUPPORTED || result == STATUS_OK;
    THEN(result, builder_check_picture(g->b, shown, bytes.data, bytes.size));
    if (result == STATUS_OK) {
        result = builder_add_image(g->b, shown, bytes.data, bytes.size, &added);
        bytes = (struct buffer)BUFFER_INIT; /* taken over */
        *row = added;
    } else if (can_lack) {
        result = builder_leave_out(g->b, g->name, 0, "texture", file ? file : name ? name : numbered, result);
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
        builder_warn(g->b, "wrap mode", "samplers[%zu]: wrap mode %llu is unknown: repeated", at->row,
                     (unsigned long long)mode);
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

/* *row stays BUILDER_NO_ROW for a texture that cannot be used. */
static status read_texture(struct gltf *g, size_t index, int64_t *row)
{
    const struct gltf_place at = gltf_at("textures", index, "");
    struct scene_texture out = {.wrap_u = WRAP_REPEAT, .wrap_v = WRAP_REPEAT};
    const struct gltf_place at_webp = gltf_within(&at, ".EXT_texture_webp");
    int64_t source = -1, sampler = -1;
    json_t *texture, *webp;
    uint32_t added;

    TRY(gltf_row(g, g->textures, &at, &texture));
    TRY(gltf_index(g, texture, &at, "source", g->images, &source));
    TRY(gltf_index(g, texture, &at, "sampler", g->samplers, &sampler));
    webp = gltf_extension(texture, "EXT_texture_webp");
    if (webp) /* the other source is for readers without WebP */
        TRY(gltf_index(g, webp, &at_webp, "source", g->images, &source));
    if (gltf_extension(texture, "KHR_texture_basisu"))
        builder_warn(g->b, "basisu", "textures[%zu] is in KTX2 form (KHR_texture_basisu), which is not read: %s", index,
                     source >= 0 ? "its other form is used" : "left out");
    if (source < 0) {
        if (g->b->options->strict)
            return gltf_fail(g, STATUS_ERR_UNSUPPORTED, &at, "has no image in a form that is read");
        if (!json_object_get(texture, "extensions"))
            builder_warn(g->b, "texture without source", "textures[%zu] has no image: left out", index);
        return STATUS_OK;
    }
    if (sampler >= 0)
        TRY(read_sampler(g, (size_t)sampler, &out));
    if (g->image_rows[source] == GLTF_ROW_UNREAD)
        TRY(read_image(g, (size_t)source, &g->image_rows[source]));
    if (g->image_rows[source] == BUILDER_NO_ROW)
        return STATUS_OK;
    out.image = (uint32_t)g->image_rows[source];
    TRY(builder_add_texture(g->b, &out, &added));
    *row = added;
    return STATUS_OK;
}

/* KHR_texture_transform: uv' = T R S uv; the angle turns counter-clockwise as seen on the
 * image, whose v runs downwards. */
static status read_transform(struct gltf *g, json_t *info, const struct gltf_place *at, struct scene_texture_slot *slot,
                             uint64_t *uv_set)
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

status gltf_slot(struct gltf *g, json_t *in, const struct gltf_place *at, const char *key,
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
