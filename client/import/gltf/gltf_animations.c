/* glTF: animations. Channels are read and checked before the scene is walked, because the walk must
 * know what moves; afterwards those of the scene's nodes are added. */
#include <math.h>
#include <string.h>

#include "client/import/gltf/gltf.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

static const char *const path_names[PATH_COUNT] = {"translation", "rotation", "scale", "weights"};

static int path_of(const char *name)
{
    for (int i = 0; i < PATH_COUNT; i++)
        if (strcmp(name, path_names[i]) == 0)
            return i;
    return -1;
}

/* ---- channels ------------------------------------------------------------------------------- */

/* "/nodes/3/translation" */
static int parse_pointer(const char *pointer, size_t node_count, uint32_t *node, int *path)
{
    uint64_t number = 0;
    const char *at = pointer;

    if (strncmp(at, "/nodes/", 7) != 0)
        return 0;
    at += 7;
    if (*at < '0' || *at > '9')
        return 0;
    for (; *at >= '0' && *at <= '9' && number <= node_count; at++)
        number = number * 10 + (uint64_t)(*at - '0');
    if (*at++ != '/' || number >= node_count)
        return 0;
    *node = (uint32_t)number;
    *path = path_of(at);
    return *path >= 0;
}

/* The target of a channel: *value, and its row, or a node and *path. NULL and -1, with a warning: it cannot be animated. */
static status read_target(struct gltf *g, json_t *channel, const struct gltf_place *at, uint32_t *node, int *path,
                          const struct gltf_value **value)
{
    const struct gltf_place inner = gltf_within(at, ".target");
    const char *name = "", *pointer = "";
    json_t *target = NULL, *extension;
    int64_t index = -1;

    *path = -1;
    *value = NULL;
    TRY(gltf_object(g, channel, at, "target", &target));
    TRY(gltf_text(g, target, &inner, "path", &name));
    TRY(gltf_index(g, target, &inner, "node", g->nodes, &index));
    extension = gltf_extension(target, "KHR_animation_pointer");
    if (extension)
        TRY(gltf_text(g, extension, &inner, "pointer", &pointer));
    if (extension && !parse_pointer(pointer, json_array_size(g->nodes), node, path)) {
        *value = gltf_value_find(pointer, node);
        if (!*value)
            builder_warn(g->b, "animation pointer", "%s[%zu]%s: animates \"%.80s\", which stands still here", at->table,
                         at->row, at->part, pointer);
        return STATUS_OK;
    }
    if (extension || index < 0) /* without a node there is nothing to move (glTF 2.0, 3.11) */
        return STATUS_OK;
    *node = (uint32_t)index;
    *path = path_of(name);
    if (*path < 0)
        builder_warn(g->b, "animation path", "%s[%zu]%s: animates the %.32s of a node, which is not known: left out",
                     at->table, at->row, at->part, name);
    return STATUS_OK;
}

/* The number of floats in a key of the path; 0, with a warning: the node has no such property. */
static status count_components(struct gltf *g, const struct gltf_place *at, uint32_t node, int path, uint32_t *out)
{
    const struct gltf_place at_node = gltf_at("nodes", node, "");
    json_t *row;
    int64_t mesh = -1;

    TRY(gltf_row(g, g->nodes, &at_node, &row));
    *out = path == PATH_ROTATION ? 4 : 3;
    if (path != PATH_WEIGHTS && json_object_get(row, "matrix")) {
        builder_warn(g->b, "animated matrix",
                     "%s[%zu]%s: animates nodes[%u], which has a matrix: it stands still (export "
                     "it with translation, rotation and scale)",
                     at->table, at->row, at->part, node);
        *out = 0;
    }
    if (path != PATH_WEIGHTS)
        return STATUS_OK;
    TRY(gltf_index(g, row, &at_node, "mesh", g->meshes, &mesh));
    *out = mesh < 0 ? 0 : (uint32_t)gltf_target_count(g, (size_t)mesh);
    if (*out == 0)
        builder_warn(g->b, "weights without targets",
                     "%s[%zu]%s: animates the weights of nodes[%u], which has no morph targets", at->table, at->row,
                     at->part, node);
    return STATUS_OK;
}

