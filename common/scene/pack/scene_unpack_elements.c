/* Elements of a packed scene, except materials. */
#include <string.h>

#include "common/scene/pack/scene_unpack_parts.h"

status unpack_mesh(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Mesh *m = (const Azulejo__Scene__Mesh *)message;
    struct scene_mesh *to = &r->scene->meshes[row];
    float bounds[6];

    TAKE(unpack_name(r, m->name, &to->name));
    TAKE(unpack_blob(r, m->blob, &to->blob));
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

status unpack_image_row(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    return unpack_image(r, (const Azulejo__Scene__Image *)message, &r->scene->images[row]);
}

status unpack_texture(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Texture *m = (const Azulejo__Scene__Texture *)message;
    struct scene_texture *to = &r->scene->textures[row];

    to->image = m->image;
    if (m->wrap_u >= WRAP_COUNT || m->wrap_v >= WRAP_COUNT)
        return unpack_damaged(r, "a texture's wrap mode is unknown");
    to->wrap_u = (enum scene_wrap)m->wrap_u;
    to->wrap_v = (enum scene_wrap)m->wrap_v;
    to->nearest = m->nearest != 0;
    if (m->encoding >= ENCODING_COUNT)
        return unpack_damaged(r, "a texture's encoding is unknown");
    to->encoding = (enum scene_encoding)m->encoding;
    return STATUS_OK;
}

status unpack_instance(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Instance *m = (const Azulejo__Scene__Instance *)message;
    struct scene_instance *to = &r->scene->instances[row];

    scene_instance_default(to);
    TAKE(unpack_name(r, m->name, &to->name));
    TAKE(unpack_name(r, m->asset, &to->asset));
    to->mesh = m->mesh;
    to->material = m->material;
    TAKE_DOUBLES(to_world, &to->to_world.m[0][0], 12);
    TAKE(unpack_index(r, "an instance's node", m->node, SCENE_NODES_MAX, &to->node));
    TAKE(unpack_index(r, "an instance's skin", m->skin, SCENE_SKINS_MAX, &to->skin));
    to->sealed = m->sealed;
    return unpack_index(r, "an instance's body", m->body, SCENE_MATERIALS_MAX, &to->body);
}

static status unpack_projector(struct scene_reader *r, const Azulejo__Scene__Projector *m, struct scene_light *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a projector")
    to->projection_yfov_rad = m->yfov_rad;
    to->projection_aspect = m->aspect;
    TAKE_DOUBLES(to_world, &to->to_world.m[0][0], 12);
    return STATUS_OK;
}

status unpack_light(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Light *m = (const Azulejo__Scene__Light *)message;
    struct scene_light *to = &r->scene->lights[row];

    scene_light_default(to);
    TAKE(unpack_name(r, m->name, &to->name));
    if (m->kind >= LIGHT_KIND_COUNT)
        return unpack_damaged(r, "a light's kind is unknown");
    to->kind = (enum scene_light_kind)m->kind;
    TAKE_DOUBLES(position, to->position, 3);
    TAKE_FLOATS(direction, to->direction, 3);
    TAKE_FLOATS(intensity, to->intensity, 3);
    to->range = m->range;
    to->inner_cone_rad = m->inner_cone_rad;
    to->outer_cone_rad = m->outer_cone_rad;
    if (m->falloff >= FALLOFF_COUNT)
        return unpack_damaged(r, "a light's falloff is unknown");
    to->falloff = (enum scene_falloff)m->falloff;
    TAKE(unpack_index(r, "a light's image", m->image, SCENE_IMAGES_MAX, &to->image));
    TAKE(unpack_projector(r, m->projector, to));
    return unpack_index(r, "a light's node", m->node, SCENE_NODES_MAX, &to->node);
}

status unpack_camera(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Camera *m = (const Azulejo__Scene__Camera *)message;
    struct scene_camera *to = &r->scene->cameras[row];

    scene_camera_default(to);
    TAKE(unpack_name(r, m->name, &to->name));
    if (m->kind >= CAMERA_KIND_COUNT)
        return unpack_damaged(r, "a camera's kind is unknown");
    to->kind = (enum scene_camera_kind)m->kind;
    TAKE_DOUBLES(to_world, &to->to_world.m[0][0], 12);
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
    return unpack_index(r, "a camera's node", m->node, SCENE_NODES_MAX, &to->node);
}

status unpack_environment(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row UNUSED)
{
    const Azulejo__Scene__Environment *m = (const Azulejo__Scene__Environment *)message;
    struct scene_environment *to = &r->scene->environment;

    to->present = 1;
    to->constant = !m->image;
    TAKE_FLOATS_IF(to_map, &to->to_map[0][0], 9);
    if (to->constant) {
        TAKE_FLOATS(radiance, to->radiance, 3);
        return STATUS_OK;
    }
    TAKE_FLOATS_IF(radiance, to->radiance, 3);
    to->brightest = m->brightest;
    return unpack_image(r, m->image, &to->image);
}

status unpack_node(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Node *m = (const Azulejo__Scene__Node *)message;
    struct scene_node *to = &r->scene->nodes[row];
    void *weights;

    scene_node_default(to);
    TAKE(unpack_index(r, "a node's parent", m->parent, SCENE_NODES_MAX, &to->parent));
    if (m->n_matrix && (m->n_translation || m->n_rotation || m->n_scale))
        return unpack_damaged(r, "a node has a matrix and more");
    to->has_matrix = m->n_matrix != 0;
    TAKE_DOUBLES_IF(matrix, &to->matrix.m[0][0], 12);
    if (!to->has_matrix)
        TAKE_DOUBLES(translation, to->translation, 3);
    TAKE_DOUBLES_IF(rotation, to->rotation, 4);
    TAKE_DOUBLES_IF(scale, to->scale, 3);
    if (m->n_weights == 0)
        return STATUS_OK;
    if (m->n_weights > SCENE_MORPHS_MAX)
        return unpack_damaged(r, "a node has too many weights");
    TAKE(unpack_array(r, m->weights, m->n_weights, sizeof *to->weights, &weights));
    to->weights = weights;
    to->weight_count = (uint32_t)m->n_weights;
    return STATUS_OK;
}

/* What a channel's message and a track's say of their keys. */
struct keys_message {
    uint32_t interpolation, components;
    size_t n_times, n_values;
    float *times, *values;
};

static status unpack_keys(struct scene_reader *r, const struct keys_message *m, struct scene_channel *to)
{
    void *times, *values;

    if (m->interpolation >= INTERPOLATE_COUNT)
        return unpack_damaged(r, "an interpolation is unknown");
    to->interpolation = (enum scene_interpolation)m->interpolation;
    if (m->n_times > SCENE_KEYS_MAX || m->components > SCENE_MORPHS_MAX)
        return unpack_damaged(r, "a channel has too many keys or components");
    to->key_count = (uint32_t)m->n_times;
    to->components = m->components;
    if (m->n_values != scene_channel_floats(to))
        return unpack_damaged(r, "a channel has not as many values as its keys call for");
    TAKE(unpack_array(r, m->times, m->n_times, sizeof *to->times, &times));
    TAKE(unpack_array(r, m->values, m->n_values, sizeof *to->values, &values));
    to->times = times;
    to->values = values;
    return STATUS_OK;
}
#define KEYS_OF(m) &(struct keys_message){(m)->interpolation, (m)->components, (m)->n_times, (m)->n_values, (m)->times, (m)->values}

status unpack_channel(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Channel *m = (const Azulejo__Scene__Channel *)message;
    struct scene_channel *to = &r->scene->channels[row];

    to->node = m->node;
    if (m->path >= PATH_COUNT)
        return unpack_damaged(r, "a channel's path is unknown");
    to->path = (enum scene_channel_path)m->path;
    return unpack_keys(r, KEYS_OF(m), to);
}

status unpack_track(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Track *m = (const Azulejo__Scene__Track *)message;
    struct scene_track *to = &r->scene->tracks[row];

    if (m->target >= TRACK_TARGETS)
        return unpack_damaged(r, "a track's target is unknown");
    *to = (struct scene_track){.target = (enum scene_track_target)m->target, .row = m->row, .field = m->field, .factor = m->factor,
                               .keys.path = PATH_WEIGHTS};
    return unpack_keys(r, KEYS_OF(m), &to->keys);
}

status unpack_skin(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Skin *m = (const Azulejo__Scene__Skin *)message;
    struct scene_skin *to = &r->scene->skins[row];
    void *joints, *inverse_bind;

    if (m->n_joints > SCENE_JOINTS_MAX || m->n_inverse_bind != m->n_joints * 12)
        return unpack_damaged(r, "a skin's joints and matrices do not match");
    to->joint_count = (uint32_t)m->n_joints;
    TAKE(unpack_array(r, m->joints, m->n_joints, sizeof *to->joints, &joints));
    TAKE(unpack_array(r, m->inverse_bind, m->n_joints, sizeof *to->inverse_bind, &inverse_bind));
    to->joints = joints;
    to->inverse_bind = inverse_bind;
    return STATUS_OK;
}

static status unpack_grid(struct scene_reader *r, const Azulejo__Scene__Grid *m, struct scene_medium *to)
{
    if (!m)
        return STATUS_OK;
    KNOWN_FIELDS("a grid")
    if (m->n_size != 3)
        return unpack_damaged(r, "a grid has not three sides");
    to->has_grid = 1;
    memcpy(to->grid_size, m->size, sizeof to->grid_size);
    TAKE(unpack_blob(r, m->blob, &to->grid));
    TAKE_DOUBLES(to_world, &to->grid_to_world.m[0][0], 12);
    return STATUS_OK;
}

status unpack_medium(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Medium *m = (const Azulejo__Scene__Medium *)message;
    struct scene_medium *to = &r->scene->media[row];

    scene_medium_default(to);
    TAKE(unpack_name(r, m->name, &to->name));
    TAKE_FLOATS(absorption, to->absorption, 3);
    TAKE_FLOATS(scattering, to->scattering, 3);
    TAKE_FLOATS_IF(emission, to->emission, 3);
    to->g = m->g;
    return unpack_grid(r, m->grid, to);
}

status unpack_portal(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row)
{
    const Azulejo__Scene__Portal *m = (const Azulejo__Scene__Portal *)message;
    struct scene_portal *to = &r->scene->environment.portals[row];

    TAKE_DOUBLES(corner, to->corner, 3);
    TAKE_FLOATS(edge1, to->edge1, 3);
    TAKE_FLOATS(edge2, to->edge2, 3);
    return STATUS_OK;
}

status unpack_origin(struct scene_reader *r, const ProtobufCMessage *message, uint32_t row UNUSED)
{
    const Azulejo__Scene__Origin *m = (const Azulejo__Scene__Origin *)message;

    TAKE_DOUBLES(at, r->scene->origin, 3);
    return STATUS_OK;
}
