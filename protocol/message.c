#include "protocol/message.h"

#include <inttypes.h>
#include <string.h>
#include <zstd.h>

#include "common/base/memory.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "sums and tails are copied as they are: a big-endian machine must swap them");

/* ---- envelopes ------------------------------------------------------------------------- */

/* Two bytes of wire can make a hundred bytes of structs, so the memory of one unpacking is counted against a limit. */
struct budget {
    size_t left_bytes;
    int exceeded, exhausted;
};

static void *budget_alloc(void *user, size_t size)
{
    struct budget *budget = user;
    void *block;

    if (size > budget->left_bytes) {
        budget->exceeded = 1;
        return NULL;
    }
    budget->left_bytes -= size;
    block = mem_alloc(size);
    if (!block)
        budget->exhausted = 1;
    return block;
}

static void budget_free(void *user UNUSED, void *block) { mem_free(block); }

status message_unpack(Azulejo__Wire__Envelope **out, const void *data, size_t size_bytes, struct error *err)
{
    struct budget budget = {MESSAGE_UNPACKED_MAX, 0, 0};
    ProtobufCAllocator allocator = {budget_alloc, budget_free, &budget};

    *out = azulejo__wire__envelope__unpack(&allocator, size_bytes, data);
    if (*out)
        return STATUS_OK;
    if (budget.exhausted)
        return error_no_memory(err, "a message being received");
    if (budget.exceeded)
        return error_set(err, STATUS_ERR_LIMIT, "a message of %zu bytes that unpacks to more than %d", size_bytes,
                         MESSAGE_UNPACKED_MAX);
    return error_set(err, STATUS_ERR_PROTOCOL, "a message of %zu bytes that is no Envelope", size_bytes);
}

void message_free(Azulejo__Wire__Envelope *message)
{
    ProtobufCAllocator allocator = {budget_alloc, budget_free, NULL};

    if (message)
        azulejo__wire__envelope__free_unpacked(message, &allocator);
}

const char *message_name(const Azulejo__Wire__Envelope *message)
{
    const ProtobufCFieldDescriptor *field = NULL;

    if (message->body_case != AZULEJO__WIRE__ENVELOPE__BODY__NOT_SET)
        field =
            protobuf_c_message_descriptor_get_field(&azulejo__wire__envelope__descriptor, (unsigned)message->body_case);
    return field ? field->name : "none";
}

/* Length of the well-formed UTF-8 character at `s`, 0 if there is none (RFC 3629). */
static size_t utf8_length(const unsigned char *s)
{
    if (s[0] < 0x80)
        return 1;
    if (s[0] >= 0xc2 && s[0] <= 0xdf)
        return (s[1] & 0xc0) == 0x80 ? 2 : 0;
    if (s[0] >= 0xe0 && s[0] <= 0xef) {
        if ((s[1] & 0xc0) != 0x80 || (s[2] & 0xc0) != 0x80)
            return 0;
        return (s[0] == 0xe0 && s[1] < 0xa0) || (s[0] == 0xed && s[1] > 0x9f) ? 0 : 3;
    }
    if (s[0] >= 0xf0 && s[0] <= 0xf4) {
        if ((s[1] & 0xc0) != 0x80 || (s[2] & 0xc0) != 0x80 || (s[3] & 0xc0) != 0x80)
            return 0;
        return (s[0] == 0xf0 && s[1] < 0x90) || (s[0] == 0xf4 && s[1] > 0x8f) ? 0 : 4;
    }
    return 0;
}

/* C0, DEL, C1 (U+0080 to U+009F); what turns the direction of the text after it (U+200E, U+200F, U+202A to U+202E,
 * U+2066 to U+2069), so that one name can look like another; and U+2028, U+2029, which end a line. */
static int is_control(const unsigned char *s)
{
    if (s[0] < 0x20 || s[0] == 0x7f || (s[0] == 0xc2 && s[1] < 0xa0))
        return 1;
    if (s[0] != 0xe2)
        return 0;
    return (s[1] == 0x80 && ((s[2] & 0xfe) == 0x8e || (s[2] >= 0xa8 && s[2] <= 0xae))) ||
           (s[1] == 0x81 && s[2] >= 0xa6 && s[2] <= 0xa9);
}

