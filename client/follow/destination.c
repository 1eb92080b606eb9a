#include "client/follow/destination.h"

#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "client/options/output.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"

int destination_is_folder(const char *path)
{
    struct stat info;
    size_t length = strlen(path);

    if (length && path[length - 1] == '/')
        return 1;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

/* Of a path that is no folder. "x.tiff" would become x.tiff.exr, and a device or a pipe a file beside it: neither is what
 * was meant. */
static status check_path(const char *out, struct error *err)
{
    static const struct {
        const char *extension, *remedy;
    } others[] = {{"tif", ""}, {"tiff", ""}, {"hdr", ""}, {"pfm", ""}, {"bmp", ""}, {"gif", ""}, {"tga", ""}, {"ppm", ""},
                  {"webp", ""}, {"mp4", "; render and fetch make videos with --video"},
                  {"mov", "; render and fetch make videos with --video"}};
    const char *extension = file_extension(out);
    struct stat info;

    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (strcasecmp(extension, others[i].extension) == 0)
            return error_set(err, STATUS_ERR_USAGE, "-o %s: pictures are written as .exr, .png or .jpg%s", out,
                             others[i].remedy);
    if (stat(out, &info) == 0 && !S_ISREG(info.st_mode))
        return error_set(err, STATUS_ERR_USAGE, "-o %s: is neither a file nor a folder", out);
    return STATUS_OK;
}

/* A path that is no folder: the file, or the files' name. */
static status name_file(struct destination *d, const char *out, unsigned formats, struct error *err)
{
    unsigned named = output_format_of(out);
    const char *extension = file_extension(out);

    if (named && formats && named != formats)
        return error_set(err, STATUS_ERR_USAGE,
                         "--format: %s is one file of its own format; write it without extension", out);
    d->folder = must(file_dirname(out));
    d->base = must(mem_strdup(file_basename(out)));
    if (!named)
        return STATUS_OK;
    d->formats = named;
    if (strlen(extension) == strlen("jpeg"))
        d->jpeg_extension = "jpeg";
    d->base[strlen(d->base) - strlen(extension) - 1] = 0;
    return STATUS_OK;
}

status destination_init(struct destination *d, const char *out, unsigned formats, const char *scene_name,
                        uint32_t frames, struct error *err)
{
    status result = STATUS_OK;

    memset(d, 0, sizeof *d);
    d->formats = formats ? formats : OUTPUT_FORMAT_BOTH;
    d->jpeg_extension = "jpg";
    d->numbered = frames > 1;
    if (!out || !*out)
        out = "./";
    if (destination_is_folder(out)) {
        d->folder = must(mem_strdup(out));
        d->base = must(mem_strdup(scene_name));
    } else {
        result = check_path(out, err);
        THEN(result, name_file(d, out, formats, err));
    }
    if (result != STATUS_OK)
        destination_release(d);
    return result;
}

status destination_of_job(struct destination *d, const char *out, unsigned formats, struct error *err)
{
    status result = STATUS_OK;
    unsigned named = 0;

    memset(d, 0, sizeof *d);
    d->formats = formats;
    d->jpeg_extension = "jpg";
    if (!out || !*out)
        out = ".";
    if (!destination_is_folder(out)) {
        TRY(check_path(out, err));
        named = output_format_of(out);
    }
    if (!named)
        d->folder = must(mem_strdup(out));
    else if (!(named & formats))
        return error_set(err, STATUS_ERR_USAGE,
                         "-o %s: this command brings no such file; end the name in .png or .jpg, or "
                         "give a folder", out);
    else
        result = name_file(d, out, 0, err);
    if (result != STATUS_OK)
        destination_release(d);
    return result;
}

void destination_release(struct destination *d)
{
    mem_free(d->base);
    mem_free(d->folder);
    memset(d, 0, sizeof *d);
}

void destination_path(const struct destination *d, uint32_t frame, const char *extension, struct buffer *path)
{
    size_t length = strlen(d->folder);

    if (strcmp(d->folder, "./") != 0 && strcmp(d->folder, ".") != 0)
        buffer_printf(path, "%s%s", d->folder, length && d->folder[length - 1] == '/' ? "" : "/");
    buffer_puts(path, d->base);
    if (d->numbered)
        buffer_printf(path, "-%04u", frame);
    buffer_printf(path, ".%s", strcmp(extension, "jpg") == 0 ? d->jpeg_extension : extension);
}
