/* Bytes to a scene. The top-level fields are read here, one element after another, and each element separately goes
 * through protobuf-c: a hostile count cannot make us take more memory than the bytes that are present justify. */
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/pack/scene_unpack_parts.h"

enum {
    FIELD_VERSION = 1,
    FIELD_NAME = 2,
    FIELD_FOG = 16,
    FIELD_VOLUME_RULE = 18,
    FIELD_COUNT = 20,
    /* Our own writer writes each field of an element once. An element with more pieces is not ours,
     * and protobuf-c would take many times its size to decode it. */
    ELEMENT_PIECES_MAX = 64,
};

static void *reader_alloc(void *user, size_t size)
{
    struct scene_reader *r = user;
    void *block = mem_alloc(size);

    if (!block)
        r->no_memory = 1;
    return block;
}

static void reader_free(void *user UNUSED, void *block) { mem_free(block); }

static int read_varint(struct scene_reader *r, uint64_t *value)
{
    *value = 0;
    for (int shift = 0; shift < 64 && r->at < r->end; shift += 7) {
        uint8_t byte = *r->at++;
        *value |= (uint64_t)(byte & 0x7f) << shift;
        if (!(byte & 0x80))
            return shift < 63 || byte <= 1;
    }
    return 0;
}

static int is_number(uint64_t field)
{
    return field == FIELD_VERSION || field == FIELD_FOG || field == FIELD_VOLUME_RULE;
}

/* The next top-level field; its payload lies at *data, or in *number. */
static status read_field(struct scene_reader *r, uint32_t *field, const uint8_t **data, size_t *size, uint64_t *number)
{
    uint64_t key, length;

    if (!read_varint(r, &key))
        return unpack_damaged(r, "it ends within a field's number");
    if (key >> 3 < 1 || key >> 3 >= FIELD_COUNT || (key & 7) != (is_number(key >> 3) ? 0 : 2))
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene has a field that this version (%s) does not know: it "
                         "is damaged or was made by a newer version",
                         AZULEJO_VERSION);
    *field = (uint32_t)(key >> 3);
    if (is_number(*field))
        return read_varint(r, number) ? STATUS_OK : unpack_damaged(r, "it ends within a number");
    if (!read_varint(r, &length) || length > (size_t)(r->end - r->at))
        return unpack_damaged(r, "it ends within an element");
    *data = r->at;
    *size = (size_t)length;
    r->at += length;
    return STATUS_OK;
}

/* Does the message have few enough pieces? protobuf-c finds all other errors. */
static int pieces_are_few(const uint8_t *data, size_t size)
{
    struct scene_reader r = {.at = data, .end = data + size};

    for (int pieces = 0; r.at < r.end; pieces++) {
        uint64_t key, skip;

        if (pieces == ELEMENT_PIECES_MAX || !read_varint(&r, &key))
            return 0;
        switch (key & 7) {
        case 0:
            if (!read_varint(&r, &skip))
                return 0;
            skip = 0;
            break;
        case 1: skip = 8; break;
        case 2:
            if (!read_varint(&r, &skip))
                return 0;
            break;
        case 5: skip = 4; break;
        default: return 0;
        }
        if (skip > (size_t)(r.end - r.at))
            return 0;
        r.at += skip;
    }
    return 1;
}

/* The contents of each top-level field. `least_bytes` is the minimum size of a valid element: it limits the memory that
 * a count of tiny elements can claim. `most_bytes` of 0 is SCENE_ELEMENT_BYTES_MAX. */
