/* azulejo tonemap: turn an EXR or HDR picture into one for the screen, or a sheet of several. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/commands/command.h"
#include "client/follow/destination.h"
#include "client/options/operator_list.h"
#include "client/follow/picture_file.h"
#include "client/views/sweep.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"

struct tonemapping {
    struct tonemap_options tone;
    const char *const *from; /* `count` pictures */
    size_t count;
    const char *out; /* -o; NULL: the second of two words is the file */
    const char *to;  /* the file of one picture */
    char *folder;    /* or the folder of their own names; owned */
    enum output_format format;
    const char *extension; /* of the files in a folder */
    const char *bits;
    int64_t quality, threads, tile_width, temporal; /* 0: not given */
    int no_dither;
    struct picture_options picture;
    struct sweep sweeps[SWEEPS_MAX];
    size_t sweep_count;
};

/* The states of the last pictures of a sequence. */
struct states {
    struct tonemap_state *last; /* of picture i at i mod `size`; NULL: each picture has its own */
    const struct tonemap_state **pointers;
    size_t size;
    struct tonemap_state mean;
};

/* The mean state of picture i and those before it, as --temporal of a job has it. */
static status mean_state(struct states *states, size_t i, const struct image *picture,
                         const struct tonemap_settings *settings, struct tonemap_context *context, struct error *err)
{
    size_t count = i + 1 < states->size ? i + 1 : states->size;

    TRY(tonemap_measure(&states->last[i % states->size], picture, settings, context, err));
    for (size_t k = 0; k < count; k++)
        states->pointers[k] = &states->last[(i + 1 - count + k) % states->size];
    tonemap_state_mean(&states->mean, states->pointers, (uint32_t)count, settings);
    context->state = &states->mean;
    return STATUS_OK;
}

static status map_picture(const struct tonemapping *t, const struct tonemap_settings *settings,
                          struct tonemap_context *context, struct states *states, size_t i, const char *to,
                          struct error *err)
{
    struct image picture = {0}, denoised = {0}, display = {0};
    const int is_denoised = settings->denoise != DENOISING_OFF;
    struct tonemap_state state;
    status result = picture_read(&picture, t->from[i], err);

    if (result == STATUS_OK && states->size)
        result = mean_state(states, i, &picture, settings, context, err);
    else if (result == STATUS_OK && is_denoised) { /* as bright as the picture with its noise */
        result = tonemap_measure(&state, &picture, settings, context, err);
        context->state = &state;
    }
    if (result == STATUS_OK && is_denoised) {
        result = picture_read_denoised(&denoised, t->from[i], err);
        image_release(&picture);
        picture = denoised;
    }
    THEN(result, tonemap_apply(&display, &picture, settings, context, err));
    THEN(result, picture_write(to, &display, t->format, &t->picture, err));
    if (!states->size)
        context->state = NULL;
    image_release(&display);
    image_release(&picture);
    return result;
}

/* The file's own name in the folder, with the extension of its new format. */
static char *name_in_folder(const struct tonemapping *t, const char *from)
{
    const char *name = file_basename(from), *extension = file_extension(from);
    int stem = (int)(strlen(name) - (*extension ? strlen(extension) + 1 : 0));
    struct buffer path = BUFFER_INIT;
    char *copy;

    buffer_printf(&path, "%s%s%.*s.%s", t->folder, t->folder[strlen(t->folder) - 1] == '/' ? "" : "/", stem, name,
                  t->extension);
    must_hold(&path);
    copy = must(mem_strdup(buffer_text(&path)));
    buffer_release(&path);
    return copy;
}

static status map_pictures(const struct tonemapping *t, struct error *err)
{
    struct tonemap_context context = {.threads = (unsigned)t->threads,
                                      .linear = t->format == OUTPUT_FORMAT_EXR};
    struct tonemap_settings settings;
    struct buffer file = BUFFER_INIT;
    struct states states = {.size = t->temporal > 1 ? (size_t)t->temporal : 0};
    status result = tonemap_options_check(&t->tone, &settings, &file, err);

    context.file_data = file.data;
    context.file_size = file.size;
    states.last = must(mem_alloc_array(states.size + 1, sizeof *states.last));
    states.pointers = must(mem_alloc_array(states.size + 1, sizeof *states.pointers));
    for (size_t i = 0; i < t->count && result == STATUS_OK; i++) {
        char *path = t->folder ? name_in_folder(t, t->from[i]) : NULL;
        result = map_picture(t, &settings, &context, &states, i, path ? path : t->to, err);
        if (result == STATUS_OK && t->count > 1)
            printf("%s\n", path);
        mem_free(path);
    }
    mem_free(states.pointers);
    mem_free(states.last);
    buffer_release(&file);
    return result;
}

