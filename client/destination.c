#include "client/destination.h"

#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "client/job_options.h"
#include "common/base/file.h"
#include "common/base/memory.h"

static int is_folder(const char *path)
{
    struct stat info;
    size_t length = strlen(path);

    if (length && path[length - 1] == '/')
        return 1;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

status destination_init(struct destination *d, const char *out, const char *scene_name,
                        uint32_t frames, struct error *err)
{
    memset(d, 0, sizeof *d);
    d->formats = OUTPUT_FORMAT_BOTH;
    d->numbered = frames > 1;
    if (!out || !*out)
        out = "./";
    if (is_folder(out)) {
        d->folder = mem_strdup(out);
        d->base = mem_strdup(scene_name);
    } else {
        const char *extension = file_extension(out);
        d->folder = file_dirname(out);
        d->base = mem_strdup(file_basename(out));
        if (strcasecmp(extension, "exr") == 0)
            d->formats = OUTPUT_FORMAT_EXR;
        else if (strcasecmp(extension, "png") == 0)
            d->formats = OUTPUT_FORMAT_PNG;
        if (d->base && d->formats != OUTPUT_FORMAT_BOTH)
            d->base[strlen(d->base) - strlen(".exr")] = 0;
    }
    if (!d->folder || !d->base) {
        destination_release(d);
        return error_no_memory(err, "a path");
    }
    return STATUS_OK;
}

void destination_release(struct destination *d)
{
    mem_free(d->base);
    mem_free(d->folder);
    memset(d, 0, sizeof *d);
}

void destination_path(const struct destination *d, uint32_t frame, const char *extension,
                      struct buffer *path)
{
    size_t length = strlen(d->folder);

    if (strcmp(d->folder, "./") != 0 && strcmp(d->folder, ".") != 0)
        buffer_printf(path, "%s%s", d->folder, length && d->folder[length - 1] == '/' ? "" : "/");
    buffer_puts(path, d->base);
    if (d->numbered)
        buffer_printf(path, "-%04u", frame);
    buffer_printf(path, ".%s", extension);
}
