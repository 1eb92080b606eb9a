/* unit_digest: a unit's result in 32 bytes (message.h). */
#include "common/base/memory.h"
#include "protocol/message.h"

static status add_parts(struct digest_stream *stream, const struct unit_result *unit, const uint8_t *work,
                        size_t work_bytes)
{
    ProtobufCBinaryData tail;

    wire_tail_set(&tail, &unit->tail);
    TRY(digest_stream_add(stream, unit->sums, unit->count * sizeof *unit->sums));
    TRY(digest_stream_add(stream, tail.data, tail.len));
    return digest_stream_add(stream, work, work_bytes);
}

status wire_unit_digest(struct digest *out, const struct unit_result *unit, struct error *err)
{
    struct digest_stream *stream = digest_stream_new();
    struct wire_work wire;
    const Azulejo__Wire__Work *work = wire_work_set(&wire, &unit->work);
    size_t size = azulejo__wire__work__get_packed_size(work);
    uint8_t *packed = mem_alloc(size);
    status s = STATUS_ERR_NO_MEMORY;

    if (stream && packed) {
        azulejo__wire__work__pack(work, packed);
        s = add_parts(stream, unit, packed, size);
    }
    mem_free(packed);
    if (s == STATUS_OK)
        s = digest_stream_final(stream, out);
    else
        digest_stream_free(stream);
    return s == STATUS_OK ? s : error_set(err, s, "a unit's digest cannot be computed");
}
