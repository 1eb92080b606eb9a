#include "client/options/output.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "client/terminal/parse.h"
#include "common/system/file.h"

static const char *const format_names[OUTPUT_FORMAT_COUNT] = {"exr", "png", "jpg"};

status output_options_check(const struct output_options *o, struct output_request *out, struct error *err)
{
    status result = STATUS_OK;

    memset(out, 0, sizeof *out);
    buffer_init(&out->tonemap_file);
    if (o->formats)
        result = parse_formats(o->formats, &out->formats, err);
    THEN(result, tonemap_options_check(&o->tone, &out->tonemap, &out->tonemap_file, err));
    if (result == STATUS_OK && out->tonemap.denoise_around > 0 && out->tonemap.denoise == DENOISING_OFF)
        result = error_set(err, STATUS_ERR_USAGE, "--denoise-around: frames around one take part in --denoise on or fast; give that, too");
    out->png_bits = o->png_bits ? (uint32_t)strtoul(o->png_bits, NULL, 10) : 0;
    out->jpeg_quality = (uint32_t)o->jpeg_quality;
    out->no_dither = o->no_dither;
    return result;
}

void output_request_release(struct output_request *request) { buffer_release(&request->tonemap_file); }

void output_message_set(struct wire_output *out, const struct output_request *request, unsigned formats)
{
    const struct output_settings settings = {
        .exr_half = request->half,
        .exr = (formats & OUTPUT_FORMAT_EXR) != 0,
        .png = (formats & OUTPUT_FORMAT_PNG) != 0,
        .jpg = (formats & OUTPUT_FORMAT_JPEG) != 0,
        .picture = {.bits = (int)request->png_bits, .plain = request->no_dither, .quality = (int)request->jpeg_quality},
        .tonemap = request->tonemap,
        .camera_ev = request->camera_ev,
    };

    wire_output_set(out, &settings);
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
    return message->metering_percentile > 0 ? message->metering_percentile : look_rows[LOOK_metering_percentile].initial;
}
