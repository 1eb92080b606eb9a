/* json_quote: text as a JSON string, without allocation. */
#pragma once

#include <stddef.h>

/* Room for a text of that many bytes, with the quotes and the 0. */
#define JSON_QUOTE_SIZE(text_bytes) (6 * (text_bytes) + 3)

/* Write `text` in quotes, at most its first `most` bytes, to out[JSON_QUOTE_SIZE(most)]. Bytes that are not UTF-8 become
 * U+FFFD. Returns how many bytes were written, without the 0. */
size_t json_quote(char *out, const char *text, size_t most);
