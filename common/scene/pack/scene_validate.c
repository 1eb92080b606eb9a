/* Checks every index, count, enum and number of a scene once, so that code that reads the scene
 * afterwards need not check again. */
#include <math.h>

#include "common/scene/pack/scene_validate_parts.h"
#include "common/scene/track.h"

/* Are the columns of the 3x3 with this row stride orthonormal? */
static int is_orthonormal(const double *m, int stride)
{
    for (int a = 0; a < 3; a++)
        for (int b = a; b < 3; b++) {
            double dot = 0;
            for (int r = 0; r < 3; r++)
                dot += m[r * stride + a] * m[r * stride + b];
            if (!(fabs(dot - (a == b)) < 1e-3))
                return 0;
        }
    return 1;
}

/* Is it long enough to be normalised, and short enough? */
static int can_be_normalized(const double q[4])
{
    double squared = 0;

    for (int i = 0; i < 4; i++)
        squared += q[i] * q[i];
    return squared > 1e-12 && squared < 1e12;
}

static status check_mesh(const struct check_place *at, const struct scene_mesh *mesh)
{
    struct scene_mesh_layout layout;

    TRY(check_name(at, mesh->name));
    TRY(check_blob(at, &mesh->blob));
    if (mesh->triangle_count < 1 || mesh->triangle_count > SCENE_TRIANGLES_MAX)
        return check_complain(at, "triangle_count", "is out of range");
    if (mesh->vertex_count < 3 || mesh->vertex_count > 3u * SCENE_TRIANGLES_MAX)
        return check_complain(at, "vertex_count", "is out of range");
    if (mesh->arrays & ~(uint32_t)MESH_ARRAYS_ALL)
        return check_complain(at, "arrays", "names an unknown vertex array");
    if (mesh->morph_count > SCENE_MORPHS_MAX)
        return check_complain(at, "morph_count", "is out of range");
    scene_mesh_layout(mesh, &layout);
    if (mesh->blob.size_bytes != layout.total_bytes)
        return check_complain(at, "blob", "has not the size that the counts call for");
    TRY(check_ranges(at, "bounds_min", mesh->bounds_min, 3, -SCENE_COORDINATE_MAX, SCENE_COORDINATE_MAX));
    TRY(check_ranges(at, "bounds_max", mesh->bounds_max, 3, -SCENE_COORDINATE_MAX, SCENE_COORDINATE_MAX));
    for (int i = 0; i < 3; i++)
        if (mesh->bounds_min[i] > mesh->bounds_max[i])
            return check_complain(at, "bounds_min", "lies beyond bounds_max");
    return check_flag(at, "closed", mesh->closed);
}

static status check_image(const struct check_place *at, const struct scene_image *image)
{
    TRY(check_name(at, image->name));
    return check_blob(at, &image->blob);
}

static status check_texture(const struct check_place *at, const struct scene_texture *texture, uint32_t image_count)
{
    TRY(check_index(at, "image", texture->image, image_count));
    TRY(check_enum(at, "wrap_u", (unsigned)texture->wrap_u, WRAP_COUNT));
    TRY(check_enum(at, "wrap_v", (unsigned)texture->wrap_v, WRAP_COUNT));
    TRY(check_enum(at, "encoding", (unsigned)texture->encoding, ENCODING_COUNT));
    return check_flag(at, "nearest", texture->nearest);
}

/* Is it a valid radiance or weight? Its square must be finite. */
static const float unlimited = SCENE_RADIANCE_MAX;

static status check_moves(const struct check_place *at, const struct scene *scene,
                          const struct scene_instance *instance)
{
    const struct scene_mesh *mesh = &scene->meshes[instance->mesh];

    TRY(check_reference(at, "node", instance->node, scene->node_count));
    TRY(check_reference(at, "skin", instance->skin, scene->skin_count));
    if (instance->skin >= 0 && !(mesh->arrays & MESH_SKIN))
        return check_complain(at, "skin", "moves a mesh that names no joints");
    if (instance->node >= 0 && mesh->morph_count) {
        uint32_t weights = scene->nodes[instance->node].weight_count;
        if (weights && weights != mesh->morph_count)
            return check_complain(at, "node", "has not one weight for each morph target of the mesh");
    }
    return STATUS_OK;
}

