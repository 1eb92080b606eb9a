/* Any bytes as a Radiance file: an error or a picture, never a crash. */
#include <stddef.h>
#include <stdint.h>

#include "common/image/image.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct image_repairs repairs = {0};
    struct image image;
    struct error err = {0};

    if (hdr_decode(&image, data, size, "fuzz", &repairs, &err) == STATUS_OK)
        image_release(&image);
    return 0;
}
