#include "coordinator/net/base/transfer.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/system/trash.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/store/files/reserve.h"
#include "protocol/message.h"

struct transfer {
    struct transfer *next;
    uint64_t request;
    int is_blob, has_digest;
    struct digest digest;
    char *path;                 /* of the file, or the name to send with bytes */
    int fd;                     /* -1: not open yet */
    struct preview_file *bytes; /* when there is no file */
    int from_file;
    const char *store; /* a blob's */
    int is_damaged;
    int waited; /* waits for the store; logged already */
    uint64_t total, offset;
    struct digest_stream *stream;  /* of a blob's bytes so far */
    struct transfer_preview shows; /* of a preview; otherwise zeros */
};

static void transfer_free(struct transfer *t)
{
    if (t->fd >= 0)
        trash_close_file(t->fd); /* its job may be removed */
    preview_file_drop(t->bytes);
    digest_stream_free(t->stream);
    mem_free(t->path);
    mem_free(t);
}

void transfers_release(struct transfers *transfers)
{
    while (transfers->first) {
        struct transfer *next = transfers->first->next;
        transfer_free(transfers->first);
        transfers->first = next;
    }
    memset(transfers, 0, sizeof *transfers);
}

static status transfer_add(struct transfers *transfers, uint64_t request, const char *path, struct transfer **out,
                           struct error *err)
{
    struct transfer *t = NULL;

    if (transfers->count >= TRANSFERS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d files are being sent already", TRANSFERS_MAX);
    t = mem_calloc(1, sizeof *t);
    if (t)
        t->path = mem_strdup(path);
    if (!t || !t->path) {
        mem_free(t);
        return error_no_memory(err, "a transfer");
    }
    t->fd = -1;
    t->request = request;
    *(transfers->last ? &transfers->last->next : &transfers->first) = t;
    transfers->last = t;
    transfers->count++;
    *out = t;
    return STATUS_OK;
}

status transfer_file(struct transfers *transfers, uint64_t request, const char *path, struct error *err)
{
    struct transfer *t = NULL;

    TRY(transfer_add(transfers, request, path, &t, err));
    t->from_file = 1;
    return STATUS_OK;
}

status transfer_blob(struct transfers *transfers, uint64_t request, const char *store, const struct digest *digest,
                     struct error *err)
{
    struct buffer path = BUFFER_INIT;
    status s;

    blobs_path(store, digest, &path);
    s = buffer_ok(&path) ? transfer_file(transfers, request, buffer_text(&path), err) : error_no_memory(err, "a path");
    if (s == STATUS_OK) {
        transfers->last->is_blob = 1;
        transfers->last->store = store;
        transfers->last->digest = *digest;
    }
    buffer_release(&path);
    return s;
}

status transfer_output(struct transfers *transfers, uint64_t request, const struct digest *digest, const char *path,
                       struct error *err)
{
    status s = transfer_file(transfers, request, path, err);

    if (s == STATUS_OK) {
        transfers->last->digest = *digest;
        transfers->last->has_digest = 1;
    }
    return s;
}

status transfer_file_preview(struct transfers *transfers, uint64_t request, const char *path,
                             const struct transfer_preview *shows, struct error *err)
{
    status s = transfer_file(transfers, request, path, err);

    if (s == STATUS_OK)
        transfers->last->shows = *shows;
    return s;
}

status transfer_bytes(struct transfers *transfers, uint64_t request, struct preview_file *file, const char *file_name,
                      const struct transfer_preview *shows, struct error *err)
{
    struct transfer *t = NULL;

    TRY(transfer_add(transfers, request, file_name, &t, err));
    t->bytes = preview_file_hold(file);
    t->total = file->bytes.size;
    t->shows = *shows;
    return STATUS_OK;
}

static status open_file(struct transfer *t, struct error *err)
{
    struct stat info;

    if (!t->from_file || t->fd >= 0)
        return STATUS_OK;
    t->fd = open(t->path, O_RDONLY | O_CLOEXEC);
    if (t->fd >= 0 && fstat(t->fd, &info) == 0 && reserve_allows(t->fd)) {
        t->total = (uint64_t)info.st_size;
        return STATUS_OK;
    }
    if (t->fd >= 0) {
        close(t->fd);
        t->fd = -1;
        errno = EMFILE;
    }
    return error_set(err, errno == ENOENT ? STATUS_ERR_NOT_FOUND : STATUS_ERR_IO, "the coordinator cannot read %s: %s",
                     t->path, strerror(errno));
}

/* The next piece's bytes: in `scratch`, or in the transfer's own memory. */
static status next_piece(struct transfer *t, uint8_t *scratch, const uint8_t **data, uint32_t *size, struct error *err)
{
    uint32_t got = 0;

    *size = blob_piece_size(t->total, t->offset);
    *data = scratch;
    if (!t->from_file) {
        *data = t->bytes->bytes.data + t->offset;
        return STATUS_OK;
    }
    while (got < *size) {
        ssize_t n = pread(t->fd, scratch + got, *size - got, (off_t)(t->offset + got));
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return error_set(err, STATUS_ERR_IO, "the coordinator cannot read %s: %s", t->path,
                             n < 0 ? strerror(errno) : "it became shorter");
        got += (uint32_t)n;
    }
    return STATUS_OK;
}

static status send_blob_piece(struct transfer *t, struct channel *channel, const uint8_t *data, uint32_t size,
                              struct error *err)
{
    Azulejo__Wire__BlobData piece = AZULEJO__WIRE__BLOB_DATA__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_DATA, blob_data, &piece);
    struct buffer packed = BUFFER_INIT;
    status s;

