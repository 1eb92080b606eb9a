/* Bytes to a scene. The top-level fields are walked here, one element after the other, and
 * each element alone goes through protobuf-c: a hostile count cannot make us take more
 * memory than the bytes that are really there are worth. */
#include <string.h>

#include "common/base/memory.h"
#include "common/scene/scene.h"
#include "common/scene/scene.pb-c.h"

enum {
    FIELD_VERSION = 1,
    FIELD_NAME = 2,
    FIELD_FOG = 16,
    FIELD_COUNT = 17,
    /* An element of ours writes each of its fields once: one with more pieces is not one of
     * ours, and protobuf-c would take many times its size to decode it. */
    ELEMENT_PIECES_MAX = 64,
};

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

static int is_number(uint64_t field)
{
    return field == FIELD_VERSION || field == FIELD_FOG;
}

/* The next top-level field; its payload lies at *data, or in *number. */
static status read_field(struct reader *r, uint32_t *field, const uint8_t **data, size_t *size,
                         uint64_t *number)
{
    uint64_t key, length;

    if (!read_varint(r, &key))
        return damaged(r, "it ends within a field's number");
    if (key >> 3 < 1 || key >> 3 >= FIELD_COUNT || (key & 7) != (is_number(key >> 3) ? 0 : 2))
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene has a field that this version (%s) does not know: it "
                         "is damaged or was made by a newer version",
                         AZULEJO_VERSION);
    *field = (uint32_t)(key >> 3);
    if (is_number(*field))
        return read_varint(r, number) ? STATUS_OK : damaged(r, "it ends within a number");
    if (!read_varint(r, &length) || length > (size_t)(r->end - r->at))
        return damaged(r, "it ends within an element");
    *data = r->at;
    *size = (size_t)length;
    r->at += length;
    return STATUS_OK;
}

