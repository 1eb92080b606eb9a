/* Bytes to a scene. The top-level fields are walked here, one element after the other, and
 * each element alone goes through protobuf-c: a hostile count cannot make us take more
 * memory than the bytes that are really there are worth. */
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/scene.h"
#include "common/scene/scene.pb-c.h"

struct reader {
    const uint8_t *at, *end;
    struct scene *scene;
    struct error *err;
    int no_memory; /* set by the allocator below */
    ProtobufCAllocator allocator;
};

static void *reader_alloc(void *user, size_t size)
{
    struct reader *r = user;
    void *block = mem_alloc(size);

    if (!block)
        r->no_memory = 1;
    return block;
}

static void reader_free(void *user, void *block)
{
    (void)user;
    mem_free(block);
}

static status damaged(struct reader *r, const char *what)
{
    return error_set(r->err, STATUS_ERR_INPUT, "the packed scene is damaged: %s", what);
}

static int read_varint(struct reader *r, uint64_t *value)
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

/* The next top-level field; its payload lies at *data. Version is the only varint. */
static status read_field(struct reader *r, uint32_t *field, const uint8_t **data, size_t *size,
                         uint64_t *number)
{
    uint64_t key, length;

    if (!read_varint(r, &key))
        return damaged(r, "it ends within a field's number");
    if (key >> 3 < 1 || key >> 3 > 10 || (key & 7) != (key >> 3 == 1 ? 0 : 2))
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene has a field that this version (%s) does not know: it "
                         "is damaged or was made by a newer version",
                         AZULEJO_VERSION);
    *field = (uint32_t)(key >> 3);
    if (*field == 1)
        return read_varint(r, number) ? STATUS_OK : damaged(r, "it ends within its version");
    if (!read_varint(r, &length) || length > (size_t)(r->end - r->at))
        return damaged(r, "it ends within an element");
    if (length > SCENE_ELEMENT_BYTES_MAX)
        return damaged(r, "an element is too large");
    *data = r->at;
    *size = (size_t)length;
    r->at += length;
    return STATUS_OK;
}

/* A copy of a string in the scene's arena; protobuf-c has already cut it at a NUL byte. */
static status take_name(struct reader *r, const char *text, const char **out)
{
    *out = arena_strdup(&r->scene->arena, text ? text : "");
    return *out ? STATUS_OK : error_no_memory(r->err, "the scene's names");
}

static status take_floats(struct reader *r, const char *what, const float *from, size_t got,
                          float *to, size_t wanted)
{
    if (got != wanted)
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene is damaged: %s has %zu numbers instead of %zu", what,
                         got, wanted);
    memcpy(to, from, wanted * sizeof *to);
    return STATUS_OK;
}

static status take_blob(struct reader *r, const Azulejo__Scene__Blob *from, struct scene_blob *to)
{
    if (!from || from->digest.len != DIGEST_BYTES)
        return damaged(r, "a blob has no SHA-256 digest");
    if (from->base.n_unknown_fields)
        return damaged(r, "a blob has an unknown field");
    memcpy(to->digest.bytes, from->digest.data, DIGEST_BYTES);
    to->size_bytes = from->size_bytes;
    return STATUS_OK;
}

static status take_image(struct reader *r, const Azulejo__Scene__Image *from,
                         struct scene_image *to)
{
    status result = take_name(r, from->name, &to->name);

    if (result == STATUS_OK && from->base.n_unknown_fields)
        return damaged(r, "an image has an unknown field");
    return result == STATUS_OK ? take_blob(r, from->blob, &to->blob) : result;
}

static status take_slot(struct reader *r, const Azulejo__Scene__TextureSlot *from,
                        struct scene_texture_slot *to)
{
    if (!from)
        return STATUS_OK; /* as scene_material_default left it */
    if (from->base.n_unknown_fields)
        return damaged(r, "a texture slot has an unknown field");
    if (from->texture >= SCENE_TEXTURES_MAX)
        return damaged(r, "a texture's index is out of range");
    to->texture = (int32_t)from->texture;
    to->uv_set = from->uv_set;
    return take_floats(r, "uv_transform", from->uv_transform, from->n_uv_transform,
                       &to->uv_transform[0][0], 6);
}

#define TAKE(call)                     \
    do {                               \
        status result_ = (call);       \
        if (result_ != STATUS_OK)      \
            return result_;            \
    } while (0)