static status check_instance(const struct check_place *at, const struct scene *scene, uint32_t row)
{
    const struct scene_instance *instance = &scene->instances[row];
    struct transform_d inverse;
    struct transform_stored rounded;
    double low[3], high[3];

    TRY(check_name(at, instance->name));
    TRY(check_name(at, instance->asset));
    TRY(check_index(at, "mesh", instance->mesh, scene->mesh_count));
    TRY(check_index(at, "material", instance->material, scene->material_count));
    TRY(check_reference(at, "body", instance->body, scene->material_count));
    if (instance->body >= 0 && scene->materials[instance->body].kind != scene->materials[instance->material].kind)
        return check_complain(at, "body", "is a material of another kind");
    TRY(check_moves(at, scene, instance));
    rounded = transform_stored_from_d(&instance->to_world);
    if (!transform_stored_is_finite(&rounded))
        return check_complain(at, "to_world", "is not finite");
    if (instance->node < 0 && !transform_d_invert(&instance->to_world, &inverse))
        return check_complain(at, "to_world", "cannot be inverted");
    if (!scene_instance_bounds(scene, row, low, high))
        return check_complain(at, "to_world", "moves the mesh out of the range of numbers");
    for (int i = 0; i < 3; i++)
        if (!(low[i] >= -(double)SCENE_COORDINATE_MAX && high[i] <= (double)SCENE_COORDINATE_MAX))
            return check_complain(at, "to_world", "moves the mesh beyond 1e15 metres");
    return STATUS_OK;
}

static status check_light(const struct check_place *at, const struct scene *scene, const struct scene_light *light)
{
    const struct vec3 d = {light->direction[0], light->direction[1], light->direction[2]};
    const float half_pi = 1.5707964f;

    TRY(check_name(at, light->name));
    TRY(check_enum(at, "kind", (unsigned)light->kind, LIGHT_KIND_COUNT));
    TRY(check_coordinates(at, "position", light->position, 3));
    if (!(fabsf(vec3_length(d) - 1) < 1e-3f))
        return check_complain(at, "direction", "is not a unit vector");
    TRY(check_ranges(at, "intensity", light->intensity, 3, 0, unlimited));
    TRY(check_range(at, "range", light->range, 0, SCENE_COORDINATE_MAX));
    TRY(check_enum(at, "falloff", (unsigned)light->falloff, FALLOFF_COUNT));
    TRY(check_reference(at, "image", light->image, scene->image_count));
    TRY(check_reference(at, "node", light->node, scene->node_count));
    TRY(check_transform_d(at, "to_world", &light->to_world));
    if (!is_orthonormal(&light->to_world.m[0][0], 4))
        return check_complain(at, "to_world", "is not a rotation or mirroring and a translation");
    TRY(check_range(at, "projection_yfov_rad", light->projection_yfov_rad, SCENE_FOV_MIN_RAD, SCENE_FOV_MAX_RAD));
    TRY(check_range(at, "projection_aspect", light->projection_aspect, 1e-6f, 1e6f));
    if (light->kind == LIGHT_SPOT) {
        TRY(check_range(at, "outer_cone_rad", light->outer_cone_rad, 0, half_pi));
        TRY(check_range(at, "inner_cone_rad", light->inner_cone_rad, 0, half_pi));
        if (!(light->inner_cone_rad < light->outer_cone_rad))
            return check_complain(at, "inner_cone_rad", "must be below outer_cone_rad");
    }
    return STATUS_OK;
}

static status check_lens(const struct check_place *at, const struct scene_camera *camera)
{
    TRY(check_range(at, "lens_radius", camera->lens_radius, 0, SCENE_FOCUS_MAX));
    TRY(check_range(at, "focus_distance", camera->focus_distance, 0, SCENE_FOCUS_MAX));
    if (camera->lens_radius > 0 && camera->focus_distance == 0)
        return check_complain(at, "focus_distance", "must be above 0 for a camera with a lens");
    if (camera->blades > SCENE_BLADES_MAX)
        return check_complain(at, "blades", "is out of range");
    TRY(check_range(at, "blade_rotation_rad", camera->blade_rotation_rad, -1e5f, 1e5f));
    TRY(check_range(at, "shutter_open_s", camera->shutter_open_s, -1e6f, 1e6f));
    TRY(check_range(at, "shutter_close_s", camera->shutter_close_s, -1e6f, 1e6f));
    if (camera->shutter_close_s < camera->shutter_open_s)
        return check_complain(at, "shutter_close_s", "comes before shutter_open_s");
    return check_range(at, "exposure_ev", camera->exposure_ev, -100, 100);
}

