#include "web/api/api_blobs.h"

#include <inttypes.h>
#include <stdlib.h>

#include "common/base/digest.h"
#include "common/base/memory.h"
#include "protocol/message.h"
#include "web/api/call.h"
#include "web/base/problem.h"

/* One body, its request's own. */
struct arriving {
    struct digest digest;
    uint64_t total, sent;
    int looked, ended;  /* the farm has said whether it needs it; the body is whole */
    int is_there;       /* it does not, and the body is thrown away */
    struct buffer held; /* what came before it had said so: a body that is paused may still bring what was read */
};

static uint32_t arriving_count;

static void arriving_free(void *own)
{
    buffer_release(&((struct arriving *)own)->held);
    mem_free(own);
    arriving_count--;
}

static void answer_stored(struct web_request *request)
{
    const struct arriving *a = request->own;
    struct buffer text = BUFFER_INIT;
    char hex[DIGEST_HEX_SIZE];

    digest_to_hex(&a->digest, hex);
    buffer_printf(&text, "{\"digest\":\"%s\",\"bytes\":%" PRIu64 "}\n", hex, a->total);
    web_answer(request, 200, "application/json", NULL, text.data, text.size);
    buffer_release(&text);
}

/* ---- the body --------------------------------------------------------------------------------------- */

static void on_stored(struct web_request *request, const Azulejo__Wire__Envelope *answer)
{
    web_call_done(request);
    if (answer->body_case == AZULEJO__WIRE__ENVELOPE__BODY_BLOB_STORED)
        answer_stored(request);
    else
        problem_answer(request, PROBLEM_INTERNAL, "the farm gave another answer than expected");
}

/* The first piece begins a stream to the farm, the others follow in it. 0: it was not sent, and that is answered. */
static int send_piece(struct web_request *request, const uint8_t *data, size_t size)
{
    Azulejo__Wire__BlobPut put = AZULEJO__WIRE__BLOB_PUT__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_PUT, blob_put, &put);
    struct arriving *a = request->own;
    struct error err = {0};
    int is_first = a->sent == 0;

    wire_digest_set(&put.digest, &a->digest);
    put.total_bytes = a->total;
    put.offset = a->sent;
    put.data = (ProtobufCBinaryData){size, (uint8_t *)data};
    put.raw_bytes = (uint32_t)size;
    a->sent += size;
    if (!is_first) {
        web_call_more(request, &envelope);
    } else if (web_call_send(request, &envelope, WEB_CALL_STREAM, on_stored, &err) != STATUS_OK) {
        problem_answer(request, problem_of_request(err.code, 1), err.text);
        return 0;
    }
    return 1;
}

static void on_body(struct web_request *request, const uint8_t *data, size_t size)
{
    struct arriving *a = request->own;

    a->ended = size == 0;
    if (!a->looked)
        buffer_append(&a->held, data, size);
    else if (!a->is_there && size > 0)
        (void)send_piece(request, data, size);
    else if (a->is_there && size == 0)
        answer_stored(request);
}

static void send_held(struct web_request *request)
{
    struct arriving *a = request->own;
    struct buffer held = a->held;
    size_t at = 0, left;
    int more = held.size > 0 || a->total == 0; /* an empty blob is one empty piece */

    buffer_init(&a->held);
    while (more) {
        left = held.size - at;
        if (left > BLOB_PIECE_BYTES)
            left = BLOB_PIECE_BYTES;
        more = send_piece(request, held.data + at, left); /* else the request is gone */
        at += left;
        more = more && at < held.size;
    }
    buffer_release(&held);
}

/* ---- the request ------------------------------------------------------------------------------------- */

/* The caller's session has looked for the blob: what is stored from now on stays until a job needs it. */
static void on_looked(struct web_request *request, const Azulejo__Wire__Envelope *answer)
{
    struct arriving *a = request->own;

    if (answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_BLOB_MISSING) {
        problem_answer(request, PROBLEM_INTERNAL, "the farm gave another answer than expected");
        return;
    }
    if (!buffer_ok(&a->held)) {
        problem_answer(request, PROBLEM_UNAVAILABLE, "out of memory for a blob");
        return;
    }
    a->looked = 1;
    a->is_there = answer->blob_missing->n_digest == 0;
    web_pause_body(request, 0);
    if (a->is_there && a->ended)
        answer_stored(request);
    else if (!a->is_there)
        send_held(request);
}

static void ask(struct web_request *request, const struct digest *digest)
{
    Azulejo__Wire__BlobQuery query = AZULEJO__WIRE__BLOB_QUERY__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_QUERY, blob_query, &query);
    ProtobufCBinaryData bytes;
    struct error err = {0};

    wire_digest_set(&bytes, digest);
    query.n_digest = 1;
    query.digest = &bytes;
    if (web_call_send(request, &envelope, WEB_CALL_SHARED, on_looked, &err) != STATUS_OK)
        problem_answer(request, problem_of_request(err.code, 1), err.text);
}

void api_blob_put(struct web_request *request)
{
    const char *length = web_header(request, "content-length");
    struct error err = {0};
    struct arriving *a;
    struct digest digest;

    if (digest_from_hex(&digest, request->parameters[0]) != STATUS_OK) {
        problem_answer(request, PROBLEM_INPUT, "digest: must be the SHA-256 of the body, 64 hexadecimal digits");
        return;
    }
    if (arriving_count >= API_UPLOADS_MAX) {
        error_set(&err, STATUS_ERR_LIMIT, "%d blobs arrive already; try again in a moment", API_UPLOADS_MAX);
        problem_answer(request, problem_of_request(err.code, 1), err.text);
        return;
    }
    if (length && strtoull(length, NULL, 10) > BLOB_BYTES_MAX) {
        error_set(&err, STATUS_ERR_LIMIT, "a blob has at most %llu bytes", BLOB_BYTES_MAX);
        problem_answer(request, PROBLEM_TOO_LARGE, err.text);
        return;
    }
    a = mem_calloc(1, sizeof *a);
    if (!a) {
        problem_answer(request, PROBLEM_UNAVAILABLE, "out of memory for a blob");
        return;
    }
    a->digest = digest;
    a->total = length ? strtoull(length, NULL, 10) : 0;
    buffer_init(&a->held);
    arriving_count++;
    request->own = a;
    request->own_free = arriving_free;
    request->on_body = on_body;
    if (a->total > 0)
        web_pause_body(request, 1); /* until the farm has said whether it needs the blob */
    ask(request, &digest);
}
