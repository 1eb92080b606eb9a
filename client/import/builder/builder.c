#include "client/import/builder/builder.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "client/terminal/format.h"
#include "client/terminal/must.h"
#include "common/base/json_quote.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"

void builder_begin(struct builder *b, struct import_result *out, const struct import_options *options, struct error *err)
{
    memset(b, 0, sizeof *b);
    scene_environment_default(&b->environment);
    b->fog = BUILDER_NO_ROW;
    b->no_camera_hint = b->no_light_hint = "";
    b->out = out;
    b->files = &out->files;
    b->options = options;
    b->err = err;
}

void builder_end(struct builder *b)
{
    mem_free(b->meshes);
    mem_free(b->images);
    mem_free(b->textures);
    mem_free(b->materials);
    mem_free(b->instances);
    mem_free(b->lights);
    mem_free(b->cameras);
    mem_free(b->nodes);
    mem_free(b->channels);
    mem_free(b->tracks);
    mem_free(b->skins);
    mem_free(b->media);
    mem_free(b->portals);
    mem_free(b->blob_index);
    mem_free(b->blob_mesh);
    for (size_t i = 0; i < b->warning_count; i++) {
        mem_free(b->warnings[i].text);
        mem_free(b->warnings[i].owned_kind);
    }
    memset(b, 0, sizeof *b);
}

/* ---- words -------------------------------------------------------------------------------- */

/* A free slot for a new kind; NULL: the kind is known and was counted. */
static struct builder_warning *warning_slot(struct builder *b, const char *kind)
{
    for (size_t i = 0; i < b->warning_count; i++)
        if (strcmp(b->warnings[i].kind, kind) == 0) {
            b->warnings[i].count++;
            return NULL;
        }
    if (b->warning_count == IMPORT_WARNINGS_MAX) {
        b->warnings_dropped++;
        return NULL;
    }
    return &b->warnings[b->warning_count];
}

static void warning_fill(struct builder *b, struct builder_warning *slot, const char *kind, char *owned_kind,
                         char *text)
{
    text_disarm(text);
    slot->text = must(mem_strdup(text));
    slot->kind = kind;
    slot->owned_kind = owned_kind;
    slot->count = 1;
    b->warning_count++;
}

void builder_warn(struct builder *b, const char *kind, const char *format, ...)
{
    struct builder_warning *slot = warning_slot(b, kind);
    char text[512];
    va_list args;

    if (!slot)
        return;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    warning_fill(b, slot, kind, NULL, text);
}

void builder_warn_at(struct builder *b, const char *file, uint64_t line, const char *kind, const char *format, ...)
{
    struct builder_warning *slot = warning_slot(b, kind);
    char text[768], *owned;
    size_t at;
    va_list args;

    if (!slot)
        return;
    owned = must(mem_strdup(kind));
    if (line)
        snprintf(text, sizeof text, "%.255s:%llu: ", file, (unsigned long long)line);
    else
        snprintf(text, sizeof text, "%.255s: ", file);
    at = strlen(text);
    va_start(args, format);
    vsnprintf(text + at, sizeof text - at, format, args);
    va_end(args);
    warning_fill(b, slot, owned, owned, text);
}

/* The length in bytes of the valid, printable UTF-8 character at `p`; 0: there is none. */
static size_t character_length(const uint8_t *p)
{
    return *p < 0x20 || *p == 0x7f || (*p == 0xc2 && p[1] < 0xa0) ? 0 : utf8_length(p);
}

const char *builder_name(struct builder *b, const char *name)
{
    char clean[SCENE_NAME_MAX + 1];
    size_t size = 0;
    char *copy;

    for (const uint8_t *p = (const uint8_t *)(name ? name : ""); *p;) {
        size_t length = character_length(p), taken = length ? length : 1;
        if (size + taken > SCENE_NAME_MAX)
            break;
        if (length)
            memcpy(clean + size, p, length);
        else
            clean[size] = '?';
        size += taken;
        p += taken;
    }
    clean[size] = 0;
    copy = must(arena_strdup(&b->out->scene.arena, clean));
    return copy;
}

/* ---- blobs -------------------------------------------------------------------------------- */

/* Where the index has the blob, else the free place for it. */
static size_t blob_slot(const struct builder *b, const struct digest *digest)
{
    uint64_t start;
    size_t at;

    memcpy(&start, digest->bytes, sizeof start);
    for (at = (size_t)start & (b->blob_index_size - 1); b->blob_index[at]; at = (at + 1) & (b->blob_index_size - 1))
        if (digest_equal(&b->out->blobs[b->blob_index[at] - 1].digest, digest))
            break;
    return at;
}