static status check_camera(const struct check_place *at, const struct scene *scene, const struct scene_camera *camera)
{
    TRY(check_name(at, camera->name));
    TRY(check_enum(at, "kind", (unsigned)camera->kind, CAMERA_KIND_COUNT));
    TRY(check_transform_d(at, "to_world", &camera->to_world));
    if (!is_orthonormal(&camera->to_world.m[0][0], 4))
        return check_complain(at, "to_world", "is not a rotation and a translation");
    if (!(transform_d_determinant(&camera->to_world) > 0))
        return check_complain(at, "to_world", "mirrors");
    TRY(check_reference(at, "node", camera->node, scene->node_count));
    TRY(check_lens(at, camera));
    if (camera->kind == CAMERA_PERSPECTIVE) {
        TRY(check_range(at, "yfov_rad", camera->yfov_rad, SCENE_FOV_MIN_RAD, SCENE_FOV_MAX_RAD));
    } else if (camera->kind == CAMERA_ORTHOGRAPHIC) {
        TRY(check_range(at, "xmag", camera->xmag, 1e-12f, SCENE_COORDINATE_MAX));
        TRY(check_range(at, "ymag", camera->ymag, 1e-12f, SCENE_COORDINATE_MAX));
    }
    return check_range(at, "aspect", camera->aspect, 0, 1e6f);
}

static status check_node(const struct check_place *at, const struct scene_node *node)
{
    if (node->parent < -1 || node->parent >= (int64_t)at->row)
        return check_complain(at, "parent", "must come before the node itself");
    TRY(check_flag(at, "has_matrix", node->has_matrix));
    TRY(check_transform_d(at, "matrix", &node->matrix));
    TRY(check_coordinates(at, "translation", node->translation, 3));
    if (!can_be_normalized(node->rotation))
        return check_complain(at, "rotation", "cannot be made a unit quaternion");
    TRY(check_coordinates(at, "scale", node->scale, 3));
    if (node->weight_count > SCENE_MORPHS_MAX)
        return check_complain(at, "weight_count", "is out of range");
    for (uint32_t i = 0; i < node->weight_count; i++)
        TRY(check_range(at, "weights", node->weights[i], -1e6f, 1e6f));
    return STATUS_OK;
}

static status check_keys(const struct check_place *at, const struct scene_channel *channel, float limit)
{
    size_t numbers, stride;

    TRY(check_enum(at, "interpolation", (unsigned)channel->interpolation, INTERPOLATE_COUNT));
    if (channel->key_count < 1 || channel->key_count > SCENE_KEYS_MAX)
        return check_complain(at, "key_count", "is out of range");
    numbers = scene_channel_floats(channel);
    stride = numbers / channel->key_count;
    for (uint32_t i = 0; i < channel->key_count; i++) {
        TRY(check_range(at, "times", channel->times[i], -1e9f, 1e9f));
        if (i && channel->times[i] <= channel->times[i - 1])
            return check_complain(at, "times", "do not ascend");
    }
    for (size_t i = 0; i < numbers; i++)
        TRY(check_range(at, "values", channel->values[i], -limit, limit));
    if (channel->path == PATH_ROTATION)
        for (uint32_t i = 0; i < channel->key_count; i++) {
            const float *key = channel->values + i * stride + (channel->interpolation == INTERPOLATE_CUBIC ? 4 : 0);
            const double q[4] = {(double)key[0], (double)key[1], (double)key[2], (double)key[3]};
            if (!can_be_normalized(q))
                return check_complain(at, "values", "cannot be made unit quaternions");
        }
    return STATUS_OK;
}

static status check_channel(const struct check_place *at, const struct scene *scene)
{
    const struct scene_channel *channel = &scene->channels[at->row];
    uint32_t components[PATH_COUNT] = {3, 4, 3, 0};

    TRY(check_index(at, "node", channel->node, scene->node_count));
    TRY(check_enum(at, "path", (unsigned)channel->path, PATH_COUNT));
    if (at->row) {
        const struct scene_channel *before = channel - 1;
        if (channel->node < before->node || (channel->node == before->node && channel->path <= before->path))
            return check_complain(at, "node", "and path are not in order, or there twice");
    }
    if (channel->path != PATH_WEIGHTS && scene->nodes[channel->node].has_matrix)
        return check_complain(at, "path", "moves a node that has a matrix");
    components[PATH_WEIGHTS] = scene->nodes[channel->node].weight_count;
    if (channel->components < 1 || channel->components != components[channel->path])
        return check_complain(at, "components", "does not fit what it moves");
    return check_keys(at, channel, channel->path == PATH_WEIGHTS ? 1e6f : SCENE_COORDINATE_MAX);
}

