/* call: a request of the API as a message to the farm, and the farm's answers as the request's.
 *
 *   request --message--> a connection (link.h) --answers--> the request is answered
 *
 * The coordinator has sessions for them as for all clients: so verbs, states, errors, owners and the audit log are
 * the same. Each token has one connection, which is kept while the token is used: blobs that it named stay until a
 * job needs them. A file has a connection of its own, so that a client that reads slowly holds up no other.
 *
 * All on the loop's thread. A request whose client vanishes is forgotten; what it asked for still happens.
 */
#pragma once

#include "protocol/azulejo.pb-c.h"
#include "web/api/request.h"

struct link_peers;
struct web_calls;

enum {
    CALL_IDLE_MS = 600000,        /* a token's session ends so long after its last request */
    CALL_WAITING_MAX = 1024,      /* requests that wait for the farm's answer */
};

status web_calls_new(struct web_calls **out, struct link_peers *farm, struct error *err) MUST_CHECK;
/* Ends sessions that are not used. */
void web_calls_tick(struct web_calls *calls, uint64_t now_ns);
/* The token has ended: what was asked for with it takes no more requests, and ends. */
void web_calls_retire_token(struct web_calls *calls, uint64_t token);
void web_calls_end_retired(struct web_calls *calls);
/* After the loop has ended; NULL is fine. */
void web_calls_free(struct web_calls *calls);

/* The farm's answer, or of a stream one of several: the request is answered with it. */
typedef void web_call_answer(struct web_request *request, const Azulejo__Wire__Envelope *answer);

enum web_call_kind {
    WEB_CALL_SHARED,              /* the token's session */
    WEB_CALL_STREAM,              /* one of its own, which sends no more than the request's client takes */
};

/* Send the message on behalf of the request's caller. The request's state and callbacks are the call's from now
 * on. A Failure is answered as a problem, unless something was answered already. ERR_LIMIT, ERR_NO_MEMORY, ERR_IO: nothing was sent and nothing answered. */
status web_call_send(struct web_request *request, Azulejo__Wire__Envelope *message, enum web_call_kind kind,
                     web_call_answer *on_answer, struct error *err) MUST_CHECK;

/* One more message of a stream, with the first one's number. Nothing happens once it was answered. */
void web_call_more(struct web_request *request, Azulejo__Wire__Envelope *message);

/* For a stream's on_answer: no more answers are expected. Before the web_end or web_answer, which frees the request. */
void web_call_done(struct web_request *request);

/* The handler of a route that has a message: the body, the path and the query fill it; the answer's body is
 * answered as JSON. */
void web_call(struct web_request *request);

/* The same in parts. The message's body, to be freed with json_wire_free; *envelope points at it. */
status web_call_message(const struct web_request *request, Azulejo__Wire__Envelope *envelope, ProtobufCMessage **body,
                        struct error *err) MUST_CHECK;
/* Send it, and answer with the answer's body. */
void web_call_go(struct web_request *request, Azulejo__Wire__Envelope *envelope);
/* Answer with a message as JSON. */
void web_answer_message(struct web_request *request, const ProtobufCMessage *message);
