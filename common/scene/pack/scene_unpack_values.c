/* The parts of the elements of a packed scene. */
#include <string.h>

#include "common/scene/pack/scene_unpack_parts.h"

status unpack_index(struct scene_reader *r, const char *what, uint32_t from, uint32_t maximum, int32_t *to)
{
    if (from > maximum)
        return error_set(r->err, STATUS_ERR_INPUT, "the packed scene is damaged: %s %u is out of range", what,
                         from - 1);
    *to = (int32_t)from - 1;
    return STATUS_OK;
}

status unpack_name(struct scene_reader *r, const char *text, const char **out)
{
    *out = arena_strdup(&r->scene->arena, text ? text : "");
    return *out ? STATUS_OK : error_no_memory(r->err, "the scene's names");
}

status unpack_floats(struct scene_reader *r, const char *what, const float *from, size_t got, float *to, size_t wanted)
{
    if (got != wanted)
        return error_set(r->err, STATUS_ERR_INPUT, "the packed scene is damaged: %s has %zu numbers instead of %zu",
                         what, got, wanted);
    memcpy(to, from, wanted * sizeof *to);
    return STATUS_OK;
}

status unpack_floats_if(struct scene_reader *r, const char *what, const float *from, size_t got, float *to,
                        size_t wanted)
{
    return got ? unpack_floats(r, what, from, got, to, wanted) : STATUS_OK;
}

status unpack_doubles(struct scene_reader *r, const char *what, const double *from, size_t got, double *to,
                      size_t wanted)
{
    if (got != wanted)
        return error_set(r->err, STATUS_ERR_INPUT, "the packed scene is damaged: %s has %zu numbers instead of %zu",
                         what, got, wanted);
    memcpy(to, from, wanted * sizeof *to);
    return STATUS_OK;
}

status unpack_array(struct scene_reader *r, const void *from, size_t got, size_t size_bytes, void **to)
{
    *to = arena_alloc(&r->scene->arena, got, size_bytes);
    NEED(*to, r->err, "the scene's motion");
    if (got)
        memcpy(*to, from, got * size_bytes);
    return STATUS_OK;
}

status unpack_blob(struct scene_reader *r, const Azulejo__Scene__Blob *from, struct scene_blob *to)
{
    if (!from || from->digest.len != DIGEST_BYTES)
        return unpack_damaged(r, "a blob has no SHA-256 digest");
    if (from->base.n_unknown_fields)
        return unpack_damaged(r, "a blob has an unknown field");
    memcpy(to->digest.bytes, from->digest.data, DIGEST_BYTES);
    to->size_bytes = from->size_bytes;
    return STATUS_OK;
}

status unpack_image(struct scene_reader *r, const Azulejo__Scene__Image *from, struct scene_image *to)
{
    status result = unpack_name(r, from->name, &to->name);

    if (result == STATUS_OK && from->base.n_unknown_fields)
        return unpack_damaged(r, "an image has an unknown field");
    return result == STATUS_OK ? unpack_blob(r, from->blob, &to->blob) : result;
}

status unpack_slot(struct scene_reader *r, const Azulejo__Scene__TextureSlot *from, struct scene_texture_slot *to)
{
    if (!from)
        return STATUS_OK; /* keep the value of scene_material_default */
    if (from->base.n_unknown_fields)
        return unpack_damaged(r, "a texture slot has an unknown field");
    if (from->texture >= SCENE_TEXTURES_MAX)
        return unpack_damaged(r, "a texture's index is out of range");
    to->texture = (int32_t)from->texture;
    to->uv_set = from->uv_set;
    return unpack_floats(r, "uv_transform", from->uv_transform, from->n_uv_transform, &to->uv_transform[0][0], 6);
}