/* Has the message few enough pieces? What else is wrong with it protobuf-c finds out. */
static int pieces_are_few(const uint8_t *data, size_t size)
{
    struct reader r = {.at = data, .end = data + size};

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

/* From the wire's index + 1; what lies in the table is checked by scene_validate. */
static status take_index(struct reader *r, const char *what, uint32_t from, uint32_t maximum,
                         int32_t *to)
{
    if (from > maximum)
        return error_set(r->err, STATUS_ERR_INPUT,
                         "the packed scene is damaged: %s %u is out of range", what, from - 1);
    *to = (int32_t)from - 1;
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

/* As take_floats, but what is not there stays as its default. */
static status take_floats_if(struct reader *r, const char *what, const float *from, size_t got,
                             float *to, size_t wanted)
{
    return got ? take_floats(r, what, from, got, to, wanted) : STATUS_OK;
}

/* A copy in the scene's arena; `got` may be 0. */
static status take_array(struct reader *r, const void *from, size_t got, size_t size_bytes,
                         void **to)
{
    *to = arena_alloc(&r->scene->arena, got, size_bytes);
    if (!*to)
        return error_no_memory(r->err, "the scene's motion");
    if (got)
        memcpy(*to, from, got * size_bytes);
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
#define TAKE_FLOATS_IF(field, to, wanted) \
    TAKE(take_floats_if(r, #field, m->field, m->n_##field, to, wanted))
#define KNOWN_FIELDS(what)            \
    if (m->base.n_unknown_fields)     \
        return damaged(r, what " has an unknown field");

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
    to->morph_count = m->morph_count;
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
    if (m->encoding >= ENCODING_COUNT)
        return damaged(r, "a texture's encoding is unknown");
    to->encoding = (enum scene_encoding)m->encoding;
    return STATUS_OK;
}

static status take_anisotropy(struct reader *r, const Azulejo__Scene__Anisotropy *m,
                              struct scene_material *to)
{
    if (!m)
        return STATUS_OK; /* here and below: as scene_material_default left it */
    KNOWN_FIELDS("an anisotropy")
    to->anisotropy = m->strength;
    to->anisotropy_rotation_rad = m->rotation_rad;
    return take_slot(r, m->texture, &to->anisotropy_texture);
}

static status take_clearcoat(struct reader *r, const Azulejo__Scene__Clearcoat *m,
                             struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a clearcoat")
    to->clearcoat = m->weight;
    TAKE(take_slot(r, m->texture, &to->clearcoat_texture));
    to->clearcoat_roughness = m->roughness;
    TAKE(take_slot(r, m->roughness_texture, &to->clearcoat_roughness_texture));
    to->clearcoat_ior = m->ior;
    to->clearcoat_normal_scale = m->normal_scale;
    return take_slot(r, m->normal_texture, &to->clearcoat_normal_texture);
}

static status take_sheen(struct reader *r, const Azulejo__Scene__Sheen *m,
                         struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a sheen")
    TAKE_FLOATS(color, to->sheen_color, 3);
    TAKE(take_slot(r, m->color_texture, &to->sheen_color_texture));
    to->sheen_roughness = m->roughness;
    return take_slot(r, m->roughness_texture, &to->sheen_roughness_texture);
}

static status take_iridescence(struct reader *r, const Azulejo__Scene__Iridescence *m,
                               struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("an iridescence")
    to->iridescence = m->weight;
    TAKE(take_slot(r, m->texture, &to->iridescence_texture));
    to->iridescence_ior = m->ior;
    to->iridescence_thickness_min_nm = m->thickness_min_nm;
    to->iridescence_thickness_max_nm = m->thickness_max_nm;
    return take_slot(r, m->thickness_texture, &to->iridescence_thickness_texture);
}

static status take_diffuse(struct reader *r, const Azulejo__Scene__DiffuseTransmission *m,
                           struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a diffuse transmission")
    to->diffuse_transmission = m->weight;
    TAKE(take_slot(r, m->texture, &to->diffuse_transmission_texture));
    TAKE_FLOATS(color, to->diffuse_transmission_color, 3);
    return take_slot(r, m->color_texture, &to->diffuse_transmission_color_texture);
}

static status take_conductor(struct reader *r, const Azulejo__Scene__Conductor *m,
                             struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a conductor")
    TAKE_FLOATS(eta, to->conductor_eta, 3);
    TAKE_FLOATS(k, to->conductor_k, 3);
    return STATUS_OK;
}

static status take_mix(struct reader *r, const Azulejo__Scene__Mix *m, struct scene_material *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a mix")
    to->mix_material[0] = m->first;
    to->mix_material[1] = m->second;
    to->mix_amount = m->amount;
    return take_slot(r, m->texture, &to->mix_texture);
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
    if (m->kind >= MATERIAL_KIND_COUNT)
        return damaged(r, "a material's kind is unknown");
    to->kind = (enum scene_material_kind)m->kind;
    TAKE(take_anisotropy(r, m->anisotropy, to));
    TAKE(take_clearcoat(r, m->clearcoat, to));
    TAKE(take_sheen(r, m->sheen, to));
    TAKE(take_iridescence(r, m->iridescence, to));
    TAKE(take_diffuse(r, m->diffuse_transmission, to));
    to->dispersion = m->dispersion;
    TAKE(take_conductor(r, m->conductor, to));
    to->base_interreflection = m->base_interreflection;
    to->thin_slab = m->thin_slab != 0;
    to->priority = m->priority;
    TAKE(take_index(r, "a material's medium", m->medium, SCENE_MEDIA_MAX, &to->medium));
    return take_mix(r, m->mix, to);
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
    TAKE(take_index(r, "an instance's node", m->node, SCENE_NODES_MAX, &to->node));
    return take_index(r, "an instance's skin", m->skin, SCENE_SKINS_MAX, &to->skin);
}

static status take_projector(struct reader *r, const Azulejo__Scene__Projector *m,
                             struct scene_light *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a projector")
    to->projection_yfov_rad = m->yfov_rad;
    to->projection_aspect = m->aspect;
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
    if (m->falloff >= FALLOFF_COUNT)
        return damaged(r, "a light's falloff is unknown");
    to->falloff = (enum scene_falloff)m->falloff;
    TAKE(take_index(r, "a light's image", m->image, SCENE_IMAGES_MAX, &to->image));
    TAKE(take_projector(r, m->projector, to));
    return take_index(r, "a light's node", m->node, SCENE_NODES_MAX, &to->node);
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
    to->lens_radius = m->lens_radius;
    to->focus_distance = m->focus_distance;
    to->blades = m->blades;
    to->blade_rotation_rad = m->blade_rotation_rad;
    to->shutter_open_s = m->shutter_open_s;
    to->shutter_close_s = m->shutter_close_s;
    to->exposure_ev = m->exposure_ev;
    return take_index(r, "a camera's node", m->node, SCENE_NODES_MAX, &to->node);
}

static status take_environment(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Environment *m = (const Azulejo__Scene__Environment *)message;
    struct scene_environment *to = &r->scene->environment;

    (void)row;
    to->present = 1;
    to->constant = !m->image;
    TAKE_FLOATS_IF(to_map, &to->to_map[0][0], 9);
    if (to->constant) {
        TAKE_FLOATS(radiance, to->radiance, 3);
        return STATUS_OK;
    }
    TAKE_FLOATS_IF(radiance, to->radiance, 3);
    return take_image(r, m->image, &to->image);
}

static status take_node(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Node *m = (const Azulejo__Scene__Node *)message;
    struct scene_node *to = &r->scene->nodes[row];
    void *weights;

    scene_node_default(to);
    TAKE(take_index(r, "a node's parent", m->parent, SCENE_NODES_MAX, &to->parent));
    if (m->n_matrix && (m->n_translation || m->n_rotation || m->n_scale))
        return damaged(r, "a node has a matrix and more");
    to->has_matrix = m->n_matrix != 0;
    TAKE_FLOATS_IF(matrix, &to->matrix.m[0][0], 12);
    if (!to->has_matrix)
        TAKE_FLOATS(translation, to->translation, 3);
    TAKE_FLOATS_IF(rotation, to->rotation, 4);
    TAKE_FLOATS_IF(scale, to->scale, 3);
    if (m->n_weights == 0)
        return STATUS_OK;
    if (m->n_weights > SCENE_MORPHS_MAX)
        return damaged(r, "a node has too many weights");
    TAKE(take_array(r, m->weights, m->n_weights, sizeof *to->weights, &weights));
    to->weights = weights;
    to->weight_count = (uint32_t)m->n_weights;
    return STATUS_OK;
}

static status take_channel(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Channel *m = (const Azulejo__Scene__Channel *)message;
    struct scene_channel *to = &r->scene->channels[row];
    void *times, *values;

    to->node = m->node;
    if (m->path >= PATH_COUNT || m->interpolation >= INTERPOLATE_COUNT)
        return damaged(r, "a channel's path or interpolation is unknown");
    to->path = (enum scene_channel_path)m->path;
    to->interpolation = (enum scene_interpolation)m->interpolation;
    if (m->n_times > SCENE_KEYS_MAX || m->components > SCENE_MORPHS_MAX)
        return damaged(r, "a channel has too many keys or components");
    to->key_count = (uint32_t)m->n_times;
    to->components = m->components;
    if (m->n_values != scene_channel_floats(to))
        return damaged(r, "a channel has not as many values as its keys call for");
    TAKE(take_array(r, m->times, m->n_times, sizeof *to->times, &times));
    TAKE(take_array(r, m->values, m->n_values, sizeof *to->values, &values));
    to->times = times;
    to->values = values;
    return STATUS_OK;
}

static status take_skin(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Skin *m = (const Azulejo__Scene__Skin *)message;
    struct scene_skin *to = &r->scene->skins[row];
    void *joints, *inverse_bind;

    if (m->n_joints > SCENE_JOINTS_MAX || m->n_inverse_bind != m->n_joints * 12)
        return damaged(r, "a skin's joints and matrices do not match");
    to->joint_count = (uint32_t)m->n_joints;
    TAKE(take_array(r, m->joints, m->n_joints, sizeof *to->joints, &joints));
    TAKE(take_array(r, m->inverse_bind, m->n_joints, sizeof *to->inverse_bind, &inverse_bind));
    to->joints = joints;
    to->inverse_bind = inverse_bind;
    return STATUS_OK;
}

static status take_grid(struct reader *r, const Azulejo__Scene__Grid *m, struct scene_medium *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a grid")
    if (m->n_size != 3)
        return damaged(r, "a grid has not three sides");
    to->has_grid = 1;
    memcpy(to->grid_size, m->size, sizeof to->grid_size);
    TAKE(take_blob(r, m->blob, &to->grid));
    TAKE_FLOATS(to_world, &to->grid_to_world.m[0][0], 12);
    return STATUS_OK;
}

static status take_medium(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Medium *m = (const Azulejo__Scene__Medium *)message;
    struct scene_medium *to = &r->scene->media[row];

    scene_medium_default(to);
    TAKE(take_name(r, m->name, &to->name));
    TAKE_FLOATS(absorption, to->absorption, 3);
    TAKE_FLOATS(scattering, to->scattering, 3);
    TAKE_FLOATS_IF(emission, to->emission, 3);
    to->g = m->g;
    return take_grid(r, m->grid, to);
}

static status take_portal(struct reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Portal *m = (const Azulejo__Scene__Portal *)message;
    struct scene_portal *to = &r->scene->environment.portals[row];

    TAKE_FLOATS(corner, to->corner, 3);
    TAKE_FLOATS(edge1, to->edge1, 3);
    TAKE_FLOATS(edge2, to->edge2, 3);
    return STATUS_OK;
}

/* What each top-level field holds. `least_bytes` is what a valid element takes at least:
 * it bounds the memory that a count of tiny elements can claim. `most_bytes` of 0 is
 * SCENE_ELEMENT_BYTES_MAX. */
static const struct element {
    const char *name;
    const ProtobufCMessageDescriptor *descriptor;
    uint32_t maximum;
    size_t least_bytes;
    status (*take)(struct reader *r, const ProtobufCMessage *message, uint32_t row);
    size_t most_bytes;
} elements[FIELD_COUNT] = {
    [3] = {"meshes", &azulejo__scene__mesh__descriptor, SCENE_MESHES_MAX, 64, take_mesh, 0},
    [4] = {"images", &azulejo__scene__image__descriptor, SCENE_IMAGES_MAX, 38, take_image_row, 0},
    [5] = {"textures", &azulejo__scene__texture__descriptor, SCENE_TEXTURES_MAX, 0, take_texture,
           0},
    [6] = {"materials", &azulejo__scene__material__descriptor, SCENE_MATERIALS_MAX, 60,
           take_material, 0},
    [7] = {"instances", &azulejo__scene__instance__descriptor, SCENE_INSTANCES_MAX, 50,
           take_instance, 0},
    [8] = {"lights", &azulejo__scene__light__descriptor, SCENE_LIGHTS_MAX, 42, take_light, 0},
    [9] = {"cameras", &azulejo__scene__camera__descriptor, SCENE_CAMERAS_MAX, 50, take_camera, 0},
    [10] = {"environments", &azulejo__scene__environment__descriptor, 1, 14, take_environment, 0},
    [11] = {"nodes", &azulejo__scene__node__descriptor, SCENE_NODES_MAX, 14, take_node,
            SCENE_NODE_BYTES_MAX},
    [12] = {"channels", &azulejo__scene__channel__descriptor, SCENE_CHANNELS_MAX, 12,
            take_channel, SCENE_CHANNEL_BYTES_MAX},
    [13] = {"skins", &azulejo__scene__skin__descriptor, SCENE_SKINS_MAX, 52, take_skin,
            SCENE_SKIN_BYTES_MAX},
    [14] = {"media", &azulejo__scene__medium__descriptor, SCENE_MEDIA_MAX, 28, take_medium, 0},
    [15] = {"portals", &azulejo__scene__portal__descriptor, SCENE_PORTALS_MAX, 42, take_portal, 0},
};

static size_t element_bytes_max(uint32_t field)
{
    return elements[field].most_bytes ? elements[field].most_bytes : SCENE_ELEMENT_BYTES_MAX;
}

/* First pass: count, without taking memory. */
static status count_elements(struct reader *r, uint32_t counts[FIELD_COUNT])
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
                return damaged(r, "its version, name or fog is there twice");
            continue;
        }
        if (size > element_bytes_max(field))
            return error_set(r->err, STATUS_ERR_LIMIT,
                             "the packed scene's %s[%u] takes %zu bytes: at most %zu are taken",
                             elements[field].name, counts[field] - 1, size,
                             element_bytes_max(field));
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

static status allocate_tables(struct reader *r, const uint32_t counts[FIELD_COUNT])
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
    ALLOCATE(13, struct scene_skin, skins, skin_count)
    ALLOCATE(14, struct scene_medium, media, medium_count)
    ALLOCATE(15, struct scene_portal, environment.portals, environment.portal_count)
#undef ALLOCATE
    return STATUS_OK;
}

static status read_element(struct reader *r, uint32_t field, uint32_t row, const uint8_t *data,
                           size_t size)
{
    const struct element *element = &elements[field];
    ProtobufCMessage *message;
    status result;

    message = pieces_are_few(data, size)
                  ? protobuf_c_message_unpack(element->descriptor, &r->allocator, size, data)
                  : NULL;
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

static status read_name(struct reader *r, const uint8_t *data, size_t size)
{
    char *name;

    if (size > SCENE_NAME_MAX)
        return damaged(r, "its name is too long");
    if (memchr(data, 0, size))
        return damaged(r, "its name holds a NUL byte");
    name = arena_alloc(&r->scene->arena, size + 1, 1);
    if (!name)
        return error_no_memory(r->err, "the scene's name");
    memcpy(name, data, size);
    r->scene->name = name;
    return STATUS_OK;
}

static status read_elements(struct reader *r)
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
            TAKE(take_index(r, "the fog's medium",
                            number > SCENE_MEDIA_MAX ? UINT32_MAX : (uint32_t)number,
                            SCENE_MEDIA_MAX, &r->scene->fog));
        else if (field != FIELD_VERSION)
            TAKE(read_element(r, field, rows[field]++, data, size));
    }
    return STATUS_OK;
}

status scene_unpack(struct scene *scene, const void *data, size_t size_bytes, struct error *err)
{
    struct reader r = {.at = data, .scene = scene, .err = err};
    uint32_t counts[FIELD_COUNT] = {0};
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
