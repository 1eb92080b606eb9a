#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

/* A node to visit. */
struct visit {
    size_t node;
    uint32_t depth;
    int moving;      /* an ancestor moves */
    const char *top; /* the name of its topmost ancestor; NULL: it is the topmost itself */
    struct transform_d to_world;
};

/* The place of the objects attached to a node. */
struct stand {
    size_t node;
    const char *asset;           /* as in struct scene_instance */
    int moving;                  /* the node or something above it */
    struct transform_d to_world; /* at rest */
};

struct walk {
    struct gltf *g;
    struct visit *stack;
    size_t count, capacity;
    uint8_t *seen; /* a node */
};

static const char *node_name(json_t *node)
{
    const char *name = json_string_value(json_object_get(node, "name"));

    return name ? name : "";
}

/* ---- instances ---------------------------------------------------------------------------- */

/* How a mesh is attached to the scene. */
struct placing {
    const struct gltf_mesh *mesh;
    const char *name, *asset;
    const struct gltf_place *at;
    int32_t node, skin;   /* rows, -1 */
    uint32_t joint_count; /* of the skin */
};

static status place_mesh(struct gltf *g, const struct placing *how, const struct transform_d *to_world)
{
    struct scene_instance instance;
    struct transform_d inverse;

    scene_instance_default(&instance);
    instance.name = how->name;
    instance.asset = how->asset;
    instance.node = how->node;
    instance.to_world = *to_world;
    if (!transform_d_is_finite(to_world) || !transform_d_invert(to_world, &inverse)) {
        if (how->node < 0 && how->skin < 0) {
            builder_warn(g->b, "flattened", "nodes[%zu] \"%.80s\": its transform flattens it to nothing: left out",
                         how->at->row, how->name);
            return STATUS_OK;
        }
        instance.to_world = transform_d_identity(); /* at other times it may be visible */
    }
    for (size_t i = 0; i < how->mesh->count; i++) {
        const struct gltf_primitive *primitive = &how->mesh->primitives[i];
        if (primitive->mesh == BUILDER_NO_ROW)
            continue;
        instance.mesh = (uint32_t)primitive->mesh;
        instance.material = (uint32_t)primitive->material;
        instance.skin = g->b->meshes[instance.mesh].arrays & MESH_SKIN ? how->skin : -1;
        if (instance.skin >= 0 && primitive->joint_max >= how->joint_count)
            return gltf_fail(g, STATUS_ERR_INPUT, how->at, "its mesh names joint %u, but its skin has %u joints",
                             primitive->joint_max, how->joint_count);
        TRY(builder_add_instance(g->b, &instance));
        gltf_note_placed(g, TRACK_INSTANCE, 0, how->at->row, g->b->instance_count - 1);
    }
    return STATUS_OK;
}

/* One attribute of EXT_mesh_gpu_instancing; *count is 0 until the first attribute sets it. */
static status read_instancing(struct gltf *g, json_t *attributes, const struct gltf_place *at, const char *key,
                              int components, size_t *count, float **out)
{
    struct gltf_accessor accessor;
    int64_t index = -1;

    TRY(gltf_index(g, attributes, at, key, g->accessors, &index));
    if (index < 0)
        return STATUS_OK;
    TRY(gltf_accessor_open(g, (size_t)index, &accessor));
    if (accessor.components != components || (*count && accessor.count != *count))
        return gltf_fail(g, STATUS_ERR_INPUT, at, "%s must have %d components and as many elements as the others", key,
                         components);
    *count = accessor.count;
    return gltf_accessor_floats(g, (size_t)index, &accessor, 0, out);
}

/* The scene's node for one of several instances on a node that moves. */
static status add_instance_node(struct gltf *g, int32_t parent, const double t[3], const double q[4], const double s[3],
                                int32_t *row)
{
    struct scene_node node = {.parent = parent, .has_matrix = 1, .rotation = {0, 0, 0, 1}};
    uint32_t added;

    for (int i = 0; i < 3; i++)
        node.scale[i] = 1;
    node.matrix = transform_d_from_trs(t, q, s);
    TRY(builder_add_node(g->b, &node, &added));
    *row = (int32_t)added;
    return STATUS_OK;
}