static void blob_index_grow(struct builder *b)
{
    b->blob_index_size = b->blob_index_size ? b->blob_index_size * 2 : 64;
    mem_free(b->blob_index);
    b->blob_index = must(mem_calloc(b->blob_index_size, sizeof *b->blob_index));
    for (size_t row = 0; row < b->out->blob_count; row++)
        b->blob_index[blob_slot(b, &b->out->blobs[row].digest)] = (uint32_t)row + 1;
}

static status blob_add(struct builder *b, uint8_t *data, size_t size_bytes, uint32_t *row)
{
    struct import_result *out = b->out;
    struct digest digest;
    status result = STATUS_OK;
    size_t at;

    if (digest_of(&digest, data, size_bytes) != STATUS_OK) {
        result = error_no_memory(b->err, "a digest");
        goto refused;
    }
    if (out->blob_count >= UINT32_MAX - 1) {
        result = error_set(b->err, STATUS_ERR_LIMIT, "too many blobs");
        goto refused;
    }
    if ((out->blob_count + 1) * 2 > b->blob_index_size)
        blob_index_grow(b);
    at = blob_slot(b, &digest);
    if (b->blob_index[at]) {
        *row = b->blob_index[at] - 1;
        mem_free(data);
        return STATUS_OK;
    }
    MUST_GROW(out->blobs, b->blob_capacity, out->blob_count + 1);
    MUST_GROW(b->blob_mesh, b->blob_mesh_capacity, out->blob_count + 1);
    *row = (uint32_t)out->blob_count++;
    out->blobs[*row] = (struct import_blob){digest, data, size_bytes};
    out->blob_bytes += size_bytes;
    b->blob_mesh[*row] = 0;
    b->blob_index[at] = *row + 1;
    return STATUS_OK;
refused:
    mem_free(data);
    return result;
}

const struct import_blob *builder_blob(const struct builder *b, const struct scene_blob *blob)
{
    uint32_t row = b->blob_index_size ? b->blob_index[blob_slot(b, &blob->digest)] : 0;

    return row ? &b->out->blobs[row - 1] : NULL;
}

status builder_add_blob(struct builder *b, uint8_t *data, size_t size_bytes, struct scene_blob *out)
{
    uint32_t row;
    status result = blob_add(b, data, size_bytes, &row);

    if (result == STATUS_OK) {
        out->digest = b->out->blobs[row].digest;
        out->size_bytes = size_bytes;
    }
    return result;
}

/* ---- rows --------------------------------------------------------------------------------- */

static status no_room(struct builder *b, const char *table)
{
    return error_set(b->err, STATUS_ERR_LIMIT, "the scene has too many %s", table);
}

