/* Any bytes as a PNG file: an error or a picture, never a crash. */
#include <stddef.h>
#include <stdint.h>

#include "common/image/image.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct image8 image;
    struct error err = {0};

    if (png_decode(&image, data, size, "fuzz", &err) == STATUS_OK)
        image8_release(&image);
    return 0;
}
