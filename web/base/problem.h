/* problem: how what went wrong is answered over HTTP: application/problem+json (RFC 9457).
 *
 *   {"type": "/docs/errors#not-found", "title": "There is no such thing", "status": 404, "code": "not-found",
 *    "detail": "there is no job 12", "instance": "/api/v1/jobs/12"}
 *
 * `code` and `type` are for programs and do not change; `detail` is the error's sentence with its remedy.
 */
#pragma once

#include "web/api/request.h"

#define PROBLEM_CONTENT_TYPE "application/problem+json"

/* code, HTTP status, title, meaning and remedy. */
#define PROBLEM_MAP(X)                                                                                               \
    X(INPUT, "input", 400, "The request cannot be read",                                                             \
      "The path, the query, a header or the JSON is not well-formed, or has a field that is not known. The detail "  \
      "names the place.")                                                                                            \
    X(NO_TOKEN, "no-token", 401, "A token is needed",                                                                \
      "Send a valid token: 'Authorization: Bearer TOKEN'. 'azulejo token create' makes one.")                        \
    X(FORBIDDEN, "forbidden", 403, "The token does not allow this",                                                  \
      "The token's role is too small, or the job is somebody else's. Use a token of the role that the detail names.") \
    X(NOT_FOUND, "not-found", 404, "There is no such thing",                                                         \
      "The path, or what it names, does not exist, not yet, or no longer.")                                          \
    X(METHOD, "method", 405, "The path has no such method", "The header Allow names those that it has.")             \
    X(STATE, "state", 409, "The present state does not allow this",                                                  \
      "The request is fine, but the job, the worker or the store is not in a state for it. The detail says what "    \
      "would make it possible.")                                                                                     \
    X(LENGTH, "length", 411, "A body needs its length", "Send the header Content-Length; chunks are not taken.")      \
    X(TOO_LARGE, "too-large", 413, "The request is too large", "The detail names the limit.")                        \
    X(WRONG_HOST, "wrong-host", 421, "This is not the host that was asked for",                                      \
      "The header Host must name this coordinator: by its address, or as --web-name says.")                          \
    X(VALUE, "value", 422, "A value is not allowed",                                                                 \
      "The JSON is well-formed, but the farm does not take a value of it. The detail names it and its range.")       \
    X(UPGRADE, "upgrade", 426, "This is a WebSocket", "Ask for the upgrade to a WebSocket.")                          \
    X(LIMIT, "limit", 429, "Too much at once", "Try again in a moment, or with less.")                               \
    X(INTERNAL, "internal", 500, "The coordinator failed", "The coordinator's log says more. Please report it.")     \
    X(UNSUPPORTED, "unsupported", 501, "This is not supported", "This coordinator cannot do it at all.")             \
    X(UNAVAILABLE, "unavailable", 503, "The coordinator cannot do this now",                                         \
      "Its disk, its memory or a worker is in the way. Try again later.")                                            \
    X(TIMEOUT, "timeout", 504, "It took too long", "Try again later.")

enum problem {
#define PROBLEM_ENUM(name, code, http, title, meaning) PROBLEM_##name,
    PROBLEM_MAP(PROBLEM_ENUM)
#undef PROBLEM_ENUM
        PROBLEM_COUNT
};

struct problem_kind {
    const char *code;
    unsigned http_status;
    const char *title, *meaning;
};
extern const struct problem_kind problem_kinds[PROBLEM_COUNT];

/* Of an error about the request itself, before anybody was asked. */
enum problem problem_of_request(status code, int has_token);
/* Of an error with which the farm answered: what it refuses, it refuses because of a state. */
enum problem problem_of_farm(status code);

/* By the HTTP status; INTERNAL: none has it. */
enum problem problem_of_http(unsigned http_status);

void problem_put(struct buffer *out, enum problem problem, const char *detail, const char *instance);
/* problem_answer.c: answer the request with it. */
void problem_answer(struct web_request *request, enum problem problem, const char *detail);
/* The connection to the farm that it waits for has ended. */
void problem_answer_lost(struct web_request *request, const struct error *why);

/* GET /docs/errors: the list of codes, as text. */
void problem_list(struct web_request *request);