#define ADD_ROW(table, count, capacity, maximum, value)                           \
    do {                                                                          \
        if (b->count >= (maximum))                                                \
            return no_room(b, #table);                                            \
        MUST_GROW(b->table, b->capacity, b->count + 1);                           \
        b->table[b->count++] = (value);                                           \
    } while (0)

status builder_add_mesh(struct builder *b, const struct scene_mesh *mesh, uint8_t *data, size_t size_bytes,
                        uint32_t *row)
{
    struct scene_mesh added = *mesh;
    uint32_t blob;

    TRY(blob_add(b, data, size_bytes, &blob));
    if (b->blob_mesh[blob]) {
        const struct scene_mesh *same = &b->meshes[b->blob_mesh[blob] - 1];
        if (same->vertex_count == mesh->vertex_count && same->arrays == mesh->arrays &&
            same->morph_count == mesh->morph_count) {
            *row = b->blob_mesh[blob] - 1;
            return STATUS_OK;
        }
    }
    added.blob.digest = b->out->blobs[blob].digest;
    added.blob.size_bytes = size_bytes;
    ADD_ROW(meshes, mesh_count, mesh_capacity, SCENE_MESHES_MAX, added);
    *row = (uint32_t)b->mesh_count - 1;
    if (!b->blob_mesh[blob])
        b->blob_mesh[blob] = *row + 1;
    b->out->triangles += mesh->triangle_count;
    b->out->vertices += mesh->vertex_count;
    return STATUS_OK;
}

status builder_add_image_row(struct builder *b, const struct scene_image *image, uint32_t *row)
{
    ADD_ROW(images, image_count, image_capacity, SCENE_IMAGES_MAX, *image);
    *row = (uint32_t)b->image_count - 1;
    return STATUS_OK;
}

status builder_add_texture(struct builder *b, const struct scene_texture *texture, uint32_t *row)
{
    ADD_ROW(textures, texture_count, texture_capacity, SCENE_TEXTURES_MAX, *texture);
    *row = (uint32_t)b->texture_count - 1;
    return STATUS_OK;
}

status builder_add_material(struct builder *b, const struct scene_material *material, uint32_t *row)
{
    ADD_ROW(materials, material_count, material_capacity, SCENE_MATERIALS_MAX, *material);
    *row = (uint32_t)b->material_count - 1;
    return STATUS_OK;
}

status builder_add_instance(struct builder *b, const struct scene_instance *instance)
{
    ADD_ROW(instances, instance_count, instance_capacity, SCENE_INSTANCES_MAX, *instance);
    b->out->triangles_placed += b->meshes[instance->mesh].triangle_count;
    return STATUS_OK;
}

status builder_add_light(struct builder *b, const struct scene_light *light)
{
    ADD_ROW(lights, light_count, light_capacity, SCENE_LIGHTS_MAX, *light);
    b->has_light = 1;
    return STATUS_OK;
}

status builder_add_camera(struct builder *b, const struct scene_camera *camera)
{
    ADD_ROW(cameras, camera_count, camera_capacity, SCENE_CAMERAS_MAX, *camera);
    return STATUS_OK;
}

/* ---- what moves --------------------------------------------------------------------------- */

/* A copy in the scene's arena; NULL if it is empty. */
static void keep(struct builder *b, void **array, size_t count, size_t size_bytes)
{
    void *copy = count ? must(arena_alloc(&b->out->scene.arena, count, size_bytes)) : NULL;

    if (copy)
        memcpy(copy, *array, count * size_bytes);
    *array = copy;
}
#define KEEP(b, array, count) keep((b), (void **)&(array), (count), sizeof *(array))

status builder_add_node(struct builder *b, const struct scene_node *node, uint32_t *row)
{
    struct scene_node added = *node;

    KEEP(b, added.weights, added.weight_count);
    ADD_ROW(nodes, node_count, node_capacity, SCENE_NODES_MAX, added);
    *row = (uint32_t)b->node_count - 1;
    return STATUS_OK;
}

static status keep_keys(struct builder *b, struct scene_channel *keys)
{
    const size_t floats = scene_channel_floats(keys);

    if (keys->key_count > SCENE_KEYS_MAX)
        return error_set(b->err, STATUS_ERR_LIMIT, "an animation has %u keys: at most %d are taken", keys->key_count,
                         SCENE_KEYS_MAX);
    KEEP(b, keys->times, keys->key_count);
    KEEP(b, keys->values, floats);
    return STATUS_OK;
}

status builder_add_channel(struct builder *b, const struct scene_channel *channel)
{
    struct scene_channel added = *channel;

    TRY(keep_keys(b, &added));
    ADD_ROW(channels, channel_count, channel_capacity, SCENE_CHANNELS_MAX, added);
    return STATUS_OK;
}

status builder_add_track(struct builder *b, const struct scene_track *track)
{
    struct scene_track added = *track;

    TRY(keep_keys(b, &added.keys));
    ADD_ROW(tracks, track_count, track_capacity, SCENE_TRACKS_MAX, added);
    return STATUS_OK;
}

status builder_add_skin(struct builder *b, const struct scene_skin *skin, uint32_t *row)
{
    struct scene_skin added = *skin;

    KEEP(b, added.joints, skin->joint_count);
    KEEP(b, added.inverse_bind, skin->joint_count);
    ADD_ROW(skins, skin_count, skin_capacity, SCENE_SKINS_MAX, added);
    *row = (uint32_t)b->skin_count - 1;
    return STATUS_OK;
}

/* ---- media, portals ----------------------------------------------------------------------- */

status builder_add_medium(struct builder *b, const struct scene_medium *medium, float *grid, uint32_t *row)
{
    struct scene_medium added = *medium;
    size_t cells;

    added.has_grid = grid != NULL;
    if (grid) {
        for (int axis = 0; axis < 3; axis++)
            if (medium->grid_size[axis] < 1 || medium->grid_size[axis] > SCENE_GRID_SIDE_MAX) {
                mem_free(grid);
                return error_set(b->err, STATUS_ERR_LIMIT,
                                 "a medium's grid has %u cells along one side: 1 to %d are taken",
                                 medium->grid_size[axis], SCENE_GRID_SIDE_MAX);
            }
        cells = (size_t)medium->grid_size[0] * medium->grid_size[1] * medium->grid_size[2];
        TRY(builder_add_blob(b, (uint8_t *)grid, cells * sizeof *grid, &added.grid));
    }
    ADD_ROW(media, medium_count, medium_capacity, SCENE_MEDIA_MAX, added);
    *row = (uint32_t)b->medium_count - 1;
    return STATUS_OK;
}

status builder_add_portal(struct builder *b, const struct scene_portal *portal)
{
    ADD_ROW(portals, portal_count, portal_capacity, SCENE_PORTALS_MAX, *portal);
    return STATUS_OK;
}
