/* azulejo tonemap: an EXR or HDR picture to PNG. */
#include <inttypes.h>
#include <stdio.h>

#include "client/command.h"
#include "client/job_info.h"
#include "client/job_options.h"
#include "common/base/buffer.h"
#include "common/base/file.h"

static void print_operators(void)
{
    size_t count;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);

    for (size_t i = 0; i < count; i++) {
        const struct tonemap_operator *op = operators[i];
        printf("%s%s\n  %s\n  source: %s\n", i ? "\n" : "", op->name, op->summary, op->source);
        for (size_t p = 0; p < op->parameter_count; p++)
            printf("  %-12s %g..%g, default %g: %s\n", op->parameters[p].name,
                   op->parameters[p].min, op->parameters[p].max, op->parameters[p].preset,
                   op->parameters[p].help);
    }
}

static status list_operators(int json, struct error *err)
{
    size_t count;
    const struct tonemap_operator *const *operators = tonemap_operators(&count);
    json_t *list;

    if (!json) {
        print_operators();
        return STATUS_OK;
    }
    list = json_array();
    for (size_t i = 0; i < count; i++) {
        json_t *parameters = json_array();
        for (size_t p = 0; p < operators[i]->parameter_count; p++) {
            const struct tonemap_parameter *q = &operators[i]->parameters[p];
            json_array_append_new(parameters,
                                  json_pack("{s:s, s:o, s:o, s:o, s:s}", "name", q->name, "min",
                                            json_number(q->min), "max", json_number(q->max),
                                            "default", json_number(q->preset), "help", q->help));
        }
        json_array_append_new(list, json_pack("{s:s, s:s, s:s, s:o}", "name", operators[i]->name,
                                              "summary", operators[i]->summary, "source",
                                              operators[i]->source, "parameters", parameters));
    }
    return json_print(json_pack("{s:o}", "operators", list), err);
}

static status tonemap_file(const char *from, const char *to, const struct tonemap_settings *how,
                           struct error *err)
{
    struct buffer file = BUFFER_INIT, png = BUFFER_INIT;
    struct image picture = {0}, display = {0};
    struct image_repairs repairs = {0};
    status result = file_read(from, IMAGE_BYTES_MAX, &file, err);

    if (result == STATUS_OK)
        result = image_decode_hdr(&picture, file.data, file.size, from, &repairs, err);
    if (result == STATUS_OK)
        result = tonemap_apply(&display, &picture, how, NULL, err);
    if (result == STATUS_OK)
        result = png_encode(&png, &display, err);
    if (result == STATUS_OK)
        result = file_write_atomic(to, png.data, png.size, err);
    image_release(&display);
    image_release(&picture);
    buffer_release(&png);
    buffer_release(&file);
    return result;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code,
                  struct error *err)
{
    const char *name = NULL;
    struct option_list parameters = {0};
    struct tonemap_settings settings;
    double exposure_ev = 0;
    int list = 0, json = 0, done;
    const struct option table[] = {
        {"tonemap", 't', OPTION_STRING, &name, "OPERATOR", "the operator (default " TONEMAP_DEFAULT ")",
         0, 0, NULL},
        {"tonemap-param", 'p', OPTION_LIST, &parameters, "NAME=X",
         "a parameter of the operator; may be given several times", 0, 0, NULL},
        {"exposure", 0, OPTION_REAL, &exposure_ev, "EV",
         "stops of exposure before tone mapping: doubles with each (default 0)", -100, 100, NULL},
        {"list", 'l', OPTION_FLAG, &list, NULL, "list the operators and their parameters", 0, 0, NULL},
        {"json", 0, OPTION_FLAG, &json, NULL, "with --list: print JSON", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    status result = command_parse(command, table, argc, argv, 0, 2, &rest, &done, err);

    (void)exit_code;
    if (result != STATUS_OK || done)
        return result;
    if (list)
        return rest.count == 0 ? list_operators(json, err)
                               : error_set(err, STATUS_ERR_USAGE, "--list takes no picture");
    if (json)
        return error_set(err, STATUS_ERR_USAGE, "--json goes with --list");
    if (rest.count != 2)
        return error_set(err, STATUS_ERR_USAGE, "two files are needed; usage: %s", command->usage);
    result = tonemap_options_check(name, &parameters, exposure_ev, &settings, err);
    if (result == STATUS_OK)
        result = tonemap_file(rest.items[0], rest.items[1], &settings, err);
    return result;
}

const struct command command_tonemap = {
    .name = "tonemap",
    .group = COMMAND_PICTURES,
    .usage = "azulejo tonemap PICTURE OUT.png [OPTION]...",
    .summary = "turn an EXR or HDR picture into a PNG for the screen",
    .description = "Tone map an EXR or Radiance HDR picture just as the farm does, into an 8-bit sRGB PNG.",
    .run = run,
};
