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

int uri_is_data(const char *uri) { return strncasecmp(uri, "data:", 5) == 0; }

/* Decode %XX; a '%' without two digits after it stays as it is. */
static void percent_decode(const char *text, size_t size, struct buffer *out)
{
    for (size_t i = 0; i < size; i++) {
        uint8_t byte = (uint8_t)text[i];
        if (text[i] == '%' && i + 2 < size && isxdigit((unsigned char)text[i + 1]) &&
            isxdigit((unsigned char)text[i + 2])) {
            const char digits[] = {text[i + 1], text[i + 2], 0};
            byte = (uint8_t)strtoul(digits, NULL, 16);
            i += 2;
        }
        buffer_append(out, &byte, 1);
    }
}

static int base64_digit(char c)
{
    if (c >= 'A' && c <= 'Z')
        return c - 'A';
    if (c >= 'a' && c <= 'z')
        return c - 'a' + 26;
    if (c >= '0' && c <= '9')
        return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
}

static status base64_decode(const char *text, size_t size, struct buffer *out, struct error *err)
{
    uint32_t bits = 0;
    int held = 0;
    uint8_t *to;

    while (size && text[size - 1] == '=')
        size--;
    if (size % 4 == 1)
        return error_set(err, STATUS_ERR_INPUT, "the base64 data is cut short");
    to = must(buffer_append_space(out, size / 4 * 3 + (size % 4 ? size % 4 - 1 : 0)));
    for (size_t i = 0; i < size; i++) {
        int digit = base64_digit(text[i]);
        if (digit < 0)
            return error_set(err, STATUS_ERR_INPUT, "the base64 data has an invalid character at position %zu", i);
        bits = bits << 6 | (uint32_t)digit;
        held += 6;
        if (held >= 8) {
            held -= 8;
            *to++ = (uint8_t)(bits >> held);
        }
    }
    return STATUS_OK;
}

status uri_decode_data(const char *uri, size_t limit_bytes, struct buffer *out, struct error *err)
{
    const char *comma = strchr(uri, ',');
    size_t size;

    if (!uri_is_data(uri) || !comma)
        return error_set(err, STATUS_ERR_INPUT, "the data URI has no comma before its data");
    size = strlen(comma + 1);
    if (size > limit_bytes)
        return error_set(err, STATUS_ERR_LIMIT, "the data URI has %zu bytes: at most %zu are taken", size, limit_bytes);
    if (comma - uri >= 7 + 5 && strncasecmp(comma - 7, ";base64", 7) == 0)
        return base64_decode(comma + 1, size, out, err);
    percent_decode(comma + 1, size, out);
    must_hold(out);
    return STATUS_OK;
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
    must_hold(&decoded);
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
