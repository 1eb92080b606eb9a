/* image_size: how large an image file is, read from its header alone. */
#pragma once

#include <stddef.h>
#include <stdint.h>

struct image_size {
    uint32_t width, height;
    uint32_t pixel_bytes; /* of the decoded pixels: 1..8, or 12 for three floats */
    /* An EXR file whose data window is a part of its display window: that one's size, and where in it the picture lies.
     * Otherwise 0. */
    uint32_t whole_width, whole_height, x, y;
};

/* Of every format that is read. 0 if the header is damaged or the format is another
 * one: the decoder will report the error. */
int image_size_of(const uint8_t *data, size_t size_bytes, struct image_size *out);
