/* Any bytes as an IES profile: an error, or a picture of numbers from 0 to 1. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "client/import/ies/ies.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct error err = {0};
    struct image image;
    double candela;

    if (ies_read(&image, &candela, data, size, &err) == STATUS_OK) {
        for (size_t i = 0; i < 3 * (size_t)image.width * image.height; i++)
            if (!(image.pixels[i] >= 0 && image.pixels[i] <= 1))
                abort();
    } else if (!err.text[0]) {
        abort();
    }
    image_release(&image);
    return 0;
}
