#include <math.h>
#include <string.h>

#include "client/terminal/format.h"
#include "client/import/import.h"
#include "client/follow/job_info.h"
#include "common/image/image.h"
#include "common/image/image_size.h"
#include "common/math/elementary.h"
#include "common/scene/scene_effects.h"
#include "common/scene/pose.h"

#define LIGHT_TEXT(KIND, text, parts) text,
static const char *const light_kinds[LIGHT_KIND_COUNT] = {SCENE_LIGHT_KINDS(LIGHT_TEXT)};
#undef LIGHT_TEXT
static const char *const camera_kinds[CAMERA_KIND_COUNT] = {"perspective", "orthographic",
                                                           "panorama"};
static const char *const format_names[] = {"unknown", "PNG", "JPEG", "HDR", "EXR", "WebP", "TGA", "PFM"};

static const struct import_blob *blob_find(const struct import_result *result, const struct digest *digest)
{
    for (size_t i = 0; i < result->blob_count; i++)
        if (digest_equal(&result->blobs[i].digest, digest))
            return &result->blobs[i];
    return NULL;
}

static const char *shown(const char *name) { return *name ? name : "(no name)"; }

static uint64_t all_effects(const struct scene *scene)
{
    uint64_t set = 0;

    for (uint32_t i = 0; i < scene->camera_count; i++)
        set |= scene_effects_default(scene, i);
    return set;
}

/* Few enough to read; the JSON has all. */
enum { LISTED_MAX = 24 };

static void print_rest(FILE *out, uint32_t count)
{
    if (count > LISTED_MAX)
        fprintf(out, "    ... and %u more\n", count - LISTED_MAX);
}

static void print_images(const struct import_result *result, FILE *out)
{
    const struct scene *scene = &result->scene;

    for (uint32_t i = 0; i < scene->image_count && i < LISTED_MAX; i++) {
        const struct scene_image *image = &scene->images[i];
        const struct import_blob *blob = blob_find(result, &image->blob.digest);
        struct image_size pixels;
        if (!blob)
            continue;
        fprintf(out, "    %-32s %s", shown(image->name),
                format_names[image_format_of(blob->data, blob->size_bytes)]);
        if (image_size_of(blob->data, blob->size_bytes, &pixels))
            fprintf(out, " %ux%u", pixels.width, pixels.height);
        fprintf(out, ", %.1f kB\n", (double)blob->size_bytes / 1e3);
    }
    print_rest(out, scene->image_count);
}

static void print_cameras(const struct scene *scene, FILE *out)
{
    for (uint32_t i = 0; i < scene->camera_count && i < LISTED_MAX; i++) {
        const struct scene_camera *camera = &scene->cameras[i];
        fprintf(out, "    %u: %-29s %s", i, shown(camera->name), camera_kinds[camera->kind]);
        if (camera->kind == CAMERA_PERSPECTIVE)
            fprintf(out, ", %.1f degrees high", (double)camera->yfov_rad * 180 / PI_D);
        else
            fprintf(out, ", %g x %g m", 2 * (double)camera->xmag, 2 * (double)camera->ymag);
        if (camera->aspect > 0)
            fprintf(out, ", aspect %.3f", (double)camera->aspect);
        fputc('\n', out);
    }
    print_rest(out, scene->camera_count);
}

static void print_environment(const struct import_result *result, FILE *out)
{
    const struct scene_environment *env = &result->scene.environment;

    if (!env->present)
        fprintf(out, "environment:    none\n");
    else if (env->constant)
        fprintf(out, "environment:    constant %g %g %g\n", (double)env->radiance[0],
                (double)env->radiance[1], (double)env->radiance[2]);
    else
        fprintf(out, "environment:    %s, %.1f kB\n", shown(env->image.name),
                (double)env->image.blob.size_bytes / 1e3);
}

