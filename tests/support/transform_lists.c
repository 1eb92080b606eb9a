/* Lists in another order, and with more in them than they need. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/memory.h"
#include "tests/support/transform.h"

/* ---- tables ---------------------------------------------------------------------------------------- */

static void reverse(void *table, size_t count, size_t size_bytes)
{
    uint8_t *low = table, *high = low + (count > 0 ? count - 1 : 0) * size_bytes;

    for (; low < high; low += size_bytes, high -= size_bytes)
        for (size_t i = 0; i < size_bytes; i++) {
            const uint8_t other = low[i];
            low[i] = high[i];
            high[i] = other;
        }
}

/* Each row to the place that is its number. */
static void permute(void *table, size_t count, size_t size_bytes, const uint32_t *number)
{
    uint8_t *old = mem_alloc(count * size_bytes + 1), *rows = table;

    if (!old)
        abort();
    if (count > 0)
        memcpy(old, rows, count * size_bytes);
    for (size_t i = 0; i < count; i++)
        memcpy(rows + number[i] * size_bytes, old + i * size_bytes, size_bytes);
    mem_free(old);
}

static uint32_t *numbers_for(uint32_t count)
{
    uint32_t *number = mem_calloc((size_t)count + 1, sizeof *number);

    if (!number)
        abort();
    return number;
}

static int may_turn(const struct scene_material *m, int bodies) { return m->kind != MATERIAL_MIX && m->refractive == bodies; }

/* The bodies, or all others, the last first; then the rest as they are, so that parts still come before mixes. */
static void number_materials(const struct scene *scene, int bodies, uint32_t *number)
{
    uint32_t next = 0;

    for (uint32_t i = scene->material_count; i-- > 0;)
        if (may_turn(&scene->materials[i], bodies))
            number[i] = next++;
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (!may_turn(&scene->materials[i], bodies) && scene->materials[i].kind != MATERIAL_MIX)
            number[i] = next++;
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (scene->materials[i].kind == MATERIAL_MIX)
            number[i] = next++;
}

static int32_t renumbered(int32_t row, const uint32_t *number) { return row < 0 ? row : (int32_t)number[row]; }

/* A row's new number in a reversed table; -1 stays. */
static int32_t turned(int32_t number, uint32_t count) { return number < 0 ? number : (int32_t)count - 1 - number; }

/* 0: a hash of a blended material's row decides which rays pass it. */
static int turn_materials(struct scene *s, int bodies)
{
    uint32_t *number = numbers_for(s->material_count), moved = 0;

    for (uint32_t i = 0; i < s->material_count; i++)
        if (s->materials[i].alpha_mode == ALPHA_BLEND)
            return mem_free(number), 0;
    number_materials(s, bodies, number);
    for (uint32_t i = 0; i < s->material_count; i++) {
        struct scene_material *m = &s->materials[i];
        for (int k = 0; k < 2 && m->kind == MATERIAL_MIX; k++)
            m->mix_material[k] = number[m->mix_material[k]];
        moved += number[i] != i;
    }
    for (uint32_t i = 0; i < s->instance_count; i++) {
        s->instances[i].material = number[s->instances[i].material];
        s->instances[i].body = renumbered(s->instances[i].body, number);
    }
    permute(s->materials, s->material_count, sizeof *s->materials, number);
    mem_free(number);
    return moved > 0;
}

static void turn_media(struct scene *s)
{
    for (uint32_t i = 0; i < s->material_count; i++) {
        s->materials[i].medium = turned(s->materials[i].medium, s->medium_count);
        s->materials[i].medium_outside = turned(s->materials[i].medium_outside, s->medium_count);
    }
    s->fog = turned(s->fog, s->medium_count);
    reverse(s->media, s->medium_count, sizeof *s->media);
}

