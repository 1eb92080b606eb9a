#include "client/import/pbrt/read/pbrt_token.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"

enum { NAME_SHOWN = 120 /* characters of a name in a message */ };

status pbrt_error_(struct error *err, status code, const struct pbrt_place *at, const char *format, ...)
{
    char text[768];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (!at || !at->file)
        return error_set_(err, code, "%s", text);
    if (!at->line)
        return error_set_(err, code, "%s: %s", at->file, text);
    return error_set_(err, code, "%s:%u: %s", at->file, at->line, text);
}

/* ---- files -------------------------------------------------------------------------------- */

/* NULL: there is no such file. */
static char *try_folder(const struct input_files *files, const char *folder, const char *name)
{
    char *path;

    if (!folder)
        return NULL;
    path = must(*name == '/' ? mem_strdup(name) : file_join(folder, name));
    if (input_files_exist(files, path))
        return path;
    mem_free(path);
    return NULL;
}

status pbrt_resolve(const struct pbrt_reader *r, const char *name, char **path, struct error *err)
{
    const char *beside = r->depth ? r->stack[r->depth - 1].folder : NULL;
    char *slashed;

    *path = NULL;
    if (!r->folder)
        return error_set(err, STATUS_ERR_INPUT,
                         "names the file \"%.*s\": files can be named only in a scene that is read from a folder",
                         NAME_SHOWN, name);
    slashed = must(mem_strdup(name));
    for (char *p = slashed; *p; p++)
        if (*p == '\\')
            *p = '/';
    *path = try_folder(r->files, r->folder, name);
    if (!*path)
        *path = try_folder(r->files, beside, name);
    if (!*path)
        *path = try_folder(r->files, r->folder, slashed);
    mem_free(slashed);
    if (!*path)
        return error_set(err, STATUS_ERR_INPUT, "the file \"%.*s\" does not exist", NAME_SHOWN, name);
    return STATUS_OK;
}

/* The same with an error that names its place. */
static status resolve_at(const struct pbrt_reader *r, const char *name, const struct pbrt_place *at, char **path,
                         struct error *err)
{
    status result = pbrt_resolve(r, name, path, err);

    if (result != STATUS_OK)
        error_prefix(err, "%s:%u", at->file, at->line);
    return result;
}

static int is_gzip(const struct buffer *data)
{
    return data->size >= 18 && data->data[0] == 0x1f && data->data[1] == 0x8b;
}

/* Unpack the bytes of a gzip file. */
static status unpack(struct buffer *data, size_t limit, struct error *err)
{
    struct buffer out = BUFFER_INIT;
    z_stream z = {0};
    int code = Z_OK;
    size_t taken = 0;
    status result = STATUS_OK;

    must_(inflateInit2(&z, 15 + 16) == Z_OK);
    while (code == Z_OK && result == STATUS_OK) {
        const size_t chunk = (size_t)1 << 20;
        size_t before = out.size, offered = data->size - taken;
        uint8_t *space = must(buffer_append_space(&out, chunk));
        if (offered > chunk)
            offered = chunk;
        z.next_in = data->data + taken;
        z.avail_in = (uInt)offered;
        z.next_out = space;
        z.avail_out = (uInt)chunk;
        code = inflate(&z, Z_NO_FLUSH);
        taken += offered - z.avail_in;
        out.size = before + chunk - z.avail_out;
        if (code == Z_OK && out.size == before && taken == data->size)
            code = Z_BUF_ERROR; /* cut short */
        if (out.size > limit)
            result = error_set(err, STATUS_ERR_LIMIT, "unpacks to more than %zu bytes", limit);
    }
    inflateEnd(&z);
    if (result == STATUS_OK && code != Z_STREAM_END)
        result = error_set(err, STATUS_ERR_INPUT, "is a damaged gzip file");
    if (result == STATUS_OK)
        buffer_append(&out, "", 0);
    if (result == STATUS_OK && out.data)
        out.data[out.size] = 0;
    if (result != STATUS_OK) {
        buffer_release(&out);
        return result;
    }
    buffer_release(data);
    *data = out;
    return STATUS_OK;
}

