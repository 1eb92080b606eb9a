#include "protocol/framing.h"

#include <string.h>
#include "common/base/bytes.h"

void framing_reader_init(struct framing_reader *r, uint32_t limit_bytes)
{
    memset(r, 0, sizeof *r);
    r->limit_bytes = limit_bytes;
}

void framing_reader_release(struct framing_reader *r)
{
    buffer_release(&r->bytes);
    r->taken = 0;
}

status framing_reader_push(struct framing_reader *r, const void *data, size_t size_bytes, struct error *err)
{
    if (r->taken) {
        buffer_consume(&r->bytes, r->taken);
        r->taken = 0;
    }
    buffer_append(&r->bytes, data, size_bytes);
    NEED(buffer_ok(&r->bytes), err, "a message being received");
    return STATUS_OK;
}

status framing_reader_next(struct framing_reader *r, const uint8_t **payload, size_t *size_bytes, struct error *err)
{
    size_t waiting = framing_reader_waiting(r);
    const uint8_t *p;
    uint32_t length;

    *payload = NULL;
    *size_bytes = 0;
    if (waiting < FRAME_HEADER_BYTES)
        return STATUS_OK;
    p = r->bytes.data + r->taken;
    length = bytes_get32(p);
    if (length == 0 || length > r->limit_bytes)
        return error_set(err, STATUS_ERR_PROTOCOL, "a message of %u bytes (1..%u are allowed)", length, r->limit_bytes);
    if (waiting - FRAME_HEADER_BYTES < length)
        return STATUS_OK;
    *payload = p + FRAME_HEADER_BYTES;
    *size_bytes = length;
    r->taken += FRAME_HEADER_BYTES + (size_t)length;
    return STATUS_OK;
}

size_t framing_reader_waiting(const struct framing_reader *r) { return r->bytes.size - r->taken; }

void framing_header_write(uint8_t header[FRAME_HEADER_BYTES], uint32_t size_bytes)
{
    for (int i = 0; i < FRAME_HEADER_BYTES; i++)
        header[i] = (uint8_t)(size_bytes >> (8 * i));
}
