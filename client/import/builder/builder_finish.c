/* builder: the end of an import, when the tables are handed over as a scene. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/import/builder/bodies.h"
#include "client/import/builder/builder.h"
#include "client/import/builder/studio.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "common/scene/scene_effects.h"
#include "common/scene/track.h"

struct ordered_channel {
    struct scene_channel channel;
    size_t order;
};

static int channel_compare(const struct scene_channel *a, const struct scene_channel *b)
{
    if (a->node != b->node)
        return a->node < b->node ? -1 : 1;
    return (a->path > b->path) - (a->path < b->path);
}

static int ordered_compare(const void *a, const void *b)
{
    const struct ordered_channel *x = a, *y = b;
    int order = channel_compare(&x->channel, &y->channel);

    return order ? order : (x->order > y->order) - (x->order < y->order);
}

/* Sort the channels; of two for one property the one that was added first stays. */
static void sort_channels(struct builder *b)
{
    struct ordered_channel *list = must(mem_alloc_array(b->channel_count, sizeof *list));
    size_t kept = 0;

    for (size_t i = 0; i < b->channel_count; i++)
        list[i] = (struct ordered_channel){b->channels[i], i};
    qsort(list, b->channel_count, sizeof *list, ordered_compare);
    for (size_t i = 0; i < b->channel_count; i++) {
        if (kept && channel_compare(&b->channels[kept - 1], &list[i].channel) == 0) {
            builder_warn(b, "animated twice", "several animations move the same thing: the first one is taken");
            continue;
        }
        b->channels[kept++] = list[i].channel;
    }
    b->channel_count = kept;
    mem_free(list);
}

static int track_compare(const void *a, const void *b) { return scene_track_compare(a, b); }

#define HAND_OVER(type, table, count)                                            \
    do {                                                                         \
        scene->table = must(ARENA_ARRAY(&scene->arena, type, b->count));         \
        if (b->count)                                                            \
            memcpy(scene->table, b->table, b->count * sizeof(type));             \
        scene->count = (uint32_t)b->count;                                       \
    } while (0)

static status hand_over_tables(struct builder *b)
{
    struct scene *scene = &b->out->scene;

    sort_channels(b);
    HAND_OVER(struct scene_mesh, meshes, mesh_count);
    HAND_OVER(struct scene_image, images, image_count);
    HAND_OVER(struct scene_texture, textures, texture_count);
    HAND_OVER(struct scene_material, materials, material_count);
    HAND_OVER(struct scene_instance, instances, instance_count);
    HAND_OVER(struct scene_light, lights, light_count);
    HAND_OVER(struct scene_node, nodes, node_count);
    HAND_OVER(struct scene_channel, channels, channel_count);
    HAND_OVER(struct scene_track, tracks, track_count);
    if (scene->track_count)
        qsort(scene->tracks, scene->track_count, sizeof *scene->tracks, track_compare);
    HAND_OVER(struct scene_skin, skins, skin_count);
    HAND_OVER(struct scene_medium, media, medium_count);
    scene->environment = b->environment;
    scene->environment.portal_count = (uint32_t)b->portal_count;
    scene->environment.portals = NULL;
    if (b->portal_count) {
        struct scene_portal *portals = must(ARENA_ARRAY(&scene->arena, struct scene_portal, b->portal_count));
        memcpy(portals, b->portals, b->portal_count * sizeof *portals);
        scene->environment.portals = portals;
    }
    scene->fog = b->fog;
    scene->volume_rule = b->volume_rule;
    return STATUS_OK;
}

/* *framed: the camera that must still be aimed, or NULL. */
static status hand_over_cameras(struct builder *b, struct scene_camera **framed)
{
    struct scene *scene = &b->out->scene;
    int none = b->camera_count == 0;

    if (none) {
        struct scene_camera camera;
        scene_camera_default(&camera);
        camera.name = builder_name(b, "framed");
        TRY(builder_add_camera(b, &camera));
    }
    HAND_OVER(struct scene_camera, cameras, camera_count);
    *framed = none ? &scene->cameras[0] : NULL;
    return STATUS_OK;
}

/* What is nowhere seen is most often a mistake of the file. */
static void warn_of_invisible(struct builder *b)
{
    const struct scene *scene = &b->out->scene;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_material *m = &scene->materials[scene->instances[i].material];
        if (m->alpha_mode == ALPHA_BLEND ? m->base_color[3] <= 0 : m->alpha_mode == ALPHA_MASK && m->base_color[3] < m->alpha_cutoff)
            builder_warn(b, "invisible", "the material \"%.200s\" is invisible: its opacity is %g", m->name, (double)m->base_color[3]);
    }
}

/* From outside such a body shows its back faces alone. bodies_find() reports those that let light through; a lamp may shine
 * inwards. */
