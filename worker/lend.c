#include "worker/lend.h"

#include "common/base/buffer.h"
#include "common/system/log.h"
#include "protocol/message.h"

void lend_init(struct lend *lend, struct pool *pool, struct blob_cache *blobs)
{
    *lend = (struct lend){.pool = pool, .blobs = blobs};
}

static void end(struct lend *lend)
{
    if (lend->blob)
        cached_blob_release(lend->blob);
    lend->blob = NULL;
    lend->state = LEND_IDLE;
}

void lend_release(struct lend *lend) { end(lend); }

static void run(struct pool_task *task)
{
    struct lend *lend = (struct lend *)task;

    lend->error = (struct error){0};
    lend->error.code = blob_cache_get(lend->blobs, &lend->digest, &lend->blob, &lend->error);
}

static void refuse(uint64_t request, struct channel *channel, const struct error *why)
{
    if (channel)
        (void)!message_send_failure(channel, request, why); /* fails only when the connection does */
}

void lend_take(struct lend *lend, uint64_t request, const Azulejo__Wire__BlobGet *get, struct channel *channel)
{
    struct error err = {0};
    status s = STATUS_OK;

    if (lend->state == LEND_SENDING)
        end(lend); /* the coordinator wants one at a time: it has given that one up */
    if (lend->state != LEND_IDLE)
        s = error_set(&err, STATUS_ERR_LIMIT, "another blob is being sent");
    THEN(s, wire_digest_get(&lend->digest, &get->digest, "a blob", &err));
    if (s != STATUS_OK) {
        refuse(request, channel, &err);
        return;
    }
    lend->state = LEND_READING;
    lend->forgotten = 0;
    lend->request = request;
    lend->offset = 0;
    lend->task.run = run;
    pool_push(lend->pool, &lend->task, 1);
}

int lend_task_done(struct lend *lend, const struct pool_task *task, struct channel *channel)
{
    char hex[DIGEST_HEX_SIZE];

    if (task != &lend->task)
        return 0;
    if (lend->error.code != STATUS_OK || lend->forgotten || !channel) {
        if (!lend->forgotten)
            refuse(lend->request, channel, &lend->error);
        end(lend);
        return 1;
    }
    digest_to_hex(&lend->digest, hex);
    log_info("the coordinator has lost blob %.12s, and gets it from this cache", hex);
    lend->state = LEND_SENDING;
    lend_pump(lend, channel);
    return 1;
}

static status send_piece(const struct lend *lend, size_t size, struct channel *channel)
{
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    Azulejo__Wire__Envelope e = MESSAGE(BLOB_PUT, blob_put, &put);
    struct buffer scratch = BUFFER_INIT;
    status s = blob_piece_pack(cached_blob_data(lend->blob) + lend->offset, size, &scratch, &put.data, &put.zstd, NULL);

    wire_digest_set(&put.digest, &lend->digest);
    put.total_bytes = cached_blob_size(lend->blob);
    put.offset = lend->offset;
    put.raw_bytes = (uint32_t)size;
    e.request = lend->request;
    THEN(s, channel_send(channel, &e));
    buffer_release(&scratch);
    return s;
}

void lend_pump(struct lend *lend, struct channel *channel)
{
    while (lend->state == LEND_SENDING && !channel_is_full(channel)) {
        size_t size = blob_piece_size(cached_blob_size(lend->blob), lend->offset);

        if (send_piece(lend, size, channel) != STATUS_OK)
            return; /* no memory at present: the next tick tries again; or the connection is lost */
        lend->offset += size;
        if (lend->offset == cached_blob_size(lend->blob))
            end(lend);
    }
}

void lend_forget(struct lend *lend)
{
    lend->forgotten = 1;
    if (lend->state == LEND_SENDING || (lend->state == LEND_READING && pool_cancel(lend->pool, &lend->task)))
        end(lend);
}
