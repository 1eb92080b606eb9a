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

/* Indices of which -1 is none are written plus one, so that none takes no bytes. */
static uint32_t index_plus_one(int32_t index)
{
    return (uint32_t)(index + 1);
}

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

/* The groups of a material: NULL where every field has its default. */
struct material_groups {
    Azulejo__Scene__Anisotropy anisotropy;
    Azulejo__Scene__Clearcoat clearcoat;
    Azulejo__Scene__Sheen sheen;
    Azulejo__Scene__Iridescence iridescence;
    Azulejo__Scene__DiffuseTransmission diffuse_transmission;
    Azulejo__Scene__Conductor conductor;
    Azulejo__Scene__Mix mix;
    Azulejo__Scene__TextureSlot slots[20];
    int slot_count;
};

static Azulejo__Scene__TextureSlot *slot_next(struct material_groups *g,
                                              const struct scene_texture_slot *slot)
{
    return slot_fill(&g->slots[g->slot_count++], slot);
}

static Azulejo__Scene__Anisotropy *anisotropy_fill(struct material_groups *g,
                                                   const struct scene_material *m)
{
    Azulejo__Scene__Anisotropy *out = &g->anisotropy;

    azulejo__scene__anisotropy__init(out);
    out->strength = m->anisotropy;
    out->rotation_rad = m->anisotropy_rotation_rad;
    out->texture = slot_next(g, &m->anisotropy_texture);
    return m->anisotropy != 0 || m->anisotropy_rotation_rad != 0 || out->texture ? out : NULL;
}

static Azulejo__Scene__Clearcoat *clearcoat_fill(struct material_groups *g,
                                                 const struct scene_material *m,
                                                 const struct scene_material *plain)
{
    Azulejo__Scene__Clearcoat *out = &g->clearcoat;

    azulejo__scene__clearcoat__init(out);
    out->weight = m->clearcoat;
    out->texture = slot_next(g, &m->clearcoat_texture);
    out->roughness = m->clearcoat_roughness;
    out->roughness_texture = slot_next(g, &m->clearcoat_roughness_texture);
    out->ior = m->clearcoat_ior;
    out->normal_scale = m->clearcoat_normal_scale;
    out->normal_texture = slot_next(g, &m->clearcoat_normal_texture);
    return m->clearcoat != 0 || m->clearcoat_roughness != 0 ||
                   m->clearcoat_ior != plain->clearcoat_ior ||
                   m->clearcoat_normal_scale != plain->clearcoat_normal_scale || out->texture ||
                   out->roughness_texture || out->normal_texture
               ? out
               : NULL;
}

static Azulejo__Scene__Sheen *sheen_fill(struct material_groups *g, const struct scene_material *m)
{
    Azulejo__Scene__Sheen *out = &g->sheen;

    azulejo__scene__sheen__init(out);
    FLOATS(out, color, m->sheen_color, 3);
    out->color_texture = slot_next(g, &m->sheen_color_texture);
    out->roughness = m->sheen_roughness;
    out->roughness_texture = slot_next(g, &m->sheen_roughness_texture);
    return !all_equal(m->sheen_color, 0, 3) || m->sheen_roughness != 0 || out->color_texture ||
                   out->roughness_texture
               ? out
               : NULL;
}

static Azulejo__Scene__Iridescence *iridescence_fill(struct material_groups *g,
                                                     const struct scene_material *m,
                                                     const struct scene_material *plain)
{
    Azulejo__Scene__Iridescence *out = &g->iridescence;

    azulejo__scene__iridescence__init(out);
    out->weight = m->iridescence;
    out->texture = slot_next(g, &m->iridescence_texture);
    out->ior = m->iridescence_ior;
    out->thickness_min_nm = m->iridescence_thickness_min_nm;
    out->thickness_max_nm = m->iridescence_thickness_max_nm;
    out->thickness_texture = slot_next(g, &m->iridescence_thickness_texture);
    return m->iridescence != 0 || m->iridescence_ior != plain->iridescence_ior ||
                   m->iridescence_thickness_min_nm != plain->iridescence_thickness_min_nm ||
                   m->iridescence_thickness_max_nm != plain->iridescence_thickness_max_nm ||
                   out->texture || out->thickness_texture
               ? out
               : NULL;
}

static Azulejo__Scene__DiffuseTransmission *diffuse_fill(struct material_groups *g,
                                                         const struct scene_material *m)
{
    Azulejo__Scene__DiffuseTransmission *out = &g->diffuse_transmission;

    azulejo__scene__diffuse_transmission__init(out);
    out->weight = m->diffuse_transmission;
    out->texture = slot_next(g, &m->diffuse_transmission_texture);
    FLOATS(out, color, m->diffuse_transmission_color, 3);
    out->color_texture = slot_next(g, &m->diffuse_transmission_color_texture);
    return m->diffuse_transmission != 0 || !all_equal(m->diffuse_transmission_color, 1, 3) ||
                   out->texture || out->color_texture
               ? out
               : NULL;
}

