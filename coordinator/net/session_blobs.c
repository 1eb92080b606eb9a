/* Blobs: which are missing, and taking and sending them. */
#include "common/base/log.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session_messages.h"
#include "coordinator/net/session_tasks.h"
#include "protocol/message.h"

int session_blob_hold(struct session *session, const struct digest *digest, uint64_t *size_bytes)
{
    if (session->role == FARM_ROLE_WORKER) /* what workers ask for is some job's */
        return blobs_find(store_folder(session->server->store), digest, size_bytes);
    if (!session->blobs_since_ns)
        session->blobs_since_ns = blobs_now();
    return blobs_hold(store_folder(session->server->store), digest, session->blobs_since_ns,
                      size_bytes);
}

status session_blob_query(struct session *session, const Azulejo__Wire__Envelope *message,
                          uint64_t now_ns, struct error *err)
{
    const Azulejo__Wire__BlobQuery *query = message->blob_query;
    Azulejo__Wire__BlobMissing missing = AZULEJO__WIRE__BLOB_MISSING__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_MISSING, blob_missing, &missing);
    status s = STATUS_OK;

    (void)now_ns;
    if (query->n_digest > MESSAGE_DIGESTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "at most %d blobs in one question",
                         MESSAGE_DIGESTS_MAX);
    missing.digest = mem_alloc_array(query->n_digest, sizeof *missing.digest);
    if (!missing.digest)
        return error_no_memory(err, "a list of blobs");
    for (size_t i = 0; s == STATUS_OK && i < query->n_digest; i++) {
        struct digest digest;
        uint64_t size;
        s = wire_digest_get(&digest, &query->digest[i], "a blob", err);
        if (s == STATUS_OK && !session_blob_hold(session, &digest, &size))
            missing.digest[missing.n_digest++] = query->digest[i];
    }
    if (s == STATUS_OK)
        session_reply(session, message->request, &envelope);
    mem_free(missing.digest);
    return s;
}

static struct upload **upload_slot(struct session *session, const struct digest *digest)
{
    for (uint32_t i = 0; i < SESSION_UPLOADS_MAX; i++) {
        struct upload *upload = session->uploads[i];
        if (digest ? upload && digest_equal(upload_digest(upload), digest) : !upload)
            return &session->uploads[i];
    }
    return NULL;
}

static status add_piece(struct session *session, struct upload **slot,
                        const struct blob_piece *piece, uint64_t request, struct error *err)
{
    static uint8_t bytes[BLOB_PIECE_BYTES];
    struct upload *upload = *slot;
    status s;

    if (piece->offset != upload_size(upload) || piece->total_bytes != upload_total(upload))
        return error_set(err, STATUS_ERR_PROTOCOL, "the pieces of a blob must come in order");
    s = blob_piece_unpack(piece, bytes, err);
    if (s == STATUS_OK)
        s = upload_add(upload, bytes, piece->raw_bytes, err);
    if (s != STATUS_OK || upload_size(upload) < upload_total(upload))
        return s;
    *slot = NULL;
    session_task_upload(session, request, upload);
    return STATUS_OK;
}

static status begin_upload(struct session *session, const struct blob_piece *piece,
                           struct upload ***slot, struct error *err)
{
    status s;

    *slot = upload_slot(session, NULL);
    if (!*slot || session->storing >= SESSION_STORING_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "too many blobs at once: at most %d may be incomplete; finish some first",
                         SESSION_UPLOADS_MAX);
    s = farm_store_usable(&session->server->farm, err);
    return s == STATUS_OK ? upload_begin(*slot, store_folder(session->server->store),
                                         &piece->digest, piece->total_bytes, err)
                          : s;
}

status session_blob_put(struct session *session, const Azulejo__Wire__Envelope *message,
                        uint64_t now_ns, struct error *err)
{
    struct blob_piece piece;
    struct upload **slot = NULL;
    uint64_t size;
    status s = blob_piece_of_put(&piece, message->blob_put, err);

    (void)now_ns;
    if (s == STATUS_OK) {
        slot = upload_slot(session, &piece.digest);
        /* A later piece of a blob that exists already, or failed: the first piece was answered. */
        if (!slot && piece.offset > 0)
            return STATUS_OK;
        if (!slot && session_blob_hold(session, &piece.digest, &size) == 1) {
            session_stored(session, message->request, &piece.digest);
            return STATUS_OK;
        }
        if (!slot)
            s = begin_upload(session, &piece, &slot, err);
    }
    if (s == STATUS_OK)
        s = add_piece(session, slot, &piece, message->request, err);
    if (s == STATUS_OK)
        return STATUS_OK;
    if (slot) {
        upload_free(*slot);
        *slot = NULL;
    }
    log_warn("session %u (%s): a blob was not taken: %s", session->id, session->host, err->text);
    return s;
}

status session_blob_get(struct session *session, const Azulejo__Wire__Envelope *message,
                        uint64_t now_ns, struct error *err)
{
    const char *folder = store_folder(session->server->store);
    struct buffer path = BUFFER_INIT;
    struct digest digest;
    uint64_t size;
    status s = wire_digest_get(&digest, &message->blob_get->digest, "a blob", err);

    (void)now_ns;
    if (s == STATUS_OK && blobs_find(folder, &digest, &size) == 0) {
        char hex[DIGEST_HEX_SIZE];
        digest_to_hex(&digest, hex);
        s = error_set(err, STATUS_ERR_NOT_FOUND, "the coordinator has no blob %s", hex);
    }
    if (s == STATUS_OK) {
        blobs_path(folder, &digest, &path);
        s = buffer_ok(&path) ? transfer_file(&session->transfers, message->request, &digest,
                                             buffer_text(&path), err)
                             : error_no_memory(err, "a path");
    }
    buffer_release(&path);
    transfers_pump(&session->transfers, session->channel);
    return s;
}