const char *message_text(char *out, size_t size, const char *text)
{
    const unsigned char *s = (const unsigned char *)text;
    size_t used = 0;

    if (size == 0)
        return "";
    while (*s) {
        size_t length = utf8_length(s);
        if (used + (length ? length : 1) >= size)
            break;
        if (length == 0 || is_control(s)) {
            out[used++] = '?';
            s += length ? length : 1;
        } else {
            memcpy(out + used, s, length);
            used += length;
            s += length;
        }
    }
    out[used] = 0;
    return out;
}

/* ---- short messages -------------------------------------------------------------------- */

status message_send_failure(struct channel *c, uint64_t request, const struct error *why)
{
    Azulejo__Wire__Failure failure = AZULEJO__WIRE__FAILURE__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(FAILURE, failure, &failure);
    char text[MESSAGE_TEXT_MAX];

    failure.code = why->code;
    failure.text = (char *)message_text(text, sizeof text, why->text);
    e.request = request;
    return channel_send(c, &e);
}

status message_send_heartbeat(struct channel *c)
{
    Azulejo__Wire__Heartbeat heartbeat = AZULEJO__WIRE__HEARTBEAT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(HEARTBEAT, heartbeat, &heartbeat);

    return channel_send(c, &e);
}

status message_failure_get(const Azulejo__Wire__Failure *failure, struct error *err)
{
    char text[MESSAGE_TEXT_MAX];
    status code = STATUS_ERR_PROTOCOL;

    if (failure->code > STATUS_OK && failure->code < STATUS_COUNT)
        code = (status)failure->code;
    message_text(text, sizeof text, failure->text);
    return error_set(err, code, "%s", text[0] ? text : status_text(code));
}

status hello_check(const Azulejo__Wire__Hello *hello, enum farm_role key_role, struct error *err)
{
    char software[64];

    if (hello->protocol_version != PROTOCOL_VERSION)
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "protocol version %u (%s); this coordinator speaks version %d: install "
                         "the same release everywhere",
                         hello->protocol_version, message_text(software, sizeof software, hello->software),
                         PROTOCOL_VERSION);
    if ((int)hello->role != (int)key_role)
        return error_set(err, STATUS_ERR_REFUSED, "connected with the %s key but claims role %d",
                         farm_role_name(key_role), (int)hello->role);
    return STATUS_OK;
}

status welcome_check(const Azulejo__Wire__Welcome *welcome, struct error *err)
{
    const uint32_t least_ms = 100, most_ms = 3600 * 1000;

    if (welcome->protocol_version != PROTOCOL_VERSION)
        return error_set(err, STATUS_ERR_UNSUPPORTED,
                         "the coordinator speaks protocol version %u, this program version %d: "
                         "install the same release everywhere",
                         welcome->protocol_version, PROTOCOL_VERSION);
    if (welcome->heartbeat_ms < least_ms || welcome->heartbeat_ms > most_ms ||
        welcome->silence_limit_ms < welcome->heartbeat_ms || welcome->silence_limit_ms > most_ms)
        return error_set(err, STATUS_ERR_PROTOCOL, "a Welcome with heartbeat %u ms and silence limit %u ms",
                         welcome->heartbeat_ms, welcome->silence_limit_ms);
    return STATUS_OK;
}

/* ---- digests, settings, tiles ---------------------------------------------------------- */

void wire_digest_set(ProtobufCBinaryData *out, const struct digest *digest)
{
    out->data = (uint8_t *)digest->bytes;
    out->len = DIGEST_BYTES;
}

status wire_digest_get(struct digest *out, const ProtobufCBinaryData *in, const char *what, struct error *err)
{
    memset(out, 0, sizeof *out);
    if (in->len != DIGEST_BYTES)
        return error_set(err, STATUS_ERR_PROTOCOL, "%s: a digest of %zu bytes (%d are needed)", what, in->len,
                         DIGEST_BYTES);
    memcpy(out->bytes, in->data, DIGEST_BYTES);
    return STATUS_OK;
}