/* The file's own render settings. */
static void print_hints(const struct import_hints *hints, FILE *out)
{
    if (!hints->width && !hints->spp && !hints->has_max_depth)
        return;
    fprintf(out, "asks for:      ");
    if (hints->width)
        fprintf(out, " %ux%u pixels", hints->width, hints->height);
    if (hints->spp)
        fprintf(out, "%s %u samples a pixel", hints->width ? "," : "", hints->spp);
    if (hints->has_max_depth)
        fprintf(out, "%s depth %u", hints->width || hints->spp ? "," : "", hints->max_depth);
    if (hints->has_filter)
        fprintf(out, ", a %s filter %g pixels wide", pixel_filter_name(hints->pixel_filter), (double)hints->filter_width);
    fputc('\n', out);
}

static void print_variants(const struct import_result *result, FILE *out)
{
    if (result->variant_count == 0)
        return;
    fprintf(out, "variants:       %zu\n", result->variant_count);
    for (size_t i = 0; i < result->variant_count && i < LISTED_MAX; i++)
        fprintf(out, "    %zu: %s%s\n", i, shown(result->variants[i]),
                (int)i == result->variant_taken ? " (taken)" : "");
    print_rest(out, (uint32_t)result->variant_count);
}

/* What was removed from the scene because it has no visible effect. */
static void print_simplified(const struct scene_simplify_report *r, FILE *out)
{
    const struct {
        uint64_t count;
        const char *what;
    } parts[] = {
        {r->folded, "constant textures"},        {r->flat_normals, "flat normal maps"},
        {r->unseen, "textures that cannot act"}, {r->made_opaque, "materials whose alpha is 1"},
        {r->mixes, "mixes of one material"},     {(uint64_t)r->uniform_environment, "environment map of one color"},
        {r->image_bytes, "bytes of images"},
    };
    int any = 0;

    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        if (parts[i].count) {
            fprintf(out, "%s%llu %s", any ? ", " : "simplified:     ",
                    (unsigned long long)parts[i].count, parts[i].what);
            any = 1;
        }
    if (any)
        fputc('\n', out);
}

static void print_motion(const struct import_result *result, FILE *out)
{
    const struct scene *scene = &result->scene;
    uint32_t morphed = 0, targets = 0;

    if (result->animation_count)
        fprintf(out, "animations:     %zu\n", result->animation_count);
    for (size_t i = 0; i < result->animation_count && i < LISTED_MAX; i++)
        fprintf(out, "    %zu: %-29s %g s%s\n", i, shown(result->animations[i].name),
                result->animations[i].duration_s,
                result->animations[i].taken ? "" : ", left out");
    print_rest(out, (uint32_t)result->animation_count);
    if (scene->channel_count)
        fprintf(out, "motion:         %u channels move %u nodes, %g s\n", scene->channel_count,
                scene->node_count, scene_duration_s(&result->scene));
    if (scene->track_count)
        fprintf(out, "animated:       %u values of materials, lights, cameras and meshes' visibility\n", scene->track_count);
    if (scene->skin_count)
        fprintf(out, "skins:          %u\n", scene->skin_count);
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        morphed += scene->meshes[i].morph_count > 0;
        targets += scene->meshes[i].morph_count;
    }
    if (morphed)
        fprintf(out, "morph targets:  %u in %u meshes\n", targets, morphed);
}

static void print_effects(uint64_t effects, FILE *out)
{
    int first = 1;

    fprintf(out, "effects:        ");
    for (int i = 0; i < EFFECT_COUNT; i++)
        if (effects >> i & 1) {
            fprintf(out, "%s%s", first ? "" : ", ", effect_name((enum effect_bit)i));
            first = 0;
        }
    fprintf(out, "%s\n", first ? "none" : "");
}

