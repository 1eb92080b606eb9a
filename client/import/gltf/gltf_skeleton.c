/* glTF: the nodes that move, and skins. The scene gets a node, and all its parents, only if it
 * moves and a visible object is attached to it. */
#include <math.h>

#include "client/import/gltf/gltf.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

void gltf_open_nodes(struct gltf *g)
{
    size_t count = json_array_size(g->nodes);

    g->node_data = must(mem_calloc(count, sizeof *g->node_data));
    for (size_t n = 0; n < count; n++) {
        g->node_data[n].parent = -1;
        g->node_data[n].row = GLTF_ROW_UNREAD;
        g->node_data[n].visible = -1;
        for (int path = 0; path < PATH_COUNT; path++)
            g->node_data[n].channels[path] = -1;
    }
    for (size_t n = 0; n < count; n++) {
        json_t *children = json_object_get(json_array_get(g->nodes, n), "children");
        for (size_t i = 0; i < json_array_size(children); i++) {
            json_int_t child = json_integer_value(json_array_get(children, i));
            if (child >= 0 && (size_t)child < count && g->node_data[child].parent < 0)
                g->node_data[child].parent = (int64_t)n;
        }
    }
}

/* ---- at rest -------------------------------------------------------------------------------- */

/* A channel that never changes replaces the node's own value. */
static const float *still_value(const struct gltf *g, size_t node, enum scene_channel_path path)
{
    int32_t row = g->node_data[node].channels[path];
    const struct scene_channel *channel;

    if (row < 0 || !g->channels[row].still)
        return NULL;
    channel = &g->channels[row].channel;
    return channel->values + (channel->interpolation == INTERPOLATE_CUBIC ? channel->components : 0);
}

static void take_still(const float *value, size_t count, double *out)
{
    for (size_t i = 0; value && i < count; i++)
        out[i] = (double)value[i];
}

status gltf_node_local(struct gltf *g, size_t node, struct gltf_local *out)
{
    const struct gltf_place at = gltf_at("nodes", node, "");
    double matrix[16];
    json_t *row;

    *out = (struct gltf_local){.rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    TRY(gltf_row(g, g->nodes, &at, &row));
    if (json_object_get(row, "matrix")) {
        TRY(gltf_numbers(g, row, &at, "matrix", 16, matrix));
        out->has_matrix = 1;
        out->matrix = transform_d_from_columns(matrix);
        return STATUS_OK;
    }
    TRY(gltf_numbers(g, row, &at, "translation", 3, out->translation));
    TRY(gltf_numbers(g, row, &at, "rotation", 4, out->rotation));
    TRY(gltf_numbers(g, row, &at, "scale", 3, out->scale));
    take_still(still_value(g, node, PATH_TRANSLATION), 3, out->translation);
    take_still(still_value(g, node, PATH_ROTATION), 4, out->rotation);
    take_still(still_value(g, node, PATH_SCALE), 3, out->scale);
    out->matrix = transform_d_from_trs(out->translation, out->rotation, out->scale);
    return STATUS_OK;
}

static status too_deep(struct gltf *g, size_t node)
{
    const struct gltf_place at = gltf_at("nodes", node, "");

    return gltf_fail(g, STATUS_ERR_INPUT, &at, "lies more than %d levels deep, or is among its own descendants",
                     GLTF_DEPTH_MAX);
}

status gltf_node_world(struct gltf *g, size_t node, struct transform_d *out)
{
    struct gltf_local local;
    int64_t at = (int64_t)node;

    *out = transform_d_identity();
    for (int depth = 0; at >= 0; depth++, at = g->node_data[at].parent) {
        if (depth >= GLTF_DEPTH_MAX)
            return too_deep(g, node);
        TRY(gltf_node_local(g, (size_t)at, &local));
        *out = transform_d_multiply(&local.matrix, out);
    }
    return STATUS_OK;
}

status gltf_node_weights(struct gltf *g, size_t node, size_t mesh, float **out, size_t *count)
{
    const struct gltf_place at_mesh = gltf_at("meshes", mesh, "");
    const struct gltf_place at_node = gltf_at("nodes", node, "");
    size_t targets = gltf_target_count(g, mesh);
    const float *still = still_value(g, node, PATH_WEIGHTS);
    json_t *list = NULL;
    float *weights;

    *out = NULL;
    *count = 0;
    if (targets == 0)
        return STATUS_OK;
    TRY(gltf_array(g, json_array_get(g->meshes, mesh), &at_mesh, "weights", &list));
    TRY(gltf_array(g, json_array_get(g->nodes, node), &at_node, "weights", &list));
    if (json_array_size(list) > targets)
        return gltf_fail(g, STATUS_ERR_INPUT, &at_node, "has %zu weights, but meshes[%zu] has %zu morph targets",
                         json_array_size(list), mesh, targets);
    weights = must(mem_calloc(targets, sizeof *weights));
    for (size_t i = 0; i < targets; i++) {
        double value = still ? (double)still[i] : json_number_value(json_array_get(list, i));
        weights[i] = (float)fmin(fmax(value, -1e6), 1e6);
    }
    *out = weights;
    *count = targets;
    return STATUS_OK;
}

/* ---- rows ----------------------------------------------------------------------------------- */

static void normalize_rotation(double q[4])
{
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);

    for (int i = 0; i < 4; i++)
        q[i] = length > 0 && isfinite(length) ? q[i] / length : i == 3;
}

