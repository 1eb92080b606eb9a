#include "web/api/call.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/fields.h"
#include "protocol/json/json_wire.h"
#include "protocol/message.h"
#include "protocol/json/json_wire.h"
#include "web/base/link.h"
#include "web/base/problem.h"
#include "web/api/routes.h"
#include "web/web.h"

/* A connection to the farm that acts for a caller. */
struct calling {
    struct calling *next;
    struct web_calls *calls;
    struct link_peer *peer;
    enum web_call_kind kind;
    uint64_t token;
    struct waiting *first; /* its requests that wait */
    uint64_t used_ns;
    int retires; /* its token has ended: it takes no more requests, */
    int closing; /* and it is freed when the connection has ended */
    int paused;  /* its request's client, or the farm, takes no more for now */
};

/* A request that waits. Its state points here. */
struct waiting {
    struct waiting *next;
    struct calling *calling;
    uint64_t number; /* of the message */
    struct web_request *request;
    web_call_answer *on_answer;
    int answered; /* an answer came: a later failure cannot be said any more */
};

struct web_calls {
    struct link_peers *farm;
    struct calling *first;
    uint64_t last_number;
    uint32_t waiting;
};

/* ---- requests that wait -------------------------------------------------------------------------- */

static void waiting_drop(struct waiting *w)
{
    struct waiting **at = &w->calling->first;

    while (*at != w)
        at = &(*at)->next;
    *at = w->next;
    w->calling->calls->waiting--;
    mem_free(w);
}

static void calling_end(struct calling *calling)
{
    if (calling->closing)
        return;
    calling->closing = 1;
    link_close(calling->peer);
}

/* The request was answered, or is gone. */
static void waiting_end(struct waiting *w)
{
    struct calling *calling = w->calling;

    w->request->state = NULL;
    w->request->on_gone = NULL;
    w->request->on_writable = NULL;
    waiting_drop(w);
    if (calling->kind == WEB_CALL_STREAM)
        calling_end(calling);
}

void web_call_done(struct web_request *request) { waiting_end(request->state); }

static void on_gone(struct web_request *request) { waiting_end(request->state); }

static void on_writable(struct web_request *request)
{
    const struct waiting *w = request->state;

    if (w->calling->paused && web_queued(request) < WEB_QUEUE_HIGH) {
        w->calling->paused = 0;
        link_pause(w->calling->peer, 0);
    }
}

/* ---- what the farm says ----------------------------------------------------------------- */

static void answer_failure(struct waiting *w, const Azulejo__Wire__Failure *failure)
{
    struct web_request *request = w->request;
    int answered = w->answered;
    struct error why = {0};

    (void)!message_failure_get(failure, &why);
    waiting_end(w);
    if (answered)
        web_end(request); /* shorter than announced: the connection ends with it */
    else
        problem_answer(request, problem_of_farm(why.code), why.text);
}

static void on_message(void *user, const Azulejo__Wire__Envelope *message)
{
    struct calling *calling = user;
    struct waiting *w = calling->first;

    while (w && w->number != message->request)
        w = w->next;
    if (!w)
        return; /* a notice, or an answer to a client that is gone */
    if (message->body_case == AZULEJO__WIRE__ENVELOPE__BODY_FAILURE) {
        answer_failure(w, message->failure);
        return;
    }
    w->answered = 1;
    if (calling->kind == WEB_CALL_SHARED) {
        struct web_request *request = w->request;
        web_call_answer *take = w->on_answer;
        waiting_end(w); /* one question, one answer */
        take(request, message);
    } else {
        struct web_request *request = w->request;
        w->on_answer(request, message);
        /* A stream takes what its client takes. */
        if (!calling->closing && calling->first && web_queued(request) >= WEB_QUEUE_HIGH) {
            calling->paused = 1;
            link_pause(calling->peer, 1);
        }
    }
}

/* What is uploaded goes on. */
static void on_drain(void *user)
{
    const struct calling *calling = user;

    if (calling->kind == WEB_CALL_STREAM && calling->first)
        web_pause_body(calling->first->request, 0);
}

static void on_closed(void *user, const struct error *why)
{
    struct calling *calling = user, **at = &calling->calls->first;

    calling->closing = 1;
    while (calling->first) {
        struct waiting *w = calling->first;
        struct web_request *request = w->request;
        int answered = w->answered;
        waiting_end(w);
        if (answered)
            web_end(request);
        else
            problem_answer_lost(request, why);
    }
    while (*at != calling)
        at = &(*at)->next;
    *at = calling->next;
    mem_free(calling);
}

static const struct link_callbacks callbacks = {on_message, on_drain, on_closed};

/* ---- sessions --------------------------------------------------------------------------------------- */

/* NULL: *err. */
static struct calling *calling_new(struct web_calls *calls, const struct web_caller *caller, enum web_call_kind kind,
                                   struct error *err)
{
    struct calling *calling = mem_calloc(1, sizeof *calling);

