#include "client/import/builder.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/bodies.h"
#include "common/base/file.h"
#include "common/base/memory.h"
#include "common/scene/effects.h"

void builder_init(struct builder *b, struct import_result *out,
                  const struct import_options *options, struct error *err)
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

void builder_release(struct builder *b)
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

void text_disarm(char *text)
{
    for (; *text; text++)
        if ((unsigned char)*text < 0x20 || *text == 0x7f)
            *text = '?';
}

/* A free slot for a kind that was not seen before; NULL: counted, nothing to add. */
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

static void warning_fill(struct builder *b, struct builder_warning *slot, const char *kind,
                         char *owned_kind, char *text)
{
    text_disarm(text);
    slot->text = mem_strdup(text);
    if (!slot->text) {
        mem_free(owned_kind);
        b->no_memory = 1;
        return;
    }
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

void builder_warn_at(struct builder *b, const char *file, uint64_t line, const char *kind,
                     const char *format, ...)
{
    struct builder_warning *slot = warning_slot(b, kind);
    char text[768], *owned;
    size_t at;
    va_list args;

    if (!slot)
        return;
    owned = mem_strdup(kind);
    if (!owned) {
        b->no_memory = 1;
        return;
    }
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

/* How many bytes the valid, printable UTF-8 character at `p` has; 0: it is none. */
static int character_length(const uint8_t *p)
{
    uint32_t code = *p;
    int length = 0;

    if (code < 0x80)
        length = 1;
    else if (code >= 0xc2 && code < 0xf5)
        length = code < 0xe0 ? 2 : code < 0xf0 ? 3 : 4;
    if (length == 1)
        return code >= 0x20 && code != 0x7f;
    if (length == 0)
        return 0;
    code &= 0xffu >> (length + 1);
    for (int i = 1; i < length; i++) {
        if ((p[i] & 0xc0) != 0x80)
            return 0;
        code = code << 6 | (p[i] & 0x3f);
    }
    if ((length == 2 && code < 0xa0) || (length == 3 && code < 0x800) ||
        (length == 4 && (code < 0x10000 || code > 0x10ffff)) || (code >= 0xd800 && code < 0xe000))
        return 0;
    return length;
}

const char *builder_name(struct builder *b, const char *name)
{
    char clean[SCENE_NAME_MAX + 1];
    size_t size = 0;
    char *copy;

    for (const uint8_t *p = (const uint8_t *)(name ? name : ""); *p;) {
        int length = character_length(p);
        int taken = length ? length : 1;
        if (size + (size_t)taken > SCENE_NAME_MAX)
            break;
        if (length)
            memcpy(clean + size, p, (size_t)length);
        else
            clean[size] = '?';
        size += (size_t)taken;
        p += taken;
    }
    clean[size] = 0;
    copy = arena_strdup(&b->out->scene.arena, clean);
    if (!copy)
        b->no_memory = 1;
    return copy ? copy : "";
}

/* ---- blobs -------------------------------------------------------------------------------- */

static size_t digest_slot(const struct digest *digest, size_t size)
{
    uint64_t start;

    memcpy(&start, digest->bytes, sizeof start);
    return (size_t)start & (size - 1);
}

static int blob_index_grow(struct builder *b)
{
    size_t size = b->blob_index_size ? b->blob_index_size * 2 : 64;
    uint32_t *index = mem_calloc(size, sizeof *index);

    if (!index)
        return 0;
    for (size_t row = 0; row < b->out->blob_count; row++) {
        size_t at = digest_slot(&b->out->blobs[row].digest, size);
        while (index[at])
            at = (at + 1) & (size - 1);
        index[at] = (uint32_t)row + 1;
    }
    mem_free(b->blob_index);
    b->blob_index = index;
    b->blob_index_size = size;
    return 1;
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
    if ((out->blob_count + 1) * 2 > b->blob_index_size && !blob_index_grow(b))
        goto no_memory;
    for (at = digest_slot(&digest, b->blob_index_size); b->blob_index[at];
         at = (at + 1) & (b->blob_index_size - 1))
        if (digest_equal(&out->blobs[b->blob_index[at] - 1].digest, &digest)) {
            *row = b->blob_index[at] - 1;
            mem_free(data);
            return STATUS_OK;
        }
    if (!MEM_GROW(out->blobs, b->blob_capacity, out->blob_count + 1) ||
        !MEM_GROW(b->blob_mesh, b->blob_mesh_capacity, out->blob_count + 1))
        goto no_memory;
    *row = (uint32_t)out->blob_count++;
    out->blobs[*row] = (struct import_blob){digest, data, size_bytes};
    out->blob_bytes += size_bytes;
    b->blob_mesh[*row] = 0;
    b->blob_index[at] = *row + 1;
    return STATUS_OK;
no_memory:
    result = error_no_memory(b->err, "the list of blobs");
refused:
    mem_free(data);
    return result;
}

const struct import_blob *builder_blob(const struct builder *b, const struct scene_blob *blob)
{
    size_t at;

    if (b->blob_index_size == 0)
        return NULL;
    for (at = digest_slot(&blob->digest, b->blob_index_size); b->blob_index[at];
         at = (at + 1) & (b->blob_index_size - 1))
        if (digest_equal(&b->out->blobs[b->blob_index[at] - 1].digest, &blob->digest))
            return &b->out->blobs[b->blob_index[at] - 1];
    return NULL;
}

status builder_add_blob(struct builder *b, uint8_t *data, size_t size_bytes,
                        struct scene_blob *out)
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
        if (!MEM_GROW(b->table, b->capacity, b->count + 1))                       \
            return error_no_memory(b->err, "the table of " #table);               \
        b->table[b->count++] = (value);                                           \
    } while (0)

status builder_add_mesh(struct builder *b, const struct scene_mesh *mesh, uint8_t *data,
                        size_t size_bytes, uint32_t *row)
{
    struct scene_mesh added = *mesh;
    uint32_t blob;
    status result = blob_add(b, data, size_bytes, &blob);

    if (result != STATUS_OK)
        return result;
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

status builder_add_material(struct builder *b, const struct scene_material *material,
                            uint32_t *row)
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

/* A copy in the scene's arena; 0 when out of memory. */
static int keep(struct builder *b, void **array, size_t count, size_t size_bytes)
{
    void *copy;

    if (count == 0) {
        *array = NULL;
        return 1;
    }
    copy = arena_alloc(&b->out->scene.arena, count, size_bytes);
    if (copy)
        memcpy(copy, *array, count * size_bytes);
    *array = copy;
    return copy != NULL;
}
#define KEEP(b, array, count) keep((b), (void **)&(array), (count), sizeof *(array))

status builder_add_node(struct builder *b, const struct scene_node *node, uint32_t *row)
{
    struct scene_node added = *node;

    if (!KEEP(b, added.weights, added.weight_count))
        return error_no_memory(b->err, "a node");
    ADD_ROW(nodes, node_count, node_capacity, SCENE_NODES_MAX, added);
    *row = (uint32_t)b->node_count - 1;
    return STATUS_OK;
}

status builder_add_channel(struct builder *b, const struct scene_channel *channel)
{
    struct scene_channel added = *channel;
    size_t values;

    if (channel->key_count > SCENE_KEYS_MAX)
        return error_set(b->err, STATUS_ERR_LIMIT,
                         "an animation has %u keys: at most %d are taken", channel->key_count,
                         SCENE_KEYS_MAX);
    if (!mem_size_mul((size_t)channel->key_count *
                          (channel->interpolation == INTERPOLATE_CUBIC ? 3 : 1),
                      channel->components, &values) ||
        !KEEP(b, added.times, channel->key_count) || !KEEP(b, added.values, values))
        return error_no_memory(b->err, "an animation");
    ADD_ROW(channels, channel_count, channel_capacity, SCENE_CHANNELS_MAX, added);
    return STATUS_OK;
}

status builder_add_skin(struct builder *b, const struct scene_skin *skin, uint32_t *row)
{
    struct scene_skin added = *skin;

    if (!KEEP(b, added.joints, skin->joint_count) || !KEEP(b, added.inverse_bind, skin->joint_count))
        return error_no_memory(b->err, "a skin");
    ADD_ROW(skins, skin_count, skin_capacity, SCENE_SKINS_MAX, added);
    *row = (uint32_t)b->skin_count - 1;
    return STATUS_OK;
}

/* ---- media, portals ----------------------------------------------------------------------- */

status builder_add_medium(struct builder *b, const struct scene_medium *medium, float *grid,
                          uint32_t *row)
{
    struct scene_medium added = *medium;
    size_t cells;

    added.has_grid = grid != NULL;
    if (grid) {
        status result;
        for (int axis = 0; axis < 3; axis++)
            if (medium->grid_size[axis] < 1 || medium->grid_size[axis] > SCENE_GRID_SIDE_MAX) {
                mem_free(grid);
                return error_set(b->err, STATUS_ERR_LIMIT,
                                 "a medium's grid has %u cells along one side: 1 to %d are taken",
                                 medium->grid_size[axis], SCENE_GRID_SIDE_MAX);
            }
        cells = (size_t)medium->grid_size[0] * medium->grid_size[1] * medium->grid_size[2];
        result = builder_add_blob(b, (uint8_t *)grid, cells * sizeof *grid, &added.grid);
        if (result != STATUS_OK)
            return result;
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

/* ---- the end ------------------------------------------------------------------------------ */

struct ordered_channel {
    struct scene_channel channel;
    size_t order;
};

static int channel_compare(const struct scene_channel *a, const struct scene_channel *b)
{
    if (a->node != b->node)
        return a->node < b->node ? -1 : 1;
    return (a->path > b->path) - (a->path < b->path);
}

static int ordered_compare(const void *a, const void *b)
{
    const struct ordered_channel *x = a, *y = b;
    int order = channel_compare(&x->channel, &y->channel);

    return order ? order : (x->order > y->order) - (x->order < y->order);
}

/* Sorted as the scene wants them; of two for one property the one that was added first stays. */
static status sort_channels(struct builder *b)
{
    struct ordered_channel *list = mem_alloc_array(b->channel_count, sizeof *list);
    size_t kept = 0;

    if (!list)
        return error_no_memory(b->err, "the animation");
    for (size_t i = 0; i < b->channel_count; i++)
        list[i] = (struct ordered_channel){b->channels[i], i};
    qsort(list, b->channel_count, sizeof *list, ordered_compare);
    for (size_t i = 0; i < b->channel_count; i++) {
        if (kept && channel_compare(&b->channels[kept - 1], &list[i].channel) == 0) {
            builder_warn(b, "animated twice",
                         "several animations move the same thing: the first one is taken");
            continue;
        }
        b->channels[kept++] = list[i].channel;
    }
    b->channel_count = kept;
    mem_free(list);
    return STATUS_OK;
}

#define HAND_OVER(type, table, count)                                            \
    do {                                                                         \
        scene->table = ARENA_ARRAY(&scene->arena, type, b->count);               \
        if (!scene->table)                                                       \
            return error_no_memory(b->err, "the scene's " #table);               \
        if (b->count)                                                            \
            memcpy(scene->table, b->table, b->count * sizeof(type));             \
        scene->count = (uint32_t)b->count;                                       \
    } while (0)

static status hand_over_tables(struct builder *b)
{
    struct scene *scene = &b->out->scene;
    status result = sort_channels(b);

    if (result != STATUS_OK)
        return result;
    HAND_OVER(struct scene_mesh, meshes, mesh_count);
    HAND_OVER(struct scene_image, images, image_count);
    HAND_OVER(struct scene_texture, textures, texture_count);
    HAND_OVER(struct scene_material, materials, material_count);
    HAND_OVER(struct scene_instance, instances, instance_count);
    HAND_OVER(struct scene_light, lights, light_count);
    HAND_OVER(struct scene_node, nodes, node_count);
    HAND_OVER(struct scene_channel, channels, channel_count);
    HAND_OVER(struct scene_skin, skins, skin_count);
    HAND_OVER(struct scene_medium, media, medium_count);
    scene->environment = b->environment;
    scene->environment.portal_count = (uint32_t)b->portal_count;
    scene->environment.portals = NULL;
    if (b->portal_count) {
        struct scene_portal *portals = b->portals;
        if (!KEEP(b, portals, b->portal_count))
            return error_no_memory(b->err, "the portals");
        scene->environment.portals = portals;
    }
    scene->fog = b->fog;
    scene->volume_rule = b->volume_rule;
    return STATUS_OK;
}

/* *framed: the camera that is still to be aimed, or NULL. */
static status hand_over_cameras(struct builder *b, struct scene_camera **framed)
{
    struct scene *scene = &b->out->scene;
    int none = b->camera_count == 0;

    if (none) {
        struct scene_camera camera;
        status result;
        scene_camera_default(&camera);
        camera.name = builder_name(b, "framed");
        result = builder_add_camera(b, &camera);
        if (result != STATUS_OK)
            return result;
        builder_warn(b, "no camera",
                     "the file has no camera: one was added that looks at the whole scene%s",
                     b->no_camera_hint);
    }
    HAND_OVER(struct scene_camera, cameras, camera_count);
    *framed = none ? &scene->cameras[0] : NULL;
    return STATUS_OK;
}

/* A scene that nothing lights would be black: say so, and light it evenly unless it has lights,
 * which then are meant to be off. What is unlit shines by itself and needs no help. */
static void light_the_dark(struct builder *b)
{
    struct scene *scene = &b->out->scene;
    const uint64_t lights = EFFECT_PUNCTUAL_LIGHT | EFFECT_ENVIRONMENT | EFFECT_EMISSIVE_MESH;
    int lit = scene->instance_count == 0;

    for (uint32_t i = 0; i < scene->instance_count && !lit; i++)
        lit = !scene->materials[scene->instances[i].material].unlit;
    if (!lit || (scene_effects_default(scene, 0) & lights))
        return;
    if (b->has_light || b->environment.present) {
        builder_warn(b, "no power", "none of the lights has any power: the picture will be black");
        return;
    }
    scene_environment_default(&scene->environment);
    scene->environment.present = scene->environment.constant = 1;
    builder_warn(b, "no light",
                 "the file has no light: an even white environment of radiance 1 was added (give "
                 "an environment map, or add lights to the file)%s",
                 b->no_light_hint);
}

static status hand_over_warnings(struct builder *b)
{
    struct import_result *out = b->out;
    size_t count = b->warning_count + (b->warnings_dropped ? 1 : 0);
    struct buffer text = BUFFER_INIT;

    if (count == 0)
        return STATUS_OK;
    out->warnings = mem_calloc(count, sizeof *out->warnings);
    if (!out->warnings)
        return error_no_memory(b->err, "the warnings");
    for (size_t i = 0; i < b->warning_count; i++) {
        struct builder_warning *w = &b->warnings[i];
        if (w->count > 1) {
            buffer_printf(&text, "%s (and %llu more of this kind)", w->text,
                          (unsigned long long)(w->count - 1));
            if (!buffer_ok(&text)) {
                buffer_release(&text);
                return error_no_memory(b->err, "the warnings");
            }
            out->warnings[out->warning_count++] = (char *)text.data;
            buffer_init(&text);
        } else {
            out->warnings[out->warning_count++] = w->text;
            w->text = NULL;
        }
    }
    if (b->warnings_dropped) {
        buffer_printf(&text, "%llu further warnings are not shown",
                      (unsigned long long)b->warnings_dropped);
        if (!buffer_ok(&text)) {
            buffer_release(&text);
            return error_no_memory(b->err, "the warnings");
        }
        out->warnings[out->warning_count++] = (char *)text.data;
    }
    return STATUS_OK;
}

static int blob_compare(const void *a, const void *b)
{
    const struct scene_blob *x = a, *y = b;

    return memcmp(x->digest.bytes, y->digest.bytes, DIGEST_BYTES);
}

/* Drop the blobs that the scene does not name (any more). */
static status prune_blobs(struct builder *b)
{
    struct import_result *out = b->out;
    struct scene_blob *named = NULL;
    size_t named_count = 0, kept = 0;
    status result = scene_blobs(&out->scene, &named, &named_count, b->err);

    if (result != STATUS_OK)
        return result;
    qsort(named, named_count, sizeof *named, blob_compare);
    out->blob_bytes = 0;
    for (size_t i = 0; i < out->blob_count; i++) {
        const struct scene_blob key = {.digest = out->blobs[i].digest};
        if (!bsearch(&key, named, named_count, sizeof *named, blob_compare)) {
            mem_free(out->blobs[i].data);
            continue;
        }
        out->blob_bytes += out->blobs[i].size_bytes;
        out->blobs[kept++] = out->blobs[i];
    }
    out->blob_count = kept;
    mem_free(named);
    return STATUS_OK;
}

static status blob_get(void *user, const struct digest *digest, const uint8_t **data,
                       size_t *size_bytes, struct error *err)
{
    const struct scene_blob wanted = {.digest = *digest};
    const struct import_blob *blob = builder_blob(user, &wanted);

    if (!blob)
        return error_set(err, STATUS_ERR_INTERNAL, "a blob of the scene is missing");
    *data = blob->data;
    *size_bytes = blob->size_bytes;
    return STATUS_OK;
}

/* Take out what no picture can show; damaged images are found on the way. */
static status simplify(struct builder *b)
{
    const struct scene_blob_reader reader = {blob_get, b};

    return scene_simplify(&b->out->scene, reader, &b->out->simplified, b->err);
}

status builder_finish(struct builder *b, const char *title, const struct import_options *options)
{
    struct import_result *out = b->out;
    struct buffer packed = BUFFER_INIT;
    struct scene_camera *framed = NULL;
    status result;

    if (b->instance_count == 0) {
        if (b->camera_count == 0)
            return error_set(b->err, STATUS_ERR_INPUT,
                             "there is nothing to render: the scene has no triangles and no "
                             "camera");
        builder_warn(b, "empty", "the scene has no triangles: only the environment will be seen");
    }
    if (options->env_path) {
        result = builder_read_environment(b, options->env_path);
        if (result != STATUS_OK)
            return result;
    }
    out->scene.name = builder_name(b, title);
    result = hand_over_tables(b);
    if (result == STATUS_OK)
        result = hand_over_cameras(b, &framed);
    if (result != STATUS_OK)
        return result;
    if (b->no_memory)
        return error_no_memory(b->err, "names and warnings");
    result = scene_validate(&out->scene, b->err);
    if (result == STATUS_OK) {
        scene_rebase(b);
        result = scene_place(b, framed);
    }
    if (result == STATUS_OK)
        result = scene_validate(&out->scene, b->err); /* as it was placed */
    if (result != STATUS_OK)
        return result;
    result = simplify(b);
    if (result == STATUS_OK)
        result = bodies_find(b);
    if (result != STATUS_OK)
        return result;
    light_the_dark(b);
    result = prune_blobs(b);
    if (result != STATUS_OK)
        return result;
    if (out->degenerate_triangles)
        builder_warn(b, "degenerate", "%llu triangles without area were left out",
                     (unsigned long long)out->degenerate_triangles);
    if (b->no_memory)
        return error_no_memory(b->err, "the warnings");
    result = hand_over_warnings(b);
    if (result == STATUS_OK)
        result = scene_pack(&out->scene, &packed, b->err);
    if (result == STATUS_OK && digest_of(&out->scene_digest, packed.data, packed.size) != STATUS_OK)
        result = error_no_memory(b->err, "the scene's digest");
    if (result == STATUS_OK) {
        out->packed = packed.data;
        out->packed_bytes = packed.size;
        return STATUS_OK;
    }
    buffer_release(&packed);
    return result;
}