static status read_channel(struct gltf *g, json_t *channel, json_t *samplers, const struct gltf_place *animation,
                           const struct gltf_place *at, double *duration_s)
{
    struct gltf_channel out = {0};
    const struct gltf_value *value;
    struct gltf_place at_sampler;
    int64_t sampler = -1;
    int path;
    status result;

    if (!json_is_object(channel))
        return gltf_fail(g, STATUS_ERR_INPUT, at, "must be an object");
    TRY(read_target(g, channel, at, &out.channel.node, &path, &value));
    TRY(gltf_index(g, channel, at, "sampler", samplers, &sampler));
    if (path < 0 && (!value || !gltf_value_is_seen(value)))
        return STATUS_OK;
    if (sampler < 0)
        return gltf_fail(g, STATUS_ERR_INPUT, at, "names no sampler");
    at_sampler = gltf_within(animation, ".samplers[%lld]", (long long)sampler);
    if (value)
        return gltf_track(g, value, out.channel.node, json_array_get(samplers, (size_t)sampler), &at_sampler, at, duration_s);
    if (g->node_data[out.channel.node].channels[path] >= 0) {
        builder_warn(g->b, "animated twice",
                     "%s[%zu]%s: animates the %s of nodes[%u], which an earlier channel does already: the first is "
                     "taken (--animation \"%.80s\" takes this animation alone)",
                     at->table, at->row, at->part, path_names[path], out.channel.node,
                     g->b->out->animations[at->row].name);
        return STATUS_OK;
    }
    out.channel.path = (enum scene_channel_path)path;
    TRY(count_components(g, at, out.channel.node, path, &out.channel.components));
    if (out.channel.components == 0)
        return STATUS_OK;
    if (g->channel_count >= SCENE_CHANNELS_MAX)
        return gltf_fail(g, STATUS_ERR_LIMIT, at, "the file has more than %d animation channels", SCENE_CHANNELS_MAX);
    result = gltf_keys(g, json_array_get(samplers, (size_t)sampler), &at_sampler, path_names[path], &out.channel);
    MUST_GROW(g->channels, g->channel_capacity, g->channel_count + 1);
    if (result != STATUS_OK) {
        gltf_keys_release(&out.channel);
        return result;
    }
    *duration_s = fmax(*duration_s, (double)out.channel.times[out.channel.key_count - 1]);
    out.still = gltf_keys_are_still(&out.channel);
    if (!out.still)
        g->node_data[out.channel.node].animated |= 1u << path;
    g->node_data[out.channel.node].channels[path] = (int32_t)g->channel_count;
    g->channels[g->channel_count++] = out;
    return STATUS_OK;
}

/* *duration_s is initialised from the accessors' claims. That value remains for a channel that is
 * not read because an earlier animation moves the same property: such a channel counts, too. */
static status read_animation(struct gltf *g, size_t index, double *duration_s)
{
    const struct gltf_place at = gltf_at("animations", index, "");
    json_t *animation, *channels = NULL, *samplers = NULL;
    size_t before = g->channel_count;
    double read_s = 0;

    TRY(gltf_row(g, g->animations, &at, &animation));
    TRY(gltf_array(g, animation, &at, "channels", &channels));
    TRY(gltf_array(g, animation, &at, "samplers", &samplers));
    for (size_t i = 0; i < json_array_size(channels); i++) {
        const struct gltf_place inner = gltf_within(&at, ".channels[%zu]", i);
        TRY(read_channel(g, json_array_get(channels, i), samplers, &at, &inner, &read_s));
    }
    if (g->channel_count - before == json_array_size(channels) || read_s > *duration_s)
        *duration_s = read_s;
    return STATUS_OK;
}

/* ---- the list ------------------------------------------------------------------------------- */

