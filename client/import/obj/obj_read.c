/* OBJ and MTL: names, lines, words and the files that they name. */
#include <assert.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "client/import/obj/obj.h"
#include "client/import/builder/scan.h"
#include "client/import/builder/uri.h"
#include "client/terminal/must.h"
#include "common/base/memory.h"

/* ---- names --------------------------------------------------------------------------------- */

static size_t hash_text(const char *text, size_t length)
{
    uint64_t h = 0xcbf29ce484222325u; /* FNV-1a */

    for (size_t i = 0; i < length; i++)
        h = (h ^ (uint8_t)text[i]) * 0x100000001b3u;
    return (size_t)(h ^ h >> 32);
}

static void names_grow(struct obj_names *names)
{
    size_t size = names->index_size ? 2 * names->index_size : 64;
    uint32_t *index = must(mem_calloc(size, sizeof *index));

    for (size_t i = 0; i < names->count; i++) {
        size_t at = hash_text(names->texts[i], strlen(names->texts[i])) & (size - 1);
        while (index[at])
            at = (at + 1) & (size - 1);
        index[at] = (uint32_t)i + 1;
    }
    mem_free(names->index);
    names->index = index;
    names->index_size = size;
}

uint32_t obj_intern(struct obj_names *names, const char *text, size_t length)
{
    const char *nul = memchr(text, 0, length);
    size_t at;
    char *copy;

    length = nul ? (size_t)(nul - text) : length;
    length = length < OBJ_NAME_BYTES_MAX ? length : OBJ_NAME_BYTES_MAX;
    if (2 * (names->count + 1) > names->index_size)
        names_grow(names);
    at = hash_text(text, length) & (names->index_size - 1);
    for (; names->index[at]; at = (at + 1) & (names->index_size - 1)) {
        assert(names->index[at] <= names->count);
        const char *other = names->texts[names->index[at] - 1];
        if (strlen(other) == length && memcmp(other, text, length) == 0)
            return names->index[at] - 1;
    }
    MUST_GROW(names->texts, names->capacity, names->count + 1);
    copy = must(mem_alloc(length + 1));
    memcpy(copy, text, length);
    copy[length] = 0;
    names->texts[names->count++] = copy;
    names->index[at] = (uint32_t)names->count;
    return (uint32_t)names->count - 1;
}

void obj_names_release(struct obj_names *names)
{
    for (size_t i = 0; i < names->count; i++)
        mem_free(names->texts[i]);
    mem_free(names->texts);
    mem_free(names->index);
    memset(names, 0, sizeof *names);
}

/* ---- lines and words ------------------------------------------------------------------------ */

static int is_line_end(char c) { return c == '\n' || c == '\r'; }

/* The length of a backslash and the line end after it at `at`; 0: there is none. */
static size_t continuation(const char *at, const char *end)
{
    if (end - at < 2 || at[0] != '\\' || !is_line_end(at[1]))
        return 0;
    return end - at > 2 && at[1] == '\r' && at[2] == '\n' ? 3 : 2;
}

int obj_next_line(struct obj_text *text, struct obj_line *line)
{
    while (text->at < text->end) {
        const char *at = text->at;
        *line = (struct obj_line){.at = at, .number = text->line};
        while (at < text->end && !is_line_end(*at)) {
            size_t skip = continuation(at, text->end);
            text->line += skip > 0;
            at += skip ? skip : 1;
        }
        line->end = at;
        text->line++;
        if (at < text->end)
            at += text->end - at > 1 && at[0] == '\r' && at[1] == '\n' ? 2 : 1;
        text->at = at;
        if (line->at < line->end)
            return 1;
    }
    return 0;
}

static void skip_space(struct obj_line *line)
{
    while (line->at < line->end) {
        size_t skip = continuation(line->at, line->end);
        if (!skip && *line->at != ' ' && *line->at != '\t' && *line->at != '\v' && *line->at != '\f')
            return;
        line->at += skip ? skip : 1;
    }
}

struct obj_word obj_next_word(struct obj_line *line)
{
    struct obj_word word;

    skip_space(line);
    word.text = line->at;
    if (line->at < line->end && *line->at == '#')
        line->at = line->end;
    else
        while (line->at < line->end && *line->at != ' ' && *line->at != '\t' && !continuation(line->at, line->end))
            line->at++;
    word.length = word.text < line->end && *word.text == '#' ? 0 : (size_t)(line->at - word.text);
    return word;
}

struct obj_word obj_rest(struct obj_line *line)
{
    struct obj_word word;