static void turn_textures(struct scene *s)
{
    for (uint32_t i = 0; i < s->material_count; i++)
        for (int k = 0; k < MATERIAL_TEXTURES; k++)
            s->materials[i].textures[k].texture = turned(s->materials[i].textures[k].texture, s->texture_count);
    for (uint32_t i = 0; i < s->texture_count; i++)
        s->textures[i].image = s->image_count - 1 - s->textures[i].image;
    for (uint32_t i = 0; i < s->light_count; i++)
        s->lights[i].image = turned(s->lights[i].image, s->image_count);
    reverse(s->textures, s->texture_count, sizeof *s->textures);
    reverse(s->images, s->image_count, sizeof *s->images);
}

uint32_t transform_reorder_tables(struct import_result *import)
{
    struct scene *s = &import->scene;

    turn_media(s);
    turn_textures(s);
    for (uint32_t i = 0; i < s->instance_count; i++) {
        s->instances[i].mesh = s->mesh_count - 1 - s->instances[i].mesh;
        s->instances[i].skin = turned(s->instances[i].skin, s->skin_count);
    }
    reverse(s->meshes, s->mesh_count, sizeof *s->meshes);
    reverse(s->skins, s->skin_count, sizeof *s->skins);
    return (uint32_t)turn_materials(s, 0) + (s->mesh_count + s->medium_count + s->texture_count > 1);
}

/* Of bodies of one priority in contact the first one's face shades, and rounds otherwise. */
uint32_t transform_reorder_bodies(struct import_result *import) { return (uint32_t)turn_materials(&import->scene, 1); }

/* Faces of two materials in one place, which files write one after the other: from both sides the first of them is seen. */
static int lies_on_another(const struct scene *scene, uint32_t i)
{
    const uint32_t one = scene->instances[i - 1].material, other = scene->instances[i].material;
    double low[2][3], high[2][3];

    return one != other && scene->materials[one].double_sided && scene->materials[other].double_sided &&
           scene_instance_bounds(scene, i - 1, low[0], high[0]) && scene_instance_bounds(scene, i, low[1], high[1]) &&
           memcmp(low[0], low[1], sizeof *low) == 0 && memcmp(high[0], high[1], sizeof *high) == 0;
}

/* Which lamp a random number chooses goes by their order, and by that of the instances that shine. */
uint32_t transform_reorder_lamps(struct import_result *import)
{
    struct scene *s = &import->scene;

    for (uint32_t i = 1; i < s->instance_count; i++)
        if (lies_on_another(s, i))
            return 0;
    reverse(s->lights, s->light_count, sizeof *s->lights);
    reverse(s->instances, s->instance_count, sizeof *s->instances);
    reverse(s->environment.portals, s->environment.portal_count, sizeof *s->environment.portals);
    return s->instance_count + s->light_count + s->environment.portal_count > 1;
}

/* ---- nodes ------------------------------------------------------------------------------------------ */

static uint32_t depth_of(const struct scene *scene, uint32_t node)
{
    uint32_t depth = 0;

    while (scene->nodes[node].parent >= 0) {
        node = (uint32_t)scene->nodes[node].parent;
        depth++;
    }
    return depth;
}

/* By depth, since parents come first; of one depth the last first. */
static void number_nodes(const struct scene *scene, uint32_t *number)
{
    uint32_t next = 0;

    for (uint32_t depth = 0; next < scene->node_count; depth++)
        for (uint32_t i = scene->node_count; i-- > 0;)
            if (depth_of(scene, i) == depth)
                number[i] = next++;
}

static int by_node(const void *one, const void *other)
{
    const struct scene_channel *a = one, *b = other;

    return a->node != b->node ? (a->node < b->node ? -1 : 1) : (int)a->path - (int)b->path;
}

