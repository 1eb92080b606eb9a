/* deflate: zlib streams of data that is in memory as a whole, by libdeflate, which takes a third of zlib's time for the
 * same size. Private to common/image. */
#pragma once

#include "common/base/buffer.h"
#include "common/base/status.h"

/* Levels, as zlib counts them. */
enum { DEFLATE_STORED = 0, DEFLATE_FAST = 1, DEFLATE_FLOATS = 4 /* 6 gains 1 % */, DEFLATE_USUAL = 6 };

struct deflater; /* for one thread */

/* NULL: out of memory. */
struct deflater *deflater_new(int level);
void deflater_free(struct deflater *deflater);

/* Append `data` as a zlib stream; what fails is `out` (buffer_ok). The bytes are a function of data and level. */
void deflater_append(struct deflater *deflater, const uint8_t *data, size_t size_bytes, struct buffer *out);

/* A CRC-32 continued; begin with 0. */
uint32_t deflate_crc32(uint32_t crc, const uint8_t *data, size_t size_bytes);