/* From the accessors' own claims: good enough for a list. */
static double claimed_duration(const struct gltf *g, size_t index)
{
    json_t *samplers = json_object_get(json_array_get(g->animations, index), "samplers");
    double duration = 0;

    for (size_t i = 0; i < json_array_size(samplers); i++) {
        json_t *input = json_object_get(json_array_get(samplers, i), "input");
        json_t *accessor = json_array_get(g->accessors, (size_t)json_integer_value(input));
        double last = json_number_value(json_array_get(json_object_get(accessor, "max"), 0));
        if (last > duration && last <= GLTF_TIME_MAX_S)
            duration = last;
    }
    return duration;
}

/* Their names; the list is the caller's. */
static const char **list_animations(struct gltf *g)
{
    struct import_result *out = g->b->out;
    size_t count = json_array_size(g->animations);
    const char **names = must(mem_calloc(count, sizeof *names));

    out->animations = must(ARENA_ARRAY(&out->scene.arena, struct import_animation, count));
    out->animation_count = count;
    for (size_t i = 0; i < count; i++) {
        const char *name = json_string_value(json_object_get(json_array_get(g->animations, i), "name"));
        names[i] = out->animations[i].name = builder_name(g->b, name);
        out->animations[i].duration_s = claimed_duration(g, i);
    }
    return names;
}

/* One key each, as Godot's RESET has: where to begin from. */
static int is_pose(const struct gltf *g, size_t index)
{
    json_t *samplers = json_object_get(json_array_get(g->animations, index), "samplers"), *sampler;
    size_t i;

    json_array_foreach(samplers, i, sampler) {
        json_t *accessor = json_array_get(g->accessors, (size_t)json_integer_value(json_object_get(sampler, "input")));
        if (json_integer_value(json_object_get(accessor, "count")) != 1)
            return 0;
    }
    return json_array_size(samplers) > 0;
}

/* Taken first, a pose would hold still what others move. */
static int is_left_out(struct gltf *g, size_t index, size_t moving)
{
    if (moving == 0 || !is_pose(g, index))
        return 0;
    builder_warn(g->b, "pose",
                 "animations[%zu] \"%.80s\" is a pose without duration beside others that last: left out "
                 "(--animation %zu takes it)",
                 index, g->b->out->animations[index].name, index);
    return 1;
}

status gltf_animations(struct gltf *g, const char *wanted)
{
    struct import_result *out = g->b->out;
    const char **names = list_animations(g);
    status result = STATUS_OK;
    int none = wanted && strcmp(wanted, "none") == 0, chosen = -1;
    size_t moving = 0;

    for (size_t i = 0; i < out->animation_count; i++)
        moving += !is_pose(g, i);
    if (wanted && !none) {
        chosen = gltf_choice(wanted, names, out->animation_count);
        if (chosen < 0)
            result = error_set(g->err, STATUS_ERR_INPUT,
                               "there is no animation \"%.80s\": the file has %zu (azulejo import "
                               "lists them)",
                               wanted, out->animation_count);
    }
    mem_free(names);
    for (size_t i = 0; result == STATUS_OK && !none && i < out->animation_count; i++) {
        if (chosen >= 0 ? (size_t)chosen != i : is_left_out(g, i, moving))
            continue;
        out->animations[i].taken = 1;
        result = read_animation(g, i, &out->animations[i].duration_s);
    }
    return result;
}

status gltf_add_channels(struct gltf *g)
{
    for (size_t i = 0; i < g->channel_count; i++) {
        struct scene_channel channel = g->channels[i].channel;
        const struct gltf_node *node = &g->node_data[channel.node];
        if (g->channels[i].still || node->row == GLTF_ROW_UNREAD)
            continue;
        channel.node = (uint32_t)node->row;
        if (channel.path == PATH_WEIGHTS && g->b->nodes[channel.node].weight_count != channel.components)
            continue;
        TRY(builder_add_channel(g->b, &channel));
    }
    return STATUS_OK;
}
