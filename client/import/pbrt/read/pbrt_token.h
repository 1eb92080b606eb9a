/* pbrt_token: the words of a pbrt scene file, and the files that it includes.
 *
 * A reader holds a stack of files; `Include` pushes one, and its end pops it. Every token knows its file and line. File
 * names live in the reader's arena, as long as the reader. Files are searched for in the folder of the scene's first
 * file, then in that of the file that names them; input_files decides which may be read.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "client/import/builder/input_files.h"
#include "common/base/arena.h"
#include "common/base/buffer.h"
#include "common/base/status.h"

enum {
    PBRT_INCLUDE_DEPTH_MAX = 32,
    PBRT_INCLUDES_MAX = 1 << 16,       /* in all */
    PBRT_STRING_BYTES_MAX = 4096,
    PBRT_WORD_BYTES_MAX = 255,
};
#define PBRT_FILE_BYTES_MAX ((size_t)4 << 30)  /* one file, unpacked */
#define PBRT_TEXT_BYTES_MAX ((size_t)16 << 30) /* all files of a scene but pictures, unpacked */

/* A place in a file. `file` lives as long as the reader. */
struct pbrt_place {
    const char *file;
    uint32_t line;
};

enum pbrt_token_kind { TOKEN_END, TOKEN_WORD, TOKEN_STRING, TOKEN_OPEN, TOKEN_CLOSE };

struct pbrt_token {
    enum pbrt_token_kind kind;
    struct pbrt_place at;
    const char *text; /* of a word or string, NUL-terminated; until the next token is read */
    size_t size;
};

struct pbrt_source {
    struct buffer data;
    size_t at;
    struct pbrt_place place;
    char *path;   /* canonical, for the cycle check; NULL: from memory */
    char *folder; /* NULL: files are refused */
};

struct pbrt_reader {
    struct arena *arena;
    struct pbrt_source stack[PBRT_INCLUDE_DEPTH_MAX];
    size_t depth;
    size_t included;
    const char *folder; /* of the first file; NULL: other files are refused */
    struct input_files *files;
    size_t read_bytes;       /* of all files, unpacked */
    struct pbrt_token token; /* of pbrt_peek() */
    int peeked;
    struct buffer text;
};

/* `data` is copied. `folder` (may be NULL) and `files` must live as long as the reader. */
status pbrt_reader_init(struct pbrt_reader *r, struct arena *arena, const void *data, size_t size_bytes,
                        const char *name, const char *folder, struct input_files *files, struct error *err) MUST_CHECK;
void pbrt_reader_release(struct pbrt_reader *r);

/* Continue reading in the file `name`, named at `at`. No token may be peeked. */
status pbrt_include(struct pbrt_reader *r, const char *name, const struct pbrt_place *at, struct error *err) MUST_CHECK;

/* The next token; it stays the next one until pbrt_next(). The end of an included file is skipped. */
status pbrt_peek(struct pbrt_reader *r, struct pbrt_token *out, struct error *err) MUST_CHECK;
status pbrt_next(struct pbrt_reader *r, struct pbrt_token *out, struct error *err) MUST_CHECK;

/* A decimal number in float's range. 0: `text` is not one. */
int pbrt_number(const char *text, double *out);

/* The path of the file `name`, mem_alloc'd. ERR_INPUT without its place. */
status pbrt_resolve(const struct pbrt_reader *r, const char *name, char **path, struct error *err) MUST_CHECK;

/* Read that file as a whole, unpacked if it is gzip. */
status pbrt_read_file(struct pbrt_reader *r, const char *name, const struct pbrt_place *at, struct buffer *out,
                      struct error *err) MUST_CHECK;

/* Format "file:line: " and the text. */
#define pbrt_error(err, code, at, ...) \
    error_set_result_(pbrt_error_((err), (code), (at), __VA_ARGS__), (code))
status pbrt_error_(struct error *err, status code, const struct pbrt_place *at, const char *format,
                   ...) __attribute__((format(printf, 4, 5)));
