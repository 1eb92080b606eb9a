/* framing: cuts a stream of bytes into messages.
 *
 * A frame is a little-endian uint32 length, 1..CHANNEL_FRAME_MAX, and that many bytes: one message.
 * The reader takes bytes as they come, in pieces of any size, and yields whole frames.
 * Invariants: a frame's bytes stay valid until the next call with the same reader. A length out of
 * range is detected before any memory is allocated for it; the reader then fails for good.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

enum { FRAME_HEADER_BYTES = 4 };

struct framing_reader {
    struct buffer bytes; /* [0, taken) was yielded, the rest waits */
    size_t taken;
    uint32_t limit_bytes; /* of one frame's payload */
};

void framing_reader_init(struct framing_reader *r, uint32_t limit_bytes);
void framing_reader_release(struct framing_reader *r);

/* Add bytes from the wire. ERR_NO_MEMORY. */
status framing_reader_push(struct framing_reader *r, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;

/* The next whole frame; *payload is NULL when more bytes are needed. ERR_PROTOCOL: a
 * length of 0, or one above the limit. */
status framing_reader_next(struct framing_reader *r, const uint8_t **payload, size_t *size_bytes,
                           struct error *err) MUST_CHECK;

/* Number of bytes that wait for the rest of their frame (or for framing_reader_next). */
size_t framing_reader_waiting(const struct framing_reader *r);

void framing_header_write(uint8_t header[FRAME_HEADER_BYTES], uint32_t size_bytes);