static status read_path(struct pbrt_reader *r, const char *path, struct buffer *out, struct error *err)
{
    status result = input_files_read(r->files, path, PBRT_FILE_BYTES_MAX, out, err);

    if (result == STATUS_OK && is_gzip(out)) {
        result = unpack(out, PBRT_FILE_BYTES_MAX, err);
        if (result != STATUS_OK)
            error_prefix(err, "%s", path);
    }
    if (result == STATUS_OK && out->size > PBRT_TEXT_BYTES_MAX - r->read_bytes)
        return error_set(err, STATUS_ERR_LIMIT, "%s: the scene's files have more than %zu GiB once unpacked", path,
                         PBRT_TEXT_BYTES_MAX >> 30);
    if (result == STATUS_OK)
        r->read_bytes += out->size;
    return result;
}

status pbrt_read_file(struct pbrt_reader *r, const char *name, const struct pbrt_place *at, struct buffer *out,
                      struct error *err)
{
    char *path;
    status result;

    TRY(resolve_at(r, name, at, &path, err));
    result = read_path(r, path, out, err);
    if (result != STATUS_OK && result != STATUS_ERR_NO_MEMORY)
        error_prefix(err, "%s:%u", at->file, at->line);
    mem_free(path);
    return result;
}

/* ---- the stack ---------------------------------------------------------------------------- */

static void source_release(struct pbrt_source *s)
{
    buffer_release(&s->data);
    mem_free(s->path);
    mem_free(s->folder);
    *s = (struct pbrt_source){0};
}

status pbrt_reader_init(struct pbrt_reader *r, struct arena *arena, const void *data, size_t size_bytes,
                        const char *name, const char *folder, struct input_files *files, struct error *err)
{
    struct pbrt_source *s = &r->stack[0];

    memset(r, 0, sizeof *r);
    r->arena = arena;
    r->folder = folder;
    r->files = files;
    r->depth = 1;
    buffer_append(&s->data, data, size_bytes);
    s->place.file = must(arena_strdup(arena, name));
    s->place.line = 1;
    must_hold(&s->data);
    if (is_gzip(&s->data))
        return unpack(&s->data, PBRT_FILE_BYTES_MAX, err);
    return STATUS_OK;
}

void pbrt_reader_release(struct pbrt_reader *r)
{
    while (r->depth)
        source_release(&r->stack[--r->depth]);
    buffer_release(&r->text);
}

static char *canonical(const char *path)
{
    char *whole = realpath(path, NULL), *copy = must(mem_strdup(whole ? whole : path));

    free(whole); /* libc's own memory */
    return copy;
}

status pbrt_include(struct pbrt_reader *r, const char *name, const struct pbrt_place *at, struct error *err)
{
    struct pbrt_source s = {0};
    char *path = NULL;
    status result;

    if (r->depth >= PBRT_INCLUDE_DEPTH_MAX || ++r->included > PBRT_INCLUDES_MAX)
        return pbrt_error(err, STATUS_ERR_LIMIT, at, "files include one another more than %d deep or %d times",
                          PBRT_INCLUDE_DEPTH_MAX, PBRT_INCLUDES_MAX);
    TRY(resolve_at(r, name, at, &path, err));
    s.path = canonical(path);
    s.folder = must(file_dirname(path));
    s.place.file = must(arena_strdup(r->arena, path));
    s.place.line = 1;
    for (size_t i = 0; i < r->depth; i++)
        if (r->stack[i].path && strcmp(r->stack[i].path, s.path) == 0) {
            result = pbrt_error(err, STATUS_ERR_INPUT, at, "\"%.*s\" includes itself", NAME_SHOWN, name);
            goto done;
        }
    result = read_path(r, path, &s.data, err);
    if (result != STATUS_OK && result != STATUS_ERR_NO_MEMORY)
        error_prefix(err, "%s:%u", at->file, at->line);
done:
    mem_free(path);
    if (result == STATUS_OK)
        r->stack[r->depth++] = s;
    else
        source_release(&s);
    return result;
}

/* ---- tokens ------------------------------------------------------------------------------- */

