#include "client/import/builder/input_files.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/terminal/format.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"

/* ---- folders ------------------------------------------------------------------------------ */

static status folder_add(struct input_files *f, const char *path, status otherwise, const char *what, struct error *err)
{
    char *whole = realpath(path, NULL);
    struct stat info;
    char *copy;

    if (!whole || stat(whole, &info) != 0 || !S_ISDIR(info.st_mode)) {
        int why = whole ? ENOTDIR : errno;
        free(whole); /* libc's own memory */
        return error_set(err, otherwise, "%s%s: %s: name a folder that exists", what, path, strerror(why));
    }
    copy = must(mem_strdup(whole));
    free(whole);
    MUST_GROW(f->folders, f->folder_capacity, f->folder_count + 1);
    f->folders[f->folder_count++] = copy;
    return STATUS_OK;
}

status input_files_init(struct input_files *f, const char *folder, const char *only_below,
                        const struct option_list *outside, struct error *err)
{
    status result = STATUS_OK;

    memset(f, 0, sizeof *f);
    f->is_confined = only_below != NULL;
    if (only_below)
        result = folder_add(f, only_below, STATUS_ERR_USAGE, "--only-below ", err);
    else if (folder)
        result = folder_add(f, folder, STATUS_ERR_INPUT, "", err);
    for (size_t i = 0; i < outside->count && result == STATUS_OK; i++)
        result = folder_add(f, outside->items[i], STATUS_ERR_USAGE, "--allow-outside ", err);
    return result;
}

void input_files_release(struct input_files *f)
{
    for (size_t i = 0; i < f->folder_count; i++)
        mem_free(f->folders[i]);
    mem_free(f->folders);
    for (size_t i = 0; i < f->count; i++)
        mem_free(f->files[i].name);
    mem_free(f->files);
    memset(f, 0, sizeof *f);
}

/* `path` is canonical. */
static int is_below(const char *folder, const char *path)
{
    size_t length = strlen(folder);

    while (length && folder[length - 1] == '/') /* the root itself */
        length--;
    return strncmp(path, folder, length) == 0 && path[length] == '/';
}

static int is_allowed(const struct input_files *f, const char *path)
{
    for (size_t i = 0; i < f->folder_count; i++)
        if (is_below(f->folders[i], path))
            return 1;
    return 0;
}

int input_files_contain(const struct input_files *f, const char *path)
{
    char *whole = realpath(path, NULL);
    int result = whole && is_allowed(f, whole);

    free(whole);
    return result;
}

int input_files_exist(const struct input_files *f, const char *path)
{
    return f->is_confined ? input_files_contain(f, path) : file_exists(path);
}

/* ---- reading ------------------------------------------------------------------------------ */

/* A word of a shell's command line. */
static void put_quoted(struct buffer *out, const char *word)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                "/._-+=:@,";

    if (*word && word[strspn(word, plain)] == 0) {
        buffer_puts(out, word);
        return;
    }
    buffer_puts(out, "'");
    for (; *word; word++)
        if (*word == '\'')
            buffer_puts(out, "'\\''");
        else
            buffer_append(out, word, 1);
    buffer_puts(out, "'");
}

static status refuse(const char *path, const char *whole, struct error *err)
{
    char *folder = must(file_dirname(whole));
    struct buffer option = BUFFER_INIT;

    put_quoted(&option, folder);
    must_hold(&option);
    error_set(err, STATUS_ERR_FORBIDDEN,
              "%.240s: lies outside the scene's folder, at %.240s, and is not read: "
              "to allow it, add --allow-outside %.300s",
              path, whole, buffer_text(&option));
    buffer_release(&option);
    mem_free(folder);
    return STATUS_ERR_FORBIDDEN;
}

/* Use the descriptor itself to find out what was opened and where it is. O_PATH opens without
 * waiting for the other end of a pipe and without touching a device. */
static status check_place(const struct input_files *f, const char *path, int place, char link[32], struct error *err)
{
    char whole[PATH_MAX];
    struct stat info;
    ssize_t length;

    if (fstat(place, &info) != 0)
        return error_set(err, STATUS_ERR_INPUT, "%s: %s", path, strerror(errno));
    if (!S_ISREG(info.st_mode))
        return error_set(err, STATUS_ERR_INPUT, "%s: is not a regular file", path);
    snprintf(link, 32, "/proc/self/fd/%d", place);
    length = readlink(link, whole, sizeof whole);
    if (length < 0 || (size_t)length >= sizeof whole)
        return error_set(err, STATUS_ERR_INPUT, "%s: its path cannot be read from %s (%s): is /proc mounted?", path,
                         link, length < 0 ? strerror(errno) : "the path is too long");
    whole[length] = 0;
    return is_allowed(f, whole) ? STATUS_OK : refuse(path, whole, err);
}

status input_files_read(struct input_files *f, const char *path, size_t limit_bytes, struct buffer *out,
                        struct error *err)
{
    size_t before = out->size;
    char link[32];
    int place = open(path, O_PATH | O_CLOEXEC);
    status result;

    if (place >= 0 && f->is_confined && !input_files_contain(f, path)) {
        close(place);
        place = -1;
    }
    if (place < 0)
        return error_set(err, STATUS_ERR_INPUT, "%s: cannot be opened: %s", path,
                         f->is_confined ? "it is not below the folder of --only-below" : strerror(errno));
    result = check_place(f, path, place, link, err);
    THEN(result, file_read_as(link, path, limit_bytes, out, err));
    close(place);
    return result == STATUS_OK ? input_files_add(f, path, out->size - before, err) : result;
}

/* ---- the list ----------------------------------------------------------------------------- */

status input_files_add(struct input_files *f, const char *name, uint64_t size_bytes, struct error *err)
{
    char *copy;

    if (f->count >= INPUT_FILES_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "the scene reads more than %d files", INPUT_FILES_MAX);
    copy = must(mem_strdup(name));
    MUST_GROW(f->files, f->capacity, f->count + 1);
    text_disarm(copy);
    f->files[f->count++] = (struct input_file){copy, size_bytes};
    return STATUS_OK;
}

static int name_compare(const void *a, const void *b)
{
    return strcmp(((const struct input_file *)a)->name, ((const struct input_file *)b)->name);
}

void input_files_sort(struct input_files *f)
{
    size_t kept = 0;

    if (f->count)
        qsort(f->files, f->count, sizeof *f->files, name_compare);
    for (size_t i = 0; i < f->count; i++)
        if (kept && strcmp(f->files[kept - 1].name, f->files[i].name) == 0)
            mem_free(f->files[i].name);
        else
            f->files[kept++] = f->files[i];
    f->count = kept;
}