    if (!calling) {
        (void)error_no_memory(err, "a session");
        return NULL;
    }
    calling->calls = calls;
    calling->kind = kind;
    calling->token = caller->token;
    if (link_open(&calling->peer, calls->farm, caller->token, &callbacks, calling, err) != STATUS_OK) {
        mem_free(calling);
        return NULL;
    }
    calling->next = calls->first;
    calls->first = calling;
    return calling;
}

static struct calling *calling_of(struct web_calls *calls, const struct web_caller *caller, enum web_call_kind kind,
                                  struct error *err)
{
    for (struct calling *c = calls->first; c && kind == WEB_CALL_SHARED; c = c->next)
        if (c->kind == WEB_CALL_SHARED && !c->retires && !c->closing && c->token == caller->token)
            return c;
    return calling_new(calls, caller, kind, err);
}

status web_calls_new(struct web_calls **out, struct link_peers *farm, struct error *err)
{
    *out = mem_calloc(1, sizeof **out);
    NEED(*out, err, "the API's calls");
    (*out)->farm = farm;
    return STATUS_OK;
}

void web_calls_tick(struct web_calls *calls, uint64_t now_ns)
{
    for (struct calling *c = calls->first; c; c = c->next)
        if (c->kind == WEB_CALL_SHARED && !c->first && now_ns > c->used_ns + CALL_IDLE_MS * NS_PER_MS)
            calling_end(c);
}

void web_calls_retire_token(struct web_calls *calls, uint64_t token)
{
    for (struct calling *c = calls->first; c; c = c->next)
        c->retires |= c->token == token;
}

void web_calls_end_retired(struct web_calls *calls)
{
    for (struct calling *c = calls->first; c; c = c->next)
        if (c->retires && !c->closing) {
            c->closing = 1;
            link_abort(c->peer, STATUS_ERR_REFUSED, "the token was revoked");
        }
}

void web_calls_free(struct web_calls *calls) { mem_free(calls); /* the loop has ended: so have all sessions */ }

/* ---- sending ----------------------------------------------------------------------------------------- */

/* A body that is passed on waits while the farm takes no more. */
static void pause_if_full(struct web_request *request)
{
    const struct waiting *w = request->state;

    if (request->on_body && link_is_full(w->calling->peer))
        web_pause_body(request, 1);
}

status web_call_send(struct web_request *request, Azulejo__Wire__Envelope *message, enum web_call_kind kind,
                     web_call_answer *on_answer, struct error *err)
{
    struct web_calls *calls = request->web->calls;
    struct calling *calling;
    struct waiting *w;
    status s;

    if (calls->waiting >= CALL_WAITING_MAX)
        return error_set(err, STATUS_ERR_LIMIT, "%d requests wait already; try again in a moment", CALL_WAITING_MAX);
    calling = calling_of(calls, &request->caller, kind, err);
    if (!calling)
        return err ? err->code : STATUS_ERR_NO_MEMORY;
    w = mem_calloc(1, sizeof *w);
    if (!w) {
        if (kind == WEB_CALL_STREAM)
            calling_end(calling);
        return error_no_memory(err, "a request");
    }
    w->calling = calling;
    w->request = request;
    w->on_answer = on_answer;
    w->number = message->request = ++calls->last_number;
    w->next = calling->first;
    calling->first = w;
    calling->used_ns = clock_monotonic_ns();
    calls->waiting++;
    request->state = w;
    request->on_gone = on_gone;
    request->on_writable = kind == WEB_CALL_STREAM ? on_writable : NULL;
    s = link_send(calling->peer, message, err);
    if (s != STATUS_OK)
        waiting_end(w);
    else
        pause_if_full(request);
    return s;
}

void web_call_more(struct web_request *request, Azulejo__Wire__Envelope *message)
{
    const struct waiting *w = request->state;
    struct error err = {0};

    if (!w)
        return;
    message->request = w->number;
    if (link_send(w->calling->peer, message, &err) != STATUS_OK)
        link_abort(w->calling->peer, err.code, err.text);
    else
        pause_if_full(request);
}

/* ---- messages by the table ---------------------------------------------------------------------------- */

/* The next of words separated by spaces, of at most 63 bytes; NULL: there are no more. */
static const char *next_word(const char *words, char out[64])
{
    size_t length;

    words += strspn(words, " ");
    length = strcspn(words, " ");
    if (length == 0)
        return NULL;
    snprintf(out, 64, "%.*s", (int)length, words);
    return words + length;
}

