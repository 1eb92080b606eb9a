/* WebP through libwebp, from memory. Its decoder gives the same bits on every machine: the SIMD
 * versions of the transforms and of the chroma upsampling equal the C ones. */
#include <string.h>

#include <webp/decode.h>

#include "common/image/image.h"

static status webp_check(const WebPBitstreamFeatures *features, VP8StatusCode result, const char *name,
                         struct error *err)
{
    if (result == VP8_STATUS_UNSUPPORTED_FEATURE)
        return error_set(err, STATUS_ERR_UNSUPPORTED, "%s: a kind of WebP that libwebp cannot read; convert it to PNG",
                         name);
    if (result != VP8_STATUS_OK)
        return error_set(err, STATUS_ERR_INPUT, "%s: the WebP is damaged or cut short", name);
    if (features->has_animation)
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "%s: an animated WebP cannot be a texture; save one of its pictures alone", name);
    return STATUS_OK;
}

status webp_decode(struct image8 *out, const uint8_t *data, size_t size_bytes, const char *name, struct error *err)
{
    WebPDecoderConfig config;
    VP8StatusCode result;
    size_t row_bytes;
    status st;

    memset(out, 0, sizeof *out);
    if (!WebPInitDecoderConfig(&config))
        return error_set(err, STATUS_ERR_INTERNAL, "%s: libwebp is of another version", name);
    TRY(webp_check(&config.input, WebPGetFeatures(data, size_bytes, &config.input), name, err));
    /* The format ends at 16383 pixels a side. A lossless file of a few bytes may really have that
     * many, so the file's size gives no bound. */
    st = image8_init(out, (uint32_t)config.input.width, (uint32_t)config.input.height, config.input.has_alpha ? 4 : 3,
                     8, err);
    if (st != STATUS_OK) {
        error_prefix(err, "%s", name);
        return st;
    }
    row_bytes = (size_t)out->width * out->channels;
    config.output.colorspace = out->channels == 4 ? MODE_RGBA : MODE_RGB;
    config.output.is_external_memory = 1;
    config.output.u.RGBA.rgba = out->pixels;
    config.output.u.RGBA.stride = (int)row_bytes;
    config.output.u.RGBA.size = row_bytes * out->height;
    result = WebPDecode(data, size_bytes, &config);
    WebPFreeDecBuffer(&config.output);
    if (result == VP8_STATUS_OUT_OF_MEMORY)
        st = error_no_memory(err, name);
    else
        st = webp_check(&config.input, result, name, err);
    if (st != STATUS_OK)
        image8_release(out);
    return st;
}