uint32_t transform_reorder_nodes(struct import_result *import)
{
    struct scene *s = &import->scene;
    uint32_t *number = numbers_for(s->node_count);

    number_nodes(s, number);
    for (uint32_t i = 0; i < s->node_count; i++)
        s->nodes[i].parent = renumbered(s->nodes[i].parent, number);
    permute(s->nodes, s->node_count, sizeof *s->nodes, number);
    for (uint32_t i = 0; i < s->channel_count; i++)
        s->channels[i].node = number[s->channels[i].node];
    qsort(s->channels, s->channel_count, sizeof *s->channels, by_node);
    for (uint32_t i = 0; i < s->instance_count; i++)
        s->instances[i].node = renumbered(s->instances[i].node, number);
    for (uint32_t i = 0; i < s->light_count; i++)
        s->lights[i].node = renumbered(s->lights[i].node, number);
    for (uint32_t i = 0; i < s->camera_count; i++)
        s->cameras[i].node = renumbered(s->cameras[i].node, number);
    for (uint32_t i = 0; i < s->skin_count; i++)
        for (uint32_t k = 0; k < s->skins[i].joint_count; k++)
            s->skins[i].joints[k] = number[s->skins[i].joints[k]];
    mem_free(number);
    return s->node_count > 1;
}

/* ---- keys ------------------------------------------------------------------------------------------- */

/* As spline() of pose.c, with the slope. out: in-tangent, value, out-tangent. */
static void spline(const struct scene_channel *c, uint32_t key, double u, uint32_t i, float out[3])
{
    const float *from = c->values + (size_t)key * 3 * c->components + i, *to = from + 3 * (size_t)c->components;
    const double span = (double)c->times[key + 1] - (double)c->times[key], u2 = u * u, u3 = u2 * u;
    const double a = (double)from[c->components], b = (double)to[c->components];
    const double leaves = span * (double)from[2 * (size_t)c->components], comes = span * (double)to[0];

    out[1] = (float)((2 * u3 - 3 * u2 + 1) * a + (u3 - 2 * u2 + u) * leaves + (3 * u2 - 2 * u3) * b + (u3 - u2) * comes);
    out[0] = out[2] = (float)(((6 * u2 - 6 * u) * (a - b) + (3 * u2 - 4 * u + 1) * leaves + (3 * u2 - 2 * u) * comes) / span);
}

static double length(const float *v, uint32_t count)
{
    double square = 0;

    for (uint32_t i = 0; i < count; i++)
        square += (double)v[i] * (double)v[i];
    return sqrt(square);
}

/* From value a to b; rotations by the share of the angle. */
static void on_the_way(const struct scene_channel *c, const float *a, const float *b, double u, float *out)
{
    double dot = 0, wa = 1 - u, wb = u;

    if (c->path == PATH_ROTATION) {
        const double of_a = length(a, 4), of_b = length(b, 4);
        double angle;
        for (int i = 0; i < 4; i++)
            dot += (double)a[i] * (double)b[i] / (of_a * of_b);
        angle = acos(fmin(fabs(dot), 1));
        wa = (angle > 1e-6 ? sin((1 - u) * angle) / sin(angle) : wa) / of_a;
        wb = (angle > 1e-6 ? sin(u * angle) / sin(angle) : wb) / (dot < 0 ? -of_b : of_b);
    }
    for (uint32_t i = 0; i < c->components; i++)
        out[i] = (float)(wa * (double)a[i] + wb * (double)b[i]);
}

/* The key that says what is between two. */
static void write_between(const struct scene_channel *c, uint32_t key, double u, float *out)
{
    const size_t width = scene_channel_floats(c) / c->key_count;
    const float *a = c->values + key * width, *b = a + width;

    if (c->interpolation == INTERPOLATE_STEP)
        memcpy(out, a, width * sizeof *out);
    else if (c->interpolation == INTERPOLATE_LINEAR)
        on_the_way(c, a, b, u, out);
    for (uint32_t i = 0; i < c->components && c->interpolation == INTERPOLATE_CUBIC; i++) {
        float numbers[3];
        spline(c, key, u, i, numbers);
        for (uint32_t part = 0; part < 3; part++)
            out[part * c->components + i] = numbers[part];
    }
}

static void *need(struct scene *scene, size_t count, size_t size_bytes)
{
    void *memory = arena_alloc(&scene->arena, count, size_bytes);

    if (!memory)
        abort();
    return memory;
}