static status check_track(const struct check_place *at, const struct scene *scene)
{
    const struct scene_track *track = &scene->tracks[at->row];
    const uint32_t rows[TRACK_TARGETS] = {[TRACK_MATERIAL] = scene->material_count, [TRACK_UV_SCALE] = scene->material_count,
                                          [TRACK_UV_ROTATION] = scene->material_count, [TRACK_UV_OFFSET] = scene->material_count,
                                          [TRACK_INSTANCE] = scene->instance_count, [TRACK_LIGHT] = scene->light_count,
                                          [TRACK_CAMERA] = scene->camera_count};
    float least, most;
    int count;

    TRY(check_enum(at, "target", (unsigned)track->target, TRACK_TARGETS));
    TRY(check_index(at, "row", track->row, rows[track->target]));
    count = scene_track_count(track, &least, &most);
    if (count == 0)
        return check_complain(at, "field", "is not known");
    if (track->keys.components != (uint32_t)count && !(track->factor && track->keys.components == 1))
        return check_complain(at, "components", "does not fit what it animates");
    if (at->row && scene_track_compare(track - 1, track) >= 0)
        return check_complain(at, "field", "is not in order, or there twice");
    if (track->keys.path != PATH_WEIGHTS || track->keys.node != 0)
        return check_complain(at, "path", "is a node's");
    return check_keys(at, &track->keys, unlimited);
}

static status check_skin(const struct check_place *at, const struct scene_skin *skin, uint32_t node_count)
{
    if (skin->joint_count < 1 || skin->joint_count > SCENE_JOINTS_MAX)
        return check_complain(at, "joint_count", "is out of range");
    for (uint32_t i = 0; i < skin->joint_count; i++) {
        TRY(check_index(at, "joints", skin->joints[i], node_count));
        TRY(check_transform(at, "inverse_bind", &skin->inverse_bind[i]));
    }
    return STATUS_OK;
}

static status check_grid(const struct check_place *at, const struct scene_medium *medium)
{
    struct transform_d inverse;
    uint64_t cells = 1;

    TRY(check_blob(at, &medium->grid));
    for (int i = 0; i < 3; i++) {
        if (medium->grid_size[i] < 1 || medium->grid_size[i] > SCENE_GRID_SIDE_MAX)
            return check_complain(at, "grid_size", "is out of range");
        cells *= medium->grid_size[i]; /* at most 2^36 */
    }
    if (medium->grid.size_bytes != cells * sizeof(float))
        return check_complain(at, "grid", "has not the size that its cells call for");
    TRY(check_transform_d(at, "grid_to_world", &medium->grid_to_world));
    if (!transform_d_invert(&medium->grid_to_world, &inverse))
        return check_complain(at, "grid_to_world", "cannot be inverted");
    return STATUS_OK;
}

static status check_medium(const struct check_place *at, const struct scene_medium *medium)
{
    TRY(check_name(at, medium->name));
    TRY(check_ranges(at, "absorption", medium->absorption, 3, 0, SCENE_COEFFICIENT_MAX));
    TRY(check_ranges(at, "scattering", medium->scattering, 3, 0, SCENE_COEFFICIENT_MAX));
    TRY(check_ranges(at, "emission", medium->emission, 3, 0, unlimited));
    if (!(medium->g > -1 && medium->g < 1))
        return check_complain(at, "g", "must lie between -1 and 1");
    TRY(check_flag(at, "has_grid", medium->has_grid));
    return medium->has_grid ? check_grid(at, medium) : STATUS_OK;
}

static status check_portal(const struct check_place *at, const struct scene_portal *portal)
{
    const float *a = portal->edge1, *b = portal->edge2;
    double aa = 0, bb = 0, ab = 0;

    TRY(check_coordinates(at, "corner", portal->corner, 3));
    TRY(check_ranges(at, "edge1", a, 3, -SCENE_COORDINATE_MAX, SCENE_COORDINATE_MAX));
    TRY(check_ranges(at, "edge2", b, 3, -SCENE_COORDINATE_MAX, SCENE_COORDINATE_MAX));
    for (int i = 0; i < 3; i++) {
        aa += (double)a[i] * (double)a[i];
        bb += (double)b[i] * (double)b[i];
        ab += (double)a[i] * (double)b[i];
    }
    /* |a x b|^2 = aa bb - ab^2: the normal of a sliver is unreliable. */
    if (!(aa > 1e-30 && bb > 1e-30 && aa * bb - ab * ab > 1e-9 * aa * bb))
        return check_complain(at, "edge1", "and edge2 span no window");
    return STATUS_OK;
}

