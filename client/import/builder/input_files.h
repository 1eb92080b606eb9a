/* input_files: the files that a scene is read from, and the folders where they may be.
 *
 * A scene file may come from a stranger, and the files that it names are sent to the farm. So only
 * regular files below the scene's own folder, or below a folder that the user allowed, are read.
 * The canonical path of a file counts, after symbolic links and "..": it is taken from the open
 * descriptor, so replacing a link meanwhile has no effect. Every file read is listed.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/buffer.h"
#include "common/cli/options.h"
#include "common/base/status.h"

enum { INPUT_FILES_MAX = 1 << 20 };

struct input_file {
    char *name; /* the path as it was opened, control characters replaced */
    uint64_t size_bytes;
};

struct input_files {
    char **folders; /* canonical; the first is the scene's own */
    size_t folder_count, folder_capacity;
    int is_confined; /* files elsewhere are reported as missing */
    struct input_file *files;
    size_t count, capacity;
};

/* Allow files below `folder` (NULL: there is none) and below each of `outside`; with `only_below` (NULL: not
 * given) below that instead of `folder`. ERR_USAGE if one of these is not a folder, ERR_INPUT for `folder`.
 * Release after a failure, too. */
status input_files_init(struct input_files *f, const char *folder, const char *only_below,
                        const struct option_list *outside, struct error *err) MUST_CHECK;
void input_files_release(struct input_files *f);

/* Does the file at `path` exist below one of the folders? For choosing among names; reading checks again. */
int input_files_contain(const struct input_files *f, const char *path);
/* Is there a file at `path`, as far as the scene may know? */
int input_files_exist(const struct input_files *f, const char *path);

/* Append the bytes of a file that the scene names, and list it. ERR_FORBIDDEN, with the option that would allow it, if
 * it is elsewhere; ERR_INPUT when it is not a regular file or cannot be read, ERR_LIMIT above `limit_bytes`. */
status input_files_read(struct input_files *f, const char *path, size_t limit_bytes, struct buffer *out,
                        struct error *err) MUST_CHECK;

/* List a file that the user named and that was read without a check. */
status input_files_add(struct input_files *f, const char *name, uint64_t size_bytes, struct error *err) MUST_CHECK;

/* Sort the list by name, each file once. */
void input_files_sort(struct input_files *f);