static status place_instances(struct gltf *g, json_t *extension, const struct placing *how,
                              const struct transform_d *to_world)
{
    const struct gltf_place inner = gltf_within(how->at, ".EXT_mesh_gpu_instancing");
    float *translations = NULL, *rotations = NULL, *scales = NULL;
    struct placing one = *how;
    json_t *attributes = NULL;
    size_t count = 0;
    status result = gltf_object(g, extension, &inner, "attributes", &attributes);

    THEN(result, read_instancing(g, attributes, &inner, "TRANSLATION", 3, &count, &translations));
    THEN(result, read_instancing(g, attributes, &inner, "ROTATION", 4, &count, &rotations));
    THEN(result, read_instancing(g, attributes, &inner, "SCALE", 3, &count, &scales));
    if (result == STATUS_OK && count == 0)
        result = place_mesh(g, how, to_world);
    for (size_t i = 0; i < count && result == STATUS_OK; i++) {
        double t[3] = {0, 0, 0}, q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1};
        struct transform_d local, world;
        for (size_t c = 0; c < 3; c++) {
            t[c] = translations ? (double)translations[3 * i + c] : 0;
            s[c] = scales ? (double)scales[3 * i + c] : 1;
        }
        for (size_t c = 0; c < 4 && rotations; c++)
            q[c] = (double)rotations[4 * i + c];
        local = transform_d_from_trs(t, q, s);
        world = transform_d_multiply(to_world, &local);
        if (how->node >= 0)
            result = add_instance_node(g, how->node, t, q, s, &one.node);
        THEN(result, place_mesh(g, &one, &world));
    }
    mem_free(scales);
    mem_free(rotations);
    mem_free(translations);
    return result;
}

/* The node's kind of use of its mesh, and the mesh for it. */
static status open_mesh(struct gltf *g, const struct stand *stand, size_t index, int skinned, int instanced,
                        const struct gltf_mesh **out)
{
    struct gltf_use use = {.skinned = skinned};
    float *weights = NULL;
    status result;

    TRY(gltf_node_weights(g, stand->node, index, &weights, &use.weight_count));
    use.weights = weights;
    use.morphing = g->node_data[stand->node].animated >> PATH_WEIGHTS & 1;
    if (use.morphing && instanced) {
        builder_warn(g->b, "instanced morph",
                     "nodes[%zu]: its morph targets are animated and it is instanced "
                     "(EXT_mesh_gpu_instancing): rendered with the weights at rest",
                     stand->node);
        use.morphing = 0;
    }
    result = gltf_mesh(g, index, &use, out);
    mem_free(weights);
    return result;
}

static status add_mesh(struct gltf *g, json_t *node, const struct gltf_place *at, size_t index,
                       const struct stand *stand)
{
    json_t *instancing = gltf_extension(node, "EXT_mesh_gpu_instancing");
    struct placing how = {.asset = stand->asset, .at = at, .node = -1, .skin = -1};
    struct transform_d to_world = stand->to_world;
    int64_t skin = -1;
    uint32_t row;

    TRY(gltf_index(g, node, at, "skin", g->skins, &skin));
    if (skin >= 0 && instancing) {
        builder_warn(g->b, "instanced skin",
                     "nodes[%zu]: has a skin and is instanced (EXT_mesh_gpu_instancing): only one "
                     "is rendered, where its joints are",
                     at->row);
        instancing = NULL;
    }
    TRY(open_mesh(g, stand, index, skin >= 0, instancing != NULL, &how.mesh));
    how.name = node_name(node);
    if (!*how.name)
        how.name = node_name(json_array_get(g->meshes, index));
    how.name = builder_name(g->b, how.name);
    if (skin >= 0) {
        TRY(gltf_skin(g, (size_t)skin, &row, &to_world));
        how.skin = (int32_t)row;
        how.joint_count = g->b->skins[row].joint_count;
    }
    if ((stand->moving && skin < 0) || how.mesh->morphing) {
        TRY(gltf_node_row(g, stand->node, &row));
        how.node = (int32_t)row;
    }
    if (instancing)
        return place_instances(g, instancing, &how, &to_world);
    return place_mesh(g, &how, &to_world);
}

