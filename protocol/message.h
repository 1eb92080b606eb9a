/* message: converts envelopes to and from C types, with every range checked.
 *
 * Wire data is untrusted: no part of it is used before one of the *_get functions has accepted it.
 * Outputs are zeroed when a function fails. Envelopes under construction point into the caller's
 * memory; channel_send copies, so they may live on the stack.
 */
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/accuracy/stop.h"
#include "common/base/buffer.h"
#include "common/base/digest.h"
#include "common/base/status.h"
#include "common/film/unit.h"
#include "common/scene/settings.h"
#include "common/schema/job_needs.h"
#include "protocol/azulejo.pb-c.h"
#include "protocol/channel.h"

enum {
    MESSAGE_UNPACKED_MAX = 64 << 20, /* memory that one unpacked envelope may take */
    MESSAGE_TEXT_MAX = 1024,         /* bytes of a text from the wire that are read */
    MESSAGE_UNITS_MAX = 4096,        /* work units in one grant, return or ack */
    MESSAGE_DIGESTS_MAX = 65536,     /* digests in one query */
    PIXEL_SAMPLES_MAX = 4096,        /* samples in one RenderRequest */
};
#define BLOB_BYTES_MAX (1ull << 36)  /* of one blob */

/* An Envelope with its body set, by its constant and its field:
 *   Azulejo__Wire__LeaseRequest ask = AZULEJO__WIRE__LEASE_REQUEST__INIT;
 *   Azulejo__Wire__Envelope e = MESSAGE(LEASE_REQUEST, lease_request, &ask); */
#define MESSAGE(CASE, field, value)                                                    \
    {.base = PROTOBUF_C_MESSAGE_INIT(&azulejo__wire__envelope__descriptor),            \
     .body_case = AZULEJO__WIRE__ENVELOPE__BODY_##CASE,                                \
     .field = (value)}

/* Unpack an envelope. ERR_PROTOCOL: it is not one; ERR_LIMIT: it would take more than
 * MESSAGE_UNPACKED_MAX; ERR_NO_MEMORY. Free with message_free. */
status message_unpack(Azulejo__Wire__Envelope **out, const void *data, size_t size_bytes, struct error *err) MUST_CHECK;
void message_free(Azulejo__Wire__Envelope *message);

/* "lease_grant"; "none" for an envelope whose body this version does not know. */
const char *message_name(const Azulejo__Wire__Envelope *message);

/* Copy text from the wire for logs and terminals: control characters, those that turn the direction of
 * text, and invalid UTF-8 become '?', at most `size` - 1 bytes. Returns `out`. */
const char *message_text(char *out, size_t size, const char *text);

/* Send a Failure that answers `request` (0: none), or a Heartbeat. */
status message_send_failure(struct channel *c, uint64_t request, const struct error *why) MUST_CHECK;
status message_send_heartbeat(struct channel *c) MUST_CHECK;
/* A Failure as an error: an unknown or OK code becomes ERR_PROTOCOL. Returns err->code. */
status message_failure_get(const Azulejo__Wire__Failure *failure, struct error *err) MUST_CHECK;

/* The coordinator checks a Hello: version, and the role against the key's. */
status hello_check(const Azulejo__Wire__Hello *hello, enum farm_role key_role, struct error *err) MUST_CHECK;
/* The peer checks a Welcome: version, and sane times (100 ms .. 1 h). */
status welcome_check(const Azulejo__Wire__Welcome *welcome, struct error *err) MUST_CHECK;

void wire_digest_set(ProtobufCBinaryData *out, const struct digest *digest); /* points at it */
/* ERR_PROTOCOL unless it is 32 bytes; `what` names it. */
status wire_digest_get(struct digest *out, const ProtobufCBinaryData *in, const char *what,
                       struct error *err) MUST_CHECK;

void wire_settings_set(Azulejo__Wire__RenderSettings *out, const struct render_settings *in);
/* Validates; ERR_INPUT. `camera_count`: of the scene, UINT32_MAX when not known yet. */
status wire_settings_get(struct render_settings *out, const Azulejo__Wire__RenderSettings *in, uint32_t camera_count,
                         struct error *err) MUST_CHECK;

/* *out points at *in afterwards. */
void wire_needs_set(Azulejo__Wire__JobSubmit *out, const struct job_needs *in);
/* ERR_INPUT, ERR_LIMIT. */
status wire_needs_get(struct job_needs *out, const Azulejo__Wire__JobSubmit *in, struct error *err) MUST_CHECK;

void wire_stop_set(Azulejo__Wire__StopRules *out, const struct stop_rules *in);
/* NULL: no rule except the cap. Validates; ERR_INPUT. */
status wire_stop_get(struct stop_rules *out, const Azulejo__Wire__StopRules *in, struct error *err) MUST_CHECK;

