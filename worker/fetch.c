#include "worker/fetch.h"

#include <string.h>

#include "common/system/log.h"
#include "common/base/memory.h"
#include "protocol/message.h"
#include "worker/cache/cache_writer.h"

struct fetch {
    struct fetch *chain; /* in its hash bucket */
    struct fetch *next;  /* in the queue */
    struct digest digest;
    uint64_t size_bytes; /* 0: not known */
    uint64_t limit_bytes;
    uint64_t request; /* 0: QUEUED */
    unsigned attempts;
    struct cache_writer *writer; /* since the first piece */
};

void fetcher_init(struct fetcher *f, struct blob_cache *cache)
{
    memset(f, 0, sizeof *f);
    f->cache = cache;
}

static struct fetch **bucket_of(struct fetcher *f, const struct digest *digest)
{
    return &f->buckets[((size_t)digest->bytes[0] << 8 | digest->bytes[1]) % FETCH_BUCKETS];
}

void fetcher_release(struct fetcher *f)
{
    for (size_t i = 0; i < FETCH_BUCKETS; i++) {
        while (f->buckets[i]) {
            struct fetch *fetch = f->buckets[i];
            f->buckets[i] = fetch->chain;
            cache_writer_abandon(fetch->writer);
            mem_free(fetch);
        }
    }
    fetcher_init(f, f->cache);
}

static void enqueue(struct fetcher *f, struct fetch *fetch)
{
    fetch->request = 0;
    fetch->next = NULL;
    if (f->last)
        f->last->next = fetch;
    else
        f->first = fetch;
    f->last = fetch;
}

status fetcher_want(struct fetcher *f, const struct scene_blob *blob, uint64_t limit_bytes, struct error *err)
{
    struct fetch **bucket = bucket_of(f, &blob->digest), *fetch = *bucket;

    while (fetch && !digest_equal(&fetch->digest, &blob->digest))
        fetch = fetch->chain;
    if (fetch)
        return STATUS_OK;
    fetch = mem_calloc(1, sizeof *fetch);
    NEED(fetch, err, "a blob to be fetched");
    fetch->digest = blob->digest;
    fetch->size_bytes = blob->size_bytes;
    fetch->limit_bytes = limit_bytes;
    fetch->chain = *bucket;
    *bucket = fetch;
    enqueue(f, fetch);
    return STATUS_OK;
}

static void forget(struct fetcher *f, struct fetch *fetch)
{
    struct fetch **at = bucket_of(f, &fetch->digest);

    while (*at != fetch)
        at = &(*at)->chain;
    *at = fetch->chain;
    cache_writer_abandon(fetch->writer);
    mem_free(fetch);
}

void fetcher_pump(struct fetcher *f, struct channel *channel)
{
    for (size_t i = 0; i < FETCHES_AT_ONCE && f->first; i++) {
        Azulejo__Wire__BlobGet get = AZULEJO__WIRE__BLOB_GET__INIT;
        Azulejo__Wire__Envelope e = MESSAGE(BLOB_GET, blob_get, &get);
        struct fetch *fetch = f->first;
        if (f->receiving[i])
            continue;
        wire_digest_set(&get.digest, &fetch->digest);
        e.request = f->last_request + 1;
        if (channel_send(channel, &e) != STATUS_OK)
            return;
        fetch->request = ++f->last_request;
        f->first = fetch->next;
        if (!f->first)
            f->last = NULL;
        f->receiving[i] = fetch;
    }
}

static struct fetch **receiving_find(struct fetcher *f, uint64_t request)
{
    for (size_t i = 0; i < FETCHES_AT_ONCE; i++)
        if (f->receiving[i] && f->receiving[i]->request == request)
            return &f->receiving[i];
    return NULL;
}