static const struct element {
    const char *name;
    const ProtobufCMessageDescriptor *descriptor;
    uint32_t maximum;
    size_t least_bytes;
    unpack_element *unpack;
    size_t most_bytes;
} elements[FIELD_COUNT] = {
    [3] = {"meshes", &azulejo__scene__mesh__descriptor, SCENE_MESHES_MAX, 64, unpack_mesh, 0},
    [4] = {"images", &azulejo__scene__image__descriptor, SCENE_IMAGES_MAX, 38, unpack_image_row, 0},
    [5] = {"textures", &azulejo__scene__texture__descriptor, SCENE_TEXTURES_MAX, 0, unpack_texture,
           0},
    [6] = {"materials", &azulejo__scene__material__descriptor, SCENE_MATERIALS_MAX, 60,
           unpack_material, 0},
    [7] = {"instances", &azulejo__scene__instance__descriptor, SCENE_INSTANCES_MAX, 50,
           unpack_instance, 0},
    [8] = {"lights", &azulejo__scene__light__descriptor, SCENE_LIGHTS_MAX, 42, unpack_light, 0},
    [9] = {"cameras", &azulejo__scene__camera__descriptor, SCENE_CAMERAS_MAX, 50, unpack_camera, 0},
    [10] = {"environments", &azulejo__scene__environment__descriptor, 1, 14, unpack_environment, 0},
    [11] = {"nodes", &azulejo__scene__node__descriptor, SCENE_NODES_MAX, 14, unpack_node,
            SCENE_NODE_BYTES_MAX},
    [12] = {"channels", &azulejo__scene__channel__descriptor, SCENE_CHANNELS_MAX, 12,
            unpack_channel, SCENE_CHANNEL_BYTES_MAX},
    [13] = {"skins", &azulejo__scene__skin__descriptor, SCENE_SKINS_MAX, 52, unpack_skin,
            SCENE_SKIN_BYTES_MAX},
    [14] = {"media", &azulejo__scene__medium__descriptor, SCENE_MEDIA_MAX, 28, unpack_medium, 0},
    [15] = {"portals", &azulejo__scene__portal__descriptor, SCENE_PORTALS_MAX, 42, unpack_portal,
            0},
    [17] = {"origins", &azulejo__scene__origin__descriptor, 1, 26, unpack_origin, 0},
    [19] = {"tracks", &azulejo__scene__track__descriptor, SCENE_TRACKS_MAX, 12, unpack_track,
            SCENE_CHANNEL_BYTES_MAX},
};

static size_t element_bytes_max(uint32_t field)
{
    return elements[field].most_bytes ? elements[field].most_bytes : SCENE_ELEMENT_BYTES_MAX;
}

/* First pass: count, without taking memory. */
static status count_elements(struct scene_reader *r, uint32_t counts[FIELD_COUNT])
{
    const uint8_t *data;
    uint64_t version = 0;
    size_t size;

    while (r->at < r->end) {
        uint64_t number = 0;
        uint32_t field;

        TAKE(read_field(r, &field, &data, &size, &number));
        if (field == FIELD_VERSION)
            version = number;
        counts[field]++;
        if (field == FIELD_NAME || is_number(field)) {
            if (counts[field] > 1)
                return unpack_damaged(r, "its version, name, fog or volume rule is there twice");
            continue;
        }
        if (size > element_bytes_max(field))
            return error_set(r->err, STATUS_ERR_LIMIT,
                             "the packed scene's %s[%u] takes %zu bytes: at most %zu are taken", elements[field].name,
                             counts[field] - 1, size, element_bytes_max(field));
        if (size < elements[field].least_bytes)
            return error_set(r->err, STATUS_ERR_INPUT, "the packed scene is damaged: %s[%u] is too short",
                             elements[field].name, counts[field] - 1);
        if (counts[field] > elements[field].maximum)
            return error_set(r->err, STATUS_ERR_LIMIT, "the packed scene has more than %u %s", elements[field].maximum,
                             elements[field].name);
    }
    if (version != SCENE_WIRE_VERSION)
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene has version %llu, this program reads version %d: "
                         "submit the scene again with a client of this release (%s)",
                         (unsigned long long)version, SCENE_WIRE_VERSION, AZULEJO_VERSION);
    return STATUS_OK;
}

static status allocate_tables(struct scene_reader *r, const uint32_t counts[FIELD_COUNT])
{
    struct scene *s = r->scene;

#define ALLOCATE(field, type, table, count)                      \
    s->table = ARENA_ARRAY(&s->arena, type, counts[field]);      \
    if (!s->table)                                               \
        return error_no_memory(r->err, "the scene's tables");    \
    s->count = counts[field];
    ALLOCATE(3, struct scene_mesh, meshes, mesh_count)
    ALLOCATE(4, struct scene_image, images, image_count)
    ALLOCATE(5, struct scene_texture, textures, texture_count)
    ALLOCATE(6, struct scene_material, materials, material_count)
    ALLOCATE(7, struct scene_instance, instances, instance_count)
    ALLOCATE(8, struct scene_light, lights, light_count)
    ALLOCATE(9, struct scene_camera, cameras, camera_count)
    ALLOCATE(11, struct scene_node, nodes, node_count)
    ALLOCATE(12, struct scene_channel, channels, channel_count)
    ALLOCATE(19, struct scene_track, tracks, track_count)
    ALLOCATE(13, struct scene_skin, skins, skin_count)
    ALLOCATE(14, struct scene_medium, media, medium_count)
    ALLOCATE(15, struct scene_portal, environment.portals, environment.portal_count)
#undef ALLOCATE
    return STATUS_OK;
}