static void print_files(const struct import_result *result, FILE *out)
{
    char size[FORMAT_SIZE];
    size_t count = result->files.count;

    fprintf(out, "takes:          %zu file%s, %s\n", count, count == 1 ? "" : "s",
            bytes_text(size, result->file_bytes));
    for (size_t i = 0; i < count && i < LISTED_MAX; i++)
        fprintf(out, "    %-32s %s\n", result->files.files[i].name,
                bytes_text(size, result->files.files[i].size_bytes));
    print_rest(out, (uint32_t)count);
}

/* The scene's place in the file's coordinates, and the spacing of floats there. */
static void print_origin(const struct import_result *result, FILE *out)
{
    const double *origin = result->scene.origin;

    fprintf(out, "centre:         %.10g, %.10g, %.10g m\n", origin[0], origin[1], origin[2]);
    if (result->position_spacing_m > 0)
        fprintf(out, "    --aov position has steps of %.2g m at its far end\n", result->position_spacing_m);
}

void import_report_print(const struct import_result *result, FILE *out)
{
    const struct scene *scene = &result->scene;
    char hex[DIGEST_HEX_SIZE];

    digest_to_hex(&result->scene_digest, hex);
    fprintf(out, "file:           %s\n", result->source);
    print_files(result, out);
    fprintf(out, "scene:          %s\n", shown(scene->name));
    fprintf(out, "triangles:      %llu, placed %llu\n", (unsigned long long)result->triangles,
            (unsigned long long)result->triangles_placed);
    fprintf(out, "vertices:       %llu\n", (unsigned long long)result->vertices);
    fprintf(out, "meshes:         %u in %u instances\n", scene->mesh_count, scene->instance_count);
    print_origin(result, out);
    fprintf(out, "materials:      %u\n", scene->material_count);
    for (uint32_t i = 0; i < scene->material_count && i < LISTED_MAX; i++)
        fprintf(out, "    %s\n", shown(scene->materials[i].name));
    print_rest(out, scene->material_count);
    print_variants(result, out);
    fprintf(out, "images:         %u in %u textures\n", scene->image_count, scene->texture_count);
    print_images(result, out);
    fprintf(out, "lights:         %u\n", scene->light_count);
    for (uint32_t i = 0; i < scene->light_count && i < LISTED_MAX; i++)
        fprintf(out, "    %-32s %s\n", shown(scene->lights[i].name),
                light_kinds[scene->lights[i].kind]);
    print_rest(out, scene->light_count);
    fprintf(out, "cameras:        %u\n", scene->camera_count);
    print_cameras(scene, out);
    print_motion(result, out);
    print_simplified(&result->simplified, out);
    print_environment(result, out);
    print_hints(&result->hints, out);
    print_effects(all_effects(scene), out);
    fprintf(out, "bytes:          %llu in %zu blobs, scene %zu\n",
            (unsigned long long)result->blob_bytes, result->blob_count, result->packed_bytes);
    fprintf(out, "digest:         %s\n", hex);
    for (size_t i = 0; i < result->warning_count; i++)
        fprintf(out, "warning: %s\n", result->warnings[i]);
}

/* ---- JSON --------------------------------------------------------------------------------- */

/* Append, and give up on everything when memory is short: `list` may be NULL by then. */
static int add(json_t *list, json_t *item) { return json_array_append_new(list, item) == 0; }

static json_t *materials_json(const struct scene *scene)
{
    json_t *list = json_array();

    for (uint32_t i = 0; list && i < scene->material_count; i++)
        if (!add(list, json_string(scene->materials[i].name))) {
            json_decref(list);
            return NULL;
        }
    return list;
}