static int is_blank(uint8_t c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\v'; }

static void skip_blanks(struct pbrt_source *s)
{
    while (s->at < s->data.size) {
        uint8_t c = s->data.data[s->at];
        if (c == '#') {
            const uint8_t *end = memchr(s->data.data + s->at, '\n', s->data.size - s->at);
            s->at = end ? (size_t)(end - s->data.data) : s->data.size;
            continue;
        }
        if (!is_blank(c))
            return;
        s->place.line += c == '\n' && s->place.line < UINT32_MAX;
        s->at++;
    }
}

static int unescape(uint8_t c)
{
    switch (c) {
    case 'n': return '\n';
    case 't': return '\t';
    case 'r': return '\r';
    case 'b': return '\b';
    case 'f': return '\f';
    case '\\':
    case '"':
    case '\'': return c;
    default: return -1;
    }
}

static status read_string(struct pbrt_reader *r, struct pbrt_source *s, struct error *err)
{
    buffer_clear(&r->text);
    for (s->at++; s->at < s->data.size && s->data.data[s->at] != '"'; s->at++) {
        uint8_t c = s->data.data[s->at];
        if (c == '\n')
            break;
        if (c == '\\' && s->at + 1 < s->data.size && unescape(s->data.data[s->at + 1]) >= 0)
            c = (uint8_t)unescape(s->data.data[++s->at]);
        if (c == 0)
            return pbrt_error(err, STATUS_ERR_INPUT, &s->place, "a string holds a zero byte");
        if (r->text.size >= PBRT_STRING_BYTES_MAX)
            return pbrt_error(err, STATUS_ERR_LIMIT, &s->place,
                              "a string is longer than %d bytes: is its closing quote missing?", PBRT_STRING_BYTES_MAX);
        buffer_append(&r->text, &c, 1);
    }
    if (s->at >= s->data.size || s->data.data[s->at] != '"')
        return pbrt_error(err, STATUS_ERR_INPUT, &s->place, "a string has no closing quote on its line");
    s->at++;
    return STATUS_OK;
}

static status read_word(struct pbrt_reader *r, struct pbrt_source *s, struct error *err)
{
    static const char marks[4] = {'"', '[', ']', '#'};
    size_t start = s->at;

    while (s->at < s->data.size && !is_blank(s->data.data[s->at]) && !memchr(marks, s->data.data[s->at], sizeof marks))
        s->at++;
    if (s->at - start > PBRT_WORD_BYTES_MAX)
        return pbrt_error(err, STATUS_ERR_LIMIT, &s->place, "a word is longer than %d bytes", PBRT_WORD_BYTES_MAX);
    if (memchr(s->data.data + start, 0, s->at - start))
        return pbrt_error(err, STATUS_ERR_INPUT, &s->place, "is not text: it holds a zero byte");
    buffer_clear(&r->text);
    buffer_append(&r->text, s->data.data + start, s->at - start);
    return STATUS_OK;
}

static status read_token(struct pbrt_reader *r, struct error *err)
{
    struct pbrt_token *t = &r->token;
    struct pbrt_source *s;
    status result = STATUS_OK;

    for (;;) {
        s = &r->stack[r->depth - 1];
        skip_blanks(s);
        if (s->at < s->data.size || r->depth == 1)
            break;
        source_release(s);
        r->depth--;
    }
    *t = (struct pbrt_token){.kind = TOKEN_END, .at = s->place, .text = ""};
    if (s->at >= s->data.size)
        return STATUS_OK;
    switch (s->data.data[s->at]) {
    case '[':
        t->kind = TOKEN_OPEN;
        s->at++;
        return STATUS_OK;
    case ']':
        t->kind = TOKEN_CLOSE;
        s->at++;
        return STATUS_OK;
    case '"':
        t->kind = TOKEN_STRING;
        result = read_string(r, s, err);
        break;
    default:
        t->kind = TOKEN_WORD;
        result = read_word(r, s, err);
        break;
    }
    must_hold(&r->text);
    t->text = buffer_text(&r->text);
    t->size = r->text.size;
    return result;
}

status pbrt_peek(struct pbrt_reader *r, struct pbrt_token *out, struct error *err)
{
    status result = STATUS_OK;

    if (!r->peeked) {
        result = read_token(r, err);
        r->peeked = result == STATUS_OK;
    }
    *out = r->token;
    return result;
}

status pbrt_next(struct pbrt_reader *r, struct pbrt_token *out, struct error *err)
{
    status result = pbrt_peek(r, out, err);

    r->peeked = 0;
    return result;
}

int pbrt_number(const char *text, double *out)
{
    char *end;

    /* strtod also takes "inf", "nan" and hexadecimal: a scene may not. */
    if (!*text || text[strspn(text, "+-.0123456789eE")])
        return 0;
    *out = strtod(text, &end);
    return *end == 0 && end > text && fabs(*out) <= 3e38;
}