#define TAKE_FLOATS(field, to, wanted) \
    TAKE(take_floats(r, #field, m->field, m->n_##field, to, wanted))

static status take_mesh(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Mesh *m = (const Azulejo__Scene__Mesh *)message;
    struct scene_mesh *to = &r->scene->meshes[row];
    float bounds[6];

    TAKE(take_name(r, m->name, &to->name));
    TAKE(take_blob(r, m->blob, &to->blob));
    to->vertex_count = m->vertex_count;
    to->triangle_count = m->triangle_count;
    to->arrays = m->arrays;
    TAKE_FLOATS(bounds, bounds, 6);
    memcpy(to->bounds_min, bounds, sizeof to->bounds_min);
    memcpy(to->bounds_max, bounds + 3, sizeof to->bounds_max);
    to->closed = m->closed != 0;
    return STATUS_OK;
}

static status take_image_row(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    return take_image(r, (const Azulejo__Scene__Image *)message, &r->scene->images[row]);
}

static status take_texture(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Texture *m = (const Azulejo__Scene__Texture *)message;
    struct scene_texture *to = &r->scene->textures[row];

    to->image = m->image;
    if (m->wrap_u >= WRAP_COUNT || m->wrap_v >= WRAP_COUNT)
        return damaged(r, "a texture's wrap mode is unknown");
    to->wrap_u = (enum scene_wrap)m->wrap_u;
    to->wrap_v = (enum scene_wrap)m->wrap_v;
    to->nearest = m->nearest != 0;
    return STATUS_OK;
}

static status take_material(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Material *m = (const Azulejo__Scene__Material *)message;
    struct scene_material *to = &r->scene->materials[row];

    scene_material_default(to);
    TAKE(take_name(r, m->name, &to->name));
    to->unlit = m->unlit != 0;
    to->double_sided = m->double_sided != 0;
    if (m->alpha_mode >= ALPHA_COUNT)
        return damaged(r, "a material's alpha mode is unknown");
    to->alpha_mode = (enum scene_alpha_mode)m->alpha_mode;
    to->alpha_cutoff = m->alpha_cutoff;
    TAKE_FLOATS(base_color, to->base_color, 4);
    TAKE(take_slot(r, m->base_color_texture, &to->base_color_texture));
    to->metallic = m->metallic;
    to->roughness = m->roughness;
    TAKE(take_slot(r, m->metallic_roughness_texture, &to->metallic_roughness_texture));
    to->normal_scale = m->normal_scale;
    TAKE(take_slot(r, m->normal_texture, &to->normal_texture));
    TAKE_FLOATS(emission, to->emission, 3);
    TAKE(take_slot(r, m->emission_texture, &to->emission_texture));
    to->ior = m->ior;
    to->specular = m->specular;
    TAKE(take_slot(r, m->specular_texture, &to->specular_texture));
    TAKE_FLOATS(specular_color, to->specular_color, 3);
    TAKE(take_slot(r, m->specular_color_texture, &to->specular_color_texture));
    to->transmission = m->transmission;
    TAKE(take_slot(r, m->transmission_texture, &to->transmission_texture));
    to->refractive = m->refractive != 0;
    TAKE_FLOATS(attenuation_color, to->attenuation_color, 3);
    to->attenuation_distance = m->attenuation_distance;
    return STATUS_OK;
}

static status take_instance(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Instance *m = (const Azulejo__Scene__Instance *)message;
    struct scene_instance *to = &r->scene->instances[row];

    scene_instance_default(to);
    TAKE(take_name(r, m->name, &to->name));
    to->mesh = m->mesh;
    to->material = m->material;
    TAKE_FLOATS(to_world, &to->to_world.m[0][0], 12);
    return STATUS_OK;
}

static status take_light(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Light *m = (const Azulejo__Scene__Light *)message;
    struct scene_light *to = &r->scene->lights[row];

    scene_light_default(to);
    TAKE(take_name(r, m->name, &to->name));
    if (m->kind >= LIGHT_KIND_COUNT)
        return damaged(r, "a light's kind is unknown");
    to->kind = (enum scene_light_kind)m->kind;
    TAKE_FLOATS(position, to->position, 3);
    TAKE_FLOATS(direction, to->direction, 3);
    TAKE_FLOATS(intensity, to->intensity, 3);
    to->range = m->range;
    to->inner_cone_rad = m->inner_cone_rad;
    to->outer_cone_rad = m->outer_cone_rad;
    return STATUS_OK;
}

static status take_camera(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Camera *m = (const Azulejo__Scene__Camera *)message;
    struct scene_camera *to = &r->scene->cameras[row];

    scene_camera_default(to);
    TAKE(take_name(r, m->name, &to->name));
    if (m->kind >= CAMERA_KIND_COUNT)
        return damaged(r, "a camera's kind is unknown");
    to->kind = (enum scene_camera_kind)m->kind;
    TAKE_FLOATS(to_world, &to->to_world.m[0][0], 12);
    to->yfov_rad = m->yfov_rad;
    to->xmag = m->xmag;
    to->ymag = m->ymag;
    to->aspect = m->aspect;
    return STATUS_OK;
}

static status take_environment(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Environment *m = (const Azulejo__Scene__Environment *)message;
    struct scene_environment *to = &r->scene->environment;

    (void)row;
    to->present = 1;
    if (m->image) {
        if (m->n_radiance)
            return damaged(r, "the environment has an image and a constant");
        return take_image(r, m->image, &to->image);
    }
    to->constant = 1;
    TAKE_FLOATS(radiance, to->radiance, 3);
    return STATUS_OK;
}

/* What each top-level field holds. `least_bytes` is what a valid element takes at least:
 * it bounds the memory that a count of tiny elements can claim. */
static const struct element {
    const char *name;
    const ProtobufCMessageDescriptor *descriptor;
    uint32_t maximum;
    size_t least_bytes;
    status (*take)(struct reader *r, const ProtobufCMessage *message, uint32_t row);
} elements[11] = {
    [3] = {"meshes", &azulejo__scene__mesh__descriptor, SCENE_MESHES_MAX, 64, take_mesh},
    [4] = {"images", &azulejo__scene__image__descriptor, SCENE_IMAGES_MAX, 38, take_image_row},
    [5] = {"textures", &azulejo__scene__texture__descriptor, SCENE_TEXTURES_MAX, 0, take_texture},
    [6] = {"materials", &azulejo__scene__material__descriptor, SCENE_MATERIALS_MAX, 60,
           take_material},
    [7] = {"instances", &azulejo__scene__instance__descriptor, SCENE_INSTANCES_MAX, 50,
           take_instance},
    [8] = {"lights", &azulejo__scene__light__descriptor, SCENE_LIGHTS_MAX, 42, take_light},
    [9] = {"cameras", &azulejo__scene__camera__descriptor, SCENE_CAMERAS_MAX, 50, take_camera},
    [10] = {"environments", &azulejo__scene__environment__descriptor, 1, 14, take_environment},
};

/* First pass: count, without taking memory. */
static status count_elements(struct reader *r, uint32_t counts[11])
{
    const uint8_t *data;
    uint64_t version = 0;
    size_t size;

    while (r->at < r->end) {
        uint64_t number = 0;
        uint32_t field;

        TAKE(read_field(r, &field, &data, &size, &number));
        if (field == 1)
            version = number;
        counts[field]++;
        if (field < 3) {
            if (counts[field] > 1)
                return damaged(r, "its version or name is there twice");
            continue;
        }
        if (size < elements[field].least_bytes)
            return error_set(r->err, STATUS_ERR_INPUT,
                             "the packed scene is damaged: %s[%u] is too short",
                             elements[field].name, counts[field] - 1);
        if (counts[field] > elements[field].maximum)
            return error_set(r->err, STATUS_ERR_LIMIT,
                             "the packed scene has more than %u %s", elements[field].maximum,
                             elements[field].name);
    }
    if (version != SCENE_WIRE_VERSION)
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene has version %llu, this program reads version %d: "
                         "import the scene again with this version (%s)",
                         (unsigned long long)version, SCENE_WIRE_VERSION, AZULEJO_VERSION);
    return STATUS_OK;
}

static status allocate_tables(struct reader *r, const uint32_t counts[11])
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
#undef ALLOCATE
    return STATUS_OK;
}

