/* The scene to bytes: every element becomes one protobuf message, packed at once, so that
 * packing needs no second copy of the scene as a tree of messages. protobuf-c writes fields
 * in the order of their numbers: the same scene gives the same bytes. */
#include <string.h>

#include "common/base/buffer.h"
#include "common/scene/scene.h"
#include "common/scene/scene.pb-c.h"

static void append_varint(struct buffer *out, uint64_t value)
{
    uint8_t bytes[10];
    size_t size = 0;

    do {
        bytes[size++] = (uint8_t)(value & 0x7f) | (value > 0x7f ? 0x80 : 0);
        value >>= 7;
    } while (value);
    buffer_append(out, bytes, size);
}

static void append_message(struct buffer *out, uint32_t field, const ProtobufCMessage *message)
{
    size_t size = protobuf_c_message_get_packed_size(message);
    uint8_t *space;

    append_varint(out, field << 3 | 2);
    append_varint(out, size);
    space = buffer_append_space(out, size);
    if (space)
        protobuf_c_message_pack(message, space);
}

/* protobuf-c's structs are not const-correct; packing does not write through them. */
#define TEXT(name) ((char *)(uintptr_t)(name))
#define FLOATS(message, field, array, count)                        \
    do {                                                            \
        (message)->n_##field = (count);                             \
        (message)->field = (float *)(uintptr_t)(array);             \
    } while (0)

static void blob_fill(Azulejo__Scene__Blob *out, const struct scene_blob *blob)
{
    azulejo__scene__blob__init(out);
    out->digest.data = (uint8_t *)(uintptr_t)blob->digest.bytes;
    out->digest.len = DIGEST_BYTES;
    out->size_bytes = blob->size_bytes;
}

static void pack_mesh(struct buffer *out, const struct scene_mesh *mesh)
{
    Azulejo__Scene__Mesh m = AZULEJO__SCENE__MESH__INIT;
    Azulejo__Scene__Blob blob;
    float bounds[6];

    memcpy(bounds, mesh->bounds_min, sizeof mesh->bounds_min);
    memcpy(bounds + 3, mesh->bounds_max, sizeof mesh->bounds_max);
    blob_fill(&blob, &mesh->blob);
    m.name = TEXT(mesh->name);
    m.blob = &blob;
    m.vertex_count = mesh->vertex_count;
    m.triangle_count = mesh->triangle_count;
    m.arrays = mesh->arrays;
    FLOATS(&m, bounds, bounds, 6);
    m.closed = mesh->closed;
    append_message(out, 3, &m.base);
}

static void pack_image(struct buffer *out, const struct scene_image *image)
{
    Azulejo__Scene__Image m = AZULEJO__SCENE__IMAGE__INIT;
    Azulejo__Scene__Blob blob;

    blob_fill(&blob, &image->blob);
    m.name = TEXT(image->name);
    m.blob = &blob;
    append_message(out, 4, &m.base);
}

static void pack_texture(struct buffer *out, const struct scene_texture *texture)
{
    Azulejo__Scene__Texture m = AZULEJO__SCENE__TEXTURE__INIT;

    m.image = texture->image;
    m.wrap_u = (uint32_t)texture->wrap_u;
    m.wrap_v = (uint32_t)texture->wrap_v;
    m.nearest = texture->nearest;
    append_message(out, 5, &m.base);
}

/* NULL for a slot without texture, so that what it would say is not in the bytes. */
static Azulejo__Scene__TextureSlot *slot_fill(Azulejo__Scene__TextureSlot *out,
                                              const struct scene_texture_slot *slot)
{
    if (slot->texture < 0)
        return NULL;
    azulejo__scene__texture_slot__init(out);
    out->texture = (uint32_t)slot->texture;
    out->uv_set = slot->uv_set;
    FLOATS(out, uv_transform, slot->uv_transform, 6);
    return out;
}