/* The row of the node to follow, if it moves. */
static status follow(struct gltf *g, const struct stand *stand, int32_t *node)
{
    uint32_t row;

    if (!stand->moving)
        return STATUS_OK;
    TRY(gltf_node_row(g, stand->node, &row));
    *node = (int32_t)row;
    return STATUS_OK;
}

/* ---- lights ------------------------------------------------------------------------------- */

static status add_light(struct gltf *g, json_t *node, size_t index, const struct stand *stand)
{
    struct scene_light out;

    TRY(gltf_light(g, index, node_name(node), &stand->to_world, &out));
    TRY(follow(g, stand, &out.node));
    TRY(builder_add_light(g->b, &out));
    gltf_note_placed(g, TRACK_LIGHT, index, stand->node, g->b->light_count - 1);
    return STATUS_OK;
}

static status add_ies_light(struct gltf *g, json_t *node, const struct gltf_place *at, json_t *extension,
                            const struct stand *stand)
{
    int32_t followed = -1;
    int added;

    TRY(follow(g, stand, &followed));
    TRY(gltf_ies_light(g, extension, at, node_name(node), &stand->to_world, followed, &added));
    if (added)
        gltf_note_placed(g, TRACK_LIGHT, UINT32_MAX, stand->node, g->b->light_count - 1);
    return STATUS_OK;
}

/* ---- cameras ------------------------------------------------------------------------------ */

static int camera_name_taken(const struct gltf *g, const char *name)
{
    for (size_t i = 0; i < g->b->camera_count; i++)
        if (strcmp(g->b->cameras[i].name, name) == 0)
            return 1;
    return 0;
}

/* The camera's name, or its node's if that is taken: users choose cameras by name. */
static const char *camera_name(struct gltf *g, const char *name, json_t *node)
{
    const char *second = node_name(node);
    char numbered[SCENE_NAME_MAX + 1];

    if (*name && !camera_name_taken(g, name))
        return builder_name(g->b, name);
    if (*second && !camera_name_taken(g, second))
        return builder_name(g->b, second);
    snprintf(numbered, sizeof numbered, "camera %zu", g->b->camera_count);
    return builder_name(g->b, numbered);
}

