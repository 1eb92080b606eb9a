/* frame: cutting a stream of bytes into messages.
 *
 * A frame is a little-endian uint32 length, 1..CHANNEL_FRAME_MAX, and that many bytes. The
 * reader takes bytes as they come, in pieces of any size, and yields whole frames.
 * Invariants: a frame's bytes stay valid until the next call with the same reader; a
 * length out of range is found before any memory is taken for it, and poisons the reader.
 */
#ifndef AZULEJO_PROTOCOL_FRAME_H
#define AZULEJO_PROTOCOL_FRAME_H

#include <stddef.h>
#include <stdint.h>

#include "common/base/buffer.h"
#include "common/base/status.h"

enum { FRAME_HEADER_BYTES = 4 };

struct frame_reader {
    struct buffer bytes; /* [0, taken) was yielded, the rest waits */
    size_t taken;
    uint32_t limit_bytes; /* of one frame's payload */
};

void frame_reader_init(struct frame_reader *r, uint32_t limit_bytes);
void frame_reader_release(struct frame_reader *r);

/* Add bytes from the wire. ERR_NO_MEMORY. */
status frame_reader_push(struct frame_reader *r, const void *data, size_t size_bytes,
                         struct error *err) MUST_CHECK;

/* The next whole frame; *payload is NULL when more bytes are needed. ERR_PROTOCOL: a
 * length of 0, or one above the limit. */
status frame_reader_next(struct frame_reader *r, const uint8_t **payload, size_t *size_bytes,
                         struct error *err) MUST_CHECK;

/* Bytes that wait for the rest of their frame (or for frame_reader_next). */
size_t frame_reader_waiting(const struct frame_reader *r);

void frame_header_write(uint8_t header[FRAME_HEADER_BYTES], uint32_t size_bytes);

#endif
