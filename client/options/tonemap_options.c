#include "client/options/tonemap_options.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/terminal/parse.h"
#include "common/system/file.h"

/* ---- the direct options --------------------------------------------------------------------- */

static const char parameters_title[] =
    "parameters of the tone mapping operators ('azulejo tonemap --list' describes them; if an option "
    "above has the name of one, write -p NAME=VALUE):";

static struct tonemap_direct *direct_find(struct tonemap_options *o, const char *name)
{
    for (size_t i = 0; i < o->direct_count; i++)
        if (strcmp(o->direct[i].name, name) == 0)
            return &o->direct[i];
    return NULL;
}

static int name_is_taken(const struct option *rows, const char *name)
{
    for (; rows->name; rows++)
        if (strcmp(rows->name, name) == 0)
            return 1;
    return 0;
}

static void help_add(struct tonemap_direct *direct, const char *operator_name, const struct tonemap_parameter *p)
{
    size_t used = strlen(direct->help), size = sizeof direct->help;
    const char *separator = used ? "; " : "";

    if (p->kind == TONEMAP_CHOICE) {
        snprintf(direct->help + used, size - used, "%s%s: ", separator, operator_name);
        for (size_t i = 0; p->choices[i]; i++) {
            used = strlen(direct->help);
            snprintf(direct->help + used, size - used, "%s%s", i ? "|" : "", p->choices[i]);
        }
        used = strlen(direct->help);
        snprintf(direct->help + used, size - used, ", default %s", p->choices[(size_t)p->preset]);
    } else {
        snprintf(direct->help + used, size - used, "%s%s: %g..%g, default %g", separator, operator_name, p->min, p->max,
                 p->preset);
    }
}

static void directs_collect(struct tonemap_options *o, const struct option *rows)
{
    size_t count;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);

    o->direct_count = 0;
    for (size_t i = 0; i < count; i++) {
        for (size_t k = 0; k < operators[i]->parameter_count; k++) {
            const struct tonemap_parameter *p = &operators[i]->parameters[k];
            struct tonemap_direct *direct = direct_find(o, p->name);

            if (name_is_taken(rows, p->name))
                continue;
            if (!direct) {
                assert(o->direct_count < TONEMAP_DIRECT_MAX);
                direct = &o->direct[o->direct_count++];
                memset(direct, 0, sizeof *direct);
                direct->name = p->name;
            }
            help_add(direct, operators[i]->name, p);
        }
    }
}

const struct option *tonemap_options_table(struct tonemap_options *o, const struct option *rows,
                                           struct option out[TONEMAP_ROWS_MAX])
{
    size_t used = 0;

    directs_collect(o, rows);
    while (rows[used].name) {
        out[used] = rows[used];
        used++;
    }
    assert(used + o->direct_count + 2 <= TONEMAP_ROWS_MAX);
    out[used++] = (struct option){.name = "", .kind = OPTION_GROUP, .help = parameters_title};
    for (size_t i = 0; i < o->direct_count; i++)
        out[used++] = (struct option){.name = o->direct[i].name,
                                      .kind = OPTION_STRING,
                                      .target = &o->direct[i].value,
                                      .argument = "VALUE",
                                      .help = o->direct[i].help};
    memset(&out[used], 0, sizeof out[used]);
    return out;
}

/* ---- from options to settings --------------------------------------------------------------- */

int tonemap_has_parameter(const struct tonemap_operator *op, const char *name, size_t length)
{
    for (size_t i = 0; i < op->parameter_count; i++)
        if (strlen(op->parameters[i].name) == length && memcmp(op->parameters[i].name, name, length) == 0)
            return 1;
    return 0;
}

void tonemap_options_keep(struct tonemap_options *o, const struct tonemap_operator *op)
{
    size_t kept = 0;

    for (size_t i = 0; i < o->direct_count; i++)
        if (!tonemap_has_parameter(op, o->direct[i].name, strlen(o->direct[i].name)))
            o->direct[i].value = NULL;
    for (size_t i = 0; i < o->parameters.count; i++)
        if (tonemap_has_parameter(op, o->parameters.items[i], strcspn(o->parameters.items[i], "=")))
            o->parameters.items[kept++] = o->parameters.items[i];
    o->parameters.count = kept;
}