/* What stands in the path: {job} is the field `job`. */
static status take_path(const struct web_request *request, ProtobufCMessage *body, struct error *err)
{
    const char *at = request->route->path;
    status s = STATUS_OK;

    for (int i = 0; s == STATUS_OK && i < WEB_PARAMETERS_MAX && request->parameters[i]; i++) {
        char name[64];
        at = strchr(at, '{') + 1;
        snprintf(name, sizeof name, "%.*s", (int)strcspn(at, "}"), at);
        if (message_is_set(body, name))
            return error_set(err, STATUS_ERR_INPUT, "%s: stands in the path already", name);
        /* Without a number a message asks for all jobs, which the path of one job does not mean. */
        if (strcmp(name, "job") == 0 && strspn(request->parameters[i], "0") == strlen(request->parameters[i]))
            return error_set(err, STATUS_ERR_NOT_FOUND, "there is no job 0: 'azulejo list' prints their numbers");
        s = json_wire_set(body, name, request->parameters[i], err);
    }
    return s;
}

/* "verb=drain": what follows from the path alone. */
static status take_fixed(const struct web_request *request, ProtobufCMessage *body, struct error *err)
{
    const char *at = request->route->fixed;
    char word[64];
    status s = STATUS_OK;

    while (s == STATUS_OK && at && (at = next_word(at, word))) {
        char *value = strchr(word, '=');
        *value++ = 0;
        if (message_is_set(body, word))
            return error_set(err, STATUS_ERR_INPUT, "%s: follows from the path", word);
        s = json_wire_set(body, word, value, err);
    }
    return s;
}

static status take_query(const struct web_request *request, ProtobufCMessage *body, struct error *err)
{
    const char *at = request->route->run ? NULL : request->route->query; /* a handler reads it by itself */
    char word[64];
    status s = STATUS_OK;

    while (s == STATUS_OK && at && (at = next_word(at, word))) {
        const char *value = web_query(request, word);
        if (value)
            s = json_wire_set(body, word, value, err);
    }
    return s;
}

status web_call_message(const struct web_request *request, Azulejo__Wire__Envelope *envelope, ProtobufCMessage **body,
                        struct error *err)
{
    const ProtobufCFieldDescriptor *field = protobuf_c_message_descriptor_get_field(
        &azulejo__wire__envelope__descriptor, (unsigned)request->route->message);
    int has_body = request->method != WEB_GET && request->method != WEB_DELETE;
    status s;

    *body = NULL;
    if (!has_body && request->body.size > 0)
        return error_set(err, STATUS_ERR_INPUT, "this request takes no body");
    s = json_wire_get(body, field->descriptor, (const char *)request->body.data, request->body.size, err);
    THEN(s, take_path(request, *body, err));
    THEN(s, take_fixed(request, *body, err));
    THEN(s, take_query(request, *body, err));
    if (s != STATUS_OK) {
        json_wire_free(*body);
        *body = NULL;
        return s;
    }
    azulejo__wire__envelope__init(envelope);
    envelope->body_case = (Azulejo__Wire__Envelope__BodyCase)request->route->message;
    memcpy((char *)envelope + field->offset, body, sizeof *body);
    return STATUS_OK;
}

/* What was asked for is done, but the disk does not have it yet. */
static int is_not_stored(const struct web_request *request, const ProtobufCMessage *message)
{
    const Azulejo__Wire__JobList *list = (const Azulejo__Wire__JobList *)message;
    int found = 0;

    if (request->method == WEB_GET || message->descriptor != &azulejo__wire__job_list__descriptor)
        return 0;
    for (size_t i = 0; i < list->n_jobs; i++)
        found |= list->jobs[i]->not_stored;
    return found;
}

void web_answer_message(struct web_request *request, const ProtobufCMessage *message)
{
    const unsigned code = is_not_stored(request, message) ? 202 : 200;
    struct buffer text = BUFFER_INIT;

    json_wire_put(&text, message);
    buffer_puts(&text, "\n");
    if (buffer_ok(&text))
        web_answer(request, code, "application/json", NULL, text.data, text.size);
    else
        problem_answer(request, PROBLEM_UNAVAILABLE, "out of memory for the answer");
    buffer_release(&text);
}

static void answer_json(struct web_request *request, const Azulejo__Wire__Envelope *answer)
{
    const ProtobufCMessage *body = message_body(answer);

    if (body && (int)answer->body_case == request->route->answer)
        web_answer_message(request, body);
    else
        problem_answer(request, PROBLEM_INTERNAL, "the farm gave another answer than expected");
}

void web_call_go(struct web_request *request, Azulejo__Wire__Envelope *envelope)
{
    struct error err = {0};

    if (web_call_send(request, envelope, WEB_CALL_SHARED, answer_json, &err) != STATUS_OK)
        problem_answer(request, problem_of_request(err.code, 1), err.text);
}

void web_call(struct web_request *request)
{
    Azulejo__Wire__Envelope envelope;
    struct error err = {0};
    ProtobufCMessage *body;

    if (web_call_message(request, &envelope, &body, &err) != STATUS_OK) {
        problem_answer(request, problem_of_request(err.code, 1), err.text);
        return;
    }
    web_call_go(request, &envelope);
    json_wire_free(body);
}