static json_t *images_json(const struct import_result *result)
{
    const struct scene *scene = &result->scene;
    json_t *list = json_array();

    for (uint32_t i = 0; list && i < scene->image_count; i++) {
        const struct scene_image *image = &scene->images[i];
        const struct import_blob *blob = blob_find(result, &image->blob.digest);
        struct image_size pixels = {0};
        char hex[DIGEST_HEX_SIZE];

        digest_to_hex(&image->blob.digest, hex);
        if (blob)
            image_size_of(blob->data, blob->size_bytes, &pixels);
        if (!add(list, json_pack("{s:s, s:s, s:i, s:i, s:I, s:s}", "name", image->name, "format",
                                 blob ? format_names[image_format_of(blob->data, blob->size_bytes)] : format_names[0],
                                 "width", (int)pixels.width, "height", (int)pixels.height, "bytes",
                                 (json_int_t)image->blob.size_bytes, "digest", hex))) {
            json_decref(list);
            return NULL;
        }
    }
    return list;
}

json_t *import_inputs_json(const struct import_result *result)
{
    const struct input_files *files = &result->files;
    json_t *list = json_array();

    for (size_t i = 0; list && i < files->count; i++)
        if (!add(list, json_pack("{s:o, s:I}", "name", json_text(files->files[i].name), "bytes",
                                 (json_int_t)files->files[i].size_bytes))) {
            json_decref(list);
            return NULL;
        }
    return list;
}

static json_t *lights_json(const struct scene *scene)
{
    json_t *list = json_array();

    for (uint32_t i = 0; list && i < scene->light_count; i++)
        if (!add(list,
                 json_pack("{s:s, s:s}", "name", scene->lights[i].name, "kind", light_kinds[scene->lights[i].kind]))) {
            json_decref(list);
            return NULL;
        }
    return list;
}

static json_t *cameras_json(const struct scene *scene)
{
    json_t *list = json_array();

    for (uint32_t i = 0; list && i < scene->camera_count; i++) {
        const struct scene_camera *camera = &scene->cameras[i];
        if (!add(list,
                 json_pack("{s:s, s:s, s:f, s:f, s:f, s:f}", "name", camera->name, "kind", camera_kinds[camera->kind],
                           "yfov_rad", (double)camera->yfov_rad, "xmag", (double)camera->xmag, "ymag",
                           (double)camera->ymag, "aspect", (double)camera->aspect))) {
            json_decref(list);
            return NULL;
        }
    }
    return list;
}

static json_t *environment_json(const struct scene_environment *env)
{
    if (!env->present)
        return json_null();
    if (env->constant)
        return json_pack("{s:s, s:[f, f, f]}", "kind", "constant", "radiance", (double)env->radiance[0],
                         (double)env->radiance[1], (double)env->radiance[2]);
    return json_pack("{s:s, s:s, s:I}", "kind", "map", "name", env->image.name, "bytes",
                     (json_int_t)env->image.blob.size_bytes);
}

static json_t *effects_json(uint64_t effects)
{
    json_t *list = json_array();

    for (int i = 0; list && i < EFFECT_COUNT; i++)
        if ((effects >> i & 1) && !add(list, json_string(effect_name((enum effect_bit)i)))) {
            json_decref(list);
            return NULL;
        }
    return list;
}

static json_t *variants_json(const struct import_result *result)
{
    json_t *list = json_array();

    for (size_t i = 0; list && i < result->variant_count; i++)
        if (!add(list, json_string(result->variants[i]))) {
            json_decref(list);
            return NULL;
        }
    return list;
}

static json_t *animations_json(const struct import_result *result)
{
    json_t *list = json_array();

    for (size_t i = 0; list && i < result->animation_count; i++)
        if (!add(list, json_pack("{s:s, s:f, s:b}", "name", result->animations[i].name, "duration_s",
                                 result->animations[i].duration_s, "taken", result->animations[i].taken))) {
            json_decref(list);
            return NULL;
        }
    return list;
}

static int morph_targets(const struct scene *scene)
{
    uint32_t count = 0;

    for (uint32_t i = 0; i < scene->mesh_count; i++)
        count += scene->meshes[i].morph_count;
    return (int)count;
}