/* Of each row of a table, from one to the other: members and fields have the same names. */
#define COPY(o, KIND, type, name, ...) out->name = (type)in->name;
#define COPY_OWN(...)

void wire_settings_set(Azulejo__Wire__RenderSettings *out, const struct render_settings *in)
{
    azulejo__wire__render_settings__init(out);
    RENDER_SETTINGS(COPY, COPY, )
    out->lens_radius = in->lens_radius > 0 ? in->lens_radius : 0;
    out->pinhole = in->lens_radius == 0;
}

status wire_settings_get(struct render_settings *out, const Azulejo__Wire__RenderSettings *in, uint32_t camera_count,
                         struct error *err)
{
    status s;

    memset(out, 0, sizeof *out);
    if (!in)
        return error_set(err, STATUS_ERR_INPUT, "render settings are missing");
    if (in->lens_radius < 0 || (in->pinhole && in->lens_radius != 0))
        return error_set(err, STATUS_ERR_INPUT, "a lens radius below 0, or a pinhole with a lens");
    RENDER_SETTINGS(COPY, COPY, )
    for (int i = 0; i < SETTING_COUNT; i++)
        setting_default_absent(&render_settings_rows[i], out);
    out->lens_radius = in->pinhole ? 0 : in->lens_radius != 0 ? in->lens_radius : -1;
    s = render_settings_validate(out, camera_count, err);
    if (s != STATUS_OK)
        memset(out, 0, sizeof *out);
    return s;
}

void wire_needs_set(Azulejo__Wire__JobSubmit *out, const struct job_needs *in)
{
    out->n_after = in->after_count;
    out->after = (uint64_t *)in->after;
    out->not_before = in->not_before;
    out->require = (char *)in->require;
    out->memory = in->memory;
    out->memory_said = in->memory_said;
    JOB_NEEDS(COPY_OWN, COPY, )
}

status wire_needs_get(struct job_needs *out, const Azulejo__Wire__JobSubmit *in, struct error *err)
{
    memset(out, 0, sizeof *out);
    if (in->n_after > JOB_AFTER_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "a job can wait for at most %d others", JOB_AFTER_MAX);
    for (size_t i = 0; i < in->n_after; i++)
        out->after[out->after_count++] = in->after[i];
    if (in->not_before < 0)
        return error_set(err, STATUS_ERR_INPUT, "a job cannot wait for a moment before 1970");
    out->not_before = in->not_before;
    out->memory = in->memory;
    out->memory_said = in->memory_said;
    JOB_NEEDS(COPY_OWN, COPY, )
    for (int i = 0; i < NEED_COUNT; i++)
        if (setting_check(&job_needs_rows[i], out, err) != STATUS_OK)
            return STATUS_ERR_INPUT;
    if (!in->require[0] || tags_parse(in->require, out->require, err) == STATUS_OK)
        return STATUS_OK;
    if (err)
        err->code = STATUS_ERR_INPUT;
    return STATUS_ERR_INPUT;
}

void wire_stop_set(Azulejo__Wire__StopRules *out, const struct stop_rules *in)
{
    azulejo__wire__stop_rules__init(out);
    STOP_RULES(COPY_OWN, COPY, )
    out->measure = in->has_target ? (uint32_t)in->target.measure + 1 : 0;
    out->target = in->has_target ? in->target.value : 0;
    out->adaptive = in->adaptive;
}

status wire_stop_get(struct stop_rules *out, const Azulejo__Wire__StopRules *in, struct error *err)
{
    status s;

    memset(out, 0, sizeof *out);
    if (!in)
        return STATUS_OK;
    if (in->measure > ALLOCATION_RMSE + 1)
        return error_set(err, STATUS_ERR_INPUT, "a target error of an unknown measure %u", in->measure);
    STOP_RULES(COPY_OWN, COPY, )
    out->has_target = in->measure > 0;
    out->target.measure = (enum allocation_measure)(in->measure > 0 ? in->measure - 1 : 0);
    out->target.value = in->measure > 0 ? in->target : 0;
    out->adaptive = in->adaptive != 0;
    s = stop_rules_validate(out, err);
    if (s != STATUS_OK)
        memset(out, 0, sizeof *out);
    return s;
}

