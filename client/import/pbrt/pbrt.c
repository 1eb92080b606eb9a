#include "client/import/pbrt/pbrt.h"

#include <string.h>
#include <strings.h>

#include "client/import/pbrt/read/pbrt_directive.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"

static const struct pbrt_word *word_find(const char *text)
{
    static const struct pbrt_word *const lists[] = {pbrt_state_words, pbrt_preamble_words,
                                                    pbrt_world_words};

    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++)
        for (const struct pbrt_word *word = lists[i]; word->word; word++)
            if (strcmp(word->word, text) == 0)
                return word;
    return NULL;
}

static status begin(struct pbrt *p, const void *data, size_t size_bytes, const char *name, const char *folder)
{
    static const struct pbrt_place nowhere = {"", 0};

    arena_init(&p->arena);
    p->time_end = 1;
    p->max_depth = p->samples = -1;
    p->last_node = BUILDER_NO_ROW;
    p->now.active = 3;
    p->now.ctm.at[0] = p->now.ctm.at[1] = transform_d_identity();
    p->now.inside = p->now.outside = p->camera_medium = "";
    TRY(pbrt_reader_init(&p->reader, &p->arena, data, size_bytes, name, folder, p->b->files, p->err));
    pbrt_material_new(p, "diffuse", "default", &nowhere, &p->default_material);
    p->now.material = p->default_material;
    return STATUS_OK;
}

static void finish(struct pbrt *p)
{
    struct pbrt_table *const tables[] = {&p->float_textures, &p->color_textures, &p->materials,
                                         &p->media,          &p->objects,        &p->systems,
                                         &p->images,         &p->texture_rows,   &p->spectra,
                                         &p->defined,        &p->derived,
                                         &p->masks};

    for (size_t i = 0; i < p->images.size; i++)
        if (p->images.entries[i].value)
            pbrt_image_forget(p->images.entries[i].value);
    for (struct pbrt_object *o = p->last_object; o; o = o->former)
        mem_free(o->parts);
    for (size_t i = 0; i < sizeof tables / sizeof *tables; i++)
        mem_free(tables[i]->entries);
    pbrt_params_release(&p->params);
    pbrt_reader_release(&p->reader);
    mem_free(p->stack);
    mem_free(p->renamed);
    mem_free(p->late);
    mem_free(p->attributes);
    mem_free(p->stack_kinds);
    arena_release(&p->arena);
}

/* An error names its place: the directive at `at` if nothing better is known. */
static status placed(struct pbrt *p, status result, const struct pbrt_place *at)
{
    size_t length = strlen(at->file);

    if (result == STATUS_OK || result == STATUS_ERR_NO_MEMORY || p->b->error_is_placed)
        return result;
    p->b->error_is_placed = 1;
    if (strncmp(p->err->text, at->file, length) != 0 || p->err->text[length] != ':')
        error_prefix(p->err, "%s:%u", at->file, at->line);
    return result;
}

static status run(struct pbrt *p)
{
    struct pbrt_token t;
    status result;

    for (;;) {
        const struct pbrt_word *word;
        result = pbrt_next(&p->reader, &t, p->err);
        if (result != STATUS_OK)
            return placed(p, result, &t.at);
        TRY(pbrt_end_imports(p, &t.at, t.kind == TOKEN_END));
        if (t.kind == TOKEN_END)
            break;
        word = t.kind == TOKEN_WORD ? word_find(t.text) : NULL;
        if (!word)
            return pbrt_fail(p, STATUS_ERR_INPUT, &t.at, "\"%.60s\" is not a directive of a pbrt scene",
                             t.kind == TOKEN_OPEN    ? "["
                             : t.kind == TOKEN_CLOSE ? "]"
                                                     : t.text);
        result = word->run(p, &t.at);
        if (result != STATUS_OK)
            return placed(p, result, &t.at);
    }
    if (p->object || p->stack_count)
        pbrt_warn(p, &t.at, "unended", "the file ends before its last %s does",
                  p->object ? "ObjectBegin" : "AttributeBegin");
    result = pbrt_late_finish(p, &t.at);
    if (result != STATUS_OK)
        return placed(p, result, &t.at);
    for (size_t i = 0; i < p->attribute_count; i++)
        pbrt_params_untaken(p->attributes[i], p->b);
    if (!p->in_world)
        return placed(p, pbrt_camera(p), &t.at);
    for (size_t i = 0; i < p->b->camera_count && !p->is_animated; i++)
        p->b->cameras[i].shutter_open_s = p->b->cameras[i].shutter_close_s = 0;
    return STATUS_OK;
}

static status import(const void *data, size_t size_bytes, const char *name, const char *folder,
                     const struct import_options *options, struct builder *b)
{
    struct pbrt *p = must(mem_calloc(1, sizeof *p));
    status result;

    p->b = b;
    b->volume_rule = VOLUMES_BOUNDARIES;
    p->err = b->err;
    p->reader.arena = &p->arena;
    result = begin(p, data, size_bytes, name, folder);
    THEN(result, run(p));
    THEN(result, builder_finish(b, file_basename(name), options));
    finish(p);
    mem_free(p);
    return result;
}

static int recognise(const void *data, size_t size_bytes, const char *name)
{
    const char *text = data, *base = file_basename(name);
    size_t length = strlen(base), at = 0, start;
    char word[32];

    if ((length > 5 && strcasecmp(base + length - 5, ".pbrt") == 0) ||
        (length > 8 && strcasecmp(base + length - 8, ".pbrt.gz") == 0))
        return 1;
    while (at < size_bytes) {
        if (text[at] == '#')
            while (at < size_bytes && text[at] != '\n')
                at++;
        else if (text[at] && strchr(" \t\r\n", text[at]))
            at++;
        else
            break;
    }
    for (start = at; at < size_bytes && at - start < sizeof word - 1 &&
                     ((text[at] >= 'a' && text[at] <= 'z') || (text[at] >= 'A' && text[at] <= 'Z'));
         at++)
        word[at - start] = text[at];
    word[at - start] = 0;
    return word_find(word) != NULL;
}

const struct import_format format_pbrt = {
    .name = "pbrt-v4 (.pbrt)",
    .recognise = recognise,
    .import = import,
};