static void warn_of_inside_out(struct builder *b)
{
    const struct scene *scene = &b->out->scene;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const struct scene_material *m = &scene->materials[scene->instances[i].material];
        if (scene->meshes[scene->instances[i].mesh].closed < 0 && !m->double_sided && m->transmission == 0 &&
            m->emission[0] + m->emission[1] + m->emission[2] == 0)
            builder_warn(b, "inside out",
                         "the mesh \"%.200s\" is closed, but all its faces look inwards, and its material \"%.80s\" is "
                         "single-sided: from outside it is black; turn its faces around",
                         scene->meshes[scene->instances[i].mesh].name, m->name);
    }
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        scene->meshes[i].closed = scene->meshes[i].closed > 0;
}

/* Unlit materials emit by themselves and need no light. */
static int is_unlit(const struct scene *scene)
{
    for (uint32_t i = 0; i < scene->instance_count; i++)
        if (!scene->materials[scene->instances[i].material].unlit)
            return 0;
    return scene->instance_count > 0;
}

/* A scene without light would be black. */
static int is_dark(const struct scene *scene)
{
    const uint64_t lights = EFFECT_PUNCTUAL_LIGHT | EFFECT_ENVIRONMENT | EFFECT_EMISSIVE_MESH;

    return !is_unlit(scene) && !(scene_effects_default(scene, 0) & lights);
}

static void light_evenly(struct builder *b)
{
    struct scene *scene = &b->out->scene;

    scene_environment_default(&scene->environment);
    scene->environment.present = scene->environment.constant = 1;
    builder_warn(b, "no light",
                 "the file has no light: an even white environment of radiance 1 was added (give "
                 "an environment map, or add lights to the file)%s",
                 b->no_light_hint);
}

/* Where the emission of surfaces is the scene's only light: how many instances shine, if none does so as a lamp. glTF's
 * emissiveFactor and MTL's Ke of at most 1 are meant to be seen beside other light; lamps have a strength above that. */
static uint32_t count_glowing(const struct scene *scene)
{
    uint32_t count = 0;

    for (uint32_t i = 0; i < scene->instance_count; i++) {
        const float *emission = scene->materials[scene->instances[i].material].emission;
        if (emission[0] > 1 || emission[1] > 1 || emission[2] > 1)
            return 0;
        count += emission[0] > 0 || emission[1] > 0 || emission[2] > 0;
    }
    return count;
}

/* Add what the file lacks for a picture, and say so: a camera was `added` if it had none. Lights without power are meant to be off. */
static status complete(struct builder *b, int added, const struct import_options *options)
{
    const struct scene *scene = &b->out->scene;
    int stated = b->has_light || b->environment.present, dark = is_dark(scene), unlit = dark && !stated;
    uint32_t glowing = dark || stated || is_unlit(scene) ? 0 : count_glowing(scene);
    int studio = (unlit || glowing > 0) && strcmp(options->studio, "on") == 0 && scene->instance_count > 0;
    const char *off = glowing > 0 ? "none" : "an even white environment instead";
    char only[64] = "";

    if (glowing > 0)
        snprintf(only, sizeof only, " but %u surface%s that glow%s", glowing, glowing == 1 ? "" : "s", glowing == 1 ? "s" : "");
    if (studio)
        TRY(studio_light(b));
    if (studio && added) {
        builder_warn(b, "no camera, no light",
                     "the file has neither camera nor light%s: a camera that looks at the whole scene, a soft studio light and "
                     "a grey ground were added (--studio off: %s)%s%s",
                     only, off, b->no_camera_hint, b->no_light_hint);
        return studio_ground(b, b->framed_center, b->framed_low_y, b->framed_distance);
    }
    if (added)
        builder_warn(b, "no camera", "the file has no camera: one was added that looks at the whole scene%s",
                     b->no_camera_hint);
    if (studio)
        builder_warn(b, "no light",
                     "the file has no light%s: a soft studio light was added (give an environment map, or add lights to the "
                     "file; --studio off: %s)%s",
                     only, off, b->no_light_hint);
    else if (unlit)
        light_evenly(b);
    else if (dark)
        builder_warn(b, "no power", "none of the lights has any power: the picture will be black");
    return STATUS_OK;
}

static void hand_over_warnings(struct builder *b)
{
    struct import_result *out = b->out;
    size_t count = b->warning_count + (b->warnings_dropped ? 1 : 0);
    struct buffer text = BUFFER_INIT;

    if (count == 0)
        return;
    out->warnings = must(mem_calloc(count, sizeof *out->warnings));
    for (size_t i = 0; i < b->warning_count; i++) {
        struct builder_warning *w = &b->warnings[i];
        if (w->count > 1) {
            buffer_printf(&text, "%s (and %llu more of this kind)", w->text, (unsigned long long)(w->count - 1));
            must_hold(&text);
            out->warnings[out->warning_count++] = (char *)text.data;
            buffer_init(&text);
        } else {
            out->warnings[out->warning_count++] = w->text;
            w->text = NULL;
        }
    }
    if (b->warnings_dropped) {
        buffer_printf(&text, "%llu further warnings are not shown", (unsigned long long)b->warnings_dropped);
        must_hold(&text);
        out->warnings[out->warning_count++] = (char *)text.data;
    }
}