static Azulejo__Scene__Conductor *conductor_fill(struct material_groups *g,
                                                 const struct scene_material *m)
{
    Azulejo__Scene__Conductor *out = &g->conductor;

    azulejo__scene__conductor__init(out);
    FLOATS(out, eta, m->conductor_eta, 3);
    FLOATS(out, k, m->conductor_k, 3);
    return !all_equal(m->conductor_eta, 1, 3) || !all_equal(m->conductor_k, 0, 3) ? out : NULL;
}

static Azulejo__Scene__Mix *mix_fill(struct material_groups *g, const struct scene_material *m)
{
    Azulejo__Scene__Mix *out = &g->mix;

    azulejo__scene__mix__init(out);
    out->first = m->mix_material[0];
    out->second = m->mix_material[1];
    out->amount = m->mix_amount;
    out->texture = slot_next(g, &m->mix_texture);
    return m->mix_material[0] || m->mix_material[1] || m->mix_amount != 0 || out->texture ? out
                                                                                          : NULL;
}

static void pack_material(struct buffer *out, const struct scene_material *material)
{
    Azulejo__Scene__Material m = AZULEJO__SCENE__MATERIAL__INIT;
    struct material_groups g = {.slot_count = 0};
    struct scene_material plain;

    scene_material_default(&plain);
    m.name = TEXT(material->name);
    m.unlit = material->unlit;
    m.double_sided = material->double_sided;
    m.alpha_mode = (uint32_t)material->alpha_mode;
    m.alpha_cutoff = material->alpha_cutoff;
    FLOATS(&m, base_color, material->base_color, 4);
    m.base_color_texture = slot_next(&g, &material->base_color_texture);
    m.metallic = material->metallic;
    m.roughness = material->roughness;
    m.metallic_roughness_texture = slot_next(&g, &material->metallic_roughness_texture);
    m.normal_scale = material->normal_scale;
    m.normal_texture = slot_next(&g, &material->normal_texture);
    FLOATS(&m, emission, material->emission, 3);
    m.emission_texture = slot_next(&g, &material->emission_texture);
    m.ior = material->ior;
    m.specular = material->specular;
    m.specular_texture = slot_next(&g, &material->specular_texture);
    FLOATS(&m, specular_color, material->specular_color, 3);
    m.specular_color_texture = slot_next(&g, &material->specular_color_texture);
    m.transmission = material->transmission;
    m.transmission_texture = slot_next(&g, &material->transmission_texture);
    m.refractive = material->refractive;
    FLOATS(&m, attenuation_color, material->attenuation_color, 3);
    m.attenuation_distance = material->attenuation_distance;
    m.kind = (uint32_t)material->kind;
    m.anisotropy = anisotropy_fill(&g, material);
    m.clearcoat = clearcoat_fill(&g, material, &plain);
    m.sheen = sheen_fill(&g, material);
    m.iridescence = iridescence_fill(&g, material, &plain);
    m.diffuse_transmission = diffuse_fill(&g, material);
    m.dispersion = material->dispersion;
    m.conductor = conductor_fill(&g, material);
    m.base_interreflection = material->base_interreflection;
    m.thin_slab = material->thin_slab;
    m.priority = material->priority;
    m.medium = index_plus_one(material->medium);
    m.medium_outside = index_plus_one(material->medium_outside);
    m.mix = mix_fill(&g, material);
    append_message(out, 6, &m.base);
}

static void pack_instance(struct buffer *out, const struct scene_instance *instance)
{
    Azulejo__Scene__Instance m = AZULEJO__SCENE__INSTANCE__INIT;

    m.name = TEXT(instance->name);
    m.mesh = instance->mesh;
    m.material = instance->material;
    m.node = index_plus_one(instance->node);
    m.skin = index_plus_one(instance->skin);
    DOUBLES(&m, to_world, instance->to_world.m, 12);
    m.body = index_plus_one(instance->body);
    m.sealed = instance->sealed;
    append_message(out, 7, &m.base);
}

static Azulejo__Scene__Projector *projector_fill(Azulejo__Scene__Projector *out,
                                                 const struct scene_light *light)
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
    if (scene->environment.present)
        pack_environment(out, &scene->environment);
    PACK_TABLE(pack_node, nodes, node_count)
    PACK_TABLE(pack_channel, channels, channel_count)
    PACK_TABLE(pack_skin, skins, skin_count)
    PACK_TABLE(pack_medium, media, medium_count)
    PACK_TABLE(pack_portal, environment.portals, environment.portal_count)
#undef PACK_TABLE
    if (scene->fog >= 0) {
        append_varint(out, 16 << 3 | 0);
        append_varint(out, index_plus_one(scene->fog));
    }
    pack_origin(out, scene->origin);
    if (scene->volume_rule != VOLUMES_NESTED) {
        append_varint(out, 18 << 3 | 0);
        append_varint(out, scene->volume_rule);
    }
    if (!buffer_ok(out))
        return error_no_memory(err, "the packed scene");
    if (out->size - start > SCENE_WIRE_BYTES_MAX)
        return error_set(err, STATUS_ERR_LIMIT,
                         "the packed scene takes %zu bytes: at most %d are taken",
                         out->size - start, SCENE_WIRE_BYTES_MAX);
    return STATUS_OK;
}