static status map_sweep(const struct tonemapping *t, struct error *err)
{
    const struct sweep_options how = {
        .tone = &t->tone,
        .sweeps = t->sweeps,
        .sweep_count = t->sweep_count,
        .tile_width = t->tile_width ? (uint32_t)t->tile_width : SWEEP_TILE_WIDTH_DEFAULT,
        .threads = (unsigned)t->threads,
        .linear = t->format == OUTPUT_FORMAT_EXR,
    };
    struct image picture = {0}, sheet = {0};
    const char *denoise = t->tone.said[LOOK_denoise].text;
    status result = sweep_check(&how, err);

    if (result == STATUS_OK)
        result = denoise && strcmp(denoise, denoising_name(DENOISING_OFF)) != 0
                     ? picture_read_denoised(&picture, t->from[0], err)
                     : picture_read(&picture, t->from[0], err);
    THEN(result, sweep_draw(&sheet, &picture, file_basename(t->from[0]), &how, err));
    THEN(result, picture_write(t->to, &sheet, t->format, &t->picture, err));
    image_release(&sheet);
    image_release(&picture);
    return result;
}

/* Two pictures of one name would be one file in the folder. */
static status check_names(const struct tonemapping *t, struct error *err)
{
    status result = STATUS_OK;

    for (size_t i = 0; i < t->count && result == STATUS_OK; i++) {
        char *mine = name_in_folder(t, t->from[i]);
        for (size_t k = 0; k < i && result == STATUS_OK; k++) {
            char *other = name_in_folder(t, t->from[k]);
            if (strcmp(mine, other) == 0)
                result =
                    error_set(err, STATUS_ERR_USAGE, "%s and %s would both become %s", t->from[k], t->from[i], mine);
            mem_free(other);
        }
        for (size_t k = 0; k < t->count && result == STATUS_OK; k++)
            if (strcmp(mine, t->from[k]) == 0)
                result = error_set(err, STATUS_ERR_USAGE,
                                   "%s would be overwritten by its own picture: choose another "
                                   "folder with -o", mine);
        mem_free(mine);
    }
    return result;
}

/* -o is one picture's file or a folder, as for every command (client/follow/destination.h). */
static status choose_files(struct tonemapping *t, const struct command *command, const struct positionals *rest,
                           struct error *err)
{
    int is_folder = t->out && (destination_is_folder(t->out) || !output_format_of(t->out));

    if (rest->count == 0 || (rest->count == 1 && !t->out))
        return error_set(err, STATUS_ERR_USAGE, "%s is missing; usage: %s",
                         rest->count == 0 ? "a picture" : "the output, -o FILE,", command->usage);
    t->from = rest->items;
    t->count = rest->count;
    t->to = t->out;
    if (!t->out && rest->count == 2 && output_format_of(rest->items[1]) && !destination_is_folder(rest->items[1])) {
        t->to = rest->items[1];
        t->count = 1;
    } else if (!t->out) {
        return error_set(err, STATUS_ERR_USAGE,
                         "-o is missing: -o FOLDER/ for %zu pictures, or -o FILE.png for one; the output's "
                         "name decides its format: .png, .jpg or .exr",
                         rest->count);
    }
    if (is_folder && !destination_is_folder(t->out) && (t->count == 1 || *file_extension(t->out)))
        return error_set(err, STATUS_ERR_USAGE,
                         "%s: the output's name decides its format: end it in .png, .jpg or .exr, or in / "
                         "for a folder",
                         t->out);
    if (is_folder) {
        t->extension = t->bits || !t->quality ? "png" : "jpg";
        t->format = t->extension[0] == 'p' ? OUTPUT_FORMAT_PNG : OUTPUT_FORMAT_JPEG;
        t->folder = must(mem_strdup(t->out));
        return check_names(t, err);
    }
    if (t->count > 1)
        return error_set(err, STATUS_ERR_USAGE,
                         "-o %s is one file, and %s is one picture too many for it: give a folder, as in "
                         "-o mapped/",
                         t->to, t->from[1]);
    t->format = (enum output_format)output_format_of(t->to);
    return STATUS_OK;
}

/* Make the folder of the files. */
static status make_folder(const struct tonemapping *t, struct error *err)
{
    char *folder = must(t->folder ? mem_strdup(t->folder) : file_dirname(t->to));
    status result = file_make_folder(folder, err);

    mem_free(folder);
    return result;
}

/* An option that would have no effect is an error. */
static status choose_picture(struct tonemapping *t, struct error *err)
{
    if (t->bits && t->format != OUTPUT_FORMAT_PNG)
        return error_set(err, STATUS_ERR_USAGE, "--bits is for PNG: end the output's name in .png");
    if (t->quality && t->format != OUTPUT_FORMAT_JPEG)
        return error_set(err, STATUS_ERR_USAGE, "--quality is for JPEG: end the output's name in "
                                                ".jpg");
    if (t->no_dither && t->format == OUTPUT_FORMAT_EXR)
        return error_set(err, STATUS_ERR_USAGE, "--no-dither: an EXR is never dithered: leave it "
                                                "out");
    if (t->temporal && t->count == 1)
        return error_set(err, STATUS_ERR_USAGE, "--temporal is for several pictures, an animation's in "
                                                "their order");
    if (t->tile_width && t->sweep_count == 0)
        return error_set(err, STATUS_ERR_USAGE, "--tile-width is for a --sweep's sheet");
    t->picture.bits = t->bits ? (int)strtol(t->bits, NULL, 10) : 0;
    t->picture.quality = (int)t->quality;
    t->picture.plain = t->no_dither;
    return STATUS_OK;
}