    wire_digest_set(&piece.digest, &t->digest);
    piece.total_bytes = t->total;
    piece.offset = t->offset;
    piece.raw_bytes = size;
    s = blob_piece_pack(data, size, &packed, &piece.data, &piece.zstd, err);
    envelope.request = t->request;
    THEN(s, channel_send(channel, &envelope));
    buffer_release(&packed);
    return s;
}

/* The last piece of a damaged blob is never sent: a worker would blame its job for it. */
static status check_blob(struct transfer *t, const uint8_t *data, uint32_t size, struct error *err)
{
    struct digest found;
    char hex[DIGEST_HEX_SIZE];
    status s;

    if (!t->stream && !(t->stream = digest_stream_new()))
        return error_no_memory(err, "a blob's digest");
    if (digest_stream_add(t->stream, data, size) != STATUS_OK)
        return error_no_memory(err, "a blob's digest");
    if (t->offset + size < t->total)
        return STATUS_OK;
    s = digest_stream_final(t->stream, &found);
    t->stream = NULL;
    if (s != STATUS_OK)
        return error_no_memory(err, "a blob's digest");
    if (digest_equal(&found, &t->digest))
        return STATUS_OK;
    digest_to_hex(&t->digest, hex);
    t->is_damaged = 1;
    return error_set(err, STATUS_ERR_NOT_FOUND,
                     "blob %.12s was damaged on the coordinator's disk and is removed: it asks the workers for it; if none has it, "
                     "submit the scene again",
                     hex);
}

static status send_output_piece(struct transfer *t, struct channel *channel, const uint8_t *data, uint32_t size)
{
    Azulejo__Wire__OutputData piece = AZULEJO__WIRE__OUTPUT_DATA__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(OUTPUT_DATA, output_data, &piece);

    piece.total_bytes = t->total;
    piece.offset = t->offset;
    piece.data.data = (uint8_t *)data;
    piece.data.len = size;
    piece.file_name = (char *)file_basename(t->path);
    if (t->has_digest)
        wire_digest_set(&piece.digest, &t->digest);
    piece.preview_covered = t->shows.covered;
    piece.preview_samples = t->shows.samples;
    envelope.request = t->request;
    return channel_send(channel, &envelope);
}

/* Send one piece; *done when it was the last one or the transfer failed. A worker would blame its job for a blob that
 * cannot be read: such a transfer waits for the store instead, and *waits is set. */
static void send_piece(struct transfer *t, struct channel *channel, int *done, int *waits)
{
    static uint8_t scratch[BLOB_PIECE_BYTES];
    const uint8_t *data = NULL;
    struct error err = {0};
    uint32_t size = 0;
    status s = open_file(t, &err);

    THEN(s, next_piece(t, scratch, &data, &size, &err));
    if (s == STATUS_OK && t->is_blob)
        s = check_blob(t, data, size, &err);
    THEN(s, t->is_blob ? send_blob_piece(t, channel, data, size, &err) : send_output_piece(t, channel, data, size));
    *waits = t->is_blob && err.code == STATUS_ERR_IO;
    if (*waits) {
        if (!t->waited)
            log_warn("%s; it is sent when it can be read", err.text);
        t->waited = 1;
        *done = 0;
        return;
    }
    t->offset += size;
    *done = s != STATUS_OK || t->offset == t->total;
    if (s != STATUS_OK && err.code != STATUS_OK && message_send_failure(channel, t->request, &err) != STATUS_OK)
        *done = 1; /* the channel is closing; its owner is notified by on_close */
}

void transfers_pump(struct transfers *transfers, struct channel *channel)
{
    while (transfers->first && !channel_is_full(channel)) {
        struct transfer *t = transfers->first;
        int done, waits;

        send_piece(t, channel, &done, &waits);
        if (waits)
            return;
        if (!done)
            continue;
        if (t->is_damaged)
            blobs_drop_damaged(t->store, &t->digest);
        transfers->first = t->next;
        if (!transfers->first)
            transfers->last = NULL;
        transfers->count--;
        transfer_free(t);
    }
}
