/* json_quote: text as a JSON string, without allocation. */
#pragma once

#include <stddef.h>

/* Length of the UTF-8 character at `s`, 0 if there is none (RFC 3629). No byte after a text's NUL is read. */
size_t utf8_length(const unsigned char *s);

/* Room for a text of that many bytes, with the quotes and the 0. */
#define JSON_QUOTE_SIZE(text_bytes) (6 * (text_bytes) + 3)

/* Write `text` in quotes, at most its first `most` bytes, to out[JSON_QUOTE_SIZE(most)]. Bytes that are not UTF-8 become
 * U+FFFD. Returns how many bytes were written, without the 0. */
size_t json_quote(char *out, const char *text, size_t most);