    skip_space(line);
    word.text = line->at;
    word.length = (size_t)(line->end - line->at);
    while (word.length && (word.text[word.length - 1] == ' ' || word.text[word.length - 1] == '\t'))
        word.length--;
    line->at = line->end;
    return word;
}

int obj_word_is(struct obj_word word, const char *text)
{
    return word.length == strlen(text) && strncasecmp(word.text, text, word.length) == 0;
}

/* A word as "1,5", of programs that write numbers as their user's country does; 0: it is none. */
static int decimal_comma(struct obj_word word, double *out)
{
    char text[64];
    double value;
    const char *comma = memchr(word.text, ',', word.length);

    if (!comma || word.length >= sizeof text || memchr(word.text, '.', word.length))
        return 0;
    memcpy(text, word.text, word.length);
    text[comma - word.text] = '.';
    if (scan_double(text, text + word.length, &value) != word.length)
        return 0;
    *out = value;
    return 1;
}

size_t obj_numbers(struct obj_line *line, size_t most, double *out)
{
    size_t count = 0;

    while (count < most) {
        struct obj_line before = *line;
        struct obj_word word = obj_next_word(line);
        size_t length = scan_double(word.text, word.text + word.length, &out[count]);
        if (length == 0) {
            *line = before;
            break;
        }
        /* Some files end values with a comma or "f". */
        if (length < word.length && !(word.length - length == 1 && strchr(",;fF", word.text[length]))) {
            int is_comma = decimal_comma(word, &out[count]);
            double value;
            if (!line->odd.length || (is_comma && !decimal_comma(line->odd, &value)))
                line->odd = word;
        }
        count++;
    }
    return count;
}

void obj_warn_of_odd(struct obj *o, const char *file, const struct obj_line *line)
{
    struct obj_word odd = line->odd;
    double value;

    if (odd.length && decimal_comma(odd, &value))
        builder_warn_at(o->b, file, line->number, "decimal comma", "numbers have decimal commas: \"%.*s\" is read as %g",
                        (int)(odd.length < 24 ? odd.length : 24), odd.text, value);
    else if (odd.length)
        builder_warn_at(o->b, file, line->number, "odd number", "\"%.*s\" is read as far as it is a number",
                        (int)(odd.length < 24 ? odd.length : 24), odd.text);
}

/* ---- other files ---------------------------------------------------------------------------- */

/* Is `file` an existing path below (or slightly above) the folder? */
static status find_file(struct obj *o, const char *file, char **path, struct error *err)
{
    struct buffer name = BUFFER_INIT;
    status result;

    for (const char *p = file; *p; p++)
        if (*p == '%') /* uri_to_path() decodes it again */
            buffer_puts(&name, "%25");
        else
            buffer_append(&name, *p == '\\' ? "/" : p, 1);
    must_hold(&name);
    result = uri_to_path(buffer_text(&name), o->folder, o->b->files, path, err);
    buffer_release(&name);
    return result;
}

/* Set *path to `prefix`/`file` if that file exists and may be read, and *path is not set yet. */
static void try_file(struct obj *o, const char *prefix, size_t prefix_length, const char *file, char **path, int *found)
{
    struct buffer name = BUFFER_INIT;
    char *other = NULL;

    if (*found)
        return;
    buffer_append(&name, prefix, prefix_length);
    buffer_puts(&name, file);
    must_hold(&name);
    if (find_file(o, buffer_text(&name), &other, NULL) == STATUS_OK && input_files_contain(o->b->files, other)) {
        mem_free(*path);
        *path = other;
        other = NULL;
        *found = 1;
    }
    mem_free(other);
    buffer_release(&name);
}

/* The name after the last separator. */
static const char *last_name(const char *path)
{
    const char *last = path;

    for (const char *p = path; *p; p++)
        if (*p == '/' || *p == '\\' || *p == ':')
            last = p + 1;
    return last;
}

status obj_read_file(struct obj *o, const char *within, const char *file, size_t limit, struct buffer *out,
                     struct error *err)
{
    size_t beside = within ? (size_t)(last_name(within) - within) : 0;
    char *path = NULL;
    int found = 0;
    status result;

    if (!o->folder)
        return error_set(err, STATUS_ERR_INPUT, "other files cannot be read here");
    try_file(o, within, beside, file, &path, &found);
    try_file(o, NULL, 0, file, &path, &found);
    /* A path on the computer that made the file: the other file may be beside this one. */
    try_file(o, within, beside, last_name(file), &path, &found);
    try_file(o, NULL, 0, last_name(file), &path, &found);
    result = found ? STATUS_OK : find_file(o, file, &path, err);
    THEN(result, input_files_read(o->b->files, path, limit, out, err));
    mem_free(path);
    return result;
}