#undef COPY
#undef COPY_OWN

status wire_unit_check(uint32_t tile, uint32_t group, uint32_t pass, const struct render_settings *settings,
                       struct error *err)
{
    if (tile >= tile_count(settings->width, settings->height))
        return error_set(err, STATUS_ERR_PROTOCOL, "tile %u: a frame of %ux%u has %u", tile, settings->width,
                         settings->height, tile_count(settings->width, settings->height));
    if (group >= GROUPS)
        return error_set(err, STATUS_ERR_PROTOCOL, "group %u: there are %d", group, GROUPS);
    if (pass >= pass_count(settings->spp, group))
        return error_set(err, STATUS_ERR_PROTOCOL, "pass %u: %u samples a pixel have %u passes of group %u", pass,
                         settings->spp, pass_count(settings->spp, group), group);
    return STATUS_OK;
}

static status pixel_check(const Azulejo__Wire__PixelSamples *p, const struct render_settings *s, struct error *err)
{
    uint32_t most = p->path ? 1 : PIXEL_SAMPLES_MAX;

    if (!settings_have_pixel(s, p->x, p->y))
        return error_set(err, STATUS_ERR_INPUT, "pixel %u,%u is outside the picture of %ux%u at %u,%u", p->x, p->y,
                         s->width, s->height, s->region_x, s->region_y);
    if (p->count < 1 || p->count > most)
        return error_set(err, STATUS_ERR_LIMIT, "%u samples at once: must be 1..%u%s", p->count, most,
                         p->path ? " with its path" : "");
    if (p->first >= s->spp || p->count > s->spp - p->first)
        return error_set(err, STATUS_ERR_INPUT, "sample %llu is beyond the pixel's: it has 0 to %u",
                         (unsigned long long)p->first + p->count - 1, s->spp - 1);
    return STATUS_OK;
}

status wire_piece_check(const Azulejo__Wire__RenderRequest *request, const struct render_settings *settings,
                        struct error *err)
{
    const Azulejo__Wire__WorkUnit *unit = request->unit;

    if (!unit == !request->pixel)
        return error_set(err, STATUS_ERR_PROTOCOL, "a RenderRequest names a unit or a pixel");
    return unit ? wire_unit_check(unit->tile, unit->group, unit->pass, settings, err)
                : pixel_check(request->pixel, settings, err);
}

size_t wire_sums_count(const struct render_settings *settings, uint32_t tile, uint32_t group, uint32_t pass)
{
    return tile_floats(settings->width, settings->height, tile, unit_aovs(settings->aovs, group, pass));
}

void wire_sums_set(ProtobufCBinaryData *out, const float *sums, size_t count)
{
    *out = (ProtobufCBinaryData){count * sizeof *sums, (uint8_t *)sums};
}

status wire_sums_get(const float **out, size_t *count, const ProtobufCBinaryData *in, struct error *err)
{
    *out = NULL;
    *count = 0;
    if (in->len % sizeof **out || in->len > TILE_FLOATS_MAX * sizeof **out)
        return error_set(err, STATUS_ERR_PROTOCOL, "a result of %zu bytes", in->len);
    *out = (const void *)in->data; /* aligned, as all memory of an unpacked message */
    *count = in->len / sizeof **out;
    return STATUS_OK;
}

_Static_assert(sizeof(struct tail_entry) == WIRE_TAIL_ENTRY_BYTES, "entries are copied as they are");

void wire_tail_set(ProtobufCBinaryData *out, const struct tail *tail)
{
    *out = (ProtobufCBinaryData){tail->count * sizeof *tail->entries, (uint8_t *)tail->entries};
}

