/* text_draw: draws text on a picture in a built-in bitmap font, so that it has the same bits on
 * every machine and needs no installed fonts. ASCII; any other byte is drawn as '?'. */
#pragma once

#include "common/image/image.h"

enum {
    TEXT_ADVANCE = 6, /* pixels from one character to the next, at scale 1 */
    TEXT_HEIGHT = 9,  /* of a line, descenders included */
};

/* How wide the text is, without the gap behind its last character. */
uint32_t text_draw_width(const char *text, uint32_t scale);

/* Every lit pixel of the font becomes a square of `scale` pixels with this value in all channels,
 * x and y being the upper left corner. What lies outside the picture is left out. */
void text_draw(struct image *image, uint32_t x, uint32_t y, uint32_t scale, float value, const char *text);