static int blob_compare(const void *a, const void *b)
{
    const struct scene_blob *x = a, *y = b;

    return memcmp(x->digest.bytes, y->digest.bytes, DIGEST_BYTES);
}

/* Drop the blobs that the scene does not name. */
static status prune_blobs(struct builder *b)
{
    struct import_result *out = b->out;
    struct scene_blob *named = NULL;
    size_t named_count = 0, kept = 0;

    TRY(scene_blobs(&out->scene, &named, &named_count, b->err));
    qsort(named, named_count, sizeof *named, blob_compare);
    out->blob_bytes = 0;
    for (size_t i = 0; i < out->blob_count; i++) {
        const struct scene_blob key = {.digest = out->blobs[i].digest};
        if (!bsearch(&key, named, named_count, sizeof *named, blob_compare)) {
            mem_free(out->blobs[i].data);
            continue;
        }
        out->blob_bytes += out->blobs[i].size_bytes;
        out->blobs[kept++] = out->blobs[i];
    }
    out->blob_count = kept;
    mem_free(named);
    return STATUS_OK;
}

status builder_nothing(struct builder *b, const char *why)
{
    for (size_t i = 0; i < b->warning_count; i++)
        if (strstr(b->warnings[i].text, "left out") || strstr(b->warnings[i].text, "not rendered"))
            return error_set(b->err, STATUS_ERR_INPUT, "there is nothing to render: %s; %s", why, b->warnings[i].text);
    return error_set(b->err, STATUS_ERR_INPUT, "there is nothing to render: %s", why);
}

static status blob_get(void *user, const struct digest *digest, const uint8_t **data, size_t *size_bytes,
                       struct error *err)
{
    const struct scene_blob wanted = {.digest = *digest};
    const struct import_blob *blob = builder_blob(user, &wanted);

    if (!blob)
        return error_set(err, STATUS_ERR_INTERNAL, "a blob of the scene is missing");
    *data = blob->data;
    *size_bytes = blob->size_bytes;
    return STATUS_OK;
}

struct scene_blob_reader builder_reader(struct builder *b) { return (struct scene_blob_reader){blob_get, b}; }

/* Remove what no picture can show; this also finds damaged images. */
static status simplify(struct builder *b)
{
    status result = scene_simplify(&b->out->scene, builder_reader(b), &b->out->simplified, b->err);

    return b->out->simplified.image_failed ? builder_damage(b, result) : result;
}

status builder_finish(struct builder *b, const char *title, const struct import_options *options)
{
    struct import_result *out = b->out;
    struct buffer packed = BUFFER_INIT;
    struct scene_camera *framed = NULL;
    status result;

    if (b->instance_count == 0 && b->camera_count == 0)
        return builder_nothing(b, "the scene has no triangles and no camera");
    if (b->instance_count == 0)
        builder_warn(b, "empty", "the scene has no triangles: only the environment will be seen");
    if (options->env_path)
        TRY(builder_read_environment(b, options->env_path));
    out->scene.name = builder_name(b, title);
    result = hand_over_tables(b);
    THEN(result, hand_over_cameras(b, &framed));
    if (result != STATUS_OK)
        return result;
    warn_of_inside_out(b);
    result = scene_validate(&out->scene, b->err);
    if (result == STATUS_OK) {
        scene_rebase(b);
        result = scene_place(b, framed);
    }
    if (result == STATUS_OK)
        result = scene_validate(&out->scene, b->err); /* as it was placed */
    if (result != STATUS_OK)
        return result;
    warn_of_invisible(b);
    result = simplify(b);
    THEN(result, bodies_find(b));
    THEN(result, scene_report_views(b));
    if (result != STATUS_OK)
        return result;
    TRY(complete(b, framed != NULL, options));
    TRY(prune_blobs(b));
    if (out->degenerate_triangles)
        builder_warn(b, "degenerate", "%llu triangles without area were left out",
                     (unsigned long long)out->degenerate_triangles);
    hand_over_warnings(b);
    result = scene_pack(&out->scene, &packed, b->err);
    if (result == STATUS_OK && digest_of(&out->scene_digest, packed.data, packed.size) != STATUS_OK)
        result = error_no_memory(b->err, "the scene's digest");
    if (result == STATUS_OK) {
        out->packed = packed.data;
        out->packed_bytes = packed.size;
        return STATUS_OK;
    }
    buffer_release(&packed);
    return result;
}
