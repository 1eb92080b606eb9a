#include "client/farm/upload.h"

#include <string.h>

#include "client/terminal/must.h"
#include "common/base/memory.h"
#include "protocol/message.h"

enum {
    QUERY_DIGESTS_MAX = 4096, /* digests in one BlobQuery: 140 KiB */
    BLOBS_UNDER_WAY = 16,     /* sent but not yet acknowledged */
};

struct upload {
    struct connection *connection;
    const struct upload_item *items;
    size_t count;
    uint8_t *missing;                    /* [count]: 1 when the coordinator lacks it */
    uint64_t under_way[BLOBS_UNDER_WAY]; /* request numbers, oldest first */
    size_t under_way_count;
    struct buffer scratch; /* one compressed piece */
    upload_progress_fn report;
    void *user;
    struct upload_progress *progress;
};

static void mark_missing(struct upload *u, size_t begin, size_t end, const Azulejo__Wire__BlobMissing *answer)
{
    for (size_t m = 0; m < answer->n_digest; m++) {
        if (answer->digest[m].len != DIGEST_BYTES)
            continue;
        for (size_t i = begin; i < end; i++) {
            if (memcmp(u->items[i].digest.bytes, answer->digest[m].data, DIGEST_BYTES) != 0)
                continue;
            if (!u->missing[i])
                u->progress->missing_bytes += u->items[i].size_bytes;
            u->missing[i] = 1;
            break; /* the same blob twice in the list is sent once */
        }
    }
}

static status query_missing(struct upload *u, struct error *err)
{
    ProtobufCBinaryData digests[QUERY_DIGESTS_MAX];
    status result = STATUS_OK;

    for (size_t begin = 0; begin < u->count && result == STATUS_OK; begin += QUERY_DIGESTS_MAX) {
        Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
        Azulejo__Wire__BlobQuery query = AZULEJO__WIRE__BLOB_QUERY__INIT;
        Azulejo__Wire__Envelope *answer = NULL;
        size_t n = u->count - begin < QUERY_DIGESTS_MAX ? u->count - begin : QUERY_DIGESTS_MAX;

        for (size_t i = 0; i < n; i++)
            wire_digest_set(&digests[i], &u->items[begin + i].digest);
        query.n_digest = n;
        query.digest = digests;
        envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_BLOB_QUERY;
        envelope.blob_query = &query;
        result = connection_ask(u->connection, &envelope, AZULEJO__WIRE__ENVELOPE__BODY_BLOB_MISSING, &answer, err);
        if (result == STATUS_OK) {
            mark_missing(u, begin, begin + n, answer->blob_missing);
            message_free(answer);
        }
    }
    return result;
}

static status await_oldest(struct upload *u, struct error *err)
{
    Azulejo__Wire__Envelope *answer = NULL;
    status result = connection_receive(u->connection, u->under_way[0], &answer, err);

    if (result != STATUS_OK)
        return result;
    if (answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_BLOB_STORED)
        result = error_set(err, STATUS_ERR_PROTOCOL, "a blob was answered with message %d", (int)answer->body_case);
    message_free(answer);
    u->under_way_count--;
    memmove(u->under_way, u->under_way + 1, u->under_way_count * sizeof u->under_way[0]);
    return result;
}

static status send_piece(struct upload *u, const struct upload_item *item, uint64_t request, size_t offset, size_t size,
                         struct error *err)
{
    Azulejo__Wire__Envelope envelope = AZULEJO__WIRE__ENVELOPE__INIT;
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    status result;

    TRY(blob_piece_pack(item->data + offset, size, &u->scratch, &put.data, &put.zstd, err));

    wire_digest_set(&put.digest, &item->digest);
    put.total_bytes = item->size_bytes;
    put.offset = offset;
    put.raw_bytes = (uint32_t)size;
    envelope.request = request;
    envelope.body_case = AZULEJO__WIRE__ENVELOPE__BODY_BLOB_PUT;
    envelope.blob_put = &put;
    result = connection_send(u->connection, &envelope, err);
    u->progress->wire_bytes += put.data.len;
    u->progress->sent_bytes += size;
    if (result == STATUS_OK && u->report)
        u->report(u->progress, u->user);
    return result;
}

static status send_blob(struct upload *u, const struct upload_item *item, struct error *err)
{
    uint64_t request = connection_request_id(u->connection);
    size_t offset = 0;
    status result = STATUS_OK;

    if (u->under_way_count == BLOBS_UNDER_WAY)
        result = await_oldest(u, err);
    while (result == STATUS_OK) {
        size_t size = blob_piece_size(item->size_bytes, offset);

        result = send_piece(u, item, request, offset, size, err);
        offset += size;
        if (offset == item->size_bytes)
            break;
        /* Another client may have stored it meanwhile, or it was refused: stop early. */
        if (result == STATUS_OK && connection_pump(u->connection, request))
            break;
    }
    if (result == STATUS_OK)
        u->under_way[u->under_way_count++] = request;
    return result;
}

status upload_blobs(struct connection *c, const struct upload_item *items, size_t count, upload_progress_fn report,
                    void *user, struct upload_progress *progress, struct error *err)
{
    struct upload u = {.connection = c, .items = items, .count = count, .report = report,
                       .user = user, .progress = progress};
    status result;

    memset(progress, 0, sizeof *progress);
    u.missing = must(mem_calloc(count ? count : 1, 1));
    result = query_missing(&u, err);
    for (size_t i = 0; i < count && result == STATUS_OK; i++)
        if (u.missing[i])
            result = send_blob(&u, &items[i], err);
    while (u.under_way_count > 0 && result == STATUS_OK)
        result = await_oldest(&u, err);
    if (result != STATUS_OK)
        error_prefix(err, "sending files");
    buffer_release(&u.scratch);
    mem_free(u.missing);
    return result;
}