static status add_camera(struct gltf *g, json_t *node, size_t index, const struct stand *stand)
{
    const struct gltf_place at = gltf_at("cameras", index, "");
    const char *type = "", *name = "";
    json_t *camera, *lens = NULL;
    struct scene_camera out;
    double yfov = 0, xmag = 0, ymag = 0, aspect = 0;

    scene_camera_default(&out);
    TRY(gltf_row(g, g->cameras, &at, &camera));
    TRY(gltf_text(g, camera, &at, "type", &type));
    TRY(gltf_text(g, camera, &at, "name", &name));
    if (strcmp(type, "perspective") != 0 && strcmp(type, "orthographic") != 0)
        return gltf_fail(g, STATUS_ERR_INPUT, &at, "type \"%.32s\" is unknown: perspective and orthographic are known",
                         type);
    TRY(gltf_object(g, camera, &at, type, &lens));
    if (type[0] == 'p') {
        out.kind = CAMERA_PERSPECTIVE;
        TRY(gltf_number(g, lens, &at, "yfov", &yfov));
        TRY(gltf_number(g, lens, &at, "aspectRatio", &aspect));
        if (!(yfov >= (double)SCENE_FOV_MIN_RAD && yfov <= (double)SCENE_FOV_MAX_RAD))
            return gltf_fail(g, STATUS_ERR_INPUT, &at, "yfov is %g: must be %g to %g radians", yfov,
                             (double)SCENE_FOV_MIN_RAD, (double)SCENE_FOV_MAX_RAD);
        if (!(aspect >= 0 && aspect <= 1e6))
            return gltf_fail(g, STATUS_ERR_INPUT, &at, "aspectRatio is %g: must be above 0", aspect);
        out.yfov_rad = (float)yfov;
        out.aspect = (float)aspect;
    } else {
        out.kind = CAMERA_ORTHOGRAPHIC;
        TRY(gltf_number(g, lens, &at, "xmag", &xmag));
        TRY(gltf_number(g, lens, &at, "ymag", &ymag));
        xmag = fabs(xmag), ymag = fabs(ymag); /* negative ones only mirror the picture */
        if (!(xmag >= 1e-12 && xmag <= 1e15 && ymag >= 1e-12 && ymag <= 1e15))
            return gltf_fail(g, STATUS_ERR_INPUT, &at, "xmag and ymag must not be 0");
        out.xmag = (float)xmag;
        out.ymag = (float)ymag;
        out.aspect = (float)fmin(xmag / ymag, 1e6);
    }
    if (!transform_d_rigid(&stand->to_world, &out.to_world)) {
        builder_warn(g->b, "camera node", "cameras[%zu] \"%.80s\": its node's transform has no directions: left out",
                     index, name);
        return STATUS_OK;
    }
    out.name = camera_name(g, name, node);
    TRY(follow(g, stand, &out.node));
    TRY(builder_add_camera(g->b, &out));
    gltf_note_placed(g, TRACK_CAMERA, index, stand->node, g->b->camera_count - 1);
    return STATUS_OK;
}

/* ---- the hierarchy ------------------------------------------------------------------------ */

static status push(struct walk *w, size_t node, const struct visit *parent)
{
    const struct gltf_place at = gltf_at("nodes", node, "");

    if (w->seen[node]++)
        return gltf_fail(w->g, STATUS_ERR_INPUT, &at,
                         "is reached twice: a node must have one parent, and no node may be among "
                         "its own descendants");
    if (parent->depth + 1 > GLTF_DEPTH_MAX)
        return gltf_fail(w->g, STATUS_ERR_LIMIT, &at, "lies more than %d levels deep", GLTF_DEPTH_MAX);
    MUST_GROW(w->stack, w->capacity, w->count + 1);
    w->stack[w->count] = *parent;
    w->stack[w->count].node = node;
    w->stack[w->count++].depth++;
    return STATUS_OK;
}

/* Push a list of node indices so that the first is visited first. */
static status push_all(struct walk *w, json_t *list, const struct gltf_place *at, const char *key,
                       const struct visit *parent)
{
    for (size_t i = json_array_size(list); i-- > 0;) {
        json_t *item = json_array_get(list, i);
        json_int_t index = json_is_integer(item) ? json_integer_value(item) : -1;
        if (index < 0 || (size_t)index >= json_array_size(w->g->nodes))
            return gltf_fail(w->g, STATUS_ERR_INPUT, at, "%s[%zu] is not the index of a node", key, i);
        TRY(push(w, (size_t)index, parent));
    }
    return STATUS_OK;
}

