/* Scene to bytes. Every element becomes one protobuf message, packed at once, so that packing needs
 * no second copy of the scene as a tree of messages. protobuf-c writes fields in the order of their
 * numbers, so the same scene gives the same bytes. */
#include <string.h>

#include "common/base/buffer.h"
#include "common/scene/pack/material_wire.h"
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

#define DOUBLES(message, field, array, count)                       \
    do {                                                            \
        (message)->n_##field = (count);                             \
        (message)->field = (double *)(uintptr_t)(array);            \
    } while (0)

static void blob_fill(Azulejo__Scene__Blob *out, const struct scene_blob *blob)
{
    azulejo__scene__blob__init(out);
    out->digest.data = (uint8_t *)(uintptr_t)blob->digest.bytes;
    out->digest.len = DIGEST_BYTES;
    out->size_bytes = blob->size_bytes;
}

/* Indices that may be -1 are written plus one, so that -1 takes no bytes. */
static uint32_t index_plus_one(int32_t index) { return (uint32_t)(index + 1); }

/* By value, not by bits: -0 is 0, as on the wire. */
static int floats_equal(const float *a, const float *b, int count)
{
    for (int i = 0; i < count; i++)
        if (a[i] != b[i])
            return 0;
    return 1;
}

static int doubles_equal(const double *a, const double *b, int count)
{
    for (int i = 0; i < count; i++)
        if (a[i] != b[i])
            return 0;
    return 1;
}

static int all_equal(const float *a, float value, int count)
{
    for (int i = 0; i < count; i++)
        if (a[i] != value)
            return 0;
    return 1;
}

static int is_identity(const struct transform_d *t)
{
    const struct transform_d identity = transform_d_identity();

    return doubles_equal(&t->m[0][0], &identity.m[0][0], 12);
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
    m.morph_count = mesh->morph_count;
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
    m.encoding = (uint32_t)texture->encoding;
    append_message(out, 5, &m.base);
}

static void pack_material(struct buffer *out, const struct scene_material *material)
{
    struct material_wire wire;

    material_wire_fill(&wire, material);
    append_message(out, 6, &wire.material.base);
}

static void pack_instance(struct buffer *out, const struct scene_instance *instance)
{
    Azulejo__Scene__Instance m = AZULEJO__SCENE__INSTANCE__INIT;

    m.name = TEXT(instance->name);
    m.asset = TEXT(instance->asset);
    m.mesh = instance->mesh;
    m.material = instance->material;
    m.node = index_plus_one(instance->node);
    m.skin = index_plus_one(instance->skin);
    DOUBLES(&m, to_world, instance->to_world.m, 12);
    m.body = index_plus_one(instance->body);
    m.sealed = instance->sealed;
    append_message(out, 7, &m.base);
}

static Azulejo__Scene__Projector *projector_fill(Azulejo__Scene__Projector *out, const struct scene_light *light)
{
    struct scene_light plain;

    scene_light_default(&plain);
    azulejo__scene__projector__init(out);
    out->yfov_rad = light->projection_yfov_rad;
    out->aspect = light->projection_aspect;
    DOUBLES(out, to_world, light->to_world.m, 12);
    return !is_identity(&light->to_world) || out->yfov_rad != plain.projection_yfov_rad ||
                   out->aspect != plain.projection_aspect
               ? out
               : NULL;
}

static void pack_light(struct buffer *out, const struct scene_light *light)
{
    Azulejo__Scene__Light m = AZULEJO__SCENE__LIGHT__INIT;
    Azulejo__Scene__Projector projector;

    m.name = TEXT(light->name);
    m.kind = (uint32_t)light->kind;
    FLOATS(&m, direction, light->direction, 3);
    FLOATS(&m, intensity, light->intensity, 3);
    m.range = light->range;
    m.inner_cone_rad = light->inner_cone_rad;
    m.outer_cone_rad = light->outer_cone_rad;
    m.falloff = (uint32_t)light->falloff;
    m.image = index_plus_one(light->image);
    m.projector = projector_fill(&projector, light);
    m.node = index_plus_one(light->node);
    DOUBLES(&m, position, light->position, 3);
    append_message(out, 8, &m.base);
}

static void pack_camera(struct buffer *out, const struct scene_camera *camera)
{
    Azulejo__Scene__Camera m = AZULEJO__SCENE__CAMERA__INIT;

    m.name = TEXT(camera->name);
    m.kind = (uint32_t)camera->kind;
    m.yfov_rad = camera->yfov_rad;
    m.xmag = camera->xmag;
    m.ymag = camera->ymag;
    m.aspect = camera->aspect;
    m.lens_radius = camera->lens_radius;
    m.focus_distance = camera->focus_distance;
    m.blades = camera->blades;
    m.blade_rotation_rad = camera->blade_rotation_rad;
    m.shutter_open_s = camera->shutter_open_s;
    m.shutter_close_s = camera->shutter_close_s;
    m.exposure_ev = camera->exposure_ev;
    m.node = index_plus_one(camera->node);
    DOUBLES(&m, to_world, camera->to_world.m, 12);
    append_message(out, 9, &m.base);
}

