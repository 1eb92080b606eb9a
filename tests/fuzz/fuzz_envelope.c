/* A stream of bytes as it comes out of TLS: framing, unpacking, and every check on what was
 * unpacked. The first byte says into how large pieces the rest is cut. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include "common/base/memory.h"
#include "protocol/framing.h"
#include "protocol/message.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void use_piece(status s, const struct blob_piece *piece)
{
    static uint8_t raw[BLOB_PIECE_BYTES];

    if (s != STATUS_OK)
        return;
    if (piece->raw_bytes > sizeof raw || piece->offset + piece->raw_bytes > piece->total_bytes)
        abort();
    (void)!blob_piece_unpack(piece, raw, NULL);
}

static void use_grant(const Azulejo__Wire__LeaseGrant *grant)
{
    struct render_settings settings;
    struct digest scene;

    (void)!wire_digest_get(&scene, &grant->scene, "lease", NULL);
    if (wire_settings_get(&settings, grant->settings, UINT32_MAX, NULL) != STATUS_OK)
        return;
    for (size_t i = 0; i < grant->n_units; i++) {
        uint32_t tile = grant->units[i]->tile, group = grant->units[i]->group;
        uint32_t pass = grant->units[i]->pass;
        if (wire_unit_check(tile, group, pass, &settings, NULL) == STATUS_OK &&
            wire_sums_count(&settings, tile, group, pass) > TILE_FLOATS_MAX)
            abort();
    }
}

static void use_result(const Azulejo__Wire__TileResult *result)
{
    struct unit_result unit;

    if (wire_unit_get(&unit, result, NULL) != STATUS_OK)
        return;
    if (unit.tail.count > TAIL_MAX || unit.count > TILE_FLOATS_MAX)
        abort();
    (void)tail_is_valid(&unit.tail, TILE_PIXELS_MAX);
    (void)unit_hash(&unit); /* reads all of it */
}

static void use_message(const Azulejo__Wire__Envelope *e)
{
    struct blob_piece piece;
    struct error err;
    char text[64];

    (void)message_name(e);
    switch (e->body_case) {
    case AZULEJO__WIRE__ENVELOPE__BODY_HELLO:
        (void)!hello_check(e->hello, FARM_ROLE_WORKER, &err);
        (void)message_text(text, sizeof text, e->hello->host);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_WELCOME: (void)!welcome_check(e->welcome, &err); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_FAILURE: (void)!message_failure_get(e->failure, &err); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_PUT: use_piece(blob_piece_of_put(&piece, e->blob_put, &err), &piece); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_BLOB_DATA:
        use_piece(blob_piece_of_data(&piece, e->blob_data, &err), &piece);
        break;
    case AZULEJO__WIRE__ENVELOPE__BODY_LEASE_GRANT: use_grant(e->lease_grant); break;
    case AZULEJO__WIRE__ENVELOPE__BODY_TILE_RESULT: use_result(e->tile_result); break;
    default: break;
    }
}

/* What was unpacked packs again, and into something that unpacks. */
static void repack(const Azulejo__Wire__Envelope *e)
{
    size_t size = azulejo__wire__envelope__get_packed_size(e);
    uint8_t *bytes = mem_alloc(size);
    Azulejo__Wire__Envelope *again;

    if (!bytes)
        return;
    if (azulejo__wire__envelope__pack(e, bytes) != size)
        abort();
    if (message_unpack(&again, bytes, size, NULL) == STATUS_OK)
        message_free(again);
    mem_free(bytes);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct framing_reader reader;
    size_t piece, at = 1;

    if (size < 1)
        return 0;
    piece = (size_t)data[0] + 1;
    framing_reader_init(&reader, CHANNEL_FRAME_MAX);
    while (at < size) {
        size_t length = size - at < piece ? size - at : piece;
        if (framing_reader_push(&reader, data + at, length, NULL) != STATUS_OK)
            break;
        at += length;
        for (;;) {
            Azulejo__Wire__Envelope *e;
            const uint8_t *payload;
            size_t payload_size;
            if (framing_reader_next(&reader, &payload, &payload_size, NULL) != STATUS_OK)
                goto done;
            if (!payload)
                break;
            if (message_unpack(&e, payload, payload_size, NULL) != STATUS_OK)
                goto done;
            use_message(e);
            repack(e);
            message_free(e);
        }
    }
done:
    framing_reader_release(&reader);
    return 0;
}
