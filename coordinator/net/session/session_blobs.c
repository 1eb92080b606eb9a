/* Blobs: which are missing, and taking and sending them. */
#include "common/system/clock.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/session/session_messages.h"
#include "coordinator/net/session/session_tasks.h"
#include "protocol/message.h"

int session_blob_hold(struct session *session, const struct digest *digest, uint64_t *size_bytes)
{
    if (session->role == FARM_ROLE_WORKER) /* what workers ask for is some job's */
        return blobs_find(store_folder(session->server->store), digest, size_bytes);
    if (!session->blobs_since_ns)
        session->blobs_since_ns = blobs_now();
    return blobs_hold(store_folder(session->server->store), digest, session->blobs_since_ns, size_bytes);
}

status session_blob_query(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                          struct error *err)
{
    const Azulejo__Wire__BlobQuery *query = message->blob_query;
    struct digest *digests;
    status s = STATUS_OK;

    if (query->n_digest > MESSAGE_DIGESTS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "at most %d blobs in one question", MESSAGE_DIGESTS_MAX);
    digests = mem_alloc_array(query->n_digest, sizeof *digests);
    if (!digests)
        return error_no_memory(err, "a list of blobs");
    for (size_t i = 0; s == STATUS_OK && i < query->n_digest; i++)
        s = wire_digest_get(&digests[i], &query->digest[i], "a blob", err);
    if (s != STATUS_OK) {
        mem_free(digests);
        return s;
    }
    if (!session->blobs_since_ns)
        session->blobs_since_ns = blobs_now();
    session_task_vouch(session, message->request, digests, query->n_digest);
    return STATUS_OK;
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

static status add_piece(struct session *session, struct upload **slot, const struct blob_piece *piece, uint64_t request,
                        struct error *err)
{
    static uint8_t bytes[BLOB_PIECE_BYTES];
    struct upload *upload = *slot;
    status s;

    if (piece->offset != upload_size(upload) || piece->total_bytes != upload_total(upload))
        return error_set(err, STATUS_ERR_PROTOCOL, "the pieces of a blob must come in order");
    s = blob_piece_unpack(piece, bytes, err);
    THEN(s, upload_add(upload, bytes, piece->raw_bytes, err));
    if (s != STATUS_OK || upload_size(upload) < upload_total(upload))
        return s;
    *slot = NULL;
    session_task_upload(session, request, upload);
    return STATUS_OK;
}

static status begin_upload(struct session *session, const struct blob_piece *piece, struct upload ***slot,
                           struct error *err)
{
    status s;

    *slot = upload_slot(session, NULL);
    if (!*slot || session->storing >= SESSION_STORING_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "too many blobs at once: at most %d may be incomplete; finish some first",
                         SESSION_UPLOADS_MAX);
    s = farm_store_usable(&session->server->farm, err);
    THEN(s, holders_blob_begin(&session->server->holders, session->holder, session->may,
                               store_folder(session->server->store), &piece->digest, piece->total_bytes,
                               clock_monotonic_ns(), err));
    return s == STATUS_OK
               ? upload_begin(*slot, store_folder(session->server->store), &piece->digest, piece->total_bytes, err)
               : s;
}

status session_blob_put(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns, struct error *err)
{
    struct blob_piece piece;
    struct upload **slot = NULL;
    uint64_t size;
    status s;

    if (session->worker)
        return recalls_put(session, message, now_ns, err);
    s = blob_piece_of_put(&piece, message->blob_put, err);
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
    THEN(s, add_piece(session, slot, &piece, message->request, err));
    if (s == STATUS_OK)
        return STATUS_OK;
    if (slot) {
        upload_free(*slot);
        *slot = NULL;
    }
    log_warn("session %u (%s): a blob was not taken: %s", session->id, session->host, err->text);
    return s;
}

/* Is the blob of this scene? *size: how long it is, 0: not known. A scene that is missing is asked back from workers. */
static status scene_has(struct session *session, const struct digest *scene, const struct digest *blob, int *has,
                        uint64_t *size, struct error *err)
{
    struct server *server = session->server;
    status s = scene_lists_has(&server->scene_lists, store_folder(server->store), scene, blob, has, size, err);

    if (s == STATUS_ERR_NOT_FOUND)
        recalls_want(server, scene, SCENE_BYTES_MAX);
    return s;
}

/* A worker reads what its leases and requests need. */
static status may_read(struct session *session, const struct digest *blob, uint64_t *size, struct error *err)
{
    const struct scenes_shown *shown = session->scenes;
    const struct digest *last = NULL;
    char hex[DIGEST_HEX_SIZE];
    int has = 0;

    *size = 0;
    if (!session->worker)
        return STATUS_OK;
    for (uint32_t i = 0; shown && !has && i < shown->count; i++) { /* the newest first */
        uint32_t at = (shown->next + SCENES_SHOWN_MAX - 1 - i) % SCENES_SHOWN_MAX;
        status s = scene_lists_has(&session->server->scene_lists, store_folder(session->server->store),
                                   &shown->scenes[at], blob, &has, size, err);
        if (s != STATUS_OK && s != STATUS_ERR_NOT_FOUND) /* a scene of no job that is left may be gone */
            return s;
    }
    for (const struct lease *l = session->worker->held.newest; l && !has; l = l->holder_older) {
        if (last && digest_equal(last, &l->frame->job->scene))
            continue;
        last = &l->frame->job->scene;
        TRY(scene_has(session, last, blob, &has, size, err));
    }
    if (has)
        return STATUS_OK;
    digest_to_hex(blob, hex);
    return error_set(err, STATUS_ERR_REFUSED, "no lease of this worker needs the blob %.12s", hex);
}

/* Is it there, with the length that is needed (0: any)? A worker would blame its job for another one. */
static status look_for(struct session *session, const struct digest *digest, uint64_t needed, struct error *err)
{
    char hex[DIGEST_HEX_SIZE];
    uint64_t size;
    int found = blobs_find(store_folder(session->server->store), digest, &size);

    if (found < 0 || (found == 1 && (needed == 0 || size == needed)))
        return STATUS_OK; /* what cannot be read at present is waited for */
    digest_to_hex(digest, hex);
    if (found == 1) {
        recalls_doubt(session->server, digest, needed);
        return error_set(err, STATUS_ERR_NOT_FOUND, "the coordinator's blob %.12s has another length than its scene says: it is "
                         "looked at, and asked of the workers if it is damaged", hex);
    }
    if (session->worker)
        recalls_want(session->server, digest, needed ? needed : SCENE_BYTES_MAX);
    return error_set(err, STATUS_ERR_NOT_FOUND,
                     "the coordinator has no blob %.12s: it asks the workers for it; if none has it, submit the scene again", hex);
}

status session_blob_get(struct session *session, const Azulejo__Wire__Envelope *message, uint64_t now_ns UNUSED,
                        struct error *err)
{
    const char *folder = store_folder(session->server->store);
    struct digest digest;
    uint64_t needed = 0;
    status s = wire_digest_get(&digest, &message->blob_get->digest, "a blob", err);

    THEN(s, may_read(session, &digest, &needed, err));
    THEN(s, look_for(session, &digest, needed, err));
    THEN(s, transfer_blob(&session->transfers, message->request, folder, &digest, err));
    transfers_pump(&session->transfers, session->channel);
    return s;
}
