#include "client/import/import.h"

#include <string.h>

#include "client/terminal/format.h"
#include "client/import/builder/builder.h"
#include "client/import/gltf/gltf.h"
#include "client/import/obj/obj.h"
#include "client/import/pbrt/pbrt.h"
#include "client/import/ply/ply_scene.h"
#include "client/terminal/must.h"
#include "common/base/buffer.h"
#include "common/system/file.h"
#include "common/base/memory.h"

/* In the order in which they are tried. */
static const struct import_format *const formats[] = {
    &format_gltf,
    &format_ply,
    &format_pbrt,
    &format_obj,
};
enum { FORMAT_COUNT = sizeof formats / sizeof *formats };

/* Its row in the table; FORMAT_COUNT: none. */
static int format_of(const void *data, size_t size_bytes, const char *name)
{
    int i = 0;

    while (i < FORMAT_COUNT && !formats[i]->recognise(data, size_bytes, name))
        i++;
    return i;
}

static status refuse_unknown(struct error *err)
{
    char list[256];
    size_t at = 0;

    for (int i = 0; i < FORMAT_COUNT && at < sizeof list; i++)
        at += (size_t)snprintf(list + at, sizeof list - at, "%s%s", i ? ", " : "", formats[i]->name);
    return error_set(err, STATUS_ERR_UNSUPPORTED, "is not a scene that can be read: these are: %s", list);
}

static void result_init(struct import_result *result)
{
    memset(result, 0, sizeof *result);
    result->variant_taken = -1;
    scene_init(&result->scene);
}

void import_result_release(struct import_result *result)
{
    for (size_t i = 0; i < result->blob_count; i++)
        mem_free(result->blobs[i].data);
    mem_free(result->blobs);
    mem_free(result->packed);
    for (size_t i = 0; i < result->warning_count; i++)
        mem_free(result->warnings[i]);
    mem_free(result->warnings);
    mem_free(result->source);
    input_files_release(&result->files);
    scene_release(&result->scene);
    result_init(result);
}

/* With `decodes_pictures` as in the builder; *has_damage as there. */
static status import_once(const void *data, size_t size_bytes, const char *name, const char *folder,
                          const struct import_options *options, int decodes_pictures, int *has_damage,
                          struct import_result *out, struct error *err)
{
    struct error inner = {0};
    struct builder builder;
    status result;
    int placed, format;

    result_init(out);
    builder_begin(&builder, out, options, &inner);
    builder.decodes_pictures = decodes_pictures;
    out->source = must(mem_strdup(name));
    result = input_files_init(&out->files, folder, options->only_below, &options->outside, &inner);
    THEN(result, input_files_add(&out->files, name, size_bytes, &inner));
    if (result != STATUS_OK)
        builder.error_is_placed = 1;
    else if (size_bytes == 0)
        result = error_set(&inner, STATUS_ERR_INPUT, "is empty");
    else if ((format = format_of(data, size_bytes, name)) < FORMAT_COUNT)
        result = formats[format]->import(data, size_bytes, name, folder, options, &builder);
    else
        result = refuse_unknown(&inner);
    placed = builder.error_is_placed;
    *has_damage = builder.has_damage;
    builder_end(&builder);
    input_files_sort(&out->files);
    for (size_t i = 0; i < out->files.count; i++)
        out->file_bytes += out->files.files[i].size_bytes;
    if (result != STATUS_OK) {
        import_result_release(out);
        text_disarm(inner.text);
        if (result != STATUS_ERR_NO_MEMORY && !placed)
            error_prefix(&inner, "%s", name);
        if (err)
            *err = inner;
    }
    return result;
}

status import_scene_memory(const void *data, size_t size_bytes, const char *name, const char *folder,
                           const struct import_options *options, struct import_result *out, struct error *err)
{
    int has_damage;
    status result = import_once(data, size_bytes, name, folder, options, 0, &has_damage, out, err);

    /* Pictures are decoded when all of a scene is known. One that cannot be is left out by its format, so the file is read once more. */
    if (result != STATUS_OK && has_damage)
        result = import_once(data, size_bytes, name, folder, options, 1, &has_damage, out, err);
    return result;
}

status import_scene(const char *path, const struct import_options *options, struct import_result *out,
                    struct error *err)
{
    struct buffer bytes = BUFFER_INIT;
    char *folder = NULL;
    status result;

    result_init(out);
    result = file_read(path, IMPORT_FILE_BYTES_MAX, &bytes, err);
    if (result != STATUS_OK)
        goto done;
    folder = must(file_dirname(path));
    result = import_scene_memory(bytes.data, bytes.size, path, folder, options, out, err);
done:
    mem_free(folder);
    buffer_release(&bytes);
    return result;
}