/* A key more between every two, and one a second after the last. */
static void add_keys(struct scene *scene, struct scene_channel *c)
{
    const size_t width = scene_channel_floats(c) / c->key_count;
    float *times = need(scene, 2 * (size_t)c->key_count, sizeof *times);
    float *values = need(scene, 2 * (size_t)c->key_count * width, sizeof *values), *last;

    for (uint32_t k = 0; k < c->key_count; k++) {
        const double from = (double)c->times[k], span = k + 1 < c->key_count ? (double)c->times[k + 1] - from : 0;
        times[2 * k] = c->times[k];
        times[2 * k + 1] = (float)(from + (span > 0 ? 0.375 * span : 1));
        if (!(times[2 * k + 1] > c->times[k]) || (span > 0 && !(times[2 * k + 1] < c->times[k + 1])))
            return;
        memcpy(values + 2 * k * width, c->values + k * width, width * sizeof *values);
        if (span > 0)
            write_between(c, k, ((double)times[2 * k + 1] - from) / span, values + (2 * k + 1) * width);
    }
    last = values + (2 * (size_t)c->key_count - 2) * width;
    if (c->interpolation == INTERPOLATE_CUBIC) /* what follows the last key stands */
        memset(last + 2 * (size_t)c->components, 0, c->components * sizeof *last);
    memcpy(last + width, last, width * sizeof *last);
    if (c->interpolation == INTERPOLATE_CUBIC)
        memset(last + width, 0, c->components * sizeof *last);
    c->times = times;
    c->values = values;
    c->key_count *= 2;
}

static int has_channel(const struct scene *scene, uint32_t count, uint32_t node, enum scene_channel_path path)
{
    for (uint32_t i = 0; i < count; i++)
        if (scene->channels[i].node == node && scene->channels[i].path == path)
            return 1;
    return 0;
}

/* Keys that keep a node as it is. */
static struct scene_channel standing(struct scene *scene, uint32_t number, enum scene_channel_path path)
{
    const struct scene_node *node = &scene->nodes[number];
    struct scene_channel c = {.node = number, .path = path, .interpolation = INTERPOLATE_LINEAR, .key_count = 2};

    c.components = path == PATH_WEIGHTS ? node->weight_count : path == PATH_ROTATION ? 4 : 3;
    c.times = need(scene, 2, sizeof *c.times);
    c.values = need(scene, 2 * (size_t)c.components, sizeof *c.values);
    c.times[1] = 1;
    for (uint32_t i = 0; i < 2 * c.components; i++) {
        const uint32_t k = i % c.components;
        c.values[i] = path == PATH_WEIGHTS ? node->weights[k]
                                           : (float)(path == PATH_ROTATION      ? node->rotation[k]
                                                     : path == PATH_TRANSLATION ? node->translation[k]
                                                                                : node->scale[k]);
    }
    return c;
}

/* Every list of keys says more than it needs, and what does not move has keys that say so. */
uint32_t transform_more_keys(struct import_result *import)
{
    struct scene *s = &import->scene;
    const uint32_t count = s->channel_count;
    struct scene_channel *channels = need(s, count + (size_t)PATH_COUNT * s->node_count + 1, sizeof *channels);

    if (count == 0)
        return 0;
    memcpy(channels, s->channels, count * sizeof *channels);
    s->channels = channels;
    for (uint32_t i = 0; i < count; i++)
        add_keys(s, &channels[i]);
    for (uint32_t i = 0; i < s->node_count; i++)
        for (int path = 0; path < PATH_COUNT; path++)
            if (!s->nodes[i].has_matrix && (path != PATH_WEIGHTS || s->nodes[i].weight_count > 0) &&
                !has_channel(s, count, i, (enum scene_channel_path)path))
                channels[s->channel_count++] = standing(s, i, (enum scene_channel_path)path);
    qsort(channels, s->channel_count, sizeof *channels, by_node);
    return count;
}
