#include "client/follow/picture_file.h"

#include <math.h>
#include <stdio.h>

#include "common/system/file.h"

status picture_read(struct image *out, const char *path, struct error *err)
{
    struct buffer file = BUFFER_INIT;
    struct image_repairs repairs = {0};
    char said[IMAGE_REPAIRS_TEXT];
    status result = file_read(path, IMAGE_BYTES_MAX, &file, err);

    THEN(result, image_decode_hdr(out, file.data, file.size, path, &repairs, err));
    if (result == STATUS_OK && image_repairs_say(&repairs, said))
        fprintf(stderr, "warning: %s: %s\n", path, said);
    buffer_release(&file);
    return result;
}

status picture_read_denoised(struct image *out, const char *path, struct error *err)
{
    static const char *const channels[3] = {"denoised.R", "denoised.G", "denoised.B"};
    struct buffer file = BUFFER_INIT;
    status result = file_read(path, IMAGE_BYTES_MAX, &file, err);

    for (size_t c = 0; c < 3 && result == STATUS_OK; c++) {
        struct image one = {0};
        result = exr_decode_channel(&one, file.data, file.size, path, channels[c], err);
        if (result == STATUS_ERR_NOT_FOUND)
            result = error_set(err, STATUS_ERR_INPUT,
                               "%s: --denoise: there is no layer 'denoised' (no channel %s); files of jobs with --denoise "
                               "have it",
                               path, channels[c]);
        if (result == STATUS_OK && c == 0)
            result = image_init(out, one.width, one.height, 3, err);
        for (size_t i = 0; result == STATUS_OK && i < (size_t)out->width * out->height; i++)
            out->pixels[3 * i + c] = fmaxf(one.pixels[3 * i], 0);
        image_release(&one);
    }
    if (result != STATUS_OK)
        image_release(out);
    buffer_release(&file);
    return result;
}

status picture_write(const char *path, const struct image *image, enum output_format format,
                     const struct picture_options *how, struct error *err)
{
    static const struct exr_options plain_exr = {0};
    struct buffer file = BUFFER_INIT;
    status result;

    if (format == OUTPUT_FORMAT_EXR)
        result = exr_encode(&file, image, &plain_exr, err);
    else if (format == OUTPUT_FORMAT_JPEG)
        result = jpeg_encode(&file, image, how, err);
    else
        result = png_encode_as(&file, image, how, err);
    THEN(result, file_write_atomic(path, file.data, file.size, err));
    buffer_release(&file);
    return result;
}
