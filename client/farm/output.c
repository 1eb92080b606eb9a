#include "client/farm/output.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "client/terminal/parse.h"
#include "common/base/file.h"
#include "protocol/message.h"

#define PERCENTILE_DEFAULT 99.0 /* the wire's, where it says 0 */

static char exr[] = "exr", png[] = "png", jpg[] = "jpg"; /* messages hold no const texts */
static char *const format_names[OUTPUT_FORMAT_COUNT] = {exr, png, jpg};

status output_options_check(const struct output_options *o, struct output_request *out,
                            struct error *err)
{
    status result = STATUS_OK;

    memset(out, 0, sizeof *out);
    buffer_init(&out->tonemap_file);
    if (o->formats)
        result = parse_formats(o->formats, &out->formats, err);
    if (result == STATUS_OK)
        result = tonemap_options_check(&o->tone, &out->tonemap, &out->tonemap_file, err);
    out->png_bits = o->png_bits ? (uint32_t)strtoul(o->png_bits, NULL, 10) : 0;
    out->jpeg_quality = (uint32_t)o->jpeg_quality;
    out->tonemap.temporal = (uint32_t)o->temporal;
    out->no_dither = o->no_dither;
    return result;
}

void output_request_release(struct output_request *request)
{
    buffer_release(&request->tonemap_file);
}

static void parameters_set(struct output_message *out, const struct tonemap_settings *s)
{
    for (size_t i = 0; i < s->op->parameter_count; i++) {
        azulejo__wire__output_settings__parameters_entry__init(&out->entries[i]);
        out->entries[i].key = (char *)s->op->parameters[i].name;
        out->entries[i].value = s->values[i];
        out->entry_pointers[i] = &out->entries[i];
    }
    out->message.n_parameters = s->op->parameter_count;
    out->message.parameters = out->entry_pointers;
}

void output_message_set(struct output_message *out, const struct output_request *request,
                        unsigned formats)
{
    const struct tonemap_settings *s = &request->tonemap;
    Azulejo__Wire__OutputSettings *m = &out->message;

    azulejo__wire__output_settings__init(m);
    parameters_set(out, s);
    m->tonemap = (char *)s->op->name;
    m->exposure_ev = s->exposure_ev;
    m->camera_ev = request->camera_ev;
    m->metering = (char *)tonemap_metering_name(s->metering);
    m->metering_percentile = s->metering_percentile;
    m->white_kelvin = s->white_kelvin;
    m->temporal = s->temporal;
    if (s->has_file) {
        wire_digest_set(&m->tonemap_file, &s->file);
        m->tonemap_file_name = (char *)s->file_name;
    }
    m->exr_half = request->half;
    m->png_bits = request->png_bits;
    m->jpeg_quality = request->jpeg_quality;
    m->no_dither = request->no_dither;
    m->formats = out->formats;
    for (int i = 0; i < OUTPUT_FORMAT_COUNT; i++)
        if (formats >> i & 1)
            out->formats[m->n_formats++] = format_names[i];
}

unsigned output_message_formats(const Azulejo__Wire__OutputSettings *message)
{
    unsigned formats = 0;

    for (size_t k = 0; k < message->n_formats; k++)
        for (int i = 0; i < OUTPUT_FORMAT_COUNT; i++)
            if (strcmp(message->formats[k], format_names[i]) == 0)
                formats |= 1u << i;
    return formats;
}

unsigned output_format_of(const char *path)
{
    const char *extension = file_extension(path);

    if (strcasecmp(extension, "exr") == 0)
        return OUTPUT_FORMAT_EXR;
    if (strcasecmp(extension, "png") == 0)
        return OUTPUT_FORMAT_PNG;
    if (strcasecmp(extension, "jpg") == 0 || strcasecmp(extension, "jpeg") == 0)
        return OUTPUT_FORMAT_JPEG;
    return 0;
}

double output_percentile(const Azulejo__Wire__OutputSettings *message)
{
    return message->metering_percentile > 0 ? message->metering_percentile : PERCENTILE_DEFAULT;
}