static void pack_environment(struct buffer *out, const struct scene_environment *env)
{
    static const float unturned[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    Azulejo__Scene__Environment m = AZULEJO__SCENE__ENVIRONMENT__INIT;
    Azulejo__Scene__Image image = AZULEJO__SCENE__IMAGE__INIT;
    Azulejo__Scene__Blob blob;

    if (env->constant || !all_equal(env->radiance, 1, 3))
        FLOATS(&m, radiance, env->radiance, 3);
    if (!env->constant) {
        blob_fill(&blob, &env->image.blob);
        image.name = TEXT(env->image.name);
        image.blob = &blob;
        m.image = &image;
        m.brightest = env->brightest;
    }
    if (!floats_equal(&env->to_map[0][0], unturned, 9))
        FLOATS(&m, to_map, env->to_map, 9);
    append_message(out, 10, &m.base);
}

static void pack_node(struct buffer *out, const struct scene_node *node)
{
    static const double upright[4] = {0, 0, 0, 1}, unscaled[3] = {1, 1, 1};
    Azulejo__Scene__Node m = AZULEJO__SCENE__NODE__INIT;

    m.parent = index_plus_one(node->parent);
    if (node->has_matrix) {
        DOUBLES(&m, matrix, node->matrix.m, 12);
    } else {
        DOUBLES(&m, translation, node->translation, 3);
        if (!doubles_equal(node->rotation, upright, 4))
            DOUBLES(&m, rotation, node->rotation, 4);
        if (!doubles_equal(node->scale, unscaled, 3))
            DOUBLES(&m, scale, node->scale, 3);
    }
    FLOATS(&m, weights, node->weights, node->weight_count);
    append_message(out, 11, &m.base);
}

static void pack_channel(struct buffer *out, const struct scene_channel *channel)
{
    Azulejo__Scene__Channel m = AZULEJO__SCENE__CHANNEL__INIT;

    m.node = channel->node;
    m.path = (uint32_t)channel->path;
    m.interpolation = (uint32_t)channel->interpolation;
    m.components = channel->components;
    FLOATS(&m, times, channel->times, channel->key_count);
    FLOATS(&m, values, channel->values, scene_channel_floats(channel));
    append_message(out, 12, &m.base);
}

static void pack_track(struct buffer *out, const struct scene_track *track)
{
    Azulejo__Scene__Track m = AZULEJO__SCENE__TRACK__INIT;

    m.target = (uint32_t)track->target;
    m.row = track->row;
    m.field = track->field;
    m.factor = track->factor;
    m.interpolation = (uint32_t)track->keys.interpolation;
    m.components = track->keys.components;
    FLOATS(&m, times, track->keys.times, track->keys.key_count);
    FLOATS(&m, values, track->keys.values, scene_channel_floats(&track->keys));
    append_message(out, 19, &m.base);
}

static void pack_skin(struct buffer *out, const struct scene_skin *skin)
{
    Azulejo__Scene__Skin m = AZULEJO__SCENE__SKIN__INIT;

    m.n_joints = skin->joint_count;
    m.joints = skin->joints;
    FLOATS(&m, inverse_bind, skin->inverse_bind, (size_t)skin->joint_count * 12);
    append_message(out, 13, &m.base);
}

static void pack_medium(struct buffer *out, const struct scene_medium *medium)
{
    Azulejo__Scene__Medium m = AZULEJO__SCENE__MEDIUM__INIT;
    Azulejo__Scene__Grid grid = AZULEJO__SCENE__GRID__INIT;
    Azulejo__Scene__Blob blob;

    m.name = TEXT(medium->name);
    FLOATS(&m, absorption, medium->absorption, 3);
    FLOATS(&m, scattering, medium->scattering, 3);
    if (!all_equal(medium->emission, 0, 3))
        FLOATS(&m, emission, medium->emission, 3);
    m.g = medium->g;
    if (medium->has_grid) {
        blob_fill(&blob, &medium->grid);
        grid.blob = &blob;
        grid.n_size = 3;
        grid.size = (uint32_t *)(uintptr_t)medium->grid_size;
        DOUBLES(&grid, to_world, medium->grid_to_world.m, 12);
        m.grid = &grid;
    }
    append_message(out, 14, &m.base);
}

static void pack_portal(struct buffer *out, const struct scene_portal *portal)
{
    Azulejo__Scene__Portal m = AZULEJO__SCENE__PORTAL__INIT;

    FLOATS(&m, edge1, portal->edge1, 3);
    FLOATS(&m, edge2, portal->edge2, 3);
    DOUBLES(&m, corner, portal->corner, 3);
    append_message(out, 15, &m.base);
}

static void pack_origin(struct buffer *out, const double origin[3])
{
    static const double nowhere[3] = {0, 0, 0};
    Azulejo__Scene__Origin m = AZULEJO__SCENE__ORIGIN__INIT;

    if (doubles_equal(origin, nowhere, 3))
        return;
    DOUBLES(&m, at, origin, 3);
    append_message(out, 17, &m.base);
}

status scene_pack(const struct scene *scene, struct buffer *out, struct error *err)
{
    size_t start = out->size;

    TRY(scene_validate(scene, err));
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
    if (scene->environment.present)
        pack_environment(out, &scene->environment);
    PACK_TABLE(pack_node, nodes, node_count)
    PACK_TABLE(pack_channel, channels, channel_count)
    PACK_TABLE(pack_skin, skins, skin_count)
    PACK_TABLE(pack_medium, media, medium_count)
    PACK_TABLE(pack_portal, environment.portals, environment.portal_count)
    if (scene->fog >= 0) {
        append_varint(out, 16 << 3 | 0);
        append_varint(out, index_plus_one(scene->fog));
    }
    pack_origin(out, scene->origin);
    if (scene->volume_rule != VOLUMES_NESTED) {
        append_varint(out, 18 << 3 | 0);
        append_varint(out, scene->volume_rule);
    }
    PACK_TABLE(pack_track, tracks, track_count)
#undef PACK_TABLE
    NEED(buffer_ok(out), err, "the packed scene");
    if (out->size - start > SCENE_WIRE_BYTES_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the packed scene takes %zu bytes: at most %d are taken",
                         out->size - start, SCENE_WIRE_BYTES_MAX);
    return STATUS_OK;
}