static status check_environment(const struct check_place *at, const struct scene_environment *env)
{
    struct transform_d to_map = transform_d_identity();

    TRY(check_flag(at, "present", env->present));
    if (!env->present)
        return STATUS_OK;
    TRY(check_flag(at, "constant", env->constant));
    TRY(check_ranges(at, "radiance", env->radiance, 3, 0, unlimited));
    TRY(check_ranges(at, "to_map", &env->to_map[0][0], 9, -2, 2));
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++)
            to_map.m[r][c] = (double)env->to_map[r][c];
    if (!is_orthonormal(&to_map.m[0][0], 4) || !(transform_d_determinant(&to_map) > 0))
        return check_complain(at, "to_map", "is not a rotation");
    TRY(check_range(at, "brightest", env->brightest, 0, SCENE_RADIANCE_MAX));
    return env->constant ? STATUS_OK : check_image(at, &env->image);
}

static status check_count(struct error *err, const char *table, uint32_t count, uint32_t maximum)
{
    if (count <= maximum)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_LIMIT, "the scene has %u %s: at most %u are taken", count, table, maximum);
}

status scene_validate(const struct scene *scene, struct error *err)
{
    struct check_place at = {"scene", 0, NULL, err};

    TRY(check_name(&at, scene->name));
    TRY(check_count(err, "meshes", scene->mesh_count, SCENE_MESHES_MAX));
    TRY(check_count(err, "images", scene->image_count, SCENE_IMAGES_MAX));
    TRY(check_count(err, "textures", scene->texture_count, SCENE_TEXTURES_MAX));
    TRY(check_count(err, "materials", scene->material_count, SCENE_MATERIALS_MAX));
    TRY(check_count(err, "instances", scene->instance_count, SCENE_INSTANCES_MAX));
    TRY(check_count(err, "lights", scene->light_count, SCENE_LIGHTS_MAX));
    TRY(check_count(err, "cameras", scene->camera_count, SCENE_CAMERAS_MAX));
    TRY(check_count(err, "nodes", scene->node_count, SCENE_NODES_MAX));
    TRY(check_count(err, "channels", scene->channel_count, SCENE_CHANNELS_MAX));
    TRY(check_count(err, "tracks", scene->track_count, SCENE_TRACKS_MAX));
    TRY(check_count(err, "skins", scene->skin_count, SCENE_SKINS_MAX));
    TRY(check_count(err, "media", scene->medium_count, SCENE_MEDIA_MAX));
    TRY(check_count(err, "portals", scene->environment.portal_count, SCENE_PORTALS_MAX));
    if (scene->camera_count == 0)
        return error_set(err, STATUS_ERR_INPUT, "the scene has no camera");
    TRY(check_enum(&at, "volume_rule", (unsigned)scene->volume_rule, VOLUME_RULE_COUNT));
#define EACH_ROW(name, count, call)                  \
    at.table = name;                                 \
    for (at.row = 0; at.row < (count); at.row++)     \
        TRY(call);
    EACH_ROW("meshes", scene->mesh_count, check_mesh(&at, &scene->meshes[at.row]))
    EACH_ROW("images", scene->image_count, check_image(&at, &scene->images[at.row]))
    EACH_ROW("textures", scene->texture_count, check_texture(&at, &scene->textures[at.row], scene->image_count))
    EACH_ROW("materials", scene->material_count, check_material(&at, scene, &scene->materials[at.row]))
    EACH_ROW("nodes", scene->node_count, check_node(&at, &scene->nodes[at.row]))
    EACH_ROW("channels", scene->channel_count, check_channel(&at, scene))
    EACH_ROW("skins", scene->skin_count, check_skin(&at, &scene->skins[at.row], scene->node_count))
    EACH_ROW("media", scene->medium_count, check_medium(&at, &scene->media[at.row]))
    EACH_ROW("portals", scene->environment.portal_count, check_portal(&at, &scene->environment.portals[at.row]))
    EACH_ROW("instances", scene->instance_count, check_instance(&at, scene, at.row))
    EACH_ROW("lights", scene->light_count, check_light(&at, scene, &scene->lights[at.row]))
    EACH_ROW("cameras", scene->camera_count, check_camera(&at, scene, &scene->cameras[at.row]))
    EACH_ROW("tracks", scene->track_count, check_track(&at, scene))
#undef EACH_ROW
    at = (struct check_place){"environment", 0, NULL, err};
    TRY(check_environment(&at, &scene->environment));
    at = (struct check_place){"scene", 0, NULL, err};
    TRY(check_coordinates(&at, "origin", scene->origin, 3));
    return check_reference(&at, "fog", scene->fog, scene->medium_count);
}