static json_t *warnings_json(const struct import_result *result)
{
    json_t *list = json_array();

    for (size_t i = 0; list && i < result->warning_count; i++) {
        /* It may contain a file's name, in any encoding. */
        json_t *text = json_string(result->warnings[i]);
        if (!add(list, text ? text : json_string("(a warning that is not valid UTF-8)"))) {
            json_decref(list);
            return NULL;
        }
    }
    return list;
}

static json_t *hints_json(const struct import_hints *hints)
{
    json_t *out = json_object();

    if (hints->width)
        json_object_set_new(out, "size", json_pack("[i, i]", (int)hints->width, (int)hints->height));
    if (hints->spp)
        json_object_set_new(out, "spp", json_integer(hints->spp));
    if (hints->has_max_depth)
        json_object_set_new(out, "max_depth", json_integer(hints->max_depth));
    if (hints->has_filter) {
        json_object_set_new(out, "pixel_filter", json_string(pixel_filter_name(hints->pixel_filter)));
        json_object_set_new(out, "filter_width", json_real((double)hints->filter_width));
    }
    if (hints->crop_width)
        json_object_set_new(out, "region", json_pack("[i, i, i, i]", (int)hints->crop_x, (int)hints->crop_y,
                                                     (int)hints->crop_width, (int)hints->crop_height));
    return out;
}

json_t *import_report_json(const struct import_result *result)
{
    const struct scene *scene = &result->scene;
    uint64_t effects = all_effects(scene);
    json_t *source = json_string(result->source);
    char hex[DIGEST_HEX_SIZE];

    digest_to_hex(&result->scene_digest, hex);
    /* "o" takes the reference also when packing fails, and a NULL makes it fail. */
    return json_pack(
        "{s:o, s:o, s:s, s:s, s:I, s:I, s:I, s:I, s:i, s:i, s:i, s:o, s:o, s:o, s:o, s:o, s:o, "
        "s:{s:I, s:I, s:I}, s:o, s:o, s:i, s:o, s:f, s:i, s:i, s:i, s:i, s:i, "
        "s:{s:i, s:i, s:i, s:i, s:i, s:b, s:I}, s:o, s:[f,f,f], s:f}",
        "file", source ? source : json_null(), "inputs", import_inputs_json(result), "name", scene->name, "digest", hex,
        "triangles", (json_int_t)result->triangles, "triangles_placed", (json_int_t)result->triangles_placed,
        "vertices", (json_int_t)result->vertices, "degenerate_triangles", (json_int_t)result->degenerate_triangles,
        "meshes", (int)scene->mesh_count, "instances", (int)scene->instance_count, "textures",
        (int)scene->texture_count, "materials", materials_json(scene), "images", images_json(result), "lights",
        lights_json(scene), "cameras", cameras_json(scene), "environment", environment_json(&scene->environment),
        "effects", effects_json(effects), "bytes", "blobs", (json_int_t)result->blob_bytes, "scene",
        (json_int_t)result->packed_bytes, "count", (json_int_t)result->blob_count, "warnings", warnings_json(result),
        "variants", variants_json(result), "variant_taken", result->variant_taken, "animations",
        animations_json(result), "duration_s", scene_duration_s(&result->scene), "nodes", (int)scene->node_count,
        "channels", (int)scene->channel_count, "tracks", (int)scene->track_count, "skins", (int)scene->skin_count,
        "morph_targets", morph_targets(scene), "simplified", "constant_textures", (int)result->simplified.folded,
        "flat_normal_maps", (int)result->simplified.flat_normals, "unseen_textures", (int)result->simplified.unseen,
        "made_opaque", (int)result->simplified.made_opaque, "mixes", (int)result->simplified.mixes,
        "uniform_environment", result->simplified.uniform_environment, "image_bytes",
        (json_int_t)result->simplified.image_bytes, "asks", hints_json(&result->hints), "origin", scene->origin[0],
        scene->origin[1], scene->origin[2], "position_spacing_m", result->position_spacing_m);
}