static status read_element(struct reader *r, uint32_t field, uint32_t row, const uint8_t *data,
                           size_t size)
{
    const struct element *element = &elements[field];
    ProtobufCMessage *message =
        protobuf_c_message_unpack(element->descriptor, &r->allocator, size, data);
    status result;

    if (!message) {
        if (r->no_memory)
            return error_no_memory(r->err, "a part of the packed scene");
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene is damaged: %s[%u] cannot be decoded", element->name,
                         row);
    }
    if (message->n_unknown_fields)
        result = error_set(r->err, STATUS_ERR_INPUT,
                           "the packed scene is damaged, or was made by a newer version than %s: "
                           "%s[%u] has an unknown field",
                           AZULEJO_VERSION, element->name, row);
    else
        result = element->take(r, message, row);
    protobuf_c_message_free_unpacked(message, &r->allocator);
    return result;
}

static status read_elements(struct reader *r)
{
    uint32_t rows[11] = {0};

    while (r->at < r->end) {
        const uint8_t *data = NULL;
        uint64_t number;
        uint32_t field;
        size_t size = 0;

        TAKE(read_field(r, &field, &data, &size, &number));
        if (field == 2) {
            char *name;
            if (memchr(data, 0, size))
                return damaged(r, "its name holds a NUL byte");
            name = arena_alloc(&r->scene->arena, size + 1, 1);
            if (!name)
                return error_no_memory(r->err, "the scene's name");
            memcpy(name, data, size);
            r->scene->name = name;
        } else if (field >= 3) {
            TAKE(read_element(r, field, rows[field]++, data, size));
        }
    }
    return STATUS_OK;
}

status scene_unpack(struct scene *scene, const void *data, size_t size_bytes, struct error *err)
{
    struct reader r = {.at = data, .scene = scene, .err = err};
    uint32_t counts[11] = {0};
    status result;

    scene_init(scene);
    r.allocator = (ProtobufCAllocator){reader_alloc, reader_free, &r};
    if (size_bytes == 0)
        return damaged(&r, "it is empty");
    if (size_bytes > SCENE_WIRE_BYTES_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "the packed scene takes %zu bytes: at most %d are taken", size_bytes,
                         SCENE_WIRE_BYTES_MAX);
    r.end = r.at + size_bytes;
    result = count_elements(&r, counts);
    if (result == STATUS_OK)
        result = allocate_tables(&r, counts);
    r.at = data;
    if (result == STATUS_OK)
        result = read_elements(&r);
    if (result == STATUS_OK)
        result = scene_validate(scene, err);
    if (result != STATUS_OK)
        scene_release(scene);
    return result;
}
