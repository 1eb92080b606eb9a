#include "coordinator/pictures/linear.h"

#include <string.h>

#include "common/base/bytes.h"
#include "common/image/half.h"

static const char picture_name[] = "color";

int linear_has_layer(uint32_t aovs, int layer)
{
    return layer == LINEAR_PICTURE || layer == AOV_SAMPLES || layer == AOV_ERROR ||
           (layer >= 0 && layer < AOV_COUNT && ((aovs & ~(AOV_MATTES | 1u << AOV_CRYPTO_ASSET)) >> layer & 1));
}

const char *linear_layer_name(int layer) { return layer == LINEAR_PICTURE ? picture_name : aov_name((enum aov)layer); }

int linear_layer_parse(const char *name)
{
    int aov = aov_parse(name);

    return strcmp(name, picture_name) == 0 ? LINEAR_PICTURE : aov >= 0 ? aov : -2;
}

/* half_from_float, but what is beyond HALF_MAX is HALF_MAX: of the light that a display can show nothing is lost.
 * Without branches, so that several are made at once: this is most of what a page that watches costs. */
static uint16_t to_half(float value)
{
    uint32_t bits = float_bits(value), sign = bits >> 16 & 0x8000, size = bits & 0x7fffffffu;
    uint32_t normal = (size - 0x38000000u + 0xfff + (size >> 13 & 1)) >> 13; /* to nearest, ties to even */
    uint32_t small = float_bits(float_from_bits(size) + 0.5f) - 0x3f000000u; /* below 2^-14: in steps of 2^-24, 0.5's last bit */
    uint32_t half = size < 0x38800000u ? small : normal;

    half = size > 0x477fe000u ? 0x7bff : half;
    half = size > 0x7f800000u ? 0x7e00 : half; /* not a number */
    return (uint16_t)(sign | half);
}

size_t linear_record(uint32_t tile, uint32_t width, uint32_t height, double samples, const float (*pixels)[4],
                     uint8_t out[LINEAR_RECORD_MAX])
{
    uint8_t *at = out + LINEAR_HEADER_BYTES;
    double counted = samples * LINEAR_SAMPLES_ONE + 0.5;
    uint16_t halves[TILE_PIXELS_MAX * 4];
    const float *values = &pixels[0][0];
    uint32_t count = width * height * 4;

    bytes_put32(out, tile);
    bytes_put16(out + 4, (uint16_t)width);
    bytes_put16(out + 6, (uint16_t)height);
    bytes_put32(out + 8, counted < UINT32_MAX ? (uint32_t)counted : UINT32_MAX);
    for (uint32_t i = 0; i < count; i++)
        halves[i] = to_half(values[i]);
    for (uint32_t i = 0; i < count; i++)
        bytes_put16(at + 2 * (size_t)i, halves[i]);
    return LINEAR_HEADER_BYTES + 2 * (size_t)count;
}

size_t linear_tile(const struct film *film, uint32_t tile, int layer, uint8_t out[LINEAR_RECORD_MAX])
{
    struct tile_rect rect = tile_rect_of(film_width(film), film_height(film), tile);
    float pixels[TILE_PIXELS_MAX][4];

    if (!(layer == LINEAR_PICTURE ? film_tile_picture(film, tile, pixels)
                                  : film_tile_aov(film, tile, (enum aov)layer, pixels)))
        return 0;
    return linear_record(tile, rect.width, rect.height, film_tile_samples(film, tile), (const float(*)[4])pixels, out);
}