static status parse_sweeps(struct tonemapping *t, const struct option_list *sweeps, struct error *err)
{
    status result = STATUS_OK;

    if (sweeps->count > SWEEPS_MAX)
        return error_set(err, STATUS_ERR_USAGE, "--sweep: %zu sweeps; a sheet shows one, or two as columns and rows",
                         sweeps->count);
    for (size_t i = 0; i < sweeps->count && result == STATUS_OK; i++)
        result = sweep_parse(&t->sweeps[t->sweep_count++], sweeps->items[i], t->tone.file != NULL, err);
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    struct tonemapping t = {0};
    struct option_list sweeps = {0};
    int list = 0, json = 0, done;
    const struct option table[] = {
        {"output", 'o', OPTION_STRING, &t.out, "OUT",
         "the picture's file: .png, .jpg, or .exr for linear display light; or a folder, created if it is "
         "missing, for PNG files (with --quality JPEG files) of the pictures' own names", 0, 0, NULL},
        {"operator", 0, OPTION_STRING, &t.tone.tonemap, "OPERATOR", "the same as --tonemap", 0, 0,
         NULL},
        TONEMAP_OPTION_ROWS(t.tone),
        {"bits", 0, OPTION_CHOICE, &t.bits, "N", "bits of a PNG's channel (default 8)", 0, 0, "8|16"},
        {"quality", 0, OPTION_INT, &t.quality, "N", "quality of a JPEG, 1 to 100 (default 92)", 1,
         100, NULL},
        {"no-dither", 0, OPTION_FLAG, &t.no_dither, NULL, "round instead of dithering", 0, 0, NULL},
        {"temporal", 0, OPTION_INT, &t.temporal, "N",
         "average the operator's measurements over the last N of the pictures, so that an animation does not "
         "flicker (default 1: each picture by itself)", 1, look_rows[LOOK_temporal].most, NULL},
        {"threads", 'j', OPTION_INT, &t.threads, "N", "threads to use (default: all)", 1, 256,
         NULL},
        {"sweep", 0, OPTION_LIST, &sweeps, "NAME=VALUE,...",
         "draw a labelled sheet with a picture for each value of a parameter, operator (or "
         "operator=all), exposure, auto-exposure, percentile or white-balance; given twice, a table "
         "of both",
         0, 0, NULL},
        {"tile-width", 0, OPTION_INT, &t.tile_width, "PIXELS",
         "width of a sheet's pictures, if they are not smaller (default 480)", SWEEP_TILE_WIDTH_MIN,
         SWEEP_TILE_WIDTH_MAX, NULL},
        {"list", 'l', OPTION_FLAG, &list, NULL,
         "list the operators: what they are, where they come from, their parameters", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "with --list: print JSON", 0, 0, NULL},
        {0},
    };
    struct option rows[TONEMAP_ROWS_MAX];
    struct positionals rest;
    status result = command_parse(command, tonemap_options_table(&t.tone, table, rows), argc, argv, 0,
                                  OPTIONS_POSITIONAL_MAX, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (list)
        return rest.count == 0 ? operator_list_print(table, json, err)
                               : error_set(err, STATUS_ERR_USAGE, "--list takes no picture");
    if (json)
        return error_set(err, STATUS_ERR_USAGE, "--json goes with --list");
    result = choose_files(&t, command, &rest, err);
    THEN(result, parse_sweeps(&t, &sweeps, err));
    THEN(result, choose_picture(&t, err));
    if (result == STATUS_OK && t.sweep_count && (t.count > 1 || t.folder))
        result = error_set(err, STATUS_ERR_USAGE, "--sweep draws one sheet of one picture: -o FILE.png");
    THEN(result, make_folder(&t, err));
    THEN(result, t.sweep_count ? map_sweep(&t, err) : map_pictures(&t, err));
    mem_free(t.folder);
    for (size_t i = 0; i < t.sweep_count; i++)
        sweep_release(&t.sweeps[i]);
    return result;
}

const struct command command_tonemap = {
    .name = "tonemap",
    .group = COMMAND_PICTURES,
    .usage = "azulejo tonemap PICTURE... -o OUT [--tonemap OPERATOR] [--PARAMETER VALUE]... [OPTION]...",
    .summary = "turn an EXR or HDR picture into one for the screen",
    .description =
        "Tone map EXR or Radiance HDR pictures just as the farm does, into a PNG, a JPEG, or an EXR of linear\n"
        "display light, or several into a folder; or, with --sweep, draw a labelled sheet that compares operators or their parameters.",
    .run = run,
};