status wire_tail_get(struct tail *out, const ProtobufCBinaryData *in, struct error *err)
{
    memset(out, 0, sizeof *out);
    if (in->len % WIRE_TAIL_ENTRY_BYTES || in->len > sizeof out->entries)
        return error_set(err, STATUS_ERR_PROTOCOL, "largest contributions of %zu bytes: at most %d entries of %d",
                         in->len, TAIL_MAX, WIRE_TAIL_ENTRY_BYTES);
    out->count = (uint32_t)(in->len / WIRE_TAIL_ENTRY_BYTES);
    if (in->len)
        memcpy(out->entries, in->data, in->len);
    return STATUS_OK;
}

static void health_set(struct wire_work *out, const struct health *in)
{
    size_t count = 0;

    for (uint32_t k = 0; k < HEALTH_KINDS; k++) {
        Azulejo__Wire__Health *row = &out->health[count];
        if (in->count[k] == 0)
            continue;
        azulejo__wire__health__init(row);
        row->kind = k;
        row->count = in->count[k];
        row->first = in->first[k];
        row->frame = in->frame[k];
        out->pointers[count++] = row;
    }
    out->message.n_health = count;
    out->message.health = out->pointers;
}

#define COPY_COUNTER(name, limit, attribute) to->name = in->name;

Azulejo__Wire__Work *wire_work_set(struct wire_work *out, const struct unit_work *in)
{
    Azulejo__Wire__Work *to = &out->message;

    azulejo__wire__work__init(to);
    WORK_COUNTERS(COPY_COUNTER)
    to->clamped_luminance = in->clamped_luminance;
    to->kept_luminance = in->kept_luminance;
    memcpy(out->depth, in->depth.sum, sizeof out->depth);
    to->depth = out->depth;
    to->n_depth = depth_light_is_known(&in->depth) ? DEPTH_SUMS : 0;
    health_set(out, &in->health);
    return to;
}

static status health_get(struct health *out, const Azulejo__Wire__Work *in, struct error *err)
{
    uint32_t least = 0;

    for (size_t i = 0; i < in->n_health; i++) {
        const Azulejo__Wire__Health *row = in->health[i];
        struct health_place place;
        if (row->kind < least || row->kind >= HEALTH_KINDS || row->count == 0 ||
            (row->first != 0 && !health_place_of(row->first, &place)))
            return error_set(err, STATUS_ERR_PROTOCOL,
                             "counter %zu of what went wrong: kind %u, count %" PRIu64 ", first %" PRIu64
                             "; kinds ascend to %d, and there is something to count",
                             i, row->kind, row->count, row->first, HEALTH_KINDS - 1);
        least = row->kind + 1;
        out->count[row->kind] = row->count;
        out->first[row->kind] = row->first;
        out->frame[row->kind] = row->frame;
    }
    return STATUS_OK;
}

status wire_work_get(struct unit_work *to, const Azulejo__Wire__Work *in, struct error *err)
{
    memset(to, 0, sizeof *to);
    if (!in)
        return STATUS_OK;
    WORK_COUNTERS(COPY_COUNTER)
    to->clamped_luminance = in->clamped_luminance;
    to->kept_luminance = in->kept_luminance;
    if (in->n_depth != 0 && in->n_depth != DEPTH_SUMS)
        return error_set(err, STATUS_ERR_PROTOCOL, "%zu sums of light by depth instead of %d", in->n_depth, DEPTH_SUMS);
    for (size_t i = 0; i < in->n_depth; i++)
        to->depth.sum[i] = in->depth[i];
    return health_get(&to->health, in, err);
}

void wire_unit_set(Azulejo__Wire__TileResult *out, struct wire_work *work, const struct unit_result *unit)
{
    out->tile = unit->tile;
    out->group = unit->group;
    out->pass = unit->pass;
    wire_sums_set(&out->sums, unit->sums, unit->count);
    wire_tail_set(&out->tail, &unit->tail);
    out->work = wire_work_set(work, &unit->work);
}