/* This attempt failed. Try again, unless that is pointless or it was tried often enough. */
static void attempt_failed(struct fetcher *f, struct fetch **place, const struct error *why, int hopeless)
{
    struct fetch *fetch = *place;
    struct error reason = *why;
    struct digest digest = fetch->digest;
    char hex[DIGEST_HEX_SIZE];

    *place = NULL;
    cache_writer_abandon(fetch->writer);
    fetch->writer = NULL;
    digest_to_hex(&digest, hex);
    error_prefix(&reason, "blob %.12s", hex);
    if (!hopeless && ++fetch->attempts < FETCH_ATTEMPTS_MAX) {
        log_warn("%s; fetching it again", reason.text);
        enqueue(f, fetch);
        return;
    }
    forget(f, fetch);
    f->failed(f->user, &digest, &reason);
}

/* Write one piece; returns the blob if it was the last. */
static status take_piece(struct fetcher *f, struct fetch *fetch, const struct blob_piece *piece,
                         struct cached_blob **done, struct error *err)
{
    uint8_t raw[BLOB_PIECE_BYTES];
    struct cache_writer *writer;
    status s = blob_piece_unpack(piece, raw, err);

    if (s == STATUS_OK && !fetch->writer)
        s = cache_writer_new(&fetch->writer, f->cache, &fetch->digest, piece->total_bytes, err);
    THEN(s, cache_writer_add(fetch->writer, raw, piece->raw_bytes, err));
    if (s != STATUS_OK || cache_writer_bytes(fetch->writer) < piece->total_bytes)
        return s;
    writer = fetch->writer;
    fetch->writer = NULL;
    return cache_writer_finish(writer, done, err);
}

status fetcher_data(struct fetcher *f, uint64_t request, const Azulejo__Wire__BlobData *data, struct error *err)
{
    struct fetch **place = receiving_find(f, request), *fetch;
    struct cached_blob *done = NULL;
    struct blob_piece piece;
    struct error why = {0};
    status s;

    TRY(blob_piece_of_data(&piece, data, err));
    if (!place) /* the rest of a blob that was dropped after a damaged piece */
        return request > 0 && request <= f->last_request
                   ? STATUS_OK
                   : error_set(err, STATUS_ERR_PROTOCOL, "a blob piece that was not requested");
    fetch = *place;
    if (!digest_equal(&piece.digest, &fetch->digest) ||
        piece.offset != (fetch->writer ? cache_writer_bytes(fetch->writer) : 0))
        return error_set(err, STATUS_ERR_PROTOCOL, "a blob piece out of order");
    if ((fetch->size_bytes && piece.total_bytes != fetch->size_bytes) || piece.total_bytes > fetch->limit_bytes) {
        (void)error_set(&why, STATUS_ERR_INPUT, "has %llu bytes (%llu were expected)",
                        (unsigned long long)piece.total_bytes,
                        (unsigned long long)(fetch->size_bytes ? fetch->size_bytes : fetch->limit_bytes));
        attempt_failed(f, place, &why, 1);
        return STATUS_OK;
    }
    f->bytes += piece.raw_bytes;
    s = take_piece(f, fetch, &piece, &done, &why);
    if (s != STATUS_OK) {
        attempt_failed(f, place, &why, 0);
    } else if (done) {
        *place = NULL;
        forget(f, fetch);
        f->arrived(f->user, done);
        cached_blob_release(done);
    }
    return STATUS_OK;
}

int fetcher_failure(struct fetcher *f, uint64_t request, const Azulejo__Wire__Failure *failure)
{
    struct fetch **place = request ? receiving_find(f, request) : NULL;
    struct error why = {0};
    status code;

    if (!place)
        return request > 0 && request <= f->last_request;
    code = message_failure_get(failure, &why);
    attempt_failed(f, place, &why, code == STATUS_ERR_NOT_FOUND || code == STATUS_ERR_REFUSED);
    return 1;
}

void fetcher_reset(struct fetcher *f)
{
    for (size_t i = 0; i < FETCHES_AT_ONCE; i++) {
        struct fetch *fetch = f->receiving[i];
        if (!fetch)
            continue;
        f->receiving[i] = NULL;
        cache_writer_abandon(fetch->writer);
        fetch->writer = NULL;
        enqueue(f, fetch);
    }
}