/* The node itself; its parent has its row. */
static status add_node(struct gltf *g, size_t node)
{
    struct gltf_node *data = &g->node_data[node];
    const struct gltf_place at = gltf_at("nodes", node, "");
    struct scene_node added = {.parent = -1};
    struct gltf_local local;
    int64_t mesh = -1;
    size_t weight_count = 0;
    uint32_t row;
    status result;

    TRY(gltf_node_local(g, node, &local));
    TRY(gltf_index(g, json_array_get(g->nodes, node), &at, "mesh", g->meshes, &mesh));
    if (data->parent >= 0)
        added.parent = (int32_t)g->node_data[data->parent].row;
    added.has_matrix = local.has_matrix;
    added.matrix = local.matrix;
    normalize_rotation(local.rotation);
    for (int i = 0; i < 4; i++)
        added.rotation[i] = local.rotation[i];
    for (int i = 0; i < 3; i++) {
        added.translation[i] = local.translation[i];
        added.scale[i] = local.scale[i];
    }
    if (!transform_d_is_finite(&added.matrix))
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "its transform is out of the range of numbers");
    if (mesh >= 0 && (data->animated >> PATH_WEIGHTS & 1)) {
        TRY(gltf_node_weights(g, node, (size_t)mesh, &added.weights, &weight_count));
        added.weight_count = (uint32_t)weight_count;
    }
    result = builder_add_node(g->b, &added, &row);
    mem_free(added.weights);
    if (result == STATUS_OK)
        data->row = row;
    return result;
}

status gltf_node_row(struct gltf *g, size_t node, uint32_t *row)
{
    size_t chain[GLTF_DEPTH_MAX], length = 0;

    for (int64_t at = (int64_t)node; at >= 0 && g->node_data[at].row == GLTF_ROW_UNREAD;
         at = g->node_data[at].parent) {
        if (length == GLTF_DEPTH_MAX)
            return too_deep(g, node);
        chain[length++] = (size_t)at;
    }
    while (length > 0)
        TRY(add_node(g, chain[--length]));
    *row = (uint32_t)g->node_data[node].row;
    return STATUS_OK;
}

/* ---- skins ---------------------------------------------------------------------------------- */

static status read_inverse_binds(struct gltf *g, json_t *skin, const struct gltf_place *at, struct scene_skin *out)
{
    struct gltf_accessor accessor;
    float *values = NULL;
    int64_t index = -1;

    for (uint32_t i = 0; i < out->joint_count; i++) {
        const struct transform_d identity = transform_d_identity();
        out->inverse_bind[i] = transform_stored_from_d(&identity);
    }
    TRY(gltf_index(g, skin, at, "inverseBindMatrices", g->accessors, &index));
    if (index < 0)
        return STATUS_OK;
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (accessor.components != 16 || accessor.count < out->joint_count)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "inverseBindMatrices must be MAT4, one for each of the %u joints",
                         out->joint_count);
    TRY(gltf_accessor_floats(g, (size_t)index, &accessor, 0, &values));
    for (uint32_t i = 0; i < out->joint_count; i++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 4; c++)
                out->inverse_bind[i].m[r][c] = values[16 * (size_t)i + (size_t)(4 * c + r)];
    mem_free(values);
    return STATUS_OK;
}

static status read_skin(struct gltf *g, size_t index, json_t *joints, json_t *skin, struct scene_skin *out)
{
    const struct gltf_place at = gltf_at("skins", index, "");

    for (uint32_t i = 0; i < out->joint_count; i++) {
        json_t *item = json_array_get(joints, i);
        json_int_t node = json_is_integer(item) ? json_integer_value(item) : -1;
        if (node < 0 || (size_t)node >= json_array_size(g->nodes))
            return gltf_fail(g, STATUS_ERR_INPUT, &at, "joints[%u] is not the index of a node", i);
        TRY(gltf_node_row(g, (size_t)node, &out->joints[i]));
    }
    return read_inverse_binds(g, skin, &at, out);
}

/* The mesh's place by joint 0: exact in the pose in which the mesh was bound. */
static status skin_place(struct gltf *g, json_t *joints, const struct scene_skin *skin, struct transform_d *about)
{
    const struct transform_d bind = transform_stored_to_d(&skin->inverse_bind[0]);
    struct transform_d joint;

    TRY(gltf_node_world(g, (size_t)json_integer_value(json_array_get(joints, 0)), &joint));
    *about = transform_d_multiply(&joint, &bind);
    return STATUS_OK;
}

status gltf_skin(struct gltf *g, size_t index, uint32_t *row, struct transform_d *about)
{
    const struct gltf_place at = gltf_at("skins", index, "");
    struct scene_skin out = {0};
    json_t *skin, *joints = NULL;
    status result = STATUS_OK;

    TRY(gltf_row(g, g->skins, &at, &skin));
    TRY(gltf_array(g, skin, &at, "joints", &joints));
    if (json_array_size(joints) < 1 || json_array_size(joints) > SCENE_JOINTS_MAX)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "must have 1 to %d joints", SCENE_JOINTS_MAX);
    if (g->skin_rows[index] != GLTF_ROW_UNREAD) {
        *row = (uint32_t)g->skin_rows[index];
        return skin_place(g, joints, &g->b->skins[*row], about);
    }
    out.joint_count = (uint32_t)json_array_size(joints);
    out.joints = must(mem_alloc_array(out.joint_count, sizeof *out.joints));
    out.inverse_bind = must(mem_alloc_array(out.joint_count, sizeof *out.inverse_bind));
    THEN(result, read_skin(g, index, joints, skin, &out));
    THEN(result, builder_add_skin(g->b, &out, row));
    if (result == STATUS_OK) {
        g->skin_rows[index] = *row;
        result = skin_place(g, joints, &out, about);
    }
    mem_free(out.joints);
    mem_free(out.inverse_bind);
    return result;
}