static status visit_node(struct walk *w, const struct visit *visit)
{
    const uint32_t moves = 1u << PATH_TRANSLATION | 1u << PATH_ROTATION | 1u << PATH_SCALE;
    struct gltf *g = w->g;
    const struct gltf_place at = gltf_at("nodes", visit->node, "");
    struct stand stand = {.node = visit->node, .asset = visit->top ? visit->top : ""};
    struct visit below = *visit;
    struct gltf_local local;
    int64_t mesh = -1, camera = -1, light = -1;
    json_t *node, *children = NULL, *extension;
    int visible = 1;

    TRY(gltf_row(g, g->nodes, &at, &node));
    extension = gltf_extension(node, "KHR_node_visibility");
    if (extension)
        TRY(gltf_flag(g, extension, &at, "visible", &visible));
    if (!visible)
        return STATUS_OK;
    TRY(gltf_node_local(g, visit->node, &local));
    stand.to_world = transform_d_multiply(&visit->to_world, &local.matrix);
    stand.moving = visit->moving || (g->node_data[visit->node].animated & moves);
    TRY(gltf_index(g, node, &at, "mesh", g->meshes, &mesh));
    TRY(gltf_index(g, node, &at, "camera", g->cameras, &camera));
    extension = gltf_extension(node, "KHR_lights_punctual");
    if (extension)
        TRY(gltf_index(g, extension, &at, "light", g->lights, &light));
    if (mesh >= 0)
        TRY(add_mesh(g, node, &at, (size_t)mesh, &stand));
    if (camera >= 0)
        TRY(add_camera(g, node, (size_t)camera, &stand));
    if (light >= 0)
        TRY(add_light(g, node, (size_t)light, &stand));
    extension = gltf_extension(node, "EXT_lights_ies");
    if (extension)
        TRY(add_ies_light(g, node, &at, extension, &stand));
    TRY(gltf_array(g, node, &at, "children", &children));
    if (!visit->top)
        below.top = builder_name(g->b, node_name(node));
    below.moving = stand.moving;
    below.to_world = stand.to_world;
    return push_all(w, children, &at, "children", &below);
}

/* Every node without a parent: the content of a file without scenes. */
static status push_roots(struct walk *w, const struct visit *world)
{
    size_t count = json_array_size(w->g->nodes);
    uint8_t *child = must(mem_calloc(count, 1));
    status result = STATUS_OK;

    for (size_t n = 0; n < count; n++) {
        json_t *children = json_object_get(json_array_get(w->g->nodes, n), "children");
        for (size_t i = 0; i < json_array_size(children); i++) {
            json_int_t index = json_integer_value(json_array_get(children, i));
            if (index >= 0 && (size_t)index < count)
                child[index] = 1;
        }
    }
    for (size_t n = count; n-- > 0 && result == STATUS_OK;)
        if (!child[n])
            result = push(w, n, world);
    mem_free(child);
    return result;
}

static status push_scene(struct walk *w, int64_t scene_index, const char **title)
{
    struct gltf *g = w->g;
    const struct visit world = {.to_world = transform_d_identity()};
    const struct gltf_place root = gltf_at("", 0, "");
    int64_t index = -1;
    struct gltf_place at;
    json_t *scene, *nodes = NULL;

    if (scene_index >= 0 && (size_t)scene_index >= json_array_size(g->scenes))
        return error_set(g->err, STATUS_ERR_INPUT, "there is no scene %lld: the file has %zu", (long long)scene_index,
                         json_array_size(g->scenes));
    if (json_array_size(g->scenes) == 0) {
        builder_warn(g->b, "no scenes", "the file has no scenes: all its nodes are rendered");
        return push_roots(w, &world);
    }
    TRY(gltf_index(g, g->root, &root, "scene", g->scenes, &index));
    if (scene_index >= 0)
        index = scene_index;
    else if (index < 0)
        index = 0;
    if (scene_index < 0 && json_array_size(g->scenes) > 1)
        builder_warn(g->b, "several scenes", "the file has %zu scenes: only scene %lld is rendered",
                     json_array_size(g->scenes), (long long)index);
    at = gltf_at("scenes", (size_t)index, "");
    TRY(gltf_row(g, g->scenes, &at, &scene));
    TRY(gltf_text(g, scene, &at, "name", title));
    TRY(gltf_array(g, scene, &at, "nodes", &nodes));
    return push_all(w, nodes, &at, "nodes", &world);
}

status gltf_walk(struct gltf *g, int64_t scene_index, const char **title)
{
    struct walk w = {.g = g};
    status result;

    w.seen = must(mem_calloc(json_array_size(g->nodes), 1));
    result = push_scene(&w, scene_index, title);
    while (result == STATUS_OK && w.count > 0) {
        const struct visit visit = w.stack[--w.count];
        result = visit_node(&w, &visit);
    }
    mem_free(w.stack);
    mem_free(w.seen);
    return result;
}