static status read_element(struct scene_reader *r, uint32_t field, uint32_t row, const uint8_t *data, size_t size)
{
    const struct element *element = &elements[field];
    ProtobufCMessage *message;
    status result;

    message =
        pieces_are_few(data, size) ? protobuf_c_message_unpack(element->descriptor, &r->allocator, size, data) : NULL;
    if (!message) {
        if (r->no_memory)
            return error_no_memory(r->err, "a part of the packed scene");
        return error_set(r->err, STATUS_ERR_INPUT, "the packed scene is damaged: %s[%u] cannot be decoded",
                         element->name, row);
    }
    if (message->n_unknown_fields)
        result = error_set(r->err, STATUS_ERR_INPUT,
                           "the packed scene is damaged, or was made by a newer version than %s: "
                           "%s[%u] has an unknown field",
                           AZULEJO_VERSION, element->name, row);
    else
        result = element->unpack(r, message, row);
    protobuf_c_message_free_unpacked(message, &r->allocator);
    return result;
}

static status read_name(struct scene_reader *r, const uint8_t *data, size_t size)
{
    char *name;

    if (size > SCENE_NAME_MAX)
        return unpack_damaged(r, "its name is too long");
    if (memchr(data, 0, size))
        return unpack_damaged(r, "its name holds a NUL byte");
    name = arena_alloc(&r->scene->arena, size + 1, 1);
    NEED(name, r->err, "the scene's name");
    memcpy(name, data, size);
    r->scene->name = name;
    return STATUS_OK;
}

static status read_elements(struct scene_reader *r)
{
    uint32_t rows[FIELD_COUNT] = {0};

    while (r->at < r->end) {
        const uint8_t *data = NULL;
        uint64_t number = 0;
        uint32_t field;
        size_t size = 0;

        TAKE(read_field(r, &field, &data, &size, &number));
        if (field == FIELD_NAME)
            TAKE(read_name(r, data, size));
        else if (field == FIELD_FOG)
            TAKE(unpack_index(r, "the fog's medium", number > SCENE_MEDIA_MAX ? UINT32_MAX : (uint32_t)number,
                              SCENE_MEDIA_MAX, &r->scene->fog));
        else if (field == FIELD_VOLUME_RULE && number >= VOLUME_RULE_COUNT)
            return unpack_damaged(r, "its rule for volumes is unknown");
        else if (field == FIELD_VOLUME_RULE)
            r->scene->volume_rule = (enum scene_volume_rule)number;
        else if (field != FIELD_VERSION)
            TAKE(read_element(r, field, rows[field]++, data, size));
    }
    return STATUS_OK;
}

status scene_unpack(struct scene *scene, const void *data, size_t size_bytes, struct error *err)
{
    struct scene_reader r = {.at = data, .scene = scene, .err = err};
    uint32_t counts[FIELD_COUNT] = {0};
    status result;

    scene_init(scene);
    r.allocator = (ProtobufCAllocator){reader_alloc, reader_free, &r};
    if (size_bytes == 0)
        return unpack_damaged(&r, "it is empty");
    if (size_bytes > SCENE_WIRE_BYTES_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the packed scene takes %zu bytes: at most %d are taken", size_bytes,
                         SCENE_WIRE_BYTES_MAX);
    r.end = r.at + size_bytes;
    result = count_elements(&r, counts);
    THEN(result, allocate_tables(&r, counts));
    r.at = data;
    THEN(result, read_elements(&r));
    THEN(result, scene_validate(scene, err));
    if (result != STATUS_OK)
        scene_release(scene);
    return result;
}
