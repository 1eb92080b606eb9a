#include "web/uploads/import_check.h"

#include <stdio.h>
#include <string.h>

#include <jansson.h>

#include "common/base/memory.h"
#include "common/schema/settings.h"
#include "protocol/message.h"

enum { WARNINGS_MAX = 100 };

/* ---- paths -------------------------------------------------------------------------------- */

static status name_check(const char *path, const char *name, size_t length, struct error *err)
{
    char shown[128];

    message_text(shown, sizeof shown, path);
    if (length == 0)
        return error_set(err, STATUS_ERR_USAGE,
                         "the path '%s': has an empty name; give a path below the upload's folder, as in "
                         "textures/wood.png", shown);
    if ((length == 1 && name[0] == '.') || (length == 2 && name[0] == '.' && name[1] == '.'))
        return error_set(err, STATUS_ERR_USAGE,
                         "the path '%s': '.' and '..' are not allowed; give it below the upload's folder, as in "
                         "textures/wood.png", shown);
    if (length > IMPORT_NAME_MAX)
        return error_set(err, STATUS_ERR_USAGE, "the path '%s': a name may have at most %d bytes", shown,
                         IMPORT_NAME_MAX);
    return STATUS_OK;
}

/* As the answers that name the file need it. */
static int is_utf8(const char *text)
{
    json_t *string = json_string(text);

    json_decref(string);
    return string != NULL;
}

