#include "coordinator/farm/linear.h"

#include <math.h>
#include <string.h>

#include "common/base/bytes.h"
#include "common/image/half.h"

static const char picture_name[] = "color";

int linear_has_layer(uint32_t aovs, int layer)
{
    return layer == LINEAR_PICTURE || layer == AOV_SAMPLES || layer == AOV_ERROR ||
           (layer >= 0 && layer < AOV_COUNT && (aovs >> layer & 1));
}

const char *linear_layer_name(int layer)
{
    return layer == LINEAR_PICTURE ? picture_name : aov_name((enum aov)layer);
}

int linear_layer_parse(const char *name)
{
    int aov = aov_parse(name);

    return strcmp(name, picture_name) == 0 ? LINEAR_PICTURE : aov >= 0 ? aov : -2;
}

/* Of the light that a display can show nothing is lost: a half reaches 65504. */
static uint16_t to_half(float value)
{
    if (value > HALF_MAX)
        value = HALF_MAX;
    else if (value < -HALF_MAX)
        value = -HALF_MAX;
    return half_from_float(value);
}

size_t linear_record(uint32_t tile, uint32_t width, uint32_t height, double samples, const float (*pixels)[4],
                     uint8_t out[LINEAR_RECORD_MAX])
{
    uint8_t *at = out + LINEAR_HEADER_BYTES;
    double counted = samples * LINEAR_SAMPLES_ONE + 0.5;

    bytes_put32(out, tile);
    bytes_put16(out + 4, (uint16_t)width);
    bytes_put16(out + 6, (uint16_t)height);
    bytes_put32(out + 8, counted < UINT32_MAX ? (uint32_t)counted : UINT32_MAX);
    for (uint32_t p = 0; p < width * height; p++, at += LINEAR_PIXEL_BYTES)
        for (uint32_t c = 0; c < 4; c++)
            bytes_put16(at + 2 * c, to_half(pixels[p][c]));
    return (size_t)(at - out);
}

size_t linear_tile(const struct film *film, uint32_t tile, int layer, uint8_t out[LINEAR_RECORD_MAX])
{
    struct tile_rect rect = tile_rect_of(film_width(film), film_height(film), tile);
    float pixels[TILE_PIXELS_MAX][4];

    if (!(layer == LINEAR_PICTURE ? film_tile_picture(film, tile, pixels)
                                  : film_tile_aov(film, tile, (enum aov)layer, pixels)))
        return 0;
    return linear_record(tile, rect.width, rect.height, film_tile_samples(film, tile),
                         (const float (*)[4])pixels, out);
}
