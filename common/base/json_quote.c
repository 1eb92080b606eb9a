#include "common/base/json_quote.h"

#include <stdio.h>
#include <string.h>

size_t utf8_length(const unsigned char *s)
{
    size_t length = s[0] < 0x80 ? 1 : s[0] >= 0xc2 && s[0] < 0xe0 ? 2 : (s[0] & 0xf0) == 0xe0 ? 3
                  : s[0] >= 0xf0 && s[0] < 0xf5 ? 4 : 0;

    for (size_t i = 1; i < length; i++)
        if ((s[i] & 0xc0) != 0x80)
            return 0;
    if ((s[0] == 0xe0 && s[1] < 0xa0) || (s[0] == 0xed && s[1] > 0x9f) || (s[0] == 0xf0 && s[1] < 0x90) ||
        (s[0] == 0xf4 && s[1] > 0x8f))
        return 0;
    return length;
}

size_t json_quote(char *out, const char *text, size_t most)
{
    const unsigned char *s = (const unsigned char *)text, *end = s + most;
    size_t used = 0;

    out[used++] = '"';
    while (s < end && *s) {
        size_t length = utf8_length(s);

        if (length > (size_t)(end - s))
            break; /* a character that is cut */
        if (*s == '"' || *s == '\\') {
            used += (size_t)sprintf(out + used, "\\%c", *s);
        } else if (*s < 0x20 || *s == 0x7f) {
            used += (size_t)sprintf(out + used, "\\u%04x", *s);
        } else if (length == 0) {
            used += (size_t)sprintf(out + used, "\\ufffd");
        } else {
            memcpy(out + used, s, length);
            used += length;
        }
        s += length ? length : 1;
    }
    out[used++] = '"';
    out[used] = 0;
    return used;
}
