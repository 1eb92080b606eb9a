#include "client/import/builder/uri.h"

#include <ctype.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "client/import/builder/input_files.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/memory.h"

enum { MESSAGE_URI_CHARS = 80 }; /* how much of a URI a message repeats */

static const char *past_space(const char *text) { return text + strspn(text, " \t\r\n"); }

int uri_is_data(const char *uri) { return strncasecmp(past_space(uri), "data:", 5) == 0; }

/* The byte at text[*at], %XX decoded, and *at past it; a '%' without two digits after it stays as it is. */
static uint8_t next_byte(const char *text, size_t size, size_t *at)
{
    const char *p = text + *at;

    if (*p == '%' && *at + 2 < size && isxdigit((unsigned char)p[1]) && isxdigit((unsigned char)p[2])) {
        const char digits[] = {p[1], p[2], 0};
        *at += 3;
        return (uint8_t)strtoul(digits, NULL, 16);
    }
    *at += 1;
    return (uint8_t)*p;
}

static void percent_decode(const char *text, size_t size, struct buffer *out)
{
    for (size_t i = 0; i < size;) {
        uint8_t byte = next_byte(text, size, &i);
        buffer_append(out, &byte, 1);
    }
    must_hold(out);
}

/* Of the usual alphabet, or of that for URLs and names of files (RFC 4648, sections 4 and 5). */
static int base64_digit(uint8_t c)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *at = c ? strchr(digits, c == '-' ? '+' : c == '_' ? '/' : c) : NULL;

    return at ? (int)(at - digits) : -1;
}

/* White space counts for nothing. Fills `to`, which has room for 3/4 of the text, up to *end. */
static status base64_decode(const char *text, size_t size, uint8_t *to, uint8_t **end, struct error *err)
{
    uint32_t bits = 0;
    size_t digits = 0, at = 0;
    int ended = 0;

    while (at < size) {
        size_t before = at;
        uint8_t c = next_byte(text, size, &at);
        int digit = base64_digit(c);
        ended |= c == '=';
        if (c == '=' || (c && strchr(" \t\r\n\f", c)))
            continue;
        if (digit < 0 || ended)
            return error_set(err, STATUS_ERR_INPUT, "the base64 data has an invalid character at position %zu", before);
        bits = bits << 6 | (uint32_t)digit;
        if (digits++ % 4)
            *to++ = (uint8_t)(bits >> (6 - 2 * ((digits - 1) % 4)));
    }
    *end = to;
    return digits % 4 == 1 ? error_set(err, STATUS_ERR_INPUT, "the base64 data is cut short") : STATUS_OK;
}

/* Is one of the parameters before the comma "base64"? It should be the last, and is not always. */
static int says_base64(const char *uri, const char *comma)
{
    while ((uri = memchr(uri, ';', (size_t)(comma - uri))) != NULL) {
        uri = past_space(uri + 1);
        if (strncasecmp(uri, "base64", 6) == 0 && strchr(";, ", uri[6]))
            return 1;
    }
    return 0;
}

status uri_decode_data(const char *uri, size_t limit_bytes, struct buffer *out, struct error *err)
{
    const char *comma = strchr(uri, ',');
    size_t size, before = out->size;
    uint8_t *to;
    status result;

    if (!uri_is_data(uri) || !comma)
        return error_set(err, STATUS_ERR_INPUT, "the data URI has no comma before its data");
    size = strlen(comma + 1);
    if (size > limit_bytes)
        return error_set(err, STATUS_ERR_LIMIT, "the data URI has %zu bytes: at most %zu are taken", size, limit_bytes);
    if (!says_base64(uri, comma)) {
        percent_decode(comma + 1, size, out);
        return STATUS_OK;
    }
    to = must(buffer_append_space(out, size));
    result = base64_decode(comma + 1, size, to, &to, err);
    out->size = result == STATUS_OK ? (size_t)(to - out->data) : before;
    return result;
}

/* Does it have a scheme ("http:", "C:")? */
static int has_scheme(const char *uri)
{
    const char *p = uri;

    if (!isalpha((unsigned char)*p))
        return 0;
    while (isalnum((unsigned char)*p) || *p == '+' || *p == '-' || *p == '.')
        p++;
    return *p == ':';
}

static status check_name(const char *uri, const char *path, size_t size, struct error *err)
{
    if (size == 0 || strlen(path) != size)
        return error_set(err, STATUS_ERR_INPUT, "the URI \"%.*s\" does not name a file", MESSAGE_URI_CHARS, uri);
    return STATUS_OK;
}

/* An absolute path is not changed: the reader checks where it leads. */
static char *path_below(const char *folder, const char *path)
{
    return *path == '/' ? must(mem_strdup(path)) : must(file_join(folder, path));
}

status uri_to_path(const char *uri, const char *folder, const struct input_files *files, char **path, struct error *err)
{
    struct buffer decoded = BUFFER_INIT;
    char *other;
    status result;

    *path = NULL;
    if (has_scheme(uri))
        return error_set(err, STATUS_ERR_INPUT,
                         "the URI \"%.*s\" has a scheme: only data URIs and relative file names "
                         "are read",
                         MESSAGE_URI_CHARS, uri);
    percent_decode(uri, strlen(uri), &decoded);
    result = check_name(uri, buffer_text(&decoded), decoded.size, err);
    if (result != STATUS_OK)
        goto done;
    *path = path_below(folder, buffer_text(&decoded));
    if (input_files_exist(files, *path))
        goto done;
    /* Names that were never encoded, and names written with the other slash. */
    for (int attempt = 0; attempt < 2; attempt++) {
        if (attempt == 0) {
            buffer_clear(&decoded);
            buffer_puts(&decoded, uri);
        } else {
            for (size_t i = 0; i < decoded.size; i++)
                if (decoded.data[i] == '\\')
                    decoded.data[i] = '/';
        }
        must_hold(&decoded);
        if (check_name(uri, buffer_text(&decoded), decoded.size, NULL) != STATUS_OK)
            break;
        other = path_below(folder, buffer_text(&decoded));
        if (input_files_exist(files, other)) {
            mem_free(*path);
            *path = other;
            break;
        }
        mem_free(other);
    }
done:
    buffer_release(&decoded);
    return result;
}
