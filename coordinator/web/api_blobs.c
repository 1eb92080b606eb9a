#include "coordinator/web/api_blobs.h"

#include <inttypes.h>
#include <stdlib.h>

#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "coordinator/net/task.h"
#include "coordinator/store/blobs.h"
#include "coordinator/web/call.h"
#include "coordinator/web/problem.h"
#include "coordinator/web/web.h"
#include "protocol/message.h"

/* One body. The request's state until its answer; then the task's. */
struct arriving {
    struct server *server;
    struct web_request *request;  /* NULL: the client is gone */
    struct upload *upload;        /* NULL: the blob is there, and the body is thrown away */
    struct digest digest;
    uint64_t total;
};

static uint32_t arriving_count;

static void arriving_free(struct arriving *a)
{
    upload_free(a->upload);
    mem_free(a);
    arriving_count--;
}

/* The request is answered next. */
static struct web_request *arriving_detach(struct arriving *a)
{
    struct web_request *request = a->request;

    if (request) {
        request->state = NULL;
        request->on_body = NULL;
        request->on_gone = NULL;
    }
    a->request = NULL;
    return request;
}

static void answer_stored(struct web_request *request, const struct digest *digest, uint64_t bytes)
{
    struct buffer text = BUFFER_INIT;
    char hex[DIGEST_HEX_SIZE];

    digest_to_hex(digest, hex);
    buffer_printf(&text, "{\"digest\":\"%s\",\"bytes\":%" PRIu64 "}\n", hex, bytes);
    web_answer(request, 200, "application/json", NULL, text.data, text.size);
    buffer_release(&text);
}

/* ---- to the disk ----------------------------------------------------------------------------------- */

struct storing {
    struct task task;
    struct arriving *arriving;
};

static void storing_run(struct task *task)
{
    task->result = upload_finish(((struct storing *)task)->arriving->upload, &task->error);
}

static void storing_end(struct task *task)
{
    struct arriving *a = ((struct storing *)task)->arriving;
    struct web_request *request = arriving_detach(a);

    if (request && task->result == STATUS_OK)
        answer_stored(request, &a->digest, a->total);
    else if (request)
        problem_answer(request, problem_of_farm(task->result), task->error.text);
}

static void storing_release(struct task *task)
{
    arriving_free(((struct storing *)task)->arriving);
}

static const struct task_kind storing_kind = {"an upload", sizeof(struct storing), storing_run, storing_end,
                                              storing_release};

/* ---- the body --------------------------------------------------------------------------------------- */

static void on_gone(struct web_request *request)
{
    struct arriving *a = request->state;

    arriving_detach(a);
    arriving_free(a);
}

static void on_gone_storing(struct web_request *request)
{
    arriving_detach(request->state); /* the task frees it */
}

static void fail(struct arriving *a, enum problem problem, const char *text)
{
    struct web_request *request = arriving_detach(a);

    arriving_free(a);
    problem_answer(request, problem, text);
}

static void on_end(struct arriving *a)
{
    struct error err = {0};
    struct storing *s;
    struct web_request *request;

    if (!a->upload) {
        struct digest digest = a->digest;
        uint64_t total = a->total;
        request = arriving_detach(a);
        arriving_free(a);
        answer_stored(request, &digest, total);
        return;
    }
    s = task_new(a->server, &storing_kind, &err);
    if (!s) {
        fail(a, PROBLEM_UNAVAILABLE, err.text);
        return;
    }
    a->request->on_body = NULL;
    a->request->on_gone = on_gone_storing;
    s->arriving = a;
    task_start(&s->task);
}

static void on_body(struct web_request *request, const uint8_t *data, size_t size)
{
    struct arriving *a = request->state;
    struct error err = {0};

    if (size == 0)
        on_end(a);
    else if (a->upload && upload_add(a->upload, data, size, &err) != STATUS_OK)
        fail(a, problem_of_farm(err.code), err.text);
}

/* ---- the request ------------------------------------------------------------------------------------- */

static status begin(struct web_request *request, const struct digest *digest, uint64_t total, int is_there,
                    struct error *err)
{
    struct server *server = request->web->server;
    struct arriving *a;
    status s = STATUS_OK;

    if (arriving_count >= API_UPLOADS_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d blobs arrive already; try again in a moment", API_UPLOADS_MAX);
    a = mem_calloc(1, sizeof *a);
    if (!a)
        return error_no_memory(err, "a blob");
    arriving_count++;
    a->server = server;
    a->digest = *digest;
    a->total = total;
    if (!is_there)
        s = farm_store_usable(&server->farm, err);
    if (s == STATUS_OK && !is_there)
        s = upload_begin(&a->upload, store_folder(server->store), digest, total, err);
    if (s != STATUS_OK) {
        arriving_free(a);
        return s;
    }
    a->request = request;
    request->state = a;
    request->on_body = on_body;
    request->on_gone = on_gone;
    return STATUS_OK;
}

static uint64_t announced(const struct web_request *request)
{
    const char *text = web_header(request, "content-length");

    return text ? strtoull(text, NULL, 10) : 0;
}

/* The caller's session has looked for the blob: what it stores from now on stays until a job needs it. */
static void on_looked(struct web_request *request, const Azulejo__Wire__Envelope *answer)
{
    struct error err = {0};
    struct digest digest;

    if (answer->body_case != AZULEJO__WIRE__ENVELOPE__BODY_BLOB_MISSING ||
        digest_from_hex(&digest, request->parameters[0]) != STATUS_OK) {
        problem_answer(request, PROBLEM_INTERNAL, "the farm gave another answer than expected");
        return;
    }
    if (begin(request, &digest, announced(request), answer->blob_missing->n_digest == 0, &err) != STATUS_OK)
        problem_answer(request, problem_of_farm(err.code), err.text);
}

void api_blob_put(struct web_request *request)
{
    Azulejo__Wire__BlobQuery query = AZULEJO__WIRE__BLOB_QUERY__INIT;
    Azulejo__Wire__Envelope envelope = MESSAGE(BLOB_QUERY, blob_query, &query);
    ProtobufCBinaryData bytes;
    struct error err = {0};
    struct digest digest;

    if (digest_from_hex(&digest, request->parameters[0]) != STATUS_OK) {
        problem_answer(request, PROBLEM_INPUT, "digest: must be the SHA-256 of the body, 64 hexadecimal digits");
        return;
    }
    wire_digest_set(&bytes, &digest);
    query.n_digest = 1;
    query.digest = &bytes;
    if (web_call_send(request, &envelope, WEB_CALL_SHARED, on_looked, &err) != STATUS_OK)
        problem_answer(request, problem_of_request(err.code, 1), err.text);
}
