/* bytes_text: numbers of bytes as people read them. */
#pragma once

#include <stdint.h>

enum { BYTES_TEXT_SIZE = 32 };

/* "512 B", "12.3 GiB"; fills `out` and returns it. */
const char *bytes_text(char out[BYTES_TEXT_SIZE], uint64_t bytes);