status wire_unit_get(struct unit_result *out, const Azulejo__Wire__TileResult *in, struct error *err)
{
    status s = wire_sums_get(&out->sums, &out->count, &in->sums, err);

    out->name = (struct unit_name){in->tile, in->group, in->pass};
    THEN(s, wire_tail_get(&out->tail, &in->tail, err));
    THEN(s, wire_work_get(&out->work, in->work, err));
    if (s != STATUS_OK)
        *out = (struct unit_result){0};
    return s;
}

/* ---- blobs ----------------------------------------------------------------------------- */

static status piece_check(struct blob_piece *p, const ProtobufCBinaryData *digest, struct error *err)
{
    status s = wire_digest_get(&p->digest, digest, "blob", err);

    if (s == STATUS_OK &&
        (p->total_bytes > BLOB_BYTES_MAX || p->raw_bytes > BLOB_PIECE_BYTES || p->offset > p->total_bytes ||
         p->raw_bytes > p->total_bytes - p->offset || (p->raw_bytes == 0 && p->total_bytes != 0) ||
         (!p->zstd && p->data.len != p->raw_bytes) || (p->zstd && p->data.len > ZSTD_COMPRESSBOUND(BLOB_PIECE_BYTES))))
        s = error_set(err, STATUS_ERR_PROTOCOL, "a blob piece of %u bytes (%zu sent) at %llu of %llu does not fit",
                      p->raw_bytes, p->data.len, (unsigned long long)p->offset, (unsigned long long)p->total_bytes);
    if (s != STATUS_OK)
        memset(p, 0, sizeof *p);
    return s;
}

status blob_piece_of_put(struct blob_piece *out, const Azulejo__Wire__BlobPut *put, struct error *err)
{
    memset(out, 0, sizeof *out);
    out->total_bytes = put->total_bytes;
    out->offset = put->offset;
    out->raw_bytes = put->raw_bytes;
    out->zstd = put->zstd;
    out->data = put->data;
    return piece_check(out, &put->digest, err);
}

status blob_piece_of_data(struct blob_piece *out, const Azulejo__Wire__BlobData *data, struct error *err)
{
    memset(out, 0, sizeof *out);
    out->total_bytes = data->total_bytes;
    out->offset = data->offset;
    out->raw_bytes = data->raw_bytes;
    out->zstd = data->zstd;
    out->data = data->data;
    return piece_check(out, &data->digest, err);
}

status blob_piece_unpack(const struct blob_piece *piece, uint8_t *out, struct error *err)
{
    size_t got;

    if (!piece->zstd) {
        if (piece->raw_bytes)
            memcpy(out, piece->data.data, piece->raw_bytes);
        return STATUS_OK;
    }
    got = ZSTD_decompress(out, piece->raw_bytes, piece->data.data, piece->data.len);
    if (ZSTD_isError(got))
        return error_set(err, STATUS_ERR_PROTOCOL, "a blob piece is damaged: %s", ZSTD_getErrorName(got));
    if (got != piece->raw_bytes)
        return error_set(err, STATUS_ERR_PROTOCOL, "a blob piece decompresses to %zu bytes instead of %u", got,
                         piece->raw_bytes);
    return STATUS_OK;
}

status blob_piece_pack(const void *raw, size_t raw_bytes, struct buffer *scratch, ProtobufCBinaryData *packed,
                       protobuf_c_boolean *zstd, struct error *err)
{
    size_t bound = ZSTD_compressBound(raw_bytes), got;
    uint8_t *space;

    packed->data = (uint8_t *)raw;
    packed->len = raw_bytes;
    *zstd = 0;
    if (raw_bytes > BLOB_PIECE_BYTES)
        return error_set(err, STATUS_ERR_INTERNAL, "a blob piece of %zu bytes (at most %d)", raw_bytes,
                         BLOB_PIECE_BYTES);
    buffer_clear(scratch);
    space = buffer_append_space(scratch, bound);
    NEED(space, err, "compressing a blob");
    got = ZSTD_compress(space, bound, raw, raw_bytes, 1);
    if (!ZSTD_isError(got) && got + raw_bytes / 16 < raw_bytes) {
        packed->data = space;
        packed->len = got;
        *zstd = 1;
    }
    return STATUS_OK;
}