/* --percentile has two uses; see its help. */
static status set_percentile(const struct tonemap_options *o, struct tonemap_settings *out, struct error *err)
{
    const double percentile = out->metering_percentile;

    if (!o->said[LOOK_metering_percentile].text || out->metering == TONEMAP_METERING_PERCENTILE)
        return STATUS_OK;
    setting_reset(&look_rows[LOOK_metering_percentile], out);
    if (tonemap_has_parameter(out->op, "percentile", strlen("percentile")))
        return tonemap_settings_set(out, "percentile", percentile, err);
    return error_set(err, STATUS_ERR_USAGE,
                     "--percentile: %s has no such parameter; or was --auto-exposure percentile "
                     "meant?",
                     out->op->name);
}

static status set_parameters(const struct tonemap_options *o, struct tonemap_settings *out, struct error *err)
{
    status result = STATUS_OK;

    for (size_t i = 0; i < o->direct_count && result == STATUS_OK; i++) {
        if (!o->direct[i].value)
            continue;
        result = tonemap_settings_set_text(out, o->direct[i].name, o->direct[i].value, err);
        if (result != STATUS_OK)
            error_prefix(err, "--%s", o->direct[i].name);
    }
    for (size_t i = 0; i < o->parameters.count && result == STATUS_OK; i++) {
        char name[64];
        const char *value;

        result = parse_parameter(o->parameters.items[i], name, sizeof name, &value, err);
        if (result != STATUS_OK)
            break;
        result = tonemap_settings_set_text(out, name, value, err);
        if (result != STATUS_OK)
            error_prefix(err, "--tonemap-param");
    }
    return result == STATUS_OK ? set_percentile(o, out, err) : result;
}

status tonemap_key_check(const struct tonemap_settings *s, const char *path, struct error *err)
{
    char *end;

    if (!path || file_exists(path) || !tonemap_has_parameter(s->op, "key", strlen("key")))
        return STATUS_OK;
    (void)strtod(path, &end);
    if (end == path || *end)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_USAGE, "--key names the farm's key file here; %s's parameter is written -p key=%s",
                     s->op->name, path);
}

static status load_file(const char *path, struct tonemap_settings *out, struct buffer *file, struct error *err)
{
    void *loaded = NULL;
    status result = file_read(path, TONEMAP_FILE_BYTES_MAX, file, err);

    THEN(result, out->op->file_load(&loaded, file->data, file->size, path, err));
    if (result != STATUS_OK)
        return result;
    out->op->file_free(loaded);
    out->has_file = 1;
    snprintf(out->file_name, sizeof out->file_name, "%.*s", TONEMAP_FILE_NAME_MAX, file_basename(path));
    return digest_of(&out->file, file->data, file->size);
}

/* Operators refuse some settings only when they run: try it now, not after hours of rendering. */
static status try_out(const struct tonemap_options *o, const struct tonemap_settings *settings,
                      const struct buffer *file, struct error *err)
{
    float grey[4 * 4 * 3];
    const struct image picture = {4, 4, 3, grey};
    const struct tonemap_context context = {
        .threads = 1, .file_data = file->data, .file_size = file->size};
    struct image display = {0};
    status result;

    for (int i = 0; i < 4 * 4 * 3; i++)
        grey[i] = (float)(i / 3 + 1);
    result = tonemap_apply(&display, &picture, settings, &context, err);
    image_release(&display);
    if (result == STATUS_ERR_INPUT && !o->file) {
        if (settings->op->file_load)
            error_prefix(err, "without --lut");
        return STATUS_ERR_USAGE;
    }
    return result;
}

status tonemap_options_check(const struct tonemap_options *o, struct tonemap_settings *out, struct buffer *file,
                             struct error *err)
{
    status result = tonemap_settings_init(out, o->tonemap ? o->tonemap : TONEMAP_DEFAULT, err);

    THEN(result, settings_said(look_rows, LOOK_COUNT, o->said, out, err));
    THEN(result, set_parameters(o, out, err));
    if (result == STATUS_OK && o->file && !out->op->file_load)
        result = error_set(err, STATUS_ERR_USAGE, "--lut: the operator %s takes no file", out->op->name);
    if (result == STATUS_OK && !o->file && out->op->file_required)
        result = error_set(err, STATUS_ERR_USAGE, "the operator %s needs a file, name it with --lut: %s", out->op->name,
                           out->op->file_help);
    if (result != STATUS_OK) /* a wrong name or range is a usage error, not a bad file */
        return result == STATUS_ERR_INPUT ? STATUS_ERR_USAGE : result;
    if (o->file)
        result = load_file(o->file, out, file, err);
    THEN(result, tonemap_settings_validate(out, err));
    return result == STATUS_OK ? try_out(o, out, file, err) : result;
}