static void pack_material(struct buffer *out, const struct scene_material *material)
{
    Azulejo__Scene__Material m = AZULEJO__SCENE__MATERIAL__INIT;
    Azulejo__Scene__TextureSlot slots[7];

    m.name = TEXT(material->name);
    m.unlit = material->unlit;
    m.double_sided = material->double_sided;
    m.alpha_mode = (uint32_t)material->alpha_mode;
    m.alpha_cutoff = material->alpha_cutoff;
    FLOATS(&m, base_color, material->base_color, 4);
    m.base_color_texture = slot_fill(&slots[0], &material->base_color_texture);
    m.metallic = material->metallic;
    m.roughness = material->roughness;
    m.metallic_roughness_texture = slot_fill(&slots[1], &material->metallic_roughness_texture);
    m.normal_scale = material->normal_scale;
    m.normal_texture = slot_fill(&slots[2], &material->normal_texture);
    FLOATS(&m, emission, material->emission, 3);
    m.emission_texture = slot_fill(&slots[3], &material->emission_texture);
    m.ior = material->ior;
    m.specular = material->specular;
    m.specular_texture = slot_fill(&slots[4], &material->specular_texture);
    FLOATS(&m, specular_color, material->specular_color, 3);
    m.specular_color_texture = slot_fill(&slots[5], &material->specular_color_texture);
    m.transmission = material->transmission;
    m.transmission_texture = slot_fill(&slots[6], &material->transmission_texture);
    m.refractive = material->refractive;
    FLOATS(&m, attenuation_color, material->attenuation_color, 3);
    m.attenuation_distance = material->attenuation_distance;
    append_message(out, 6, &m.base);
}

static void pack_instance(struct buffer *out, const struct scene_instance *instance)
{
    Azulejo__Scene__Instance m = AZULEJO__SCENE__INSTANCE__INIT;

    m.name = TEXT(instance->name);
    m.mesh = instance->mesh;
    m.material = instance->material;
    FLOATS(&m, to_world, instance->to_world.m, 12);
    append_message(out, 7, &m.base);
}

static void pack_light(struct buffer *out, const struct scene_light *light)
{
    Azulejo__Scene__Light m = AZULEJO__SCENE__LIGHT__INIT;

    m.name = TEXT(light->name);
    m.kind = (uint32_t)light->kind;
    FLOATS(&m, position, light->position, 3);
    FLOATS(&m, direction, light->direction, 3);
    FLOATS(&m, intensity, light->intensity, 3);
    m.range = light->range;
    m.inner_cone_rad = light->inner_cone_rad;
    m.outer_cone_rad = light->outer_cone_rad;
    append_message(out, 8, &m.base);
}

static void pack_camera(struct buffer *out, const struct scene_camera *camera)
{
    Azulejo__Scene__Camera m = AZULEJO__SCENE__CAMERA__INIT;

    m.name = TEXT(camera->name);
    m.kind = (uint32_t)camera->kind;
    FLOATS(&m, to_world, camera->to_world.m, 12);
    m.yfov_rad = camera->yfov_rad;
    m.xmag = camera->xmag;
    m.ymag = camera->ymag;
    m.aspect = camera->aspect;
    append_message(out, 9, &m.base);
}

static void pack_environment(struct buffer *out, const struct scene_environment *env)
{
    Azulejo__Scene__Environment m = AZULEJO__SCENE__ENVIRONMENT__INIT;
    Azulejo__Scene__Image image = AZULEJO__SCENE__IMAGE__INIT;
    Azulejo__Scene__Blob blob;

    if (env->constant) {
        FLOATS(&m, radiance, env->radiance, 3);
    } else {
        blob_fill(&blob, &env->image.blob);
        image.name = TEXT(env->image.name);
        image.blob = &blob;
        m.image = &image;
    }
    append_message(out, 10, &m.base);
}

status scene_pack(const struct scene *scene, struct buffer *out, struct error *err)
{
    size_t start = out->size;
    status result = scene_validate(scene, err);

    if (result != STATUS_OK)
        return result;
    append_varint(out, 1 << 3 | 0);
    append_varint(out, SCENE_WIRE_VERSION);
    append_varint(out, 2 << 3 | 2);
    append_varint(out, strlen(scene->name));
    buffer_append(out, scene->name, strlen(scene->name));
#define PACK_TABLE(pack, table, count)              \
    for (uint32_t i = 0; i < scene->count; i++)     \
        pack(out, &scene->table[i]);
    PACK_TABLE(pack_mesh, meshes, mesh_count)
    PACK_TABLE(pack_image, images, image_count)
    PACK_TABLE(pack_texture, textures, texture_count)
    PACK_TABLE(pack_material, materials, material_count)
    PACK_TABLE(pack_instance, instances, instance_count)
    PACK_TABLE(pack_light, lights, light_count)
    PACK_TABLE(pack_camera, cameras, camera_count)
#undef PACK_TABLE
    if (scene->environment.present)
        pack_environment(out, &scene->environment);
    if (!buffer_ok(out))
        return error_no_memory(err, "the packed scene");
    if (out->size - start > SCENE_WIRE_BYTES_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "the packed scene takes %zu bytes: at most %d are taken",
                         out->size - start, SCENE_WIRE_BYTES_MAX);
    return STATUS_OK;
}
