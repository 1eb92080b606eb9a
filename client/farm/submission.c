#include "client/farm/submission.h"

#include <stdio.h>
#include <string.h>

#include "client/terminal/format.h"
#include "client/terminal/must.h"
#include "client/terminal/progress.h"
#include "client/options/schedule_option.h"
#include "client/farm/upload.h"
#include "common/system/file.h"
#include "common/base/memory.h"
#include "common/system/shell.h"

/* The file's settings apply unless the user gives others. */
static void take_hints(const struct import_hints *hints, const struct job_options *o, int quiet,
                       struct job_request *request)
{
    struct render_settings *s = &request->settings;
    const int size = !o->size && hints->width && hints->height;
    const int spp = !request->spp_given && hints->spp;
    const int depth = !o->said[SETTING_max_depth].text && hints->has_max_depth;
    const int filter = !o->said[SETTING_pixel_filter].text && !o->said[SETTING_filter_width].text && hints->has_filter;

    if (size) {
        s->width = hints->width;
        s->height = hints->height;
    }
    if (size && hints->crop_width && !o->region)
        request->region = (struct tile_rect){hints->crop_x, hints->crop_y, hints->crop_width, hints->crop_height};
    if (spp)
        s->spp = hints->spp;
    if (depth)
        s->max_depth = hints->max_depth;
    if (filter) {
        s->pixel_filter = hints->pixel_filter;
        s->filter_width = hints->filter_width;
    }
    if ((size || spp || depth || filter) && !quiet)
        fprintf(stderr, "from the file: %ux%u pixels, %u samples, depth %u%s%s%s\n", s->width, s->height, s->spp,
                s->max_depth, filter ? ", pixel filter " : "", filter ? pixel_filter_name(s->pixel_filter) : "",
                size && hints->crop_width && !o->region ? ", its crop window as --region" : "");
}

/* Without folders, so that a picture's header is the same wherever it was rendered. */
static void note_source(const char *path, const struct import_options *o, struct buffer *out)
{
    const struct import_options plain = IMPORT_OPTIONS_OF_COMMANDS;

    shell_word(out, file_basename(path));
    buffer_consume(out, 1);
    if (o->env_path)
        shell_option(out, "env", file_basename(o->env_path));
    if (o->scene_index != plain.scene_index)
        buffer_printf(out, " --scene %lld", (long long)o->scene_index);
    if (o->variant)
        shell_option(out, "variant", o->variant);
    if (o->animation)
        shell_option(out, "animation", o->animation);
    if (o->light_units && (!plain.light_units || strcmp(o->light_units, plain.light_units) != 0))
        shell_option(out, "light-units", o->light_units);
    if (strcmp(o->studio, plain.studio) != 0)
        shell_option(out, "studio", o->studio);
    for (size_t i = 0; i < o->outside.count; i++)
        shell_option(out, "allow-outside", o->outside.items[i]);
    if (o->strict)
        buffer_puts(out, " --strict");
    if (o->image_megapixels != plain.image_megapixels)
        buffer_printf(out, " --max-image %lld", (long long)o->image_megapixels);
    if (o->images_bytes != plain.images_bytes)
        buffer_printf(out, " --max-image-memory %llu", (unsigned long long)o->images_bytes);
    must_hold(out);
}

status submission_prepare(const char *path, const struct job_options *options, int quiet, struct job_request *request,
                          struct import_result *scene, struct error *err)
{
    status result;

    TRY(import_scene(path, &options->import, scene, err));
    for (size_t i = 0; i < scene->warning_count && !quiet; i++)
        fprintf(stderr, "warning: %s\n", scene->warnings[i]);
    note_source(path, &options->import, &request->source);
    TRY(job_request_complete(request, options, &scene->scene, err));
    take_hints(&scene->hints, options, quiet, request);
    result = job_request_crop(request, err);
    THEN(result, schedule_option_fit(request, options, err));
    if (result != STATUS_OK)
        return result;
    return render_settings_validate(&request->settings, scene->scene.camera_count, err);
}

static void report_upload(const struct upload_progress *progress, void *user)
{
    char sent[FORMAT_SIZE], all[FORMAT_SIZE], text[128];
    double fraction = progress->missing_bytes ? (double)progress->sent_bytes / (double)progress->missing_bytes : 1;

    snprintf(text, sizeof text, "sending the scene, %s of %s", bytes_text(sent, progress->sent_bytes),
             bytes_text(all, progress->missing_bytes));
    progress_draw(user, fraction, text);
}

status submission_upload(struct connection *c, const struct import_result *scene, const struct job_request *request,
                         int quiet, struct error *err)
{
    const struct output_request *output = &request->output;
    size_t count = scene->blob_count;
    struct upload_item *items = must(mem_calloc(count + 2, sizeof *items));
    struct upload_progress uploaded;
    struct progress progress;
    char size[FORMAT_SIZE];
    status result;

    if (!quiet)
        fprintf(stderr, "takes %zu file%s, %s\n", scene->files.count, scene->files.count == 1 ? "" : "s",
                bytes_text(size, scene->file_bytes));
    for (size_t i = 0; i < scene->blob_count; i++)
        items[i] = (struct upload_item){scene->blobs[i].digest, scene->blobs[i].data,
                                        scene->blobs[i].size_bytes};
    if (output->tonemap.has_file)
        items[count++] = (struct upload_item){output->tonemap.file, output->tonemap_file.data,
                                              output->tonemap_file.size};
    /* The scene is sent last: once it is stored, so is everything that it names. */
    items[count++] = (struct upload_item){scene->scene_digest, scene->packed, scene->packed_bytes};
    progress_init(&progress, quiet);
    result = upload_blobs(c, items, count, report_upload, &progress, &uploaded, err);
    progress_clear(&progress);
    mem_free(items);
    return result;
}

status submission_send(struct connection *c, const struct import_result *scene, const struct job_request *request,
                       const char *name, unsigned formats, int quiet, struct job_accepted *out, struct error *err)
{
    TRY(submission_upload(c, scene, request, quiet, err));
    return job_request_submit(c, request, name, &scene->scene_digest, formats, out, err);
}

char *submission_name(const char *path)
{
    const char *base = file_basename(path);
    const char *dot = strrchr(base, '.');
    char *name = must(mem_strdup(*base ? base : "scene"));

    if (dot && dot > base)
        name[dot - base] = 0;
    return name;
}