/* Does a RenderRequest name one piece, a unit or samples of a pixel, that a frame of these settings has?
 * ERR_PROTOCOL: both or none, or the unit does not exist; ERR_INPUT: the pixel or a sample does not
 * exist; ERR_LIMIT: more than PIXEL_SAMPLES_MAX samples, or more than one with its path. */
status wire_piece_check(const Azulejo__Wire__RenderRequest *request, const struct render_settings *settings,
                        struct error *err) MUST_CHECK;
/* ERR_PROTOCOL unless the unit exists in a frame of these settings. */
status wire_unit_check(uint32_t tile, uint32_t group, uint32_t pass, const struct render_settings *settings,
                       struct error *err) MUST_CHECK;

/* As many floats as the unit has. */
size_t wire_sums_count(const struct render_settings *settings, uint32_t tile, uint32_t group, uint32_t pass);
/* Float32 little-endian, as they are in memory: *out points at them afterwards. */
void wire_sums_set(ProtobufCBinaryData *out, const float *sums, size_t count);
/* Points into the message. ERR_PROTOCOL: no whole number of floats, or more than a unit can have. */
status wire_sums_get(const float **out, size_t *count, const ProtobufCBinaryData *in, struct error *err) MUST_CHECK;

enum { WIRE_TAIL_ENTRY_BYTES = 8 };
/* *out points at them afterwards. */
void wire_tail_set(ProtobufCBinaryData *out, const struct tail *tail);
/* ERR_PROTOCOL: not a whole number of entries, or too many. The film checks order and range. */
status wire_tail_get(struct tail *out, const ProtobufCBinaryData *in, struct error *err) MUST_CHECK;

/* A Work, and what it points to. */
struct wire_work {
    Azulejo__Wire__Work message;
    Azulejo__Wire__Health health[HEALTH_KINDS];
    double depth[DEPTH_SUMS];
    Azulejo__Wire__Health *pointers[HEALTH_KINDS];
};
/* Fills *out, which must then stay where it is; returns its message. */
Azulejo__Wire__Work *wire_work_set(struct wire_work *out, const struct unit_work *in);
/* NULL: all 0. ERR_PROTOCOL: counters that there are not, or that are 0 or repeated. */
status wire_work_get(struct unit_work *out, const Azulejo__Wire__Work *in, struct error *err) MUST_CHECK;

/* All of the TileResult but whose it is, and how long it took: it points at *work and *unit afterwards. */
void wire_unit_set(Azulejo__Wire__TileResult *out, struct wire_work *work, const struct unit_result *unit);
/* The sums stay the message's. ERR_PROTOCOL: what cannot be of any unit; the film checks the rest. */
status wire_unit_get(struct unit_result *out, const Azulejo__Wire__TileResult *in, struct error *err) MUST_CHECK;

/* SHA-256 over the unit's sums, tail and work, each as a TileResult has them (unit_digest.c): two results are
 * equal, byte for byte, where it is. */
status wire_unit_digest(struct digest *out, const struct unit_result *unit, struct error *err) MUST_CHECK;

/* ---- blobs ----------------------------------------------------------------------------- */

/* One piece of a blob, checked: offset + raw_bytes <= total_bytes <= BLOB_BYTES_MAX,
 * raw_bytes <= BLOB_PIECE_BYTES, and raw_bytes is 0 only in an empty blob. */
struct blob_piece {
    struct digest digest;
    uint64_t total_bytes, offset;
    uint32_t raw_bytes;
    int zstd;
    ProtobufCBinaryData data; /* points into the message */
};
status blob_piece_of_put(struct blob_piece *out, const Azulejo__Wire__BlobPut *put, struct error *err) MUST_CHECK;
status blob_piece_of_data(struct blob_piece *out, const Azulejo__Wire__BlobData *data, struct error *err) MUST_CHECK;
/* Write the piece's bytes to out[raw_bytes]. ERR_PROTOCOL: damaged or not of that length. */
status blob_piece_unpack(const struct blob_piece *piece, uint8_t *out, struct error *err) MUST_CHECK;

/* Compress a piece of a blob with zstd into `scratch` if that saves a sixteenth or more. *packed
 * then points into scratch, otherwise to `raw` itself; *zstd says which. */
status blob_piece_pack(const void *raw, size_t raw_bytes, struct buffer *scratch, ProtobufCBinaryData *packed,
                       protobuf_c_boolean *zstd, struct error *err) MUST_CHECK;

/* The length of the piece at `offset`: the rest, at most BLOB_PIECE_BYTES. */
static inline uint32_t blob_piece_size(uint64_t total_bytes, uint64_t offset)
{
    uint64_t rest = total_bytes - offset;
    return rest < BLOB_PIECE_BYTES ? (uint32_t)rest : (uint32_t)BLOB_PIECE_BYTES;
}
