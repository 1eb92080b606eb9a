/* Any bytes as a WebP file: an error or a picture, never a crash. Pictures that truly need much
 * memory are left out: their cost is known, and bounded by the format's sides. */
#include <stddef.h>
#include <stdint.h>

#include <webp/decode.h>

#include "common/image/image.h"

enum { PIXELS_MAX = 1 << 22 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct image8 image;
    struct error err = {0};
    int width = 0, height = 0;

    if (WebPGetInfo(data, size, &width, &height) && (int64_t)width * height > PIXELS_MAX)
        return 0;
    if (webp_decode(&image, data, size, "fuzz", &err) == STATUS_OK)
        image8_release(&image);
    return 0;
}