status import_path_check(const char *path, struct error *err)
{
    status s = STATUS_OK;
    int depth = 0;

    if (strlen(path) > IMPORT_PATH_MAX)
        return error_set(err, STATUS_ERR_USAGE, "a file's path may have at most %d bytes", IMPORT_PATH_MAX);
    for (const char *c = path; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            return error_set(err, STATUS_ERR_USAGE, "a file's path has a control character; rename the file");
    if (!is_utf8(path))
        return error_set(err, STATUS_ERR_USAGE, "a file's path is not UTF-8; rename the file");
    for (const char *name = path; s == STATUS_OK;) {
        size_t length = strcspn(name, "/");
        if (++depth > IMPORT_DEPTH_MAX)
            return error_set(err, STATUS_ERR_USAGE, "a file may lie at most %d folders deep", IMPORT_DEPTH_MAX - 1);
        s = name_check(path, name, length, err);
        if (!name[length])
            break;
        name += length + 1;
    }
    return s;
}

/* ---- options ------------------------------------------------------------------------------ */

enum kind { FLAG, VALUE, PATH };

/* What of `azulejo submit` a stranger may say: nothing that reads or writes the coordinator's own files, takes
 * room that the disk has not, or waits for the job. */
static const struct {
    const char *name;
    enum kind kind;
} allowed[] = {
    {"size", VALUE}, {"spp", VALUE}, {"frames", VALUE}, {"first-middle-last", FLAG}, {"name", VALUE}, {"priority", VALUE},
    {"camera", VALUE}, {"fit", VALUE}, {"region", VALUE}, {"tonemap", VALUE}, {"tonemap-param", VALUE}, {"lut", PATH},
    {"alpha", FLAG}, {"half", FLAG}, {"format", VALUE}, {"png-bits", VALUE}, {"jpeg-quality", VALUE}, {"no-dither", FLAG},
    {"env", PATH}, {"scene", VALUE}, {"variant", VALUE}, {"animation", VALUE}, {"light-units", VALUE}, {"studio", VALUE},
    {"strict", FLAG},
#define SETTING(o, KIND, type, name, initial, least, most, shown, attribute, option, ...) {option, VALUE},
#define FIELD(...)
#define OPTION(o, name, option, ...) {option, VALUE},
    RENDER_SETTINGS(FIELD, SETTING, ) LOOK_SETTINGS(SETTING, ) STOP_RULES(OPTION, SETTING, ) JOB_NEEDS(OPTION, SETTING, )
#undef OPTION
#undef FIELD
#undef SETTING
};
enum { ALLOWED_COUNT = sizeof allowed / sizeof *allowed };

/* Its row; -1: it is not allowed. */
static int find(const char *name, size_t length)
{
    for (int i = 0; i < ALLOWED_COUNT; i++)
        if (strlen(allowed[i].name) == length && memcmp(allowed[i].name, name, length) == 0)
            return i;
    return -1;
}

static status refuse(const char *word, struct error *err)
{
    struct buffer names = BUFFER_INIT;
    char shown[64];

    for (int i = 0; i < ALLOWED_COUNT; i++)
        buffer_printf(&names, "%s--%s", i ? ", " : "", allowed[i].name);
    error_set(err, STATUS_ERR_USAGE, "options: '%s' cannot be given with an upload; what can: %s",
              message_text(shown, sizeof shown, word), buffer_text(&names));
    buffer_release(&names);
    return STATUS_ERR_USAGE;
}

static status value_check(int row, const char *value, struct error *err)
{
    if (strlen(value) > IMPORT_VALUE_MAX)
        return error_set(err, STATUS_ERR_USAGE, "options: --%s: may have at most %d bytes", allowed[row].name,
                         IMPORT_VALUE_MAX);
    for (const char *c = value; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            return error_set(err, STATUS_ERR_USAGE, "options: --%s: has a control character", allowed[row].name);
    if (allowed[row].kind != PATH || import_path_check(value, err) == STATUS_OK)
        return STATUS_OK;
    error_prefix(err, "options: --%s", allowed[row].name);
    return STATUS_ERR_USAGE;
}

static status add(struct import_words *out, int row, const char *value, struct error *err)
{
    struct buffer word = BUFFER_INIT;

    TRY(value ? value_check(row, value, err) : STATUS_OK);
    buffer_printf(&word, "--%s", allowed[row].name);
    if (value)
        buffer_printf(&word, "=%s%s", allowed[row].kind == PATH ? "./" : "", value);
    out->items[out->count] = buffer_ok(&word) ? mem_strdup(buffer_text(&word)) : NULL;
    buffer_release(&word);
    NEED(out->items[out->count], err, "options");
    out->count++;
    return STATUS_OK;
}

/* The option at options[*at], and its value behind it or behind a '='. */
static status read_one(struct import_words *out, const json_t *options, size_t *at, struct error *err)
{
    const char *word = json_string_value(json_array_get(options, (*at)++)), *value;
    size_t length;
    int row;

    if (!word)
        return error_set(err, STATUS_ERR_USAGE, "options: must be texts, as in [\"--spp\", \"64\"]");
    if (strncmp(word, "--", 2) != 0)
        return refuse(word, err);
    length = strcspn(word + 2, "=");
    row = find(word + 2, length);
    if (row < 0)
        return refuse(word, err);
    value = word[2 + length] ? word + 2 + length + 1 : NULL;
    if (allowed[row].kind == FLAG && value)
        return error_set(err, STATUS_ERR_USAGE, "options: --%s: takes no value", allowed[row].name);
    if (allowed[row].kind != FLAG && !value) {
        value = json_string_value(json_array_get(options, (*at)++));
        if (!value)
            return error_set(err, STATUS_ERR_USAGE, "options: --%s: needs a value behind it", allowed[row].name);
    }
    return add(out, row, value, err);
}

status import_words_read(struct import_words *out, const json_t *options, struct error *err)
{
    status s = STATUS_OK;

    memset(out, 0, sizeof *out);
    if (!options)
        return STATUS_OK;
    if (!json_is_array(options))
        return error_set(err, STATUS_ERR_USAGE, "options: must be an array, as in [\"--spp\", \"64\"]");
    for (size_t at = 0; s == STATUS_OK && at < json_array_size(options);) {
        if (out->count == IMPORT_OPTIONS_MAX)
            return error_set(err, STATUS_ERR_USAGE, "options: at most %d", IMPORT_OPTIONS_MAX);
        s = read_one(out, options, &at, err);
    }
    return s;
}

void import_words_release(struct import_words *words)
{
    for (size_t i = 0; i < words->count; i++)
        mem_free(words->items[i]);
    memset(words, 0, sizeof *words);
}

/* ---- what the importer says --------------------------------------------------------------- */

/* `text` without the folder's path: people know their files by the names that they sent. */
static void strip(struct buffer *out, const char *text, size_t length, const char *folder)
{
    size_t skip = strlen(folder);

    for (size_t i = 0; i < length;) {
        if (skip > 0 && length - i >= skip && memcmp(text + i, folder, skip) == 0) {
            i += skip;
            if (i < length && text[i] == '/')
                i++;
            else
                buffer_puts(out, ".");
        } else if (length - i >= 2 && memcmp(text + i, "./", 2) == 0 && (i == 0 || strchr(" '\"(", text[i - 1]))) {
            i += 2;
        } else {
            buffer_append(out, text + i++, 1);
        }
    }
}

/* Where the text says that a file is not there; NULL: it does not. The importer says the same of files elsewhere on
 * the coordinator's machine (--only-below). */
static const char *find_missing(const char *text)
{
    static const char *const marks[] = {": cannot be opened: ", "\" does not exist"};
    const char *first = NULL;

    for (size_t i = 0; i < sizeof marks / sizeof *marks; i++) {
        const char *at = strstr(text, marks[i]);
        if (at && (!first || at < first))
            first = at + (*at == '"');
    }
    return first;
}

void import_sentence(char *out, size_t size, const char *printed, const char *folder)
{
    static const char mark[] = "azulejo submit: ", mark_early[] = "azulejo: "; /* of the program itself */
    const char *said = NULL, *help, *missing;
    struct buffer text = BUFFER_INIT;
    size_t length;

    out[0] = 0;
    for (const char *line = printed; line && *line; line = strchr(line, '\n') ? strchr(line, '\n') + 1 : NULL)
        if (strncmp(line, mark, sizeof mark - 1) == 0)
            said = line + sizeof mark - 1;
        else if (strncmp(line, mark_early, sizeof mark_early - 1) == 0)
            said = line + sizeof mark_early - 1;
    if (!said)
        return;
    length = strlen(said);
    while (length > 0 && said[length - 1] == '\n')
        length--;
    help = strstr(said, " ('azulejo submit --help'");
    if (help && help < said + length)
        length = (size_t)(help - said);
    strip(&text, said, length, folder);
    missing = find_missing(buffer_text(&text));
    message_text(out, size, buffer_text(&text));
    if (missing) {
        length = (size_t)(missing - buffer_text(&text));
        length = length < size / 2 ? length : size / 2;
        snprintf(out + length, size - length,
                 ": is not among the uploaded files: upload it, too, where the scene looks for it");
    }
    buffer_release(&text);
}

json_t *import_warnings(const char *printed, const char *folder)
{
    static const char mark[] = "warning: ";
    json_t *out = json_array();

    for (const char *line = printed; out && line && *line && json_array_size(out) < WARNINGS_MAX;) {
        size_t length = strcspn(line, "\n");
        if (strncmp(line, mark, sizeof mark - 1) == 0) {
            struct buffer raw = BUFFER_INIT;
            char text[1024];
            strip(&raw, line + sizeof mark - 1, length - (sizeof mark - 1), folder);
            json_array_append_new(out, json_string(message_text(text, sizeof text, buffer_text(&raw))));
            buffer_release(&raw);
        }
        line += length + (line[length] == '\n');
    }
    return out;
}
